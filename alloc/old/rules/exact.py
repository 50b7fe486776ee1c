"""The exact level, what is proved with it, and the rules that use it: exact, oracle, cooperative, preview.

In: an `AllocationProblem`. Out: the limits with the largest sum up to the plan that are as equal as bounds allow; KKT
residuals of any rule's answer (`optimality`); a solver's answer made exact from its active set (`polished`).
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from alloc.old.compilation import jit
from alloc.old.display import displayed
from alloc.old.rules.problem import (
    CASE_A,
    CASE_B,
    ROUNDING,
    Allocation,
    AllocationProblem,
    Floats,
    allocation,
    highest_cap,
    lowest,
    sums_at_bounds,
)
from alloc.old.rules.rule import RULES, Caps, Rule, Trigger

# The exact level that par. 0050 of JP5484215 names but does not compute, without sorting.
#
# The limits are the projection of the plan onto {x: sum m x = Mu_z sum m, lower <= x <= upper} in the norm sum m (x -
# Mu_z)^2. In this norm, weighted with mass, every unit inside its bounds is at one level L whatever its mass: x =
# min(max(L, lower), upper). L is the root of a monotone, piecewise linear function.


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
    promise="exact", colour="#0072b2", marker="P",
)  # fmt: skip
RULES.register("exact", EXACT)


# One checker of optimality for every rule's answer: the Karush-Kuhn-Tucker residuals of the allocation's QP.
#
#     minimise 1/2 sum m (x - Mu_z)^2   subject to   sum m x = attainable sum m,   lower <= x <= upper.
#
# With the level L as multiplier of the sum, a unit inside its bounds must stand at L; at its upper bound L may lie
# above it, at its lower bound below it.


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


# The last step of every solver of the quadratic program: from its active set to the optimum itself, with a certificate.
#
# A first-order or interior-point method comes as near as its tolerances say, which is not near if masses are a million
# apart. But it does find out which units are at a bound. With these fixed, the conditions of optimality are linear: the
# other units are at one level L, which follows from the sum. If L fits the bounds, the answer is the optimum; otherwise
# the guess was wrong.


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


# The best possible result: the exact level, by a rule that knows the rail.


@jit
def oracle_law(units, expected, limit_out):
    """Limits at the exact level of the true coefficients."""
    return exact_limits(units.truth, expected, units.mass, units.limit_max, limit_out)


def answer_oracle(problem: AllocationProblem) -> Allocation:
    """The exact answer to the problem with the true coefficients."""
    return answer_exact(problem.changed(cap=problem.available))


ORACLE = Rule(
    "oracle", "the exact level on the true coefficients: what could be had at best", answer_oracle,
    oracle_law, trigger=Trigger.PERIOD, caps=Caps.TRUE, promise="exact", colour="#000000", marker="*",
)  # fmt: skip
RULES.register("oracle", ORACLE)


# This project's own rule: limited units deliver what they can, and the others make up for the shortfall together.
#
# It uses what the units report, see `alloc.old.onboard.telegrams`: whether they are limited, and what they deliver. It uses
# no belief about the rail, neither the increments nor a curve.
#
# - **Own caps.** A limited unit's cap is what it delivers. Every other unit may go up to the coefficient that it has
#   shown to
#   carry, and one that was never limited may go up to its torque limit. The exact level over these caps makes up for
#   the
#   shortfall.
# - **The plan at least.** No limit is below the plan. If a unit finds less adhesion, its own controller takes care of
#   it. That
#   controller finds the rail's recovery sooner than telegrams report it. What trailers lack comes from units with room
#   alone.
# - **Probing.** Beyond the plan a limit stays at the coefficient that the unit has shown, so its wheels do not work at
#   the
#   peak all the time. The mark rises slowly until the unit is limited once more, and falls slowly while it delivers
#   less.
# - **Room to search.** A limited unit is asked for a little more than it delivers. A controller that searches for the
#   peak
#   learns nothing while its torque is at the limit, and mistakes each change of the limit for a response of the rail.


@jit
def cooperative_law(units, expected, limit_out):
    """The exact level over all caps; every unit gets the plan at least, and beyond the plan at most `upper_bound`."""
    level, reached = exact_limits(units.cap, expected, units.mass, units.limit_max, limit_out)
    # out of reach every unit does what it can, the best one too
    most = level if reached else np.inf
    for j in range(limit_out.size):
        limit_out[j] = min(max(min(most, units.upper_bound[j]), units.plan), units.limit_max[j])
    return level, reached


COOPERATIVE = Rule(
    "cooperative", "limited units keep what they find, the others make up for it", answer_exact,
    cooperative_law, caps=Caps.DELIVERED, promise="exact", colour="#8e0055", marker="p",
)  # fmt: skip
RULES.register("cooperative", COOPERATIVE)


# What a preview of the rail could bring: `cooperative`, and what units ahead could report of the rail if they measured its
# peak without error.


@jit
def preview_law(units, expected, limit_out):
    """As `cooperative_law` with the truth as cap where it is told; there no limit exceeds it, not even up to the plan."""
    for j in range(limit_out.size):
        limit_out[j] = units.truth[j] if np.isfinite(units.truth[j]) else units.cap[j]
    level, reached = exact_limits(limit_out, expected, units.mass, units.limit_max, limit_out)
    most = level if reached else np.inf
    for j in range(limit_out.size):
        asked = max(min(most, units.upper_bound[j]), units.plan)
        limit_out[j] = min(asked, units.truth[j], units.limit_max[j])
    return level, reached


PREVIEW = Rule(
    "preview", "as cooperative, and told the true peak ahead of all units but the leader: what no train has",
    law=preview_law, caps=Caps.PREVIEW, promise="heuristic", colour="#211b04", marker="$V$",
)  # fmt: skip
RULES.register("preview", PREVIEW)
