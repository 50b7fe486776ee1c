"""Allocation as the optimisation that it is: the effort of the train at the least wear, from what units report alone.

In: an `AllocationProblem` with marks p, the coefficient that each unit has shown to carry. Out: the limits x that

    minimise    1/2 sum m x^2 / p
    subject to  sum m x = Mu_z sum m,    lower <= x <= upper,

with the plan Mu_z and the masses m. Upper bounds are what limited units deliver now, torque limits, and rates of change.

What is minimised is a model of the power that wheels dissipate, force times slip velocity. Its marginal cost is x / p, the
share of its own peak at which a unit works. True slips are not known on board, nor is the curve. But where units share the
shape of a curve and the slip velocity of its peak, the true marginal cost s + mu / (d mu / d s) is one rising function of
that share for all of them. Then equal marginal cost, which is what an optimum is, is equal share in both: the model has the
optimum of the truth, whatever the curve. `alloc.old.metrics.least_damage` has the truth.

The program is solved in three forms that give one answer. `wear` is water filling: all units that are at no bound have one
share, which Newton's method finds in n passes at most. `wear-qp` is a quadratic program for OSQP, certified by its active
set, `wear-cvxpy` the same as one would write it down. With shares x / p in the place of limits and m p in that of masses,
the program is that of `alloc.old.rules.qp`, so its solvers and its certificate serve here too.

A unit at its upper bound, or any where the plan is out of reach, has nothing to share. It is asked for `upper_bound` and for
the plan at least, that is for so much that its controller searches for the peak undisturbed (`alloc.old.onboard.distribution`).
So no unit that the rail limits is kept below what it may carry by a mark of a rail that is gone. What trailers lack is asked
only of those that can give it. A unit that the rail limits would fill its part of that with air, and slide.
"""

import time
from collections.abc import Callable

import numpy as np

from alloc.old.compilation import inlined_jit, jit
from alloc.old.rules.exact import answer_exact
from alloc.old.rules.problem import (
    CASE_A,
    CASE_B,
    ROUNDING,
    Allocation,
    AllocationProblem,
    Floats,
    allocation,
)
from alloc.old.rules.rule import RULES, Caps, Rule, Trigger, units_of

LEAST_MARK = 1e-3
"""Mark below which a unit's share counts as that of this mark: a unit without any adhesion has none."""

AT_BOUND = 1e-9
"""Distance from a bound, over the bound, within which a solver's answer counts as at it."""


@inlined_jit
def _undisturbed(units, j):
    """What unit `j` is asked for that does what it can: more than it delivers, and the plan at least."""
    upper = units.upper_bound[j]
    return min(max(upper, units.plan) if np.isfinite(upper) else units.cap[j], units.limit_max[j])


@jit
def wear_law(units, expected, limit_out):
    """Fill `limit_out` with min(p L, upper) at the share L that reaches the plan; whether that is within reach.

    sum m min(p L, upper) is concave in L: the iterates rise, and stop as soon as they pass no further unit's bound.
    """
    total, balance = 0.0, 0.0
    for j in range(units.cap.size):
        total += units.mass[j]
        balance += units.mass[j] * (min(units.cap[j], units.limit_max[j]) - expected)
    if balance <= ROUNDING * expected * total:
        for j in range(units.cap.size):
            limit_out[j] = _undisturbed(units, j)
        return np.nan, False
    share = 0.0
    for _ in range(units.cap.size):
        free, rest = 0.0, expected * total
        for j in range(units.cap.size):
            mark, upper = max(units.mark[j], LEAST_MARK), min(units.cap[j], units.limit_max[j])
            if mark * share >= upper:
                rest -= units.mass[j] * upper
            else:
                free += units.mass[j] * mark
        if free == 0.0 or rest <= share * free:
            break
        share = rest / free
    for j in range(units.cap.size):
        limit_out[j] = max(units.mark[j], LEAST_MARK) * share
        if limit_out[j] >= min(units.cap[j], units.limit_max[j]):
            limit_out[j] = _undisturbed(units, j)
    return np.nan, True


def in_shares(problem: AllocationProblem) -> tuple[AllocationProblem, Floats]:
    """The program with x / p in the place of x, which is that of `alloc.old.rules.qp`; and p, (n,)."""
    mark = np.maximum(problem.peak, LEAST_MARK)
    mass, bounds = problem.weight * mark, ("cap", "limit_max", "previous", "rate")
    shares = {
        name: value / mark for name in bounds if (value := getattr(problem, name)) is not None
    }
    nothing = dict.fromkeys(("delivered", "truth", "deviation", "mark", "upper_bound", "plan"))
    expected = problem.expected * float(problem.weight.sum() / mass.sum())
    return problem.changed(expected=expected, mass=mass, **shares, **nothing), mark


def answer_wear(
    solve: Callable[[AllocationProblem], Allocation], problem: AllocationProblem
) -> Allocation:
    """Limits of least wear, with `solve` for the program in shares."""
    started = time.perf_counter()
    asked = np.clip(np.maximum(problem.searching, problem.own_plan), *problem.rate_box)
    undisturbed = np.where(np.isfinite(problem.searching), asked, problem.box[1])
    if not problem.within_reach:
        return allocation(problem, undisturbed, np.nan, CASE_A, time.perf_counter() - started)
    shares, mark = in_shares(problem)
    answer = solve(shares)
    limit = np.clip(mark * answer.limit, *problem.box)
    bound = np.minimum(problem.cap, problem.torque_limit)
    limit = np.where(limit >= (1.0 - AT_BOUND) * bound, undisturbed, limit)
    spent = time.perf_counter() - started
    return allocation(problem, limit, np.nan, CASE_B, spent, answer.status)


def answer_by_filling(problem: AllocationProblem) -> Allocation:
    """Limits of least wear by water filling, with or without limits on their rate of change."""
    if problem.rate is not None:
        return answer_wear(answer_exact, problem)
    started = time.perf_counter()
    limit = np.empty(problem.n)
    level, reached = wear_law(units_of(problem), problem.expected, limit)
    case = CASE_B if reached else CASE_A
    return allocation(problem, limit, level, case, time.perf_counter() - started)


WEAR = Rule(
    "wear", "the plan at the least wear: each unit the same share of what it has shown to carry", answer_by_filling,
    wear_law, trigger=Trigger.TELEGRAM, caps=Caps.DELIVERED, colour="#1b2c28", marker="$W$",
)  # fmt: skip
RULES.register("wear", WEAR)
