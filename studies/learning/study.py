"""Learning the increments of adhesion along the train, station by station (JP5484215, embodiment 2)."""

from alloc.estimation.increments import DIRECTIONS
from studies.core.cell import Task
from studies.core.study import Study
from studies.learning.starts import DURATION, STATIONS, series_of_train, series_rows
from studies.learning.statements import CLAIMS, learning_statements


def cells(seed: int, starts: int, duration: float = DURATION) -> list[Task]:
    """`starts` of each arm, on each kind of rail, from each kind of wrong values; made up to whole trains.

    `duration` [s] shortens the starts.
    """
    stations = max(1, min(STATIONS, starts // len(DIRECTIONS)))
    trains = max(1, -(-starts // (len(DIRECTIONS) * stations)))
    return [
        Task(series.label, series_rows, (series,))
        for train in range(trains)
        for series in series_of_train(train, stations, seed, duration)
    ]


LEARNING = Study(
    name="learning",
    question="how fast wrong increments are learnt, what learning gains, what the robust rule costs",
    default_events=240,
    step=len(DIRECTIONS) * STATIONS,  # a whole train
    cells=cells,
    judge=learning_statements,
    claims=CLAIMS,
)
