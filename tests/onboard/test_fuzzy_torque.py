"""Surfaces of the fuzzy controllers: ordered, bounded, and at rest where they should be."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.errors import OnboardError
from alloc.onboard.controllers.creep import CreepControl, FuzzyCreep, allowed_rate
from alloc.onboard.controllers.search import FuzzyTracking, inferred_step

CREEP, TRACKING = FuzzyCreep(), FuzzyTracking()
SLIP, RATE = st.floats(-1.0, 3.0), st.floats(-20.0, 20.0)
CHANGE, WAY = st.floats(-0.05, 0.05), st.floats(-0.1, 0.1)
EXACT = 1e-12


@given(SLIP, SLIP, RATE, RATE)
def test_more_slip_or_more_growth_never_allows_more(slip, other, rate, growth):
    (low, high), (slow, fast) = sorted((slip, other)), sorted((rate, growth))
    assert allowed_rate(high, rate, CREEP) <= allowed_rate(low, rate, CREEP) + EXACT
    assert allowed_rate(slip, fast, CREEP) <= allowed_rate(slip, slow, CREEP) + EXACT
    assert abs(allowed_rate(slip, rate, CREEP)) <= CREEP.change + EXACT


def test_at_its_reference_steady_slip_changes_nothing_and_near_it_creep_control_is_met():
    assert allowed_rate(CREEP.reference, 0.0, CREEP) == 0.0
    linear = CreepControl()
    d = 1e-3
    below = allowed_rate(CREEP.reference - d, 0.0, CREEP)
    assert below == pytest.approx(linear.integral * d, rel=0.05)
    growing = allowed_rate(CREEP.reference, d, CREEP)
    assert growing == pytest.approx(-linear.proportional * d, rel=0.05)


def test_what_runs_away_loses_torque_and_what_comes_back_does_not():
    assert allowed_rate(1.0, 5.0, CREEP) == pytest.approx(-CREEP.change)
    assert allowed_rate(1.0, -5.0, CREEP) == pytest.approx(0.0, abs=EXACT)
    assert allowed_rate(0.0, 5.0, CREEP) == pytest.approx(0.0, abs=EXACT)
    assert allowed_rate(0.0, 0.0, CREEP) == pytest.approx(CREEP.change)


@given(CHANGE, CHANGE, WAY)
def test_the_more_the_coefficient_rose_the_further_the_search_goes_on(one, other, way):
    low, high = (inferred_step(0.01, c, abs(way), TRACKING) for c in sorted((one, other)))
    if one * other * way != 0.0:
        assert low <= high + EXACT


@given(st.sampled_from([-0.01, 0.01]), CHANGE, WAY)
def test_an_inferred_step_is_bounded_and_points_to_more_adhesion(last, change, way):
    step = inferred_step(last, change, way, TRACKING)
    assert TRACKING.least <= abs(step) <= TRACKING.largest * (1.0 + EXACT)
    if abs(change * way) > 1e-9:
        assert math.copysign(1, step) == math.copysign(1, change) * math.copysign(1, way)


def test_where_the_rules_say_nothing_the_search_turns():
    assert inferred_step(0.02, 0.0, 0.01, TRACKING) == -TRACKING.least
    assert inferred_step(-0.02, 0.01, 0.0, TRACKING) == TRACKING.least


def test_bounds_in_the_wrong_order_are_refused():
    with pytest.raises(OnboardError, match="reference"):
        FuzzyCreep(reference=0.4)
    with pytest.raises(OnboardError, match="least"):
        FuzzyTracking(least=0.1)
