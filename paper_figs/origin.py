"""Where the data of a figure come from: the command that gives them in full, the seeds, and whether these are all."""

from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd

from studies.comparison.defaults import DEFAULT_SEEDS, default_rules
from studies.core.arms import COMPARED
from studies.core.gallery import Asked
from studies.core.job import Job
from studies.core.study import Study
from studies.scenario.loading import SCENARIOS, default_scenarios, load_scenario


@dataclass(frozen=True)
class Origin:
    """Where data come from."""

    command: str
    """The command that gives them in full."""
    shown: str
    """What is drawn, in words: events or runs."""
    seeds: tuple[int, ...]
    draft: bool = False
    """Whether the command gives more events than are drawn."""

    @property
    def words(self) -> str:
        """What is drawn, from which seeds, and where it comes from."""
        shown = self.shown
        if self.seeds:
            seeds = "seed" if len(self.seeds) == 1 else "seeds"
            shown += f", {seeds} {', '.join(map(str, self.seeds))}"
        return f"{shown}; `{self.command}`"


def of_study(study: Study, events: int | None) -> Origin:
    """Origin of the first so many events of a study; None where a few stand in for them."""
    whole = study.default_events
    shown = f"{'a few' if events is None else events} of {max(whole, events or 0)} events"
    return Origin(f"readhesion sweep {study.name}", shown, (0,), events is None or events < whole)


def of_job(job: Job, command: str = "") -> Origin:
    """Origin of a recorded run, made by `command`; without one the scenario is told by its name."""
    name = job.scenario.name
    words = f"{name} --rule {job.rule} --controller {job.controller} --seed {job.seed}"
    return Origin(command or f"readhesion simulate {words}", f"one run of {name}", (job.seed,))


def of_comparison(table: pd.DataFrame, asked: Asked | None = None) -> Origin:
    """Origin of the rows of a comparison; a draft where events that draw something have fewer seeds than by default.

    Unless it is known how they were `asked` for, a command is told that names the same parts.
    """
    seeds = tuple(sorted({int(seed) for seed in table["seed"]}))
    scenarios = list(dict.fromkeys(table["scenario"]))
    if asked is None:
        drawing = any(name not in SCENARIOS or load_scenario(name).draws() for name in scenarios)
        asked = Asked(_command_of(table, scenarios), not drawing or len(seeds) >= DEFAULT_SEEDS)
    fewer = not asked.whole
    events = f"{len(scenarios)} event{'s' * (len(scenarios) != 1)}"
    shown = f"{events} of up to {len(seeds)} seeds" if len(seeds) > 1 else f"{events} of 1 seed"
    if fewer:
        shown = f"{events}, {len(seeds)} of {DEFAULT_SEEDS} seeds each"
    return Origin(asked.command, shown, seeds, fewer)


def _command_of(table: pd.DataFrame, scenarios: Sequence[str]) -> str:
    """The comparison of these parts over all seeds; parts that are those of the default are left out."""
    words = ["readhesion compare"]
    if set(scenarios) != {one.name for one in default_scenarios()}:
        words += ["--scenario", *scenarios]
    rules, controllers = (list(dict.fromkeys(table[part])) for part in ("rule", "controller"))
    if set(rules) != set(default_rules()):
        words += ["--rules", *rules]
    if set(controllers) != {*COMPARED, "mpc"}:
        words += ["--controllers", *controllers]
    return " ".join(words)
