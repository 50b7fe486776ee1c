"""The belief about the slope: it converges to the true one, stays where nothing is felt, and keeps its bounds."""

import numpy as np
import pytest

from alloc.by_reference import ByReference
from alloc.plant.adhesion_laws import tangential_coefficient
from mpc.belief import CurveObserver
from mpc.curve_belief import micro_slip, slope_belief, stretch_parameters, update_slope
from mpc.settings import CurveBelief, PeakBelief

PERIOD, PEAK, SPEED = 0.01, 0.12, 10.0
KINDS = ("piecewise", "polach", "slip-ratio")


def stretched(curve, stretch):
    """The `curve` with its rising branch stretched along the slip axis."""
    q = np.empty(6)
    stretch_parameters(curve.kind, curve.q, stretch, q)
    return curve.with_parameters(q)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("stretch", [0.5, 2.0])
def test_stretching_moves_the_rising_branch_along_the_slip_axis(make_context, kind, stretch):
    curve = make_context(kind).curve
    other = stretched(curve, stretch)
    limit, top = curve.limit(PEAK, SPEED)
    slip = np.linspace(0.0, top, 20)
    # creepage divides by the rim's speed, and Polach's friction falls with the slip: neither is stretched
    tolerance = {"piecewise": 1e-12, "polach": 0.1, "slip-ratio": 0.03}[kind]
    np.testing.assert_allclose(
        other.coefficient(stretch * slip, PEAK, SPEED), curve.coefficient(slip, PEAK, SPEED),
        rtol=tolerance, atol=1e-12,
    )  # fmt: skip
    assert other.limit(PEAK, SPEED)[0] == pytest.approx(limit, rel=tolerance)
    if kind != "polach":  # whose top is so flat that the fall of friction moves it by a third
        assert other.limit(PEAK, SPEED)[1] == pytest.approx(stretch * top, rel=2 * tolerance)


@pytest.mark.parametrize("kind", KINDS)
def test_micro_slip_inverts_the_curve(make_context, kind):
    curve = make_context(kind).curve
    limit, top = (float(value) for value in curve.limit(PEAK, SPEED))
    for share in (-0.7, 0.0, 0.2, 0.9):
        slip = micro_slip(curve.kind, curve.q, share * limit, PEAK, top, SPEED)
        rim = SPEED + abs(slip)
        back = tangential_coefficient(curve.kind, curve.q, slip, SPEED, rim, PEAK)
        assert back == pytest.approx(share * limit, abs=1e-6)


def _drive(observer, context, truth, slips, noise=0.0, offset=0.0, seed=1):
    """Axles that run through `slips` [m/s] on a rail with the curve `truth`; returns the stretch believed, (time,)."""
    rng = np.random.default_rng(seed)
    believed, before, speed = [], slips[0], SPEED
    for slip in slips:
        coefficient = float(truth.coefficient(slip, PEAK, speed))
        wheel = context.inertia * (slip - before) / PERIOD / context.radius
        torque = (coefficient * context.axle_load * context.radius + wheel) / context.gear_ratio
        measured = speed + slip + offset + noise * rng.standard_normal(context.axles)
        observer.update(speed, measured / context.radius, torque)
        believed.append(observer.stretch)
        before = slip
    return np.array(believed)


def _starts(top, number=4, beyond=2.5, rate=0.12):
    """Slip that rises past the peak at `top` by `rate` [m/s2], stays for a second, falls and rests for another."""
    ramp = beyond * top / rate
    corners = np.cumsum([0.0, ramp, 1.0, ramp, 1.0])
    instants = np.arange(0.0, corners[-1], PERIOD)
    once = np.interp(instants, corners, [0.0, beyond * top, beyond * top, 0.0, 0.0])
    return np.tile(once, number)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("wrong", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("initial", [0.7 * PEAK, PEAK, 1.3 * PEAK])
def test_a_wrong_slope_is_found(make_context, kind, wrong, initial):
    truth = make_context(kind).curve
    context = make_context(kind, believed=stretched(truth, wrong))
    observer = CurveObserver(context, PeakBelief(initial=initial))
    _drive(observer, context, truth, _starts(float(truth.limit(PEAK, SPEED)[1])))
    assert observer.stretch == pytest.approx(1.0 / wrong, rel=0.07)
    top = stretched(context.curve, observer.stretch).limit(observer.peak, SPEED)[1]
    np.testing.assert_allclose(observer.peak_slip, top, rtol=1e-3)


@pytest.mark.parametrize("wrong", [0.5, 1.0, 2.0])
@pytest.mark.parametrize(
    ("noise", "offset", "within"), [(0.005, 0.0, 0.1), (0.01, 0.0, 0.1), (0.01, 0.015, 0.35)]
)
def test_it_is_found_through_noise_and_behind_a_reference_that_is_off(
    make_context, wrong, noise, offset, within
):
    truth = make_context().curve
    context = make_context(believed=stretched(truth, wrong))
    observer = CurveObserver(context, PeakBelief())
    slips = _starts(float(truth.limit(PEAK, SPEED)[1]), number=8, beyond=5.0)
    _drive(observer, context, truth, slips, noise, offset)
    assert observer.stretch == pytest.approx(1.0 / wrong, rel=within)


def test_nothing_moves_while_nothing_is_felt(make_context):
    truth = make_context().curve
    context = make_context(believed=stretched(truth, 2.0))
    observer = CurveObserver(context, PeakBelief())
    top = float(truth.limit(PEAK, SPEED)[1])
    _drive(observer, context, truth, _starts(top))
    found = observer.stretch
    rolling = _drive(observer, context, truth, np.zeros(6000), noise=0.005)
    assert np.abs(rolling / found - 1.0).max() < 0.03
    # at the peak and beyond, where nothing is told of micro slip, it does not move at all
    observer = CurveObserver(context, PeakBelief())
    _drive(observer, context, truth, _starts(top))
    held = _drive(observer, context, truth, np.full(3000, 1.5 * top))
    assert held[-1] == held[100]


def test_bounds_hold_whatever_comes(make_context):
    context = make_context()
    belief = CurveBelief(smallest=0.6, largest=1.5)
    rng = np.random.default_rng(4)
    for seed in range(5):
        observer = CurveObserver(context, PeakBelief(), belief)
        for k in range(400):
            slip = rng.normal(0.02 * seed, 0.05, 4) + 0.05 * (k > 200)
            observer.update(SPEED, (SPEED + slip) / context.radius, rng.uniform(-200.0, 900.0))
            assert belief.smallest <= observer.stretch <= belief.largest
        assert np.isfinite(observer.q).all()


def test_a_reference_that_slips_along_tells_nothing(make_context):
    # every axle is driven: none shows the train's speed, and measured slip is zero at any force
    context = make_context()
    observer = CurveObserver(context, PeakBelief())
    for torque in np.linspace(0.0, 500.0, 300):
        observer.update(SPEED, np.full(4, SPEED / context.radius), torque)
    assert observer.stretch == pytest.approx(1.0, abs=0.02)


def test_braking_by_others_tells_nothing(make_context):
    # the air brake's share of the force is not in the motor's torque
    context = make_context()
    observer = CurveObserver(context, PeakBelief())
    for torque in np.linspace(0.0, 300.0, 300):
        omega = np.full(4, (SPEED + 1e-4 * torque) / context.radius)
        observer.update(SPEED, omega, torque, observer.coefficient.mean() + 0.03)
    assert observer.stretch == 1.0


def test_switched_off_the_given_curve_is_believed(make_context):
    truth = make_context().curve
    context = make_context(believed=stretched(truth, 2.0))
    observer = CurveObserver(context, PeakBelief(), CurveBelief(estimate=False))
    _drive(observer, context, truth, _starts(0.05))
    assert observer.stretch == 1.0
    np.testing.assert_array_equal(observer.q, context.curve.q)


def test_a_slope_in_the_middle_of_two_axles_that_disagree(make_context):
    curve = make_context().curve
    slope = slope_belief(curve, 2, PERIOD, CurveBelief(), PEAK)
    record = ByReference(slope)
    peak, told = np.full(2, PEAK), np.full(2, PEAK)
    felt = np.full(2, 0.5 * PEAK)
    top = float(curve.limit(PEAK, SPEED)[1])
    slip = micro_slip(curve.kind, curve.q, felt[0], PEAK, top, SPEED)
    for _ in range(2000):
        slips = slip * np.array([0.8, 1.4])
        update_slope(record, SPEED, slips, felt, peak, told, np.ones(2, dtype=bool), 0.0, 0.015)
    assert slope.stretch[0] == pytest.approx(1.1, rel=0.01)
