"""The belief about the peak follows what slipping axles feel, and rises slowly where nothing slips."""

import math

import numpy as np
import pytest

from mpc.belief import CurveObserver
from mpc.settings import PeakBelief

PERIOD, PEAK = 0.01, 0.12
BELIEF = PeakBelief(initial=0.2)


def _drive(observer, context, peak, slip, seconds, acceleration=0.5):
    """An axle that runs at constant `slip` on a rail of `peak`, with the torque that this takes."""
    wheel = context.inertia * acceleration / context.radius
    for k in range(round(seconds / PERIOD)):
        speed = 10.0 + acceleration * k * PERIOD
        coefficient = float(context.curve.coefficient(slip, peak, speed))
        torque = (coefficient * context.axle_load * context.radius + wheel) / context.gear_ratio
        omega = np.full(context.axles, (speed + slip) / context.radius)
        observer.update(speed, omega, torque)
    return coefficient


def test_axle_coefficient_is_that_of_the_rail(context):
    observer = CurveObserver(context, BELIEF)
    coefficient = _drive(observer, context, PEAK, 0.02, 0.5)
    np.testing.assert_allclose(observer.coefficient, coefficient, rtol=1e-4)


@pytest.mark.parametrize("curve", ["piecewise", "polach"])
@pytest.mark.parametrize("ratio", [2.0, 5.0])
def test_slipping_axles_tell_the_peak(make_context, curve, ratio):
    # wherever beyond the peak they slip: the curve says what share of the peak they feel
    context = make_context(curve)
    slip = ratio * float(context.curve.limit(PEAK, 10.0)[1])
    observer = CurveObserver(context, BELIEF)
    _drive(observer, context, PEAK, slip, 3.0)
    np.testing.assert_allclose(observer.peak, PEAK, rtol=2e-3)


def test_untested_belief_rises_at_the_probing_rate_to_the_ceiling(context):
    observer = CurveObserver(context, BELIEF)
    _drive(observer, context, PEAK, 0.005, 2.0)
    np.testing.assert_allclose(observer.peak, 0.2 * math.exp(2.0 * BELIEF.probe), rtol=1e-9)
    ceiling = PeakBelief(probe=5.0, ceiling=0.3)
    observer = CurveObserver(context, ceiling)
    _drive(observer, context, PEAK, 0.005, 2.0)
    np.testing.assert_array_equal(observer.peak, 0.3)


def test_an_axle_that_feels_more_than_believed_raises_the_belief(context):
    observer = CurveObserver(context, PeakBelief(initial=0.05, probe=0.0))
    coefficient = _drive(observer, context, 0.2, 0.02, 1.0)
    assert coefficient > 0.05
    # the observer starts in equilibrium, and its first values hold the wheelset's acceleration
    np.testing.assert_allclose(observer.peak, coefficient, rtol=0.02)


def test_belief_of_one_axle_leaves_the_others_alone(context):
    observer = CurveObserver(context, PeakBelief(probe=0.0))
    for _ in range(100):
        omega = np.array([10.005, 10.005, 10.005, 10.3]) / context.radius
        observer.update(10.0, omega, 0.1 * context.axle_load * context.radius / 7.07)
    np.testing.assert_array_equal(observer.peak[:3], 0.2)
    felt = context.curve.coefficient(0.3, observer.peak[3])
    assert felt == pytest.approx(0.1, rel=1e-3)


def test_peak_slip_is_that_of_the_believed_curve(context):
    observer = CurveObserver(context, BELIEF)
    _drive(observer, context, PEAK, 0.15, 0.3)
    np.testing.assert_allclose(observer.peak_slip, context.curve.limit(observer.peak, 10.0)[1])


def test_measured_slip_within_its_error_does_not_lower_the_belief(context):
    # white noise of the speed sensors on a rolling axle: without the margin it passes for slip on a rail without adhesion
    rng = np.random.default_rng(3)
    careful, rash = (
        CurveObserver(context, PeakBelief(initial=0.05, probe=0.0, **margins))
        for margins in ({}, {"slip_error": 0.0, "noise_margin": 0.0})
    )
    for _ in range(500):
        omega = (10.02 + 0.01 * rng.standard_normal(4)) / context.radius
        careful.update(10.0, omega, 20.0)
        rash.update(10.0, omega, 20.0)
    assert careful.peak.min() > 0.04
    assert rash.peak.min() < 0.02
