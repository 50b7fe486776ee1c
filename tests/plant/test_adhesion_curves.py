"""Adhesion curves: the laws of every curve (`alloc.testing`), and those of one kind."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.balance import BRAKED
from alloc.plant.adhesion import CURVES as REGISTERED
from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    PiecewiseCurve,
    PolachByFrictionCurve,
    PolachCurve,
    RationalCurve,
    SlipRatioCurve,
)
from alloc.plant.laws import parabola_curvature, reference_speed
from alloc.testing import check_curve

CURVES = {
    "piecewise": PiecewiseCurve(),
    "piecewise-flat-tail": PiecewiseCurve(macro_slope=1e-3, residual_ratio=0.0),
    "piecewise-steep-tail": PiecewiseCurve(macro_slope=2.0, residual_ratio=0.95),
    "polach-dry": POLACH_DRY,
    "polach-wet": POLACH_WET,
    "polach-by-friction": PolachByFrictionCurve(),
    "slip-ratio": SlipRatioCurve(0.03, 1.0),
    "slip-ratio-falling": SlipRatioCurve(0.1, 0.4),
    "rational": RationalCurve(),
    "rational-flat": RationalCurve(0.3, 40.0),
    "rational-hollow": RationalCurve(0.05, 0.5),
}
CURVES |= {name: kind() for name, kind in REGISTERED.items() if kind() not in CURVES.values()}
peaks = st.floats(1e-3, 1.0)
speeds = st.floats(0.0, 100.0)
once = settings(max_examples=60, deadline=None, derandomize=True)


@pytest.mark.parametrize("curve", CURVES.values(), ids=CURVES)
def test_every_curve_keeps_the_laws_of_curves(curve):
    worst = {one.law.name: one.worst for one in check_curve(curve, 60)}
    assert worst["smooth"] <= 1e-4


@pytest.mark.parametrize("name", [name for name in CURVES if name.startswith("piecewise")])
@once
@given(peak=peaks)
def test_piecewise_slope_jumps_nowhere(name, peak):
    """Second differences on a gapless grid stay within the curvature of parabola and tail."""
    curve = CURVES[name]
    g2, residual = curve.macro_slope, curve.residual_ratio
    c = float(parabola_curvature(peak, *curve.q[:4]))
    top = float(curve.limit(peak)[1])
    end = 1.2 * (top + g2 / c)
    slip, d = np.linspace(0.0, end, 20001, retstep=True)
    second = np.abs(np.diff(curve.coefficient(slip, peak), 2))
    bound = max(2.0 * c, g2**2 / (peak * (1.0 - residual) - g2**2 / (4.0 * c)))
    assert second.max() <= 1.001 * bound * d**2 + 1e-15 * peak


@once
@given(peak=st.floats(0.02, 1.0))
def test_published_parabola_is_kept_where_it_makes_a_curve(peak):
    """Readhesion paper: C = 40 wherever the rail is not too slippery for it."""
    curve = PiecewiseCurve()
    narrowest = max(5.0**2 / 4.0, 0.05**2 / (2.0 * (1.0 - curve.residual_ratio))) / peak
    assert float(parabola_curvature(peak, *curve.q[:4])) == max(40.0, narrowest)


def test_published_points_of_the_piecewise_curve():
    """Readhesion paper (1)-(6) at mu_max = 0.18 by hand: slope 5, top at 0.036 + 5/160, residual 0.9."""
    curve, peak = PiecewiseCurve(), 0.18
    assert float(curve.coefficient(1e-3, peak)) == pytest.approx(5e-3, rel=1e-12)
    limit, top = curve.limit(peak)
    assert (float(limit), float(top)) == pytest.approx((0.18, 0.036 + 5.0 / 160.0))
    assert float(curve.coefficient(100.0, peak)) == pytest.approx(0.9 * 0.18, rel=1e-6)


def test_polach_initial_slope():
    """Polach (2005), (6): small creepage gives 2/pi (kA + kS) G pi abc11 / (4 Q) times creepage."""
    speed, creepage = 20.0, 1e-8
    value = PolachCurve(creep_stiffness=186.0).coefficient(creepage * speed, 0.3, speed)
    assert float(value) == pytest.approx(2.0 / np.pi * 0.4 * 186.0 * creepage, rel=1e-4)


def test_slip_ratio_curve_is_flat_beyond_its_peak():
    curve, speed = SlipRatioCurve(0.03, 1.0), 20.0
    braking = curve.coefficient(-speed * np.array([0.03, 0.1, 0.5, 1.0]), 0.1, speed)
    np.testing.assert_allclose(braking, -0.1, rtol=1e-12)


CREEPING = [
    name for name in CURVES if name.startswith(("polach", "slip")) and "default" not in name
]


@pytest.mark.parametrize("name", CREEPING)
@pytest.mark.parametrize("slip", [-0.3, 0.02, 0.5, 5.0])
def test_no_kink_at_low_speed(name, slip):
    """Slopes over the speed agree from both sides, but where the rim turns round or is as fast as the train."""
    curve, d = CURVES[name], 1e-6
    speed = np.linspace(0.0, 4.0, 4001)
    faster = np.abs(np.abs(speed + slip) - speed) < 1e-3
    speed = speed[~faster & (np.abs(speed + slip) > 1e-3) & (speed > 1e-3)]
    left, here, right = (curve.coefficient(slip, 0.2, speed + k * d) for k in (-1.0, 0.0, 1.0))
    np.testing.assert_allclose((here - left) / d, (right - here) / d, rtol=0, atol=2e-5)


@pytest.mark.parametrize("name", CREEPING)
@once
@given(
    peak=st.floats(0.02, 0.6), speed=speeds, load=st.floats(20e3, 200e3),
    radius=st.floats(0.3, 0.65), braking=st.booleans(),
)  # fmt: skip
def test_macro_slip_never_rises(name, peak, speed, load, radius, braking):
    """Over load, radius, speed and level: one rise to the limit, then no rise, driving and braking up to a lock."""
    curve = CURVES[name]
    contact = curve.contact(load, radius)
    limit, top = curve.limit(peak, speed, contact)
    slip = np.concatenate([np.linspace(0.0, 3.0 * top, 300), np.geomspace(3.0 * top, 100.0, 300)])
    if braking:
        slip = np.minimum(slip, speed)
    value = curve.coefficient(-slip if braking else slip, peak, speed, contact)
    value = np.abs(value)
    highest = value.argmax()
    rounding = 1e-9 * limit
    assert np.all(np.diff(value[: highest + 1]) >= -rounding)
    assert np.all(np.diff(value[highest:]) <= rounding)
    if not braking:
        assert value.max() <= limit * (1.0 + 1e-9)


def test_creepage_counts_the_speed_itself_above_twice_the_floor():
    speed = np.linspace(2.0, 100.0, 50)
    np.testing.assert_array_equal(reference_speed(speed, speed), speed)
    assert float(reference_speed(0.0, 0.0)) == 1.0


def test_a_braked_wheel_exceeds_the_limit_of_a_driving_one_by_no_more_than_a_sound_run_may():
    speeds = np.concatenate([np.geomspace(5e-3, 1.0, 40), np.linspace(1.0, 60.0, 30)])
    for name, curve in CURVES.items():
        for peak in (0.02, 0.1, 0.3, 0.6):
            for speed in speeds:
                held = np.abs(curve.coefficient(-np.linspace(0.0, speed, 200), peak, speed)).max()
                assert held <= (1.0 + BRAKED) * float(curve.limit(peak, speed)[0]), (
                    name,
                    peak,
                    speed,
                )
