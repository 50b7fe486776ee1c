"""The grid scenario x rule x controller x seed of a comparison."""

from dataclasses import dataclass

from alloc.display import displayed
from studies.core.job import Job
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario


@displayed
@dataclass(frozen=True)
class Grid:
    """What a comparison consists of: the product of its parts over `seeds`, and slow controllers on the first of them."""

    scenarios: tuple[Scenario, ...]
    rules: tuple[str, ...]
    controllers: tuple[str, ...]
    seeds: tuple[int, ...]
    once: tuple[str, ...] = ()
    """Controllers that meet every scenario under every rule too, but on the first seed alone."""
    fixed: frozenset[str] = frozenset()
    """Scenarios that meet the first seed alone, for every other would be the same event."""

    def jobs(self) -> list[Job]:
        """Every cell once: by scenario, then rule, controller, seed."""
        jobs = [
            Job(scenario, rule, controller, seed)
            for scenario in dict.fromkeys(self.scenarios)
            for rule in self.rules
            for controller in dict.fromkeys((*self.controllers, *self.once))
            for seed in self._seeds(scenario.name, controller)
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

    def _seeds(self, scenario: str, controller: str) -> tuple[int, ...]:
        """Seeds that this scenario meets under this controller."""
        alone = scenario in self.fixed or controller not in self.controllers
        return self.seeds[:1] if alone else self.seeds
