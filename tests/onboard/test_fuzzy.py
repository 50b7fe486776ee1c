"""The fuzzy law: sets that share every value among them, rules in order, and what follows for the surface."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.errors import OnboardError
from alloc.onboard.brakes import LAWS, SENSITIVITIES, Fuzzy, SlideProtection, Threshold
from alloc.onboard.laws import HOLD, RELEASE, RULES, SUPPLY, infer, memberships, valve_action

SLIP, RATE = (0.0, 0.05, 0.15), (-1.0, 0.0, 1.0)
slips = st.floats(0.0, 1.0)
rates = st.floats(-20.0, 20.0)
sensitivities = st.floats(0.1, 10.0)
EXACT = 1e-12


@given(st.floats(-10.0, 10.0))
def test_sets_share_every_value(x):
    degrees = memberships(x, *RATE)
    assert all(0.0 <= degree <= 1.0 for degree in degrees)
    assert sum(degrees) == pytest.approx(1.0)


def test_rules_are_ordered():
    assert np.all(np.diff(RULES, axis=0) >= 0.0)
    assert np.all(np.diff(RULES, axis=1) >= 0.0)


def test_at_the_peaks_of_two_sets_their_rule_alone_speaks():
    found = [[infer(slip, rate, 1.0, SLIP, RATE) for rate in RATE] for slip in SLIP]
    np.testing.assert_allclose(found, RULES, atol=EXACT)


@given(slips, slips, rates, sensitivities)
def test_more_slip_never_asks_for_more_brake(a, b, rate, sensitivity):
    low, high = (infer(s, rate, sensitivity, SLIP, RATE) for s in sorted((a, b)))
    assert SUPPLY - EXACT <= low <= high + EXACT <= RELEASE + 2 * EXACT


@given(slips, rates, rates, sensitivities)
def test_growing_slip_never_asks_for_more_brake(slip, a, b, sensitivity):
    low, high = (infer(slip, r, sensitivity, SLIP, RATE) for r in sorted((a, b)))
    assert low <= high + EXACT


@given(slips, st.floats(0.0, 20.0), sensitivities, sensitivities)
def test_more_sensitivity_never_asks_for_more_brake_of_a_slide_that_grows(slip, rate, a, b):
    low, high = (infer(slip, rate, s, SLIP, RATE) for s in sorted((a, b)))
    assert low <= high + EXACT


def test_sensitivity_is_a_scale():
    assert infer(0.03, 0.2, 2.0, SLIP, RATE) == pytest.approx(infer(0.06, 0.4, 1.0, SLIP, RATE))


def test_rolling_wheels_are_supplied():
    for sensitivity in SENSITIVITIES.values():
        assert valve_action(infer(0.0, 0.0, sensitivity, SLIP, RATE)) == SUPPLY


@pytest.mark.parametrize(
    ("inferred", "action"),
    [(0.0, SUPPLY), (0.49, SUPPLY), (0.51, HOLD), (1.49, HOLD), (1.51, RELEASE), (2.0, RELEASE)],
)
def test_the_nearest_action_is_taken(inferred, action):
    assert valve_action(inferred) == action


def test_the_settings_are_named_in_their_order():
    assert list(SENSITIVITIES) == ["low", "medium", "high"]
    assert sorted(SENSITIVITIES.values()) == list(SENSITIVITIES.values())
    assert Fuzzy().sensitivity == SENSITIVITIES["medium"] == 1.0


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (Fuzzy, {"sensitivity": 0.0}, "sensitivity = 0.0"),
        (Fuzzy, {"slip": (0.0, 0.2, 0.1)}, "three growing numbers"),
        (Fuzzy, {"rate": (-1.0, 0.0, math.nan)}, "three growing numbers"),
        (Fuzzy, {"pole": -1.0}, "pole = -1.0"),
        (Threshold, {"hold": 0.2, "release": 0.1}, "must not exceed release"),
        (SlideProtection, {"law": "fuzy"}, "must be one of none, threshold, fuzzy"),
        (SlideProtection, {"refill": -0.1}, "refill = -0.1"),
        (SlideProtection, {"time_out": 0.0}, "time_out = 0.0"),
    ],
)
def test_impossible_parameters_are_refused(kind, values, words):
    with pytest.raises(OnboardError, match=words):
        kind(**values)


def test_every_law_can_be_chosen():
    assert [SlideProtection(law=law).law for law in LAWS] == ["none", "threshold", "fuzzy"]
