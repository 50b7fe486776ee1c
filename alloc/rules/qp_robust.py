"""Chance-constrained allocation: the rail carries every cap with a chosen probability; then the quadratic program as before.

The true bound of unit j is normal about its cap with standard deviation d_j. Then

    P(limit_j <= true bound_j) >= p    is equivalent to    limit_j <= cap_j - Phi^-1(p) d_j,

a linear constraint again: the program of `alloc.rules.qp` with lower caps (Charnes and Cooper, Management Science 6 (1959),
p. 73: deterministic equivalent of an individual chance constraint). The probability applies unit by unit. That the rail
carries all caps at once is less probable. An error of the foremost unit's estimate shifts all caps alike, and is part of
each deviation.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import ndtri

from alloc.rules.allocation import Allocation
from alloc.rules.problem import AllocationError, AllocationProblem
from alloc.rules.qp import answer_qp
from alloc.rules.rule import RULES, Rule

PROBABILITY = 0.9
"""Default probability that the rail carries a cap. Assumed, no source names one. The next steps, 0.95 and 0.99, cost 1.3 and
1.8 times as much effort, and a unit that slips all the same has its own readhesion control."""


def check_probability(probability: float) -> float:
    """`probability` as a number; raises `AllocationError` outside of 0.5 <= p < 1."""
    try:
        value = float(probability)
    except (TypeError, ValueError):
        value = float("nan")
    if isinstance(probability, bool) or not 0.5 <= value < 1.0:
        raise AllocationError(
            f"probability = {probability!r} must be a number with 0.5 <= probability < 1: at 0.5 the caps stay as they "
            "are, and with certainty a normal error allows no limit at all"
        )
    return value


def chance_constrained(
    problem: AllocationProblem, probability: float = PROBABILITY
) -> AllocationProblem:
    """The certain problem whose caps the true ones exceed with `probability` each: cap - Phi^-1(p) deviation, >= 0.

    Raises `AllocationError` for an impossible probability.
    """
    quantile = float(ndtri(check_probability(probability)))
    if problem.deviation is None:
        return problem
    cap = np.asarray(problem.cap) - quantile * np.asarray(problem.deviation)
    return problem.changed(cap=np.maximum(cap, 0.0), deviation=None)


def answer_robust(problem: AllocationProblem, probability: float = PROBABILITY) -> Allocation:
    """Limits by `qp` under the caps of `chance_constrained`."""
    return answer_qp(chance_constrained(problem, probability), "qp-robust")


QP_ROBUST = Rule(
    "qp-robust", "qp with caps that hold with a probability of 0.9", answer_robust,
    colour="#00c68e", marker=">",
)  # fmt: skip
RULES.register("qp-robust", QP_ROBUST)


def robust_rule(probability: float) -> Rule:
    """`qp-robust` with another probability; raises `AllocationError` for an impossible one."""
    value = check_probability(probability)
    description = f"qp with caps that hold with a probability of {value:g}"
    answer = partial(answer_robust, probability=value)
    return replace(QP_ROBUST, description=description, answer=answer)
