"""One cell of a comparison's grid: an event under a rule and a controller, and the row that it yields."""

import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import xarray as xr

from alloc.metrics import evaluate
from alloc.onboard.host import TrainControllerFactory
from alloc.simulation import simulate
from studies.core.code_version import code_hash
from studies.core.controllers import host_factories
from studies.core.study_error import StudyError
from studies.scenario.scenario import Scenario

Measure = Callable[[xr.Dataset], dict[str, float]]
"""What a study reads from a recorded run beside the metrics: column -> number. A function of a module, since it travels to
other processes; its module counts among the sources of `studies.core.code_version`."""

KEY = ("scenario", "scenario_hash", "rule", "controller", "seed", "code_hash")
"""Columns that identify a row."""


class Key(NamedTuple):
    """Identity of a row."""

    scenario: str
    scenario_hash: str
    rule: str
    controller: str
    seed: int
    code_hash: str

    @property
    def label(self) -> str:
        """Name for people and files: scenario/rule/controller/seed."""
        return f"{self.scenario}/{self.rule}/{self.controller}/{self.seed}"


@dataclass(frozen=True)
class Job:
    """What to run."""

    scenario: Scenario
    rule: str
    controller: str
    seed: int

    @property
    def key(self) -> Key:
        """Identity of the row that the job yields under the present code."""
        return Key(
            self.scenario.name,
            self.scenario.hash(),
            self.rule,
            self.controller,
            self.seed,
            code_hash(),
        )


class Outcome(NamedTuple):
    """Identity, row of the table (column: value) and, where it was to be kept, the recorded run."""

    key: Key
    row: dict[str, Any]
    run: xr.Dataset | None


def run_job(
    job: Job, keep: bool = False, code: str | None = None, measure: Measure | None = None
) -> Outcome:
    """Run a job. Whatever goes wrong in it becomes a row with status "failed" and the reason.

    `measure`: gives further columns of the row.
    `code`: hash of the code that the caller runs. A worker that was started after the sources changed has loaded
    others; its result would pass for one of the caller's code, so it refuses.
    """
    started = time.perf_counter()
    key = job.key if code is None else job.key._replace(code_hash=code)
    row: dict[str, Any] = key._asdict()
    run = None
    try:
        if key.code_hash != code_hash():
            raise StudyError("the sources changed while the study ran; run it again")
        run = simulate_job(job, host_factories(job.controller))
        row |= {"status": "ok", "reason": "", "messages": str(run.attrs["messages"])}
        row |= {"duration": float(run["time"].values[-1] - run["time"].values[0])}
        row |= evaluate(run)
        row |= {} if measure is None else measure(run)
    except Exception as error:  # a study of a hundred runs goes on without this one
        where = traceback.extract_tb(error.__traceback__)[-1]
        reason = " ".join(str(error).split()) or "no message"
        row |= {
            "status": "failed",
            "reason": f"{type(error).__name__} at {where.name}: {reason}",
            "messages": "{}",
        }
    row["wall_time"] = time.perf_counter() - started
    return Outcome(key, row, run if keep else None)


def simulate_job(job: Job, factories: Mapping[str, TrainControllerFactory]) -> xr.Dataset:
    """The recorded run of a job; errors are raised."""
    run = simulate(job.scenario.event(job.seed), job.rule, job.controller, factories)
    return run.assign_attrs(scenario=job.scenario.name, scenario_hash=job.scenario.hash())
