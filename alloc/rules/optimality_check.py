"""One checker of optimality for every rule's answer: the Karush-Kuhn-Tucker residuals of the allocation's QP.

    minimise 1/2 sum m (x - Mu_z)^2   subject to   sum m x = attainable sum m,   lower <= x <= upper.

With the level L as multiplier of the sum, a unit inside its bounds must stand at L; at its upper bound L may lie
above it, at its lower bound below it.
"""

from dataclasses import dataclass

import numpy as np

from alloc.compilation import jit
from alloc.display import displayed
from alloc.rules.allocation import Allocation
from alloc.rules.exact import box_limits
from alloc.rules.problem import AllocationProblem, Floats

CERTIFIED = 3e-10
"""Largest error of a certified level, relative to the plan: twice this error is still less than 1e-9."""


@jit
def certified(lower, upper, mass, expected, limit, level):
    """Whether `limit` is the optimum within 2 `CERTIFIED`, relative to the plan; for bounds that leave a choice.

    With clip(L) = min(max(L, lower), upper), two conditions are checked. First, every limit is clip(level) within the
    tolerance. That covers stationarity, complementarity and the multipliers' signs: it is the residual of the projected
    gradient, over the mass. Second, the sum of m clip(L) is at most the plan's a tolerance below `level`, and at least the
    plan's a tolerance above. The sum rises with L, so the true multiplier is in between. A small residual of the sum alone
    would prove nothing where the free units are light.
    """
    tolerance = CERTIFIED * expected
    below, above, holds = 0.0, 0.0, True
    for j in range(limit.size):
        at_level = min(max(level, lower[j]), upper[j])
        within = lower[j] <= limit[j] <= upper[j]
        holds = holds and within and abs(limit[j] - at_level) <= tolerance
        below += mass[j] * (min(max(level - tolerance, lower[j]), upper[j]) - expected)
        above += mass[j] * (min(max(level + tolerance, lower[j]), upper[j]) - expected)
    return holds and below <= 0.0 <= above


@displayed
@dataclass(frozen=True)
class Optimality:
    """Residuals as coefficients, all >= 0 and zero for the optimum; `gap` is the rule's distance from the optimum."""

    primal: float
    """Largest violation of a bound, or of the sum over n."""
    dual: float
    """Largest multiplier of the wrong sign: a unit at its upper bound but above L, or at its lower bound but below L."""
    complementarity: float
    """Largest distance from its bound of a unit whose multiplier is not zero, or that multiplier if smaller."""
    stationarity: float
    """Largest distance from L of a unit at neither bound."""
    gap: float
    """Root mean square, weighted with mass, of the distance from the optimum."""
    level: float
    """L: the rule's own level if it is one of the sum's multipliers, else the level that fits its limits best."""

    @property
    def worst(self) -> float:
        """Largest of the four residuals."""
        return max(self.primal, self.dual, self.complementarity, self.stationarity)


def optimality(
    problem: AllocationProblem, allocation: Allocation, tolerance: float = 1e-9
) -> Optimality:
    """Residuals of `allocation` as an answer to `problem`.

    `tolerance`: distance from a bound, relative to the plan, within which a unit counts as being at the bound.
    """
    x, weight = allocation.limit, problem.weight
    lower, upper = problem.box
    near = tolerance * problem.expected
    at_upper, at_lower = upper - x <= near, x - lower <= near
    free = ~at_upper & ~at_lower
    level = allocation.level
    if not np.isfinite(level):
        level = fitted_level(x, problem, tolerance)
    excess = x - level
    at_one = at_upper ^ at_lower  # where both bounds meet, a multiplier of either sign is right
    wrong = np.where(at_upper, excess, -excess)
    distance = np.where(at_upper, np.abs(upper - x), np.abs(x - lower))
    slack = np.where(at_upper | at_lower, np.minimum(distance, np.abs(excess)), 0.0)
    missed = abs(float(np.average(x, weights=weight)) - problem.attainable)
    best = np.empty(problem.n)
    box_limits(lower, upper, weight, problem.expected, best)
    return Optimality(
        primal=max(missed, _largest(lower - x), _largest(x - upper)),
        dual=_largest(wrong[at_one]),
        complementarity=_largest(slack),
        stationarity=_largest(np.abs(excess[free])),
        gap=float(np.sqrt(np.average((x - best) ** 2, weights=weight))),
        level=level,
    )


def _largest(values: Floats) -> float:
    return max(float(values.max(initial=0.0)), 0.0)


def fitted_level(limit: Floats, problem: AllocationProblem, tolerance: float = 1e-9) -> float:
    """The level that fits `limit` best: that of the units at neither bound, or one that fits the units at their bounds."""
    lower, upper = problem.box
    near = tolerance * problem.expected
    at_upper = upper - limit <= near
    free = ~at_upper & (limit - lower > near)
    if free.any():
        return float(np.average(limit[free], weights=problem.weight[free]))
    return float(limit[at_upper].max()) if at_upper.any() else float(limit.min())
