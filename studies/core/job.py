"""The cell of most studies: a slip event under a rule and a readhesion controller."""

import json
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import Any

import xarray as xr

from alloc.display import displayed
from alloc.errors import OnboardError
from alloc.metrics import METRICS, evaluate
from alloc.onboard.host import HostedController
from alloc.recording import attributes_of
from alloc.rules import RULES
from alloc.simulation import CONTROLLERS, Event, simulate
from studies.core.cell import Shared, Yield
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario

# Whether a recorded run is one of the rule and the controller that it is named after.

MOST_FAILURES = 0.05
"""Share of its calls, or of its steps over all units, in which a rule or a controller may fail in a run that counts.

Assumed: where it fails the exact level or cut-and-ramp answers for it, and beyond one in twenty the run is also theirs."""

DEGRADED = "degraded"
"""Status of a row whose run counts for neither: its numbers are kept, and enter no mean and no statement."""


def run_status(run: xr.Dataset) -> dict[str, Any]:
    """Status columns of a row: none while failures are few, else status and reason with the share that failed."""
    told = attributes_of(run)
    messages = json.loads(told["messages"])
    for part, calls, count, failed in (
        ("rule", "calls", told["rule_calls"], told["rule_failures"]),
        ("controller", "steps", told["controller_calls"], told["controller_failures"]),
    ):
        if failed > MOST_FAILURES * count:
            mine = {text: n for text, n in messages.items() if text.startswith(f"{part}: ")}
            reason = (
                f"the {part} failed in {failed / count:.1%} of {count} {calls}, {MOST_FAILURES:.0%} are allowed; "
                f"most often: {max(mine, key=mine.__getitem__).removeprefix(f'{part}: ')}"
            )
            return {"status": DEGRADED, "reason": reason}
    return {}


# What a study asks of readhesion controllers: whether they can be had, and whether they live in Python.


def check_controller(name: str) -> None:
    """Raise `StudyError` where there is no controller of this name, or it needs what is not installed."""
    try:
        CONTROLLERS.find(name)
    except OnboardError as error:
        raise StudyError(str(error)) from None
    except (ImportError, AttributeError) as error:
        raise StudyError(
            f"controller {name!r} needs something that is not installed ({error}); "
            "run `make setup`, or leave it out with --controllers"
        ) from None


def is_hosted(name: str) -> bool:
    """Whether a controller runs in Python, which is slow."""
    return isinstance(CONTROLLERS.get(name), HostedController)


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
        return (__name__, *parts, *self.scenario.sources, *sorted(METRICS.origins()), *measures)

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
    run.attrs |= {"scenario": job.scenario.name, "scenario_hash": job.scenario.hash()}
    return run
