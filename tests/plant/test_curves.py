"""Adhesion curves: the laws of every curve (`alloc.testing`), those of one kind, and Polach's against Open Rails."""

import math
import pkgutil
from dataclasses import dataclass
from importlib import import_module

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import studies
from alloc.balance import BRAKED
from alloc.errors import PlantError
from alloc.metrics import METRICS
from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import CURVES as REGISTERED
from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    ExponentialDifference,
    PiecewiseCurve,
    PolachByFrictionCurve,
    PolachCurve,
    RationalCurve,
    RigPolachCurve,
    ShapedCurve,
    SlipRatioCurve,
    creep_stiffness,
)
from alloc.plant.laws import (
    TABULATED,
    adhesion_limit,
    parabola_curvature,
    polach_set,
    reference_speed,
    tangential_coefficient,
)
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import SETS
from alloc.plant.train import Train
from alloc.rules import RULES
from alloc.testing import check_curve
from tests.cases import looped

CURVES = {
    "piecewise": PiecewiseCurve(),
    "piecewise-flat-tail": PiecewiseCurve(macro_slope=1e-3, residual_ratio=0.0),
    "piecewise-steep-tail": PiecewiseCurve(macro_slope=2.0, residual_ratio=0.95),
    "piecewise-constant-residual": PiecewiseCurve(residual_ratio=0.97, constant_residual=0.05),
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


any_speed = st.floats(0.0, 100.0)


once = settings(max_examples=60, deadline=None, derandomize=True)


@looped("curve", CURVES.values())
def test_every_curve_keeps_the_laws_of_curves(curve):
    worst = {one.law.name: one.worst for one in check_curve(curve, 60)}
    assert worst["smooth"] <= 1e-4


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


@once
@given(peak=st.floats(0.02, 1.0), slip=st.floats(-20.0, 20.0))
def test_a_constant_residual_is_another_ratio_at_every_peak(peak, slip):
    curve = PiecewiseCurve(residual_ratio=0.97, constant_residual=0.1)
    same = PiecewiseCurve(residual_ratio=min(0.97, 0.1 / peak))
    assert float(curve.coefficient(slip, peak)) == pytest.approx(
        float(same.coefficient(slip, peak)), rel=1e-12
    )
    assert curve.residual(peak) == pytest.approx(float(curve.coefficient(1e4, peak)), rel=1e-12)


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


@looped("name", CREEPING)
@looped("slip", [-0.3, 0.02, 0.5, 5.0])
def test_no_kink_at_low_speed(name, slip):
    """Slopes over the speed agree from both sides, but where the rim turns round or is as fast as the train."""
    curve, d = CURVES[name], 1e-6
    speed = np.linspace(0.0, 4.0, 4001)
    faster = np.abs(np.abs(speed + slip) - speed) < 1e-3
    speed = speed[~faster & (np.abs(speed + slip) > 1e-3) & (speed > 1e-3)]
    left, here, right = (curve.coefficient(slip, 0.2, speed + k * d) for k in (-1.0, 0.0, 1.0))
    np.testing.assert_allclose((here - left) / d, (right - here) / d, rtol=0, atol=2e-5)


@looped("name", CREEPING)
@once
@given(
    peak=st.floats(0.02, 0.6), speed=any_speed, load=st.floats(20e3, 200e3),
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
    any_speed = np.concatenate([np.geomspace(5e-3, 1.0, 40), np.linspace(1.0, 60.0, 30)])
    for name, curve in CURVES.items():
        for peak in (0.02, 0.1, 0.3, 0.6):
            for speed in any_speed:
                held = np.abs(curve.coefficient(-np.linspace(0.0, speed, 200), peak, speed)).max()
                assert held <= (1.0 + BRAKED) * float(curve.limit(peak, speed)[0]), (
                    name,
                    peak,
                    speed,
                )


any_peak, any_slip = st.floats(1e-3, 1.0), st.floats(0.005, 2.0)


steepnesses = st.floats(0.02, 100.0)


sixty = settings(max_examples=60, deadline=None, derandomize=True)


def _slope(curve, slip, peak, step=1e-6):
    """Derivative by central differences of fourth order; `step` over the slip of the peak."""
    h = step * curve.peak_slip
    near, far = (
        curve.coefficient(slip + k * h, peak) - curve.coefficient(slip - k * h, peak)
        for k in (1.0, 2.0)
    )
    return (8.0 * near - far) / (12.0 * h)


@sixty
@given(peak=any_peak, top=any_slip, n=steepnesses)
def test_the_slope_at_the_origin_is_steepness_times_peak_over_its_slip(peak, top, n):
    # the second derivative jumps at the origin, so differences from both sides cancel less well than one
    slope = float(RationalCurve(top, n).coefficient(1e-9 * top, peak)) / (1e-9 * top)
    assert slope == pytest.approx(n * peak / top, rel=1e-6)


@sixty
@given(peak=any_peak, top=any_slip, n=steepnesses, x=st.just(0.0) | st.floats(1e-6, 30.0))
def test_it_is_the_same_beyond_the_peak_as_before_it_on_a_scale_of_ratios(peak, top, n, x):
    curve = RationalCurve(top, n)
    beyond = curve.coefficient(top / x, peak) if x > 0.0 else 0.0
    assert float(curve.coefficient(top * x, peak)) == pytest.approx(float(beyond), rel=1e-9)


@sixty
@given(peak=any_peak, top=any_slip, n=st.floats(1e-4, 60.0))
def test_the_steepest_slope_is_the_least_bound(peak, top, n):
    curve = RationalCurve(top, n)
    x = np.concatenate([[0.0], np.geomspace(1e-4, 0.1, 500), np.linspace(0.1, 3.0, 20_000)])
    below = 1.0 + x * (x + n - 2.0)
    slopes = peak / top * n * (1.0 - x * x) / below**2
    bound = curve.steepest_slope(peak)
    assert np.abs(slopes).max() <= bound * (1.0 + 1e-9)
    assert np.abs(slopes).max() >= bound * (1.0 - 1e-3)


@sixty
@given(peak=any_peak, top=any_slip, n=steepnesses, x=st.floats(0.01, 5.0))
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


forty = settings(max_examples=40, deadline=None, derandomize=True)


WIDE_SLIP = np.concatenate([np.geomspace(1e-4, 0.1, 100), np.linspace(0.1, 20.0, 2000)])


def open_rails(slip, friction, speed, load, radius, faults=False):
    """Open Rails' coefficient on straight track, with spin; `load` of a wheel.

    With its `faults` an area in mm2 meets a modulus in Pa, and kA is not squared with the gradient.
    """
    b = 6.0  # mm
    a = 1.52 * np.sqrt(load / 1e3 * radius * 1e3 * 1e3 / (2.0 * b * 207000.0))
    c11 = np.polyval([0.32955, 0.48538, 3.4992], a / b)
    area = a * b * (1.0 if faults else 1e-6)
    fall = max(1.6 * friction - 0.28, 0.2)
    k_adhesion, k_slip = max(2.8 * friction - 0.54, 0.3), max(1.2 * friction - 0.26, 0.1)
    mu = friction * (0.4 + 0.6 * np.exp(-fall * slip))
    longitudinal, spin = slip / speed, np.sin(np.deg2rad(3.0)) / radius * a * 1e-3
    creepage = np.hypot(longitudinal, spin)
    eps = 8.4e10 * np.pi * area * c11 / (4.0 * load * mu) * creepage
    below = 1.0 + (k_adhesion * eps**2 if faults else (k_adhesion * eps) ** 2)
    total = 2.0 * mu / np.pi * (k_adhesion * eps / below + np.arctan(k_slip * eps))
    return total * longitudinal / creepage


@looped("curve", [POLACH_WET, PolachByFrictionCurve()])
def test_the_corrected_formula_of_open_rails(curve):
    """At 0.30, 20 m/s, 100 kN and 0.5 m, braking from micro slip to a lock: within 1 % of the peak."""
    expected = open_rails(WIDE_SLIP, 0.30, 20.0, 1e5, 0.5)
    value = -curve.coefficient(-WIDE_SLIP, 0.30, 20.0, curve.contact(1e5, 0.5))
    assert expected.max() == pytest.approx(0.2244, abs=1e-4)
    assert np.abs(value - expected).max() < 0.01 * expected.max()


@looped("friction", [0.1, 0.3, 0.42, 0.55])
@looped(("load", "radius"), [(60e3, 0.43), (100e3, 0.5), (180e3, 0.53)])
def test_open_rails_family_next_door(friction, load, radius):
    """There C11 follows a / b of each load, here the ratio is given: 2 % of the peak's height, 8 % of its slip."""
    curve, speed = PolachByFrictionCurve(), 10.0
    slip = WIDE_SLIP[speed > WIDE_SLIP]
    expected = open_rails(slip, friction, speed, load, radius)
    value = -curve.coefficient(-slip, friction, speed, curve.contact(load, radius))
    assert value.max() == pytest.approx(expected.max(), rel=0.02)
    assert slip[value.argmax()] == pytest.approx(slip[expected.argmax()], rel=0.08)


def test_open_rails_as_coded_gives_another_curve():
    """Its peak is 31 % higher and lies at a twelfth of the slip."""
    fine = np.geomspace(1e-3, 20.0, 4000)
    right, coded = (open_rails(fine, 0.30, 20.0, 1e5, 0.5, faults) for faults in (False, True))
    assert (right.max(), fine[right.argmax()]) == pytest.approx((0.2244, 1.405), rel=5e-3)
    assert (coded.max(), fine[coded.argmax()]) == pytest.approx((0.294, 0.12), rel=0.05)


@forty
@given(load=st.floats(20e3, 200e3), radius=st.floats(0.3, 0.65), factor=st.floats(0.2, 5.0))
def test_stiffness_falls_with_the_root_of_the_load(load, radius, factor):
    curve = PolachCurve()
    one, other = curve.on(load, radius), curve.on(factor * load, radius)
    assert other.creep_stiffness == pytest.approx(one.creep_stiffness / np.sqrt(factor), rel=1e-12)
    wider = curve.on(load, factor * radius)
    assert wider.creep_stiffness == pytest.approx(one.creep_stiffness * np.sqrt(factor), rel=1e-12)


def test_stiffness_of_the_reference_contact():
    assert creep_stiffness() == pytest.approx(120.8, abs=0.1)
    assert PolachCurve().on(1e5, 0.5).creep_stiffness == pytest.approx(creep_stiffness())
    # Kalker, Poisson's ratio 0.25: C11 grows from 3.6 at a / b = 0.5 to 4.1 at 1, 14 %
    assert creep_stiffness(1.0) / creep_stiffness(0.5) == pytest.approx(1.14, abs=0.02)


def test_a_given_stiffness_counts_for_every_axle():
    curve = PolachCurve(creep_stiffness=186.0)
    np.testing.assert_array_equal(curve.contact([5e4, 1e5], 0.43), 1.0)
    assert curve.on(5e4, 0.43) == curve


def test_each_axle_has_the_stiffness_of_its_load(car):
    """A light car before a heavy one."""
    cars = (car(True, mass=20e3), car(True, mass=80e3))
    model = build(Train("two", cars), Rail(0.3, curve=POLACH_WET))
    wheel_load = 0.5 * model.structure.static_load
    expected = np.sqrt(1e5 / wheel_load * 0.43 / 0.5)
    np.testing.assert_allclose(model.environment.contact, expected, rtol=1e-12)


def test_polach_sets_lie_on_the_family():
    """Dry at 0.55, wet at 0.30 and below."""
    family = PolachByFrictionCurve()
    for friction, curve in ((0.55, POLACH_DRY), (0.30, POLACH_WET), (0.05, POLACH_WET)):
        named = polach_set(family.kind, family.q, np.array(friction))
        own = polach_set(curve.kind, curve.q, np.array(friction))
        np.testing.assert_allclose(named, own, rtol=1e-12)


def test_the_rigs_set_has_its_peak_where_the_rig_found_it():
    """Below 1 % slip, at less the faster, and a coefficient that falls with speed and with the load of the axle."""
    rig, speed = RigPolachCurve(), np.array([10.0, 20.0, 40.0, 80.0])
    for friction in (0.08, 0.15, 0.28):
        heights = []
        for load in (40e3, 110e3):
            height, slip = rig.limit(friction, speed, rig.contact(load, 0.46))
            ratio = slip / (speed + slip)
            assert ratio.max() < 0.01
            assert (np.diff(ratio) < 0.0).all()
            assert (np.diff(height) < 0.0).all()
            heights.append(height)
        assert (heights[1] < heights[0]).all()
    # Polach's own wet set is what the rig is not
    assert POLACH_WET.limit(0.28, 20.0)[1] / 20.0 > 0.05


@looped("values", [{"creep_stiffness": 0.0}, {"half_axes_ratio": 3.0}])
def test_impossible_contacts_are_refused(values):
    for curve in (PolachCurve, PolachByFrictionCurve):
        with pytest.raises(PlantError, match=next(iter(values))):
            curve(**values)


@dataclass(frozen=True)
class DoubleExponential(ShapedCurve):
    a: float = 0.54
    b: float = 1.2

    def shape(self, slip):
        return np.exp(-self.a * slip) - np.exp(-self.b * slip)

    @property
    def top(self):
        return np.log(self.b / self.a) / (self.b - self.a)


@dataclass(frozen=True)
class Faulty(ShapedCurve):
    values: str = "nan"

    def shape(self, slip):
        return {
            "nan": np.full_like(slip, np.nan),
            "negative": -slip,
            "no maximum": slip,
            "not from 0": np.exp(-slip),
            "one value": np.array(1.0),
        }[self.values]


SLIP = np.linspace(0.0, 25.0, 4001)


@looped("curve", [DoubleExponential(), DoubleExponential(0.1, 50.0)])
def test_the_shape_is_met_at_every_slip_and_scaled_to_the_peak(curve):
    shape = curve.shape(SLIP) / curve.shape(np.array(curve.top))
    np.testing.assert_allclose(curve.coefficient(SLIP, 0.2), 0.2 * shape, atol=2e-5 * 0.2)
    np.testing.assert_allclose(curve.coefficient(-SLIP, 0.2), -0.2 * shape, atol=2e-5 * 0.2)


def test_a_steep_shape_keeps_the_laws_of_curves():
    check_curve(DoubleExponential(1.0, 60.0), 60)


def test_compiled_code_agrees():
    curve = DoubleExponential()

    @numba.njit
    def compiled(q, slip, peak):
        return tangential_coefficient(TABULATED, q, slip, 10.0, 10.0 + slip, peak), adhesion_limit(
            TABULATED, q, peak, 10.0
        )

    for slip in (-3.0, -0.01, 0.0, 0.7, 1e6):
        value, limit = compiled(curve.q, slip, 0.17)
        assert value == pytest.approx(float(curve.coefficient(slip, 0.17)), rel=1e-12, abs=1e-15)
        assert limit == (0.17, curve.q[0])


@looped("values", ["nan", "negative", "no maximum", "not from 0", "one value"])
def test_what_is_no_curve_is_refused_by_name(values):
    with pytest.raises(PlantError, match="adhesion curve Faulty: shape must"):
        Faulty(values).coefficient(0.1, 0.2)


def test_the_shipped_curves_are_known_by_name():
    assert list(REGISTERED)[:3] == ["piecewise", "polach", "slip-ratio"]
    with pytest.raises(PlantError, match="did you mean 'polach'"):
        REGISTERED.find("pollach")


@looped("registry", [REGISTERED, RULES, CONTROLLERS, SETS, METRICS])
def test_no_part_is_there_only_where_a_study_was_imported(registry):
    for module in pkgutil.walk_packages(studies.__path__, "studies."):
        import_module(module.name)
    assert [name for name in registry if registry.origin(name).startswith("studies.")] == []


def test_the_exponential_difference_peaks_where_its_derivative_says():
    curve = ExponentialDifference()
    slip = math.log(curve.b * curve.d / (curve.a * curve.c)) / (curve.b - curve.a)
    assert curve.limit(0.2, 15.0)[1] == pytest.approx(slip, rel=1e-3)
    assert slip == pytest.approx(1.21, abs=0.01)
    assert type(curve) is REGISTERED["exponential-difference"]
    with pytest.raises(PlantError, match="shape must"):
        ExponentialDifference(a=1.2).coefficient(0.1, 0.2)


def test_the_mpc_cannot_believe_in_it():
    casadi = pytest.importorskip("casadi")
    slip = casadi.SX.sym("slip")
    with pytest.raises(PlantError, match="name another"):
        tangential_coefficient(TABULATED, DoubleExponential().q, slip, 10.0, 10.0, 0.2)
