"""Sanders: the trial's distances, pairs of sanders, and placements with two ways to share the brake force."""

from typing import Any

from studies.core.cell import Task
from studies.core.study import Study
from studies.files.study_error import StudyError
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
from studies.sanders.statements import CLAIMS, sander_statements
from studies.sanders.trial import DISTANCES, SOURCE, SOURCES, Source, stop

TRIALS = ((2, "slip-ratio"), (1, "slip-ratio"), (2, "polach"))
"""Units and adhesion curve: as calibrated first, then next door."""
CARS = 8


def cells(seed: int, events: int, source: Source = SOURCE) -> list[Task]:
    """The trial's rows, every pair of cars ahead of which the sand may lie, and every arm of so many drawn events."""
    if source not in SOURCES:
        raise StudyError(f"--source {source}: give one of {', '.join(SOURCES)}")
    trials = [
        _task(
            "trial", stop, (kind, CALIBRATED, units, curve), source, kind=kind, units=units, curve=curve
        )
        for units, curve in TRIALS
        for kind in DISTANCES
    ]  # fmt: skip
    pairs = [
        _task("pair", place_row, (_pair(a, b), "equal", NOMINAL, CURVES[0], 0), source, first=a, second=b)
        for a in range(CARS)
        for b in range(a, CARS)
    ]  # fmt: skip
    return trials + pairs + [task for k in range(events) for task in _event(seed, k, source)]


def _pair(first: int, second: int) -> tuple[int, ...]:
    """First axles of two cars, of one where both are the same."""
    return tuple(sorted({AXLES_PER_CAR * first, AXLES_PER_CAR * second}))


def _event(seed: int, k: int, source: Source) -> list[Task]:
    drawn, curve = EVENTS.draw(seed, k), CURVES[k % len(CURVES)]
    return [
        _task(
            "placement", place_row, (axles, sharing, drawn, curve, k), source,
            scenario=EVENTS.event_name(seed, k), event=k, placement=name, sharing=sharing, curve=curve, **drawn,
        )
        for name, axles in PLACEMENTS.items()
        for sharing in SHARINGS
    ]  # fmt: skip


def _task(
    part: str, function: Any, arguments: tuple[Any, ...], source: Source, **columns: Any
) -> Task:
    told = {"part": part, "source": source, **columns}
    return Task("/".join(map(str, told.values())), function, (*arguments, source), tuple(told.items()))  # fmt: skip


SANDERS = Study(
    name="sanders",
    question="stopping distance with sanders: the trials of RSSB T1107, placement of the sand, sharing of the brake force",
    default_events=10,
    cells=cells,
    judge=lambda table: sander_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
