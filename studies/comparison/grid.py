"""The grid scenario x rule x controller x seed of a comparison."""

from dataclasses import dataclass

from studies.core.job import Job
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario


@dataclass(frozen=True)
class Grid:
    """What a comparison consists of: the product of its parts over `seeds`, plus `extra` cells."""

    scenarios: tuple[Scenario, ...]
    rules: tuple[str, ...]
    controllers: tuple[str, ...]
    seeds: tuple[int, ...]
    extra: tuple[tuple[Scenario, str, str], ...] = ()
    """Cells (scenario, rule, controller) beyond the product, over the same seeds."""
    fixed: frozenset[str] = frozenset()
    """Scenarios that meet the first seed alone, for every other would be the same event."""

    def jobs(self) -> list[Job]:
        """Every cell once: by scenario, then rule, controller, seed."""
        cells = [
            (scenario, rule, controller)
            for scenario in self.scenarios
            for rule in self.rules
            for controller in self.controllers
        ]
        jobs = [
            Job(scenario, rule, controller, seed)
            for scenario, rule, controller in dict.fromkeys([*cells, *self.extra])
            for seed in (self.seeds[:1] if scenario.name in self.fixed else self.seeds)
        ]
        names = {job.scenario.name: job.scenario for job in jobs}
        for job in jobs:
            if names[job.scenario.name] != job.scenario:
                raise StudyError(
                    f"two different scenarios are named {job.scenario.name!r}; rename one of the files"
                )
        order = {name: k for k, name in enumerate(names)}
        rules = {rule: k for k, rule in enumerate(dict.fromkeys(job.rule for job in jobs))}
        return sorted(jobs, key=lambda job: (order[job.scenario.name], rules[job.rule]))
