"""The exact level that JP5484215 par. 0050 names but does not compute, with masses, torque limits and rates: exact, oracle.

The limits are the projection of the plan onto {x: sum m x = needed sum m, lower <= x <= upper} in the norm sum m (x -
needed)^2. Weighted like this, every unit inside its bounds is at one level L whatever its mass: x = min(max(L, lower),
upper), and L is the root of a monotone, piecewise linear function.
"""

import numpy as np

from alloc.compilation import jit
from alloc.onboard.signatures import share
from alloc.rules.problem import ROUNDING, AllocationProblem, Floats
from alloc.rules.rule import RULES, Rule


@jit
def level_between(lower, upper, mass, needed):
    """Level L with sum m min(max(L, lower), upper) = needed sum m, and the case: 2 (B), or 1 (A) where it is out of reach.

    Variable fixing (Bitran and Hax 1981, Management Science 27(4)): the level of the units still free is compared with what
    they would lose at their upper and gain at their lower bounds. The heavier side is at its bounds in the solution too, so
    n passes suffice. Out of reach, L is the highest bound; where even the lower bounds exceed the plan, the lowest.
    """
    most, least, total, highest, lowest = 0.0, 0.0, 0.0, 0.0, np.inf
    for j in range(upper.size):
        most += mass[j] * (upper[j] - needed)
        least += mass[j] * (lower[j] - needed)
        total += mass[j]
        highest, lowest = max(highest, upper[j]), min(lowest, lower[j])
    slack = ROUNDING * needed * total
    if most <= slack:
        return highest, 1
    if least >= -slack:
        return lowest, 2
    below, above, level = -np.inf, np.inf, needed
    for _ in range(upper.size):
        free, deficit = 0.0, 0.0
        for j in range(upper.size):
            if upper[j] <= below:
                deficit += mass[j] * (needed - upper[j])
            elif lower[j] >= above:
                deficit += mass[j] * (needed - lower[j])
            else:
                free += mass[j]
        if free == 0.0:
            break
        level = needed + deficit / free
        lost, gained = 0.0, 0.0
        for j in range(upper.size):
            if upper[j] > below and lower[j] < above:
                lost += mass[j] * max(level - upper[j], 0.0)
                gained += mass[j] * max(lower[j] - level, 0.0)
        if abs(lost - gained) <= slack:
            break
        if lost > gained:
            below = level
        else:
            above = level
    return level, 2


@jit
def share_exactly(units, run, rate):
    """Set every unit's limit to the level within its bounds; returns the level. `rate`: largest change of a limit."""
    lower, upper, mass = np.empty(units.size), np.empty(units.size), np.empty(units.size)
    for j in range(units.size):
        u = units[j]
        before = u.wanted if u.wanted < np.inf else run.needed
        mass[j] = u.mass_share
        upper[j] = min(min(u.cap, u.most), before + rate)
        # adhesion and torque that fell faster than the rate prevail
        lower[j] = min(max(before - rate, 0.0), upper[j])
    level, run.case = level_between(lower, upper, mass, run.needed)
    for j in range(units.size):
        units[j].wanted = min(max(level, lower[j]), upper[j])
    return level


@share
def share_exact(units, run):
    """Limits at the exact level of the caps."""
    return share_exactly(units, run, run.limit_rate)


@share
def share_oracle(units, run):
    """Limits at the exact level of the true coefficients."""
    for j in range(units.size):
        units[j].cap = units[j].truth
    return share_exactly(units, run, np.inf)


def exact_limits(problem: AllocationProblem) -> tuple[Floats, float]:
    """The optimum of `problem`, (n,), and its level."""
    level, _ = level_between(problem.lower, problem.upper, problem.mass, problem.expected)
    return np.clip(level, problem.lower, problem.upper), level


EXACT = Rule(
    "exact",
    "the exact level of JP5484215 par. 0050, weighted with mass",
    share_exact,
    promise="exact",
    colour="#0072b2",
    marker="P",
)

ORACLE = Rule(
    "oracle",
    "the exact level on the true coefficients: what could be had at best",
    share_oracle,
    "known",
    promise="effort",
    colour="#000000",
    marker="*",
)

for _rule in (EXACT, ORACLE):
    RULES.register(_rule)
