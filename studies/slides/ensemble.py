"""Sets of undisclosed parameters that reach the tables of JP4209318: an evolution strategy finds some, a sampler the rest.

The prior is even over `BOUNDS` (over the logarithm of some) and 0 where adhesion is implausible. Every target has a
normal error whose standard deviation is half its tolerance: the posterior's logarithm is minus twice the misfit.

- CMA-ES (Hansen, "The CMA evolution strategy: a tutorial", 2016; package cma) goes from a point of the prior to
  the targets. It needs no gradient, which valves that switch roughen, and gets by with 1000 to 2000 sets in 15 dimensions.
- Walkers (`studies.core.walkers`, package emcee) go on from what several such searches found.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.core.walkers import needed, walk
from studies.slides.calibration import (
    from_unit_cube,
    reaches,
    row_of,
    to_unit_cube,
    undisclosed_of,
)
from studies.slides.jp4209318 import BOUNDS, Undisclosed
from studies.slides.targets import OUTCOMES, implausible, misfit_up_to, outcomes

Floats = NDArray[np.float64]
Row = dict[str, Any]

FIRST_WIDTH = 0.15
"""Standard deviation that the search begins with, as a share of every range."""
POPULATION = 12
"""Sets of a generation of the search: the usual 4 + 3 ln 15."""
KEPT = 12
"""Sets that a search passes on: the best of its last three generations, which are as wide as what it has learnt."""
IMPLAUSIBLE = 1e4
"""Misfit from which implausible sets are ranked by how far they are from plausible; none that is run has as much."""
SHARPNESS = 2.0
"""Sharpness of the posterior, whose logarithm is this multiple of minus the misfit."""
DISORDER = 10.0
"""What slips out of the source's order take from it: such a set is taken once in e^10 times."""

HOPELESS = 20.0
"""A set that misses by this much more than twice the walkers' median is not run to its end."""
NEARNESS = (0.002, 0.02)
"""Least and greatest standard deviation of sets drawn around those found, as a share of every range."""
POOR = 8.0
"""Misfit beyond which such a set is not run to its end: that of a set that misses every target by its tolerance."""
PASSED = (*BOUNDS, *OUTCOMES, "misfit", "misfit without 2", "unreached")
"""Columns of a walker."""


def tried_row(undisclosed: Undisclosed) -> Row:
    """Row of a set."""
    return row_of(undisclosed, outcomes(undisclosed))


def search(start: Undisclosed, seed: int, leave_out: str | None, evaluations: int) -> list[Row]:
    """Rows of the last and best sets of CMA-ES from `start`, which ends at the first that reaches all targets.

    `evaluations`: largest number of sets to run. The target `leave_out` is not required.
    """
    cma = needed("cma")
    strategy = cma.CMAEvolutionStrategy(
        to_unit_cube(start).tolist(), FIRST_WIDTH,
        {"seed": 1 + seed, "bounds": [0.0, 1.0], "popsize": POPULATION, "verbose": -9},
    )  # fmt: skip
    generations: list[list[Row]] = []
    most, run, reached = np.inf, 0, False
    while run < evaluations and not reached:
        points = strategy.ask()
        tried = [_tried(from_unit_cube(np.asarray(point)), most, leave_out) for point in points]
        values = [value for value, _ in tried]
        strategy.tell(points, values)
        run += sum(value < IMPLAUSIBLE for value in values)
        most = float(np.median(values))  # the worse half only has to be known as worse
        generations = [*generations[-2:], [row for _, row in tried if row is not None]]
        reached = any(reaches(row, leave_out) for row in generations[-1])
    last = [row for rows in generations for row in rows]
    last.sort(key=lambda row: (not reaches(row, leave_out), float(row[_column(leave_out)])))
    return [{"rank": k, "evaluations": run, **row} for k, row in enumerate(last[:KEPT])]


def _column(leave_out: str | None) -> str:
    return "misfit" if leave_out is None else "misfit without 2"


def _tried(
    undisclosed: Undisclosed, most: float, leave_out: str | None
) -> tuple[float, Row | None]:
    """Misfit and row of a set; or a bound of its misfit that is above `most`, and None."""
    off = implausible(undisclosed)
    if off > 0.0:
        return IMPLAUSIBLE * (1.0 + off), None
    value, found = misfit_up_to(undisclosed, most, leave_out)
    return value, None if found is None else row_of(undisclosed, found)


def sample(walkers: Sequence[Row], seed: int, leave_out: str | None, steps: int) -> list[Row]:
    """A row per walker after this number of `steps` of the sampler; and one per set on the way that reaches all targets."""
    column = _column(leave_out)
    points = np.array([to_unit_cube(undisclosed_of(row)) for row in walkers])
    most = 2.0 * float(np.median([float(row[column]) for row in walkers])) + HOPELESS
    rows = {point.tobytes(): row for point, row in zip(points, walkers, strict=True)}

    def log_posterior(point: Floats) -> float:
        if np.any((point < 0.0) | (point > 1.0)):
            return -np.inf
        _, row = _tried(from_unit_cube(point), most, leave_out)
        if row is None:
            return -np.inf
        rows[point.tobytes()] = row
        return _log_posterior(row, column)

    values = np.array([_log_posterior(row, column) for row in walkers])
    walked = walk(points, values, log_posterior, seed, steps)
    # a walker that stayed keeps its row: to the cube and back its set would be rounded
    found = [rows.pop(point.tobytes()) for point in walked.points]
    for point in points:
        rows.pop(point.tobytes(), None)
    passed = [row for row in rows.values() if reaches(row, leave_out)]
    return [
        *(
            {"walker": k, "accepted": float(share), **{name: row[name] for name in PASSED}}
            for k, (row, share) in enumerate(zip(found, walked.accepted, strict=True))
        ),
        *({"walker": -1, **{name: row[name] for name in PASSED}} for row in passed),
    ]


def _log_posterior(row: Row, column: str) -> float:
    return -SHARPNESS * float(row[column]) - DISORDER * (float(row["slides"]) > 0.0)


def around(found: Sequence[Row], seed: int, draws: int) -> list[Row]:
    """Rows of the sets that reach all targets, among sets drawn around those `found`, each about one of these.

    Switching valves make the misfit rough. So few of the sets near a good one reach all targets, however near they are.
    """
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(draws):
        start = to_unit_cube(undisclosed_of(found[int(rng.integers(len(found)))]))
        width = np.exp(rng.uniform(*np.log(NEARNESS)))
        point = np.clip(start + width * rng.standard_normal(start.size), 0.0, 1.0)
        _, row = _tried(from_unit_cube(point), POOR, None)
        if row is not None and reaches(row):
            rows.append({name: row[name] for name in PASSED})
    return rows
