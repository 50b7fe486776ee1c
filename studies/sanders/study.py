"""Sanders: the trial's distances, pairs of sanders, and placements with two ways to share the brake force."""

from typing import Any

from studies.core.cell import Task
from studies.core.study import Study
from studies.sanders.calibration import CALIBRATED
from studies.sanders.placement import (
    AXLES_PER_CAR,
    CURVES,
    EVENTS,
    NOMINAL,
    PLACEMENTS,
    SHARINGS,
    place_row,
)
from studies.sanders.statements import sander_statements
from studies.sanders.trial import DISTANCES, measures, stop

TRIALS = ((2, "slip-ratio"), (1, "slip-ratio"), (2, "polach"))
"""Units and adhesion curve: as calibrated first, then next door."""
CARS = 8


def trial_row(kind: str, units: int, curve: str) -> dict[str, float]:
    """A row of the trial, with slip measured from the true speed."""
    return measures(stop(kind, CALIBRATED, units, curve))


def cells(seed: int, events: int) -> list[Task]:
    """The trial's rows, every pair of cars ahead of which the sand may lie, and every arm of so many drawn events."""
    trials = [
        _task("trial", trial_row, (kind, units, curve), kind=kind, units=units, curve=curve)
        for units, curve in TRIALS
        for kind in DISTANCES
    ]
    pairs = [
        _task("pair", place_row, (_pair(a, b), "equal", NOMINAL, CURVES[0], 0), first=a, second=b)
        for a in range(CARS)
        for b in range(a, CARS)
    ]
    return trials + pairs + [task for k in range(events) for task in _event(seed, k)]


def _pair(first: int, second: int) -> tuple[int, ...]:
    """First axles of two cars, of one where both are the same."""
    return tuple(sorted({AXLES_PER_CAR * first, AXLES_PER_CAR * second}))


def _event(seed: int, k: int) -> list[Task]:
    drawn, curve = EVENTS.draw(seed, k), CURVES[k % len(CURVES)]
    return [
        _task(
            "placement", place_row, (axles, sharing, drawn, curve, k),
            scenario=EVENTS.event_name(seed, k), event=k, placement=name, sharing=sharing, curve=curve, **drawn,
        )
        for name, axles in PLACEMENTS.items()
        for sharing in SHARINGS
    ]  # fmt: skip


def _task(part: str, function: Any, arguments: tuple[Any, ...], **columns: Any) -> Task:
    label = "/".join(map(str, (part, *columns.values())))
    return Task(label, function, arguments, (("part", part), *columns.items()))


SANDERS = Study(
    name="sanders",
    question="stopping distance with sanders: the trials of RSSB T1107, placement of the sand, sharing of the brake force",
    default_events=12,
    cells=cells,
    judge=lambda table: sander_statements(table[table["status"] == "ok"]),
)
