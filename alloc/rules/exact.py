"""The exact level that par. 0050 of JP5484215 names but does not compute, without sorting.

The limits are the projection of the plan onto {x: sum m x = Mu_z sum m, lower <= x <= upper} in the norm sum m (x - Mu_z)^2.
In this norm, weighted with mass, every unit inside its bounds is at one level L whatever its mass: x = min(max(L, lower),
upper). L is the root of a monotone, piecewise linear function.
"""

import time

import numpy as np

from alloc.compilation import jit
from alloc.rules.allocation import CASE_A, CASE_B, Allocation, allocation
from alloc.rules.problem import AllocationProblem, Floats
from alloc.rules.reach import ROUNDING, highest_cap, lowest, sums_at_bounds
from alloc.rules.rule import RULES, Rule


@jit
def exact_limits(cap, expected, mass, limit_max, limit_out):
    """Fill `limit_out` with min(cap, limit_max, L); returns the level L and whether the plan is within reach.

    L is the root of sum m min(upper, L) = expected sum m, found by Newton's method from L = expected. The function is
    concave, so the iterates rise. They stop exactly as soon as they pass no further unit's bound, after n steps at most. If
    the plan is out of reach, L is the highest bound, and the second value is False.
    """
    free, balance, deficit, total, nearest = 0.0, 0.0, 0.0, 0.0, np.inf
    # sums without branches: which unit is above the level follows no pattern that a processor could predict
    for j in range(cap.size):
        upper = min(cap[j], limit_max[j])
        limit_out[j] = upper
        gap = mass[j] * (upper - expected)
        above = gap > 0.0
        total += mass[j]
        balance += gap
        free += mass[j] if above else 0.0
        deficit -= 0.0 if above else gap
        nearest = min(nearest, upper if above else np.inf)
    if balance <= ROUNDING * expected * total:
        return highest_cap(limit_out), False
    level = expected + deficit / free
    while nearest < level:
        free, deficit, nearest = 0.0, 0.0, np.inf
        for j in range(cap.size):
            gap = mass[j] * (expected - limit_out[j])
            above = limit_out[j] > level
            free += mass[j] if above else 0.0
            deficit += 0.0 if above else gap
            nearest = min(nearest, limit_out[j] if above else np.inf)
        if free == 0.0:  # rounding at the edge of what is within reach
            break
        level = expected + deficit / free
    for j in range(cap.size):
        limit_out[j] = min(limit_out[j], level)
    return level, True


@jit
def box_level(lower, upper, mass, expected):
    """Root L of sum m min(max(L, lower), upper) = expected sum m; the plan must lie between the bounds' sums.

    The method is variable fixing (Bitran and Hax 1981, Management Science 27(4)). The level of the units that are still free
    is compared with what they would lose at their upper and gain at their lower bounds. The heavier side is at its bounds in
    the solution too. Each pass fixes a unit, so n passes suffice. `below` and `above` enclose L and say which units are
    fixed.
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

    Where even the upper bounds fall short of the plan, all units are at their upper bounds. Where even the lower bounds
    exceed it, all are at their lower bounds.
    """
    most, least, total = sums_at_bounds(lower, upper, mass, expected)
    slack = ROUNDING * expected * total
    reached = most > slack
    if not reached:
        level = highest_cap(upper)
    elif least >= -slack:
        level = lowest(lower)
    else:
        level = box_level(lower, upper, mass, expected)
    for j in range(upper.size):
        limit_out[j] = min(max(level, lower[j]), upper[j])
    return level, reached


@jit
def exact_law(units, expected, limit_out):
    """Limits at the exact level of the caps."""
    return exact_limits(units.cap, expected, units.mass, units.limit_max, limit_out)


def exact_in_box(problem: AllocationProblem, limit_out: Floats) -> tuple[float, int]:
    """Fill `limit_out` with the exact limits under rates of change as well; returns level and case."""
    lower, upper = problem.box
    level, reached = box_limits(lower, upper, problem.weight, problem.expected, limit_out)
    return level, CASE_B if reached else CASE_A


def answer_exact(problem: AllocationProblem) -> Allocation:
    """The exact limits, with or without limits on their rate of change."""
    started = time.perf_counter()
    limit = np.empty(problem.n)
    if problem.rate is None:
        level, reached = exact_limits(
            problem.cap, problem.expected, problem.weight, problem.torque_limit, limit
        )
        case = CASE_B if reached else CASE_A
    else:
        level, case = exact_in_box(problem, limit)
    return allocation(problem, limit, level, case, time.perf_counter() - started)


EXACT = Rule(
    "exact", "the exact level of JP5484215 par. 0050, weighted with mass", answer_exact, exact_law,
    colour="#0072b2", marker="P",
)  # fmt: skip
RULES.register("exact", EXACT)
