"""The ladder of readhesion controllers, from none to MPC: all of them meet the same random events with the same noise."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from studies.core.job import Job
from studies.core.runner import run_jobs
from studies.core.statement import Statement
from studies.core.store import Store
from studies.core.stored_events import stored_events
from studies.ladder.events import DURATION, draw, event_name, scenario
from studies.ladder.measures import measure
from studies.ladder.statements import HOSTED_RUNG, LADDER, ladder_statements

DESCRIPTION = (
    "readhesion controllers from none to MPC: adhesion used, search time, fluctuation, slip, damage"
)
DEFAULT_EVENTS = 30
BLOCK = 6
"""Events in which every train meets every curve once. The MPC, whose runs take as long as ten of the others, meets every
second block."""
RULE = "alone"
"""No unit hears of another: what a run yields is its readhesion controller's doing."""


def run(
    folder: Path,
    events: int,
    seed: int,
    jobs: int,
    on_row: Callable[[str, int, int], None] | None = None,
    duration: float = DURATION,
) -> pd.DataFrame:
    """One row per event and controller: metrics, measures (`studies.ladder.measures`) and what was drawn.

    Rows that the store in `folder` holds are not run again. `duration` [s] shortens the events.
    """
    cells = [
        Job(one, RULE, controller, k)
        for k in range(events)
        for one in (scenario(seed, k, duration),)
        for controller in controllers_of(k)
    ]
    table = run_jobs(cells, Store(folder), jobs, on_row=on_row, measure=measure)
    drawn = pd.DataFrame(
        [{"scenario": event_name(seed, k), **draw(seed, k)} for k in range(events)]
    )
    return table.merge(drawn, on="scenario", how="left")


def controllers_of(k: int) -> tuple[str, ...]:
    """Controllers that meet event `k`."""
    return LADDER if k // BLOCK % 2 == 0 else tuple(c for c in LADDER if c != HOSTED_RUNG)


def stored(folder: Path, seed: int = 0) -> int:
    """Number of events, counted from the first, that a folder holds in full under the present code."""
    return stored_events(
        folder,
        lambda key: (key.scenario, key.controller),
        lambda k: {(event_name(seed, k), controller) for controller in controllers_of(k)},
    )


def statements(table: pd.DataFrame) -> list[Statement]:
    """Yardsticks, rungs and weaknesses, from the events in which no controller failed."""
    return ladder_statements(complete(table))


def complete(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the events in which all controllers that met them succeeded: only those can be paired."""
    failed = table["scenario"][table["status"] != "ok"]
    return table[~table["scenario"].isin(failed)]


__all__ = ["DEFAULT_EVENTS", "DESCRIPTION", "complete", "run", "statements", "stored"]
