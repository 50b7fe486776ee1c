"""The exact level that par. 0050 of JP5484215 names but does not compute, without sorting.

The limits are the projection of the plan onto {x: sum m x = Mu_z sum m, lower <= x <= upper} in the norm
sum m (x - Mu_z)^2. Weighted with the mass, every unit inside its bounds stands at one level L whatever its
mass: x = min(max(L, lower), upper). L is the root of a monotone, piecewise linear function.
"""

import numpy as np

from alloc.compilation import jit
from alloc.rules.greedy import ROUNDING, highest_cap


@jit
def water_level(upper, mass, expected):
    """Root L of sum m min(upper, L) = expected sum m, and whether the plan is within reach.

    Newton's method from L = expected: the function is concave, so the iterates rise, and stop exactly as soon as no
    further unit reaches its bound, after n steps at most. Out of reach: the highest bound, and False.
    """
    free, deficit, spare, total = 0.0, 0.0, 0.0, 0.0
    for j in range(upper.size):
        gap = mass[j] * (upper[j] - expected)
        total += mass[j]
        if gap > 0.0:
            free += mass[j]
            spare += gap
        else:
            deficit -= gap
    if spare - deficit <= ROUNDING * expected * total:
        return highest_cap(upper), False
    level = expected + deficit / free
    while True:
        still_free, deficit = 0.0, 0.0
        for j in range(upper.size):
            if upper[j] > level:
                still_free += mass[j]
            else:
                deficit += mass[j] * (expected - upper[j])
        if still_free == free or still_free == 0.0:
            return level, True
        free = still_free
        level = expected + deficit / free


@jit
def exact_limits(cap, expected, mass, limit_max, limit_out):
    """Fill `limit_out` with min(cap, limit_max, L); returns L and whether the plan is within reach."""
    for j in range(cap.size):
        limit_out[j] = min(cap[j], limit_max[j])
    level, reached = water_level(limit_out, mass, expected)
    for j in range(cap.size):
        limit_out[j] = min(limit_out[j], level)
    return level, reached


@jit
def box_level(lower, upper, mass, expected):
    """Root L of sum m min(max(L, lower), upper) = expected sum m; the plan must lie between the bounds' sums.

    Variable fixing (Bitran and Hax 1981, Management Science 27(4)): the level of the units still free is compared
    with what they would lose at their upper and gain at their lower bounds; the heavier side is at its bounds in the
    solution too. Each pass fixes a unit, so n passes suffice. `below` and `above` enclose L and say which are fixed.
    """
    below, above, level = -np.inf, np.inf, expected
    total = 0.0
    for j in range(upper.size):
        total += mass[j]
    for _ in range(upper.size):
        free, deficit = 0.0, 0.0
        for j in range(upper.size):
            if upper[j] <= below:
                deficit += mass[j] * (expected - upper[j])
            elif lower[j] >= above:
                deficit += mass[j] * (expected - lower[j])
            else:
                free += mass[j]
        if free == 0.0:
            break
        level = expected + deficit / free
        lost, gained = 0.0, 0.0
        for j in range(upper.size):
            if upper[j] > below and lower[j] < above:
                lost += mass[j] * max(level - upper[j], 0.0)
                gained += mass[j] * max(lower[j] - level, 0.0)
        if abs(lost - gained) <= ROUNDING * expected * total:
            break
        if lost > gained:
            below = level
        else:
            above = level
    return level


@jit
def box_limits(lower, upper, mass, expected, limit_out):
    """Fill `limit_out` with the projection onto the box; returns level and whether the plan is within reach.

    Where even the upper bounds fall short all units stand there, and where even the lower ones exceed the plan, there.
    """
    most, least, total = 0.0, 0.0, 0.0
    for j in range(upper.size):
        most += mass[j] * (upper[j] - expected)
        least += mass[j] * (lower[j] - expected)
        total += mass[j]
    slack = ROUNDING * expected * total
    reached = most > slack
    if not reached:
        level = highest_cap(upper)
    elif least >= -slack:
        level = lower[0]
        for j in range(1, lower.size):
            level = min(level, lower[j])
    else:
        level = box_level(lower, upper, mass, expected)
    for j in range(upper.size):
        limit_out[j] = min(max(level, lower[j]), upper[j])
    return level, reached
