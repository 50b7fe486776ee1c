"""The cell of most studies: a slip event under a rule and a readhesion controller."""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import xarray as xr

from alloc.display import displayed
from alloc.metrics import METRICS, evaluate
from alloc.rules import RULES
from alloc.simulation import CONTROLLERS, Event, simulate
from studies.core.cell import Shared, Yield
from studies.core.controllers import is_hosted
from studies.core.run_status import run_status
from studies.scenario.scenario import Scenario

Measure = Callable[[xr.Dataset], dict[str, float]]
"""Function of a module that computes numbers from a recorded run beside the metrics: column -> number."""


@displayed
@dataclass(frozen=True)
class Job:
    """An event under a rule and a controller; its row has every metric, and what `measure` adds."""

    scenario: Scenario
    rule: str
    controller: str
    seed: int
    measure: Measure | None = None

    @property
    def label(self) -> str:
        """Scenario/rule/controller/seed."""
        return f"{self.scenario.name}/{self.rule}/{self.controller}/{self.seed}"

    @property
    def identity(self) -> Mapping[str, Any]:
        """Columns that identify a row, apart from the code."""
        return {
            "scenario": self.scenario.name,
            "scenario_hash": self.scenario.hash(),
            "rule": self.rule,
            "controller": self.controller,
            "seed": self.seed,
        }

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules of the simulation, of the measure, and of the run's parts, wherever they come from."""
        measures = () if self.measure is None else (self.measure.__module__,)
        parts = (RULES.origin(self.rule), CONTROLLERS.origin(self.controller))
        metrics = {METRICS.origin(name) for name in METRICS}
        return (__name__, *parts, *self.scenario.sources, *sorted(metrics), *measures)

    @property
    def programs(self) -> tuple[str, ...]:
        """The loop, in which rules and controllers are compiled, and the compiled code of parts that live in Python."""
        parts = {RULES.origin(self.rule), CONTROLLERS.origin(self.controller)}
        return ("alloc.loop", *sorted(parts))

    @property
    def group(self) -> Hashable:
        """Its event, the same for all rules; None under a controller in Python, whose long runs gain nothing from it."""
        return None if is_hosted(self.controller) else (self.scenario.hash(), self.seed)

    def work(self, shared: Shared) -> Yield:
        """Simulate and evaluate."""
        if "event" not in shared:
            shared["event"] = self.scenario.event(self.seed)
        run = _run(self, shared["event"])
        row = dict(self.identity) | {"messages": str(run.attrs["messages"])}
        row |= {"duration": float(run["time"].values[-1] - run["time"].values[0])}
        row |= evaluate(run)
        row |= {} if self.measure is None else self.measure(run)
        return Yield([row | run_status(run)], run)


def simulate_job(job: Job) -> xr.Dataset:
    """The recorded run of a job; errors are raised."""
    return _run(job, job.scenario.event(job.seed))


def _run(job: Job, event: Event) -> xr.Dataset:
    run = simulate(event, job.rule, job.controller)
    return run.assign_attrs(scenario=job.scenario.name, scenario_hash=job.scenario.hash())
