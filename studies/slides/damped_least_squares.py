"""Levenberg and Marquardt's method in the unit cube, with central differences as wide as the caller says.

For deviations that switching valves roughen: differences over a few per cent of a range see the slope through the ripple,
where those of a library's routine, a millionth wide, see the ripple alone.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

Floats = NDArray[np.float64]

DAMPINGS = (1.0, 4.0, 16.0, 64.0, 256.0, 1024.0)
"""Tried in turn until a step improves."""
REACH = 0.25
"""Longest step along any side of the cube."""
WORTHWHILE, NARROWER, NARROWEST = 0.97, 0.6, 0.004
"""A step that leaves more than this share of the misfit makes the differences narrower, down to the last."""


def minimise(
    deviations: Callable[[Floats], Floats],
    misfit: Callable[[Floats], float],
    start: Floats,
    width: float,
    iterations: int,
    enough: float = 0.0,
) -> tuple[Floats, float]:
    """Best point found (n,) and its misfit.

    `deviations` of a point (m,) are made small; `misfit` of deviations decides what is better. `width`: half that of the
    first differences. Ends after so many `iterations`, once the misfit is `enough`, or where nothing improves.
    """
    point = np.clip(start, 0.0, 1.0)
    here = deviations(point)
    least = misfit(here)
    for _ in range(iterations):
        if least <= enough:
            break
        slope = _slope(deviations, point, width)
        before = least
        for damping in DAMPINGS:
            tried = np.clip(point + _step(slope, here, point, damping), 0.0, 1.0)
            there = deviations(tried)
            if misfit(there) < least:
                point, here, least = tried, there, misfit(there)
                break
        if least > WORTHWHILE * before:
            if width <= NARROWEST:
                break
            width = max(NARROWER * width, NARROWEST)
    return point, least


def _slope(deviations: Callable[[Floats], Floats], point: Floats, width: float) -> Floats:
    """Central differences, (m, n); one-sided at the cube's faces."""
    columns = []
    for i in range(point.size):
        ahead, back = point.copy(), point.copy()
        ahead[i], back[i] = min(point[i] + width, 1.0), max(point[i] - width, 0.0)
        columns.append((deviations(ahead) - deviations(back)) / (ahead[i] - back[i]))
    return np.stack(columns, axis=1)


def _step(slope: Floats, here: Floats, point: Floats, damping: float) -> Floats:
    """Least squares of the linearised deviations and of the step itself, within the cube and `REACH`."""
    n = point.size
    matrix = np.vstack([slope, np.sqrt(damping) * np.eye(n)])
    target = -np.concatenate([here, np.zeros(n)])
    # open bounds: a point on a face must have some room on both sides
    low, high = np.maximum(-point, -REACH) - 1e-9, np.minimum(1.0 - point, REACH) + 1e-9
    return np.asarray(lsq_linear(matrix, target, bounds=(low, high)).x)
