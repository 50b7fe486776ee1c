"""Laws and adhesion curves: one text on three back ends, sources' numbers, shapes that curves have in common."""

import inspect
import math

import casadi
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from alloc import laws
from alloc.backends import compiled, symbolic
from alloc.plant.curves import (
    CURVES,
    POLACH_DRY,
    POLACH_WET,
    PiecewiseCurve,
    find_tops,
    own_curve,
    steepest,
    top,
)
from alloc.schema.errors import InputError
from tests.cases import looped

OWN = inspect.getmembers(laws, lambda one: getattr(one, "__module__", "") == laws.__name__)
LAWS = dict(OWN)
SIGNED = {
    "slip",
    "speed",
    "rim",
    "torque",
    "command",
    "other",
    "angular_speed",
    "elongation",
    "rate",
    "x",
    "force",
}


def values(law, n=300):
    """Arguments of a law: what has a direction takes either sign."""
    rng = np.random.default_rng(len(inspect.signature(law).parameters))
    names = inspect.signature(law).parameters
    return [
        rng.uniform(0.02, 0.9, n) * (rng.choice([-1.0, 1.0, 9.0], n) if one in SIGNED else 1.0)
        for one in names
    ]


@looped("name", LAWS)
def test_numpy_compiled_and_symbolic_laws_agree(name):
    given = values(LAWS[name])
    reference = LAWS[name](*given)
    by_numba = [getattr(compiled, name)(*map(float, one)) for one in zip(*given, strict=True)]
    symbols = [casadi.SX.sym(f"x{k}") for k in range(len(given))]
    of_symbols = casadi.Function("law", symbols, [getattr(symbolic, name)(*symbols)])
    assert np.allclose(by_numba, reference, rtol=1e-12, atol=1e-14)
    assert np.allclose(of_symbols(*given).full().ravel(), reference, rtol=1e-12, atol=1e-14)


@looped("kind", CURVES)
def test_a_curve_is_odd_rises_from_0_to_one_maximum_and_falls(kind):
    curve, slip, peak = CURVES[kind](), np.geomspace(1e-4, 20.0, 3000), np.array([[0.03], [0.3]])
    for speed in (0.0, 1.5, 30.0):
        mu = curve(slip, peak, speed)
        most, place = curve.top(speed, peak)
        assert np.array_equal(-mu, CURVES[kind]()(-slip, peak, -speed))
        assert curve(0.0, 0.2) == 0.0
        before = slip < place
        assert np.all(np.diff(mu) * before[:, 1:] > -1e-12)
        assert np.all(np.diff(mu) * ~before[:, :-1] < 1e-4 * peak)
        assert np.all(mu <= most * (1.0 + 1e-6))
        assert np.allclose(mu.max(1), most[:, 0], rtol=1e-3)
        steep = np.diff(mu) / np.diff(slip)
        assert steep.max() <= 1.01 * max(
            steepest(curve.number, curve.values, one) for one in peak[:, 0]
        )


@looped("kind", CURVES)
def test_the_top_is_where_an_optimiser_finds_it(kind):
    curve = CURVES[kind]()
    for speed in (0.3, 20.0):
        most, place = curve.top(speed, 0.2, 1.3)
        sought = minimize_scalar(lambda one, v=speed: -float(curve(one, 0.2, v, 1.3)), bounds=(0.0, 5.0),
                                 options={"xatol": 1e-9})  # fmt: skip
        assert most == pytest.approx(-sought.fun, rel=1e-5)
        assert curve(place, 0.2, speed, 1.3) == pytest.approx(most)
        assert curve(0.9 * place, 0.2, speed, 1.3) < most
        found = top.py_func(curve.number, curve.values, speed, 0.2, 1.3)
        assert found == pytest.approx((most, place))


def test_the_piecewise_curve_rises_without_its_tail():
    shape, slip = (5.0, 40.0, 0.05, 0.9), np.linspace(0.0, 1.0, 50)
    for peak in (0.03, 0.1, 0.3):
        breadth = laws.parabola_breadth(peak, *shape)
        part = slip * laws.piecewise_top(peak, *shape)
        rise = laws.piecewise_rise(part, peak, shape[0], breadth)
        np.testing.assert_array_equal(rise, laws.piecewise_coefficient(part, peak, *shape, 1.0))
        assert rise[-1] == pytest.approx(peak)


def test_the_piecewise_curve_is_that_of_the_paper():
    # (1)-(6) with the printed g1, C, g2, at a peak of 0.18
    g1, c, g2, peak, rest = 5.0, 40.0, 0.05, 0.18, 0.162
    line, best = peak / g1 - g1 / (4 * c), peak / g1 + g1 / (4 * c)
    tail = best + g2 / (2 * c)
    drop = peak - rest - g2 * g2 / (4 * c)
    mu = PiecewiseCurve()
    assert mu(0.8 * line, peak) == pytest.approx(g1 * 0.8 * line)
    assert mu(best + 0.01, peak) != mu(best, peak) == pytest.approx(peak)
    inside = 0.5 * (line + best)
    assert mu(inside, peak) == pytest.approx(peak - c * (inside - best) ** 2)
    assert mu(tail + 1.0, peak) == pytest.approx(rest + drop * math.exp(-g2 / drop))


def test_a_rail_too_slippery_for_the_curvature_narrows_the_parabola():
    steep_tail = PiecewiseCurve(macro_slope=2.0, top_curvature=1.0)
    for curve in (PiecewiseCurve(), steep_tail):
        mu = curve(np.linspace(0.0, 1.0, 20_001), 0.01)
        assert np.abs(np.diff(mu)).max() < 6e-4
        assert mu.max() == pytest.approx(0.01, rel=1e-3)
        assert mu[-1] < mu.max()


def test_polachs_sets_meet_where_friction_says():
    slip, by_friction = np.geomspace(1e-3, 5.0, 50), CURVES["polach-by-friction"]()
    assert np.allclose(by_friction(slip, 0.30, 10.0), POLACH_WET(slip, 0.30, 10.0), rtol=1e-12)
    assert np.allclose(by_friction(slip, 0.55, 10.0), POLACH_DRY(slip, 0.55, 10.0), rtol=1e-12)
    assert POLACH_WET.contact(2e5, 0.5) == pytest.approx(math.sqrt(0.5))  # falls as load^-1/2


def test_an_own_curve_is_the_same_as_function_and_as_table():
    slip, knots = np.linspace(-6.0, 6.0, 999), np.linspace(0.0, 20.0, 4001)
    shape = own_curve("mine", lambda s: s * np.exp(-2.0 * s))
    table = own_curve("mine", np.column_stack([knots, 7.0 * knots * np.exp(-2.0 * knots)]))
    exact = 0.2 * 2.0 * math.e * slip * np.exp(-2.0 * np.abs(slip))
    assert np.allclose(shape(slip, 0.2), exact, atol=1e-5)
    assert np.allclose(table(slip, 0.2), exact, atol=2e-5)
    assert shape == own_curve("mine", lambda s: s * np.exp(-2.0 * s)) != table
    for bad in (
        lambda s: s,
        lambda s: np.cos(s) ** 2,
        lambda s: -s,
        [[0.0, 0.0], [0.0, 1.0]],
        np.ones(3),
    ):
        with pytest.raises(InputError, match="adhesion curve bad"):
            own_curve("bad", bad)


@looped("kind", CURVES)
def test_tops_of_a_record_are_the_tops_of_its_instants(kind):
    curve, rng = CURVES[kind](), np.random.default_rng(2)
    peak, speed, contact = (
        rng.uniform(0.02, 0.4, (4, 3)),
        rng.uniform(0.0, 40.0, (4, 1)),
        rng.uniform(0.5, 2.0, 3),
    )
    of = curve.number, curve.values
    most, slip = find_tops(*of, speed, peak, contact)
    assert np.allclose(
        (most[2, 1], slip[2, 1]), top(*of, speed[2, 0], peak[2, 1], contact[1]), rtol=1e-12
    )


def test_laws_have_the_numbers_of_their_sources():
    assert laws.gradient_force(1.0, 0.025) == pytest.approx(
        laws.GRAVITY * math.sin(math.atan(0.025))
    )
    assert laws.speed_law(10.0, 7.5, 44.0, 0.161) == pytest.approx(
        7.5 / 80.0 + 0.161
    )  # Curtius and Kniffler at 36 km/h
    assert laws.window(np.array([-1.0, 0.0, 5.0, 10.0]), 0.0, 10.0, 1.0) == pytest.approx(
        [0.0, 0.5, 1.0, 0.5]
    )
    assert (
        laws.resistance(20.0, 100.0, 3.0, 2.0)
        == pytest.approx(960.0, rel=1e-5)
        == -laws.resistance(-20.0, 100.0, 3.0, 2.0)
    )
    assert laws.recovery(0.0, 4200.0, 1.0, 4200.0, 0.1, 1e3) == pytest.approx(math.tanh(1.0))
    assert laws.recovered(0.1, 0.5, 0.2) == pytest.approx(0.15)
    assert laws.recovered(0.3, 0.5, 0.2) == 0.3
    assert laws.cleaned(-0.05, 0.05) == pytest.approx(1.0 - math.exp(-1.0))
    assert laws.power_taken(0.75, 0.7, 0.2, 3.0, 0.0) == pytest.approx(0.9)


def test_couplers_hold_nothing_within_their_slack():
    force = laws.coupler_force(
        np.array([0.004, 0.015, -0.015]), np.array([9.0, 0.0, 0.0]), 2e6, 1e9, 2e4, 0.01
    )
    assert force == pytest.approx([0.0, 2.1e4, -2.1e4])


def test_valves_follow_the_nine_rules_at_their_corners():
    knots = 0.0, 0.08, 0.17, -3.6, 0.0, 3.6
    found = [[laws.fuzzy_valve(ratio, rate, *knots) for rate in knots[3:]] for ratio in knots[:3]]
    assert np.allclose(found, [[0, 0, 1], [0, 1, 2], [1, 2, 2]])
