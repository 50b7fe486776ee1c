"""The last step of every solver of the quadratic program: from its active set to the optimum itself, with a certificate.

A first-order or interior-point method comes as near as its tolerances say, which is not near if masses are a million apart.
But it does find out which units are at a bound. With these fixed, the conditions of optimality are linear: the other units
are at one level L, which follows from the sum. If L fits the bounds, the answer is the optimum; otherwise the guess was
wrong.
"""

import time
from collections.abc import Sequence

import numpy as np

from alloc.compilation import jit
from alloc.rules.allocation import CASE_A, CASE_B, Allocation, allocation
from alloc.rules.exact import exact_in_box
from alloc.rules.optimality_check import certified
from alloc.rules.problem import AllocationProblem, Floats
from alloc.rules.reach import ROUNDING, highest_cap, lowest, sums_at_bounds


@jit
def polish(lower, upper, mass, expected, guess, excess, limit_out):
    """Fill `limit_out` from a solver's answer; returns level, whether the plan is within reach, and the certificate.

    `guess`: the solver's limits. `excess`: its multiplier of each unit's bounds over the mass, so that at the optimum it is
    the level less the limit: > 0 at an upper bound, < 0 at a lower one. If the bounds leave only one point, the limits are
    that point.
    """
    most, least, total = sums_at_bounds(lower, upper, mass, expected)
    slack = ROUNDING * expected * total
    if most <= slack or least >= -slack:
        short = most <= slack
        for j in range(upper.size):
            limit_out[j] = upper[j] if short else lower[j]
        return highest_cap(upper) if short else lowest(lower), not short, True
    free, deficit, level = 0.0, 0.0, 0.0
    for j in range(upper.size):
        at_upper = upper[j] - guess[j] < excess[j] or upper[j] == lower[j]
        at_lower = guess[j] - lower[j] < -excess[j]
        if at_upper or at_lower:
            limit_out[j] = upper[j] if at_upper else lower[j]
            deficit += mass[j] * (expected - limit_out[j])
            if at_upper:
                level = max(level, upper[j])
        else:
            limit_out[j] = np.nan
            free += mass[j]
    if free > 0.0:
        level = expected + deficit / free
    for j in range(upper.size):
        if np.isnan(limit_out[j]):
            limit_out[j] = min(max(level, lower[j]), upper[j])
    return level, True, certified(lower, upper, mass, expected, limit_out, level)


def polished(
    name: str,
    problem: AllocationProblem,
    answer: Sequence[Floats],
    status: str,
    started: float,
) -> Allocation:
    """The optimum that a solver's `answer` leads to, or the exact limits unless `status` is "ok" and the certificate holds.

    `answer`: limits and `excess` as in `polish`, each over the plan, (n,).
    """
    limit, plan = np.empty(problem.n), problem.expected
    if status == "ok":
        guess, excess = answer
        level, reached, holds = polish(
            *problem.box, problem.weight, plan, plan * guess, plan * excess, limit
        )
        case = CASE_B if reached else CASE_A
        status = "ok" if holds else "not optimal"
    if status != "ok":
        status = f"{name} failed ({status}): exact level used"
        level, case = exact_in_box(problem, limit)
    return allocation(problem, limit, level, case, time.perf_counter() - started, status)
