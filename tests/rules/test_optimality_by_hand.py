"""Residuals of the optimality checker for answers that are wrong in one way each, computed by hand."""

import math

import numpy as np
import pytest

from alloc.rules import AllocationProblem, optimality
from alloc.rules.exact import fitted_level
from alloc.rules.problem import CASE_B, allocation

# Unit 1 lacks 2 x 0.05, which units 2 and 3 make up by 0.05 each: the optimum is 0.15, 0.25, 0.25 and the level 0.25.
PROBLEM = AllocationProblem([0.15, 0.30, 0.40], 0.2, mass=[2.0, 1.0, 1.0])


def checked(limit, level, problem=PROBLEM, **options):
    """primal, dual, complementarity, stationarity, gap and level of these limits."""
    answer = allocation(problem, np.array(limit), level, CASE_B, 0.0)
    found = optimality(problem, answer, **options)
    return (
        found.primal, found.dual, found.complementarity, found.stationarity, found.gap, found.level,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("limit", "level", "expected"),
    [
        ([0.15, 0.25, 0.25], 0.25, (0, 0, 0, 0, 0, 0.25)),
        # inside their bounds at 0.04 below and 0.02 above the level: 0.02 / 4 are missed
        ([0.15, 0.21, 0.27], 0.25, (0.005, 0, 0, 0.04, math.sqrt((0.04**2 + 0.02**2) / 4), 0.25)),
        # without a level the mean of units 2 and 3 stands for it
        ([0.15, 0.22, 0.28], math.nan, (0, 0, 0, 0.03, math.sqrt(2 * 0.03**2 / 4), 0.25)),
        # unit 1 beyond its cap by 0.01, of twice the mass
        ([0.16, 0.24, 0.24], 0.24, (0.01, 0, 0.01, 0, math.sqrt((2 * 0.01**2 + 2 * 0.01**2) / 4), 0.24)),
        # at its upper bound although above the level
        ([0.15, 0.30, 0.20], 0.20, (0, 0.10, 0, 0, math.sqrt(2 * 0.05**2 / 4), 0.20)),
        # unit 3 at its lower bound although below the level; unit 1 holds 2 x 0.10 less
        ([0.05, 0.30, 0.00], 0.30, (0.1, 0.30, 0, 0.25, math.sqrt((2 * 0.1**2 + 0.05**2 + 0.25**2) / 4), 0.30)),
    ],
)  # fmt: skip
def test_residuals_are_those_by_hand(limit, level, expected):
    assert checked(limit, level) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_a_limit_below_its_lower_bound_by_hand():
    # bounds 0.10 to 0.15, 0.20 to 0.30, 0.20 to 0.30; unit 3 is 0.02 below its own, and 0.09 below the level
    held = PROBLEM.changed(previous=[0.15, 0.25, 0.25], rate=0.05)
    expected = (0.02, 0.09, 0.02, 0, math.sqrt((0.02**2 + 0.07**2) / 4), 0.27)
    assert checked([0.15, 0.27, 0.18], 0.27, held) == pytest.approx(expected, rel=1e-9, abs=1e-15)


def test_where_both_bounds_meet_a_multiplier_has_either_sign():
    fixed = AllocationProblem([0.3], 0.2, previous=[0.15], rate=0.0)
    for level in (0.10, 0.25):
        assert checked([0.15], level, fixed)[:5] == (0.0, 0.0, 0.0, 0.0, 0.0)


def test_near_a_bound_counts_as_at_it_by_the_tolerance():
    # 1e-4 below the cap, with a multiplier of 0.05: it stands at its bound if 1e-4 is near
    limit = [0.15, 0.2499, 0.2501]
    bounded = AllocationProblem([0.15, 0.25, 0.40], 0.2, mass=[2.0, 1.0, 1.0])
    far = checked(limit, 0.30, bounded, tolerance=1e-4)
    near = checked(limit, 0.30, bounded, tolerance=1e-3)
    assert far[2:4] == pytest.approx((0.0, 0.0501), rel=1e-9)
    assert near[2:4] == pytest.approx((1e-4, 0.0499), rel=1e-9)


def test_the_level_that_fits_best():
    # the free units' mean by mass; else the highest that stands at its cap; else the lowest
    free = AllocationProblem([0.3, 0.3, 0.1], 0.2, mass=[3.0, 1.0, 1.0])
    assert fitted_level(np.array([0.2, 0.24, 0.1]), free) == pytest.approx(0.21, rel=1e-12)
    assert fitted_level(np.array([0.3, 0.0, 0.1]), free) == 0.3
    held = free.changed(previous=[0.25, 0.28, 0.09], rate=[0.03, 0.02, 0.005])
    assert fitted_level(np.array([0.22, 0.26, 0.085]), held) == pytest.approx(0.085)


def test_what_is_near_a_bound_does_not_tell_the_level():
    # 2e-4 is near, by 1e-3 of the plan: so the second unit stands at its cap, and 1e-3 below it is free
    problem = AllocationProblem([0.3, 0.1], 0.2)
    for low, level in ((0.0999, 0.25), (0.099, 0.1745)):
        assert fitted_level(np.array([0.25, low]), problem, 1e-3) == pytest.approx(level)


def test_worst_is_the_largest_residual():
    answer = allocation(PROBLEM, np.array([0.15, 0.30, 0.20]), 0.20, CASE_B, 0.0)
    assert optimality(PROBLEM, answer).worst == pytest.approx(0.10)
