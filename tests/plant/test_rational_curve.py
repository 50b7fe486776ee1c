"""Laws of the rational curve: its three numbers are peak, slip of the peak, and slope at the origin."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.plant.adhesion import CURVES, RationalCurve, SlipRatioCurve
from studies.scenario.loading import load_scenario

peaks, slips = st.floats(1e-3, 1.0), st.floats(0.005, 2.0)
steepnesses = st.floats(0.02, 100.0)
once = settings(max_examples=60, deadline=None, derandomize=True)


def _slope(curve, slip, peak, step=1e-6):
    """Derivative by central differences of fourth order; `step` over the slip of the peak."""
    h = step * curve.peak_slip
    near, far = (
        curve.coefficient(slip + k * h, peak) - curve.coefficient(slip - k * h, peak)
        for k in (1.0, 2.0)
    )
    return (8.0 * near - far) / (12.0 * h)


@once
@given(peak=peaks, top=slips, n=steepnesses)
def test_the_top_is_at_its_slip_whatever_the_steepness(peak, top, n):
    curve = RationalCurve(top, n)
    assert tuple(map(float, curve.limit(peak, 13.0))) == (peak, top)
    assert float(curve.coefficient(top, peak)) == pytest.approx(peak, rel=1e-12)
    x = np.concatenate([np.linspace(0.0, 0.999, 400), np.linspace(1.001, 50.0, 400)])
    assert curve.coefficient(top * x, peak).max() < peak
    # at steepness 0.02 the top is 0.07 peak slips narrow
    assert abs(_slope(curve, top, peak, 1e-4)) < 1e-5 * peak / top


@once
@given(peak=peaks, top=slips, n=steepnesses)
def test_the_slope_at_the_origin_is_steepness_times_peak_over_its_slip(peak, top, n):
    # the second derivative jumps at the origin, so differences from both sides cancel less well than one
    slope = float(RationalCurve(top, n).coefficient(1e-9 * top, peak)) / (1e-9 * top)
    assert slope == pytest.approx(n * peak / top, rel=1e-6)


@once
@given(peak=peaks, top=slips, n=steepnesses, x=st.just(0.0) | st.floats(1e-6, 30.0))
def test_it_is_the_same_beyond_the_peak_as_before_it_on_a_scale_of_ratios(peak, top, n, x):
    curve = RationalCurve(top, n)
    beyond = curve.coefficient(top / x, peak) if x > 0.0 else 0.0
    assert float(curve.coefficient(top * x, peak)) == pytest.approx(float(beyond), rel=1e-9)


@once
@given(peak=peaks, top=slips, n=st.floats(1e-4, 60.0))
def test_the_steepest_slope_is_the_least_bound(peak, top, n):
    curve = RationalCurve(top, n)
    x = np.concatenate([[0.0], np.geomspace(1e-4, 0.1, 500), np.linspace(0.1, 3.0, 20_000)])
    below = 1.0 + x * (x + n - 2.0)
    slopes = peak / top * n * (1.0 - x * x) / below**2
    bound = curve.steepest_slope(peak)
    assert np.abs(slopes).max() <= bound * (1.0 + 1e-9)
    assert np.abs(slopes).max() >= bound * (1.0 - 1e-3)


@once
@given(peak=peaks, top=slips, n=steepnesses, x=st.floats(0.01, 5.0))
def test_elasticity_level_and_slope_at_the_origin_tell_where_the_peak_is(peak, top, n, x):
    """Kiencke and Daiss: with D = slip times slope at the origin over the coefficient, e D = 1 - x^2."""
    curve = RationalCurve(top, n)
    coefficient = float(curve.coefficient(x * top, peak))
    elasticity = x * top * _slope(curve, x * top, peak, 1e-5 * x) / coefficient
    d = x * top * (n * peak / top) / coefficient
    assert elasticity * d == pytest.approx(1.0 - x * x, abs=1e-4 * max(1.0, d))


def test_with_steepness_2_it_is_the_rise_of_the_curve_by_slip_ratio():
    ratio, speed = 0.03, 20.0
    other = SlipRatioCurve(ratio, 0.0)
    slip = np.linspace(0.0, 3.0, 200)
    # where slip is small against the speed the two abscissae are alike
    x = slip / (speed + slip) / ratio
    np.testing.assert_allclose(
        RationalCurve(0.7, 2.0).coefficient(0.7 * x, 0.2),
        other.coefficient(slip, 0.2, speed),
        rtol=1e-12,
    )


def test_by_hand():
    # peak 0.12 at 0.1 m/s, steepness 4: a quarter of the peak's slip gives 4/4 / (1 + 2/4 + 1/16) = 16/25
    curve = RationalCurve(0.1, 4.0)
    assert float(curve.coefficient(0.025, 0.12)) == pytest.approx(0.12 * 16.0 / 25.0, rel=1e-12)
    assert float(curve.coefficient(-0.4, 0.12)) == pytest.approx(-0.12 * 16.0 / 25.0, rel=1e-12)
    assert curve.steepest_slope(0.12) == pytest.approx(4.8)
    # steepness 1 turns where x^3 - 3 x + 1 = 0, at x = 2 sin(10 degrees)
    x = 2.0 * np.sin(np.pi / 18.0)
    steepest = 1.2 * (1.0 - x * x) / (1.0 - x + x * x) ** 2
    assert RationalCurve(0.1, 1.0).steepest_slope(0.12) == pytest.approx(steepest, rel=1e-12)


def test_scenario_files_name_it(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text("""
title = "a rational rail"
train = "commuter-8car"
duration_s = 1.0
record_period_s = 0.02
[[command]]
time_s = 0.0
acceleration_kmhs = 3.0
[rail]
level = 0.1
increments = { law = "logarithmic" }
curve = { kind = "rational", peak_slip = 0.09, steepness = 5.0 }
""")
    assert CURVES["rational"] is RationalCurve
    event = load_scenario(path).event(0)
    assert event.model.rail.curve == RationalCurve(0.09, 5.0)
