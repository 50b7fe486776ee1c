"""A rule's answer: the limits, and what they deliver."""

from dataclasses import dataclass

import numpy as np

from alloc.display import displayed
from alloc.rules.problem import AllocationProblem, Floats
from alloc.rules.reach import ROUNDING

CASE_NONE, CASE_A, CASE_B = 0, 1, 2
CASES = ("none", "A", "B")
"""Name of each case by its number: no slip; the plan out of reach; within reach."""


@displayed
@dataclass(frozen=True, eq=False)
class Allocation:
    """Limits of the tangential force coefficients, one per unit, and how the rule determined them."""

    limit: Floats
    """Limit of each unit, (n,), read-only."""
    level: float
    """Coefficient at which the units with adhesion to spare are held; nan where the rule has none."""
    case: str
    """"none": no slip. "A": the bounds do not allow the plan. "B": they do."""
    unmet: float
    """Mean shortfall of the limits against the plan, weighted with mass, as a coefficient; >= 0."""
    status: str = "ok"
    """"ok", which a rule with a solver states only for a certified optimum, or what happened instead."""
    solve_time: float = 0.0
    """Wall time that the rule took [s]."""

    def effort(self, problem: AllocationProblem) -> float:
        """Mean limit weighted with mass: what the train would deliver if every unit reached its limit."""
        return float(np.average(self.limit, weights=problem.weight))

    def excess(self, problem: AllocationProblem) -> float:
        """Mean limit beyond the plan, weighted with mass; >= 0."""
        return max(self.effort(problem) - problem.expected, 0.0)

    def usable(self, problem: AllocationProblem) -> float:
        """Mean of min(limit, cap) weighted with mass: what would be delivered if the caps were true."""
        return float(np.average(np.minimum(self.limit, problem.cap), weights=problem.weight))


def allocation(
    problem: AllocationProblem,
    limit: Floats,
    level: float,
    case: int,
    solve_time: float,
    status: str = "ok",
) -> Allocation:
    """The answer with `limit` to `problem`; shortfalls within rounding count as none."""
    shortfall = problem.expected - float(np.dot(problem.weight, limit) / problem.weight.sum())
    unmet = shortfall if shortfall > ROUNDING * problem.expected else 0.0
    limit.flags.writeable = False
    return Allocation(limit, float(level), CASES[case], unmet, status, solve_time)
