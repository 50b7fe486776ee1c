"""What the MPC believes of rail, gradient and air brake: it follows what axles feel, and nothing else moves it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from alloc.metrics import evaluate
from alloc.onboard.parameters import Braking, Onboard
from alloc.plant.adhesion import PiecewiseCurve, RationalCurve, SlipRatioCurve
from alloc.plant.laws import GRAVITY
from alloc.records import ByReference
from alloc.simulation import simulate
from mpc.belief import LEAST_AIR, GroupBelief, UnitBelief, with_predicted_curve
from mpc.estimator import USUAL_STEEPNESS
from mpc.group import GroupProblem, WheelsAndRail
from mpc.model import air_place, parameters, torque_per_coefficient, unit_model
from mpc.period import RealTimeIteration
from mpc.settings import MpcSettings, PeakBelief, SlipSearch
from mpc.slip_search import GOLDEN, USUAL_SHARE
from mpc.unit import EXCESS, MpcController, pose, tracked_coefficient, unit_problem
from studies.scenario import load as shipped_scenario
from tests.cases import looped
from tests.mpc.conftest import make_unit
from tests.mpc.drop import drop_event
from tests.mpc.made_problems import UNLOADING, SyntheticUnit, small_cars, train_of
from tests.mpc.peers import right_side

INITIAL = MpcSettings().belief.initial


BELIEVED = RationalCurve(MpcSettings().search.first / USUAL_SHARE, USUAL_STEEPNESS)


"""Curve believed in before anything is felt; it stays so while the unit is not limited."""


def _steady(unit, slip, seconds):
    """Run at `slip` [m/s], not limited; returns the peaks, (time, axles)."""
    peaks = []
    for _ in range(round(seconds / unit.context.period)):
        unit.period(slip, wanted=0.0)
        peaks.append(unit.belief.peak.copy())
    return np.array(peaks)


def _knowing(*args, **options):
    """A unit that has heard of its curve: one slip alone tells either its peak or its slope, not both."""
    unit = SyntheticUnit(*args, **options)
    unit.believed.heard_for = 1.0
    return unit


def test_axle_coefficient_is_that_of_the_rail():
    unit = SyntheticUnit(PiecewiseCurve())
    _steady(unit, 0.02, 0.5)
    np.testing.assert_allclose(unit.belief.coefficient, unit.coefficient(0.02), rtol=1e-6)


def test_slip_is_as_late_as_the_coefficient():
    # while both change the pair stays on the curve: here on a straight line through the origin
    unit = SyntheticUnit(RationalCurve(1e3, 2.0), peak=1e3)
    rng, axles = np.random.default_rng(1), unit.belief.record.axles
    for slip in np.cumsum(rng.normal(0.0, 1e-3, 300)) + 0.05:
        unit.period(slip, wanted=0.0)
    ratio = axles.coefficient / axles.slip
    np.testing.assert_allclose(ratio, 2.0, rtol=0.05)


# --- peaks


@looped("share", [0.7, 1.0, 2.0])
@looped("noise", [0.0, 0.005, 0.014])
@looped("truth", [0.06, 0.12, 0.3])
def test_peaks_converge_to_the_truth_on_the_believed_curve(share, noise, truth):
    for seed in range(3):
        unit = _knowing(BELIEVED, truth, noise=noise, seed=seed)
        peaks = _steady(unit, share * BELIEVED.peak_slip, 4.0)
        # through noise, pairs below the peak may as well tell of another slope at the origin
        within = 0.2 if share < 1.0 and noise > 0.01 else 0.04
        np.testing.assert_allclose(peaks[-100:].mean(0), truth, rtol=within)


@looped("truth", [0.06, 0.12])
@looped("steepness", [2.0, 4.0])
def test_at_first_a_lower_peak_is_found_at_a_smaller_slip(steepness, truth):
    """The rise of the torque has told the coefficient's slope at the origin, r mu_p; later it is r that stays."""
    curve, slopes = RationalCurve(0.1, steepness), []
    for heard in (0.0, 1.0):
        unit = SyntheticUnit(curve, truth)
        unit.believed.heard_for = heard
        for k in range(300):
            unit.period(min(0.0005 * k, 0.1), wanted=0.0)
        slopes.append(unit.believed.slope * unit.belief.peak.mean())
    own = truth * steepness / curve.peak_slip
    assert 0.45 * own < slopes[0] < 1.2 * own
    assert slopes[0] > 1.5 * slopes[1]


@looped(("noise", "seconds"), [(0.0, 0.15), (0.005, 0.15), (0.014, 0.5)])
def test_a_sudden_fall_of_the_rail_is_taken_over_at_once(noise, seconds):
    for seed in range(3):
        unit = _knowing(BELIEVED, 0.15, noise=noise, seed=seed)
        _steady(unit, 1.2 * BELIEVED.peak_slip, 3.0)
        unit.peak = 0.6 * 0.15
        fallen = _steady(unit, 1.2 * BELIEVED.peak_slip, seconds)[-1]
        np.testing.assert_allclose(fallen, unit.peak, rtol=0.15)


def test_variance_is_never_negative_and_peaks_keep_their_bounds(context):
    belief = PeakBelief(initial=0.1, floor=0.05, ceiling=0.15)
    rng = np.random.default_rng(5)
    for scale in (0.003, 0.1, 3.0):
        unit = UnitBelief(context, MpcSettings(belief=belief))
        for _ in range(400):
            omega = (10.0 + scale * rng.standard_normal(4)) / context.radius
            unit.update(10.0, omega, rng.uniform(-300.0, 900.0), estimate=rng.uniform(-0.1, 0.2))
            assert np.all(unit.record.axles.variance >= 0.0)
            assert np.all((unit.peak >= 0.05) & (unit.peak <= 0.15))
            assert np.isfinite([*unit.peak, unit.slip_limit, *unit.curve]).all()


def test_an_axle_at_low_slip_does_not_lower_its_peak():
    # as little as that is felt of a rail of any peak
    unit = SyntheticUnit(BELIEVED, INITIAL, noise=0.002)
    assert _steady(unit, 0.05 * BELIEVED.peak_slip, 5.0).min() > 0.93 * INITIAL


def test_noise_of_a_rolling_axle_is_not_slip_on_a_rail_without_adhesion():
    unit = SyntheticUnit(BELIEVED, INITIAL, noise=0.005)
    unit.acceleration = 0.0
    assert _steady(unit, 0.0, 2.0).min() > 0.7 * INITIAL


def test_noise_at_the_start_does_not_pass_for_a_rail_without_adhesion():
    """A single axle has nothing to compare its first readings with."""
    for seed in range(20):
        unit = SyntheticUnit(BELIEVED, INITIAL, noise=0.028, seed=seed, axles=1)
        assert _steady(unit, 0.0, 0.5).min() > 0.3 * INITIAL


def test_an_axle_that_feels_more_than_believed_raises_the_belief():
    unit = SyntheticUnit(BELIEVED, 0.3, MpcSettings(belief=PeakBelief(initial=0.05)))
    _steady(unit, 0.3 * BELIEVED.peak_slip, 1.0)
    assert unit.belief.peak.min() > unit.coefficient(0.3 * BELIEVED.peak_slip)


def test_belief_of_one_axle_leaves_the_others_alone(context):
    slips = np.array([[0.0, 0.0, 0.0, 0.02], [0.0, 0.0, 0.0, 0.3]])
    one, other = (UnitBelief(context, MpcSettings()) for _ in range(2))
    for _ in range(100):
        for belief, slip in zip((one, other), slips, strict=True):
            belief.update(10.0, (10.0 + slip) / context.radius, 400.0, wanted=0.0)
    # the noise is that of all: but for it, they know nothing of each other
    np.testing.assert_allclose(one.peak[:3], other.peak[:3], rtol=1e-6)
    assert one.peak[3] > 1.2 * other.peak[3]


# --- noise


@looped("noise", [0.001, 0.005, 0.02, 0.1])
def test_noise_is_that_of_the_sensor(noise):
    for seed in range(2):
        unit = SyntheticUnit(BELIEVED, noise=noise, seed=seed)
        felt = []
        for k in range(1200):
            # slip that moves as slowly as wheels do is no noise
            unit.period(0.05 + 0.03 * math.sin(0.05 * k), wanted=0.0)
            felt.append(unit.belief.record.axles.noise.mean())
        assert np.mean(felt[600:]) == pytest.approx(noise, rel=0.1)


# --- the unit


def test_forces_are_forgotten_without_what_is_known_of_the_rail(context):
    belief = UnitBelief(context, MpcSettings())
    for k in range(100):
        belief.update(10.0, np.full(4, (10.0 + 0.002 * k) / context.radius), 300.0)
    peak, curve = belief.peak.copy(), belief.curve
    belief.forget_forces()
    np.testing.assert_array_equal(belief.peak, peak)
    assert belief.curve == curve
    belief.update(10.0, np.full(4, 10.01 / context.radius), 123.0)
    # in equilibrium from the first reading on
    expected = 123.0 * context.gear_ratio / (context.axle_load * context.radius)
    np.testing.assert_allclose(belief.coefficient, expected, rtol=1e-9)


def test_observers_that_start_again_trust_their_readings_as_new_ones_do():
    old, new = SyntheticUnit(BELIEVED, noise=0.02), SyntheticUnit(BELIEVED)
    for _ in range(300):
        old.period(0.3 * float(BELIEVED.limit(old.peak, old.speed)[1]), wanted=0.0)
    for name in ("noise", "peak", "variance"):
        getattr(new.belief.record.axles, name)[:] = getattr(old.belief.record.axles, name)
    for part in ("curve", "search"):
        getattr(new.belief.record, part).state[:] = getattr(old.belief.record, part).state
    before = old.belief.peak.copy()
    old.belief.forget_forces()
    # one reading is as noisy as the sensor, and so is the pair that begins with it
    for slip in (0.02, 0.03, 0.01):
        for unit in (old, new):
            unit.belief.update(10.0, np.full(4, (10.0 + slip) / unit.context.radius), 400.0, 0.0)
        # new ones learn the noise faster, and that alone differs
        new.belief.record.axles.noise[:] = old.belief.record.axles.noise
        np.testing.assert_allclose(new.belief.peak, old.belief.peak, rtol=5e-4)
    assert np.all(np.abs(old.belief.peak / before - 1.0) > 2e-3)


def test_a_given_share_of_the_given_curves_slip_is_held_where_nothing_is_sought():
    for share in (0.7, 1.0):
        settings = MpcSettings(search=SlipSearch(seek=False, given_share=share))
        curve = PiecewiseCurve()
        unit = SyntheticUnit(curve, 0.12, settings)
        limits, held = [], []
        for _ in range(400):
            unit.period(0.04)
            limits.append(unit.belief.slip_limit)
            held.append(share * float(curve.limit(unit.belief.peak.min(), unit.speed)[1]))
        # the mean over whole swings, whatever their length
        turns = round(4.0 / settings.search.swing_time) // 2
        last = round(turns * settings.search.swing_time / unit.context.period)
        assert np.mean(limits[-last:]) == pytest.approx(np.mean(held[-last:]), rel=0.01)


# --- a group


def test_a_group_of_units_believes_what_they_would_alone():
    units = [make_unit(unit=k, car=k, unloading=()) for k in range(3)]
    settings = MpcSettings()
    group, alone = GroupBelief(units, settings), [UnitBelief(u, settings) for u in units]
    rng = np.random.default_rng(3)
    for _ in range(150):
        omega = (10.0 + rng.uniform(0.0, 0.1, 12)) / 0.43
        torque = rng.uniform(200.0, 500.0, 3)
        estimate = np.array([0.3, 0.35, math.nan])
        group.update(np.full(3, 10.0), omega, torque, np.full(3, 900.0), estimate)
        for k, one in enumerate(alone):
            one.update(10.0, omega[4 * k : 4 * k + 4], torque[k], 900.0, estimate[k])
    np.testing.assert_array_equal(group.peak, np.concatenate([one.peak for one in alone]))
    np.testing.assert_array_equal(group.slip_limit, np.repeat([o.slip_limit for o in alone], 4))
    air = np.array([one.air_coefficient for one in alone])
    assert air[:2].min() > 0.05
    assert air[2] == 0.0
    np.testing.assert_allclose(
        group.air_torque, [a * u.axle_load * u.radius for a, u in zip(air, units, strict=True)]
    )
    per_coefficient = [torque_per_coefficient(u) for u in units]
    left = [max(one.peak.min() - a, 0.0) for one, a in zip(alone, air, strict=True)]
    np.testing.assert_allclose(
        group.carried_torque(), np.multiply(left, per_coefficient), rtol=1e-12
    )
    mean = np.exp(np.mean([np.log(one.curve) for one in alone], axis=0))
    np.testing.assert_allclose(group.curve, mean, rtol=1e-12)


def test_the_air_brake_of_a_unit_is_shared_by_its_axles_as_they_are_loaded():
    """The torque at all wheelsets is the coefficient times all that they carry, whichever of them the car unloads."""
    for sign in (1.0, -1.0):
        units = [replace(one, unloading=tuple(sign * np.array(UNLOADING))) for one in train_of(3)]
        group = GroupBelief(units, MpcSettings())
        for _ in range(50):
            load = group.load.reshape(3, 4).copy()
            torque, estimate = np.array([200.0, 350.0, 500.0]), np.array([0.2, 0.25, 0.3])
            group.update(
                np.full(3, 10.0), np.full(12, 10.02 / 0.43), torque, np.full(3, 900.0), estimate
            )
            air = np.array([one.air_coefficient for one in group.observers])
            np.testing.assert_allclose(4 * group.air_torque, air * 0.43 * load.sum(axis=1))
        assert air.min() > 0.05
        assert np.ptp(load, axis=1).min() > 0.01 * load.mean()


def test_units_swing_out_of_step():
    group = GroupBelief(train_of(6), MpcSettings())
    phases = np.array([o.record.search.state[0].phase for o in group.observers])
    np.testing.assert_allclose(phases, GOLDEN * np.arange(6) % (2.0 * math.pi), rtol=1e-12)
    apart = np.abs(np.exp(1j * phases)[:, None] - np.exp(1j * phases)[None, :])
    assert apart[~np.eye(6, dtype=bool)].min() > 0.4
    assert abs(np.exp(1j * phases).mean()) < 0.3


PERIOD, SLIP = 0.01, 0.02


def _climb(unit, context, grade, seconds, start=8.0):
    """Drive the unit up a gradient at constant slip with a constant force; returns the last speed [m/s]."""
    coefficient, wheels = 0.1, context.axles
    force = coefficient * context.axle_load * wheels
    acceleration = force / context.mass - GRAVITY * grade
    turning = context.inertia * acceleration / context.radius
    torque = coefficient * context.axle_load * context.radius + turning
    for k in range(round(seconds / PERIOD)):
        speed = start + acceleration * k * PERIOD
        omega = np.full(wheels, (speed + SLIP) / context.radius)
        unit.update(speed, omega, torque / context.gear_ratio)
    return speed


@looped("grade", [-0.02, 0.0, 0.03])
def test_a_gradient_is_found(context, grade):
    unit = UnitBelief(context, MpcSettings())
    _climb(unit, context, grade, 5.0)
    assert unit.grade == pytest.approx(grade, abs=2e-4)


def test_it_is_found_within_its_time_and_a_new_start_of_the_observers_is_no_jump(context):
    unit = UnitBelief(context, MpcSettings())
    speed = _climb(unit, context, 0.03, 0.5)
    found = unit.grade
    assert 0.5 * 0.03 < found < 0.8 * 0.03
    unit.forget_forces()
    _climb(unit, context, 0.03, PERIOD, start=speed + 1.0)
    assert unit.grade == found
    _climb(unit, context, 0.03, 5.0, start=speed + 1.0)
    assert unit.grade == pytest.approx(0.03, abs=2e-4)


def test_the_prediction_has_it(context, make_sense):
    controller = MpcController(context)
    for k in range(50):
        assert controller.decide(make_sense(speed=10.0 + 0.001 * k, torque=500.0)).ok
    assert controller.belief.grade > 0.01
    assert controller._unit.solver.now.parameters[context.axles] == controller.belief.grade


AIR = 0.04


def blended(curve, air=AIR, **settings):
    """A unit whose air brake gives a coefficient of `air`, on a rail of 0.12."""
    unit = SyntheticUnit(curve, 0.12, MpcSettings(**settings))
    unit.air = air
    return unit


@looped("air", [0.02, 0.06])
def test_what_is_believed_of_the_rail_does_not_depend_on_who_brakes(air):
    one, other = (blended(PiecewiseCurve(), part) for part in (air, 0.0))
    for k in range(400):
        for unit in (one, other):
            unit.period(0.06 * unit.swing + 0.01 * math.sin(0.03 * k))
    np.testing.assert_allclose(one.belief.peak, other.belief.peak, rtol=0.02)
    assert one.search.elasticity == pytest.approx(other.search.elasticity, abs=0.02)
    assert one.belief.record.air.coefficient[0] == pytest.approx(air, rel=0.05)


def test_elasticity_is_that_of_all_force():
    """That of the motors' part alone would be larger by the share that they do not give."""
    curve = SlipRatioCurve()
    unit = blended(curve, search=SlipSearch(seek=False, given_share=0.5))
    slip = 0.5 * float(curve.limit(0.12, unit.speed)[1])
    for _ in range(400):
        unit.period(slip * unit.swing)
    mu = [float(unit.coefficient(slip * f)) for f in (0.99, 1.01)]
    own = (math.log(mu[1]) - math.log(mu[0])) / (math.log(1.01) - math.log(0.99))
    assert unit.search.elasticity == pytest.approx(own, rel=0.12)


def test_no_estimate_and_a_small_difference_count_as_no_air():
    for air, reading in ((AIR, {"estimate": math.nan}), (0.9 * LEAST_AIR, {})):
        unit = blended(PiecewiseCurve(), air)
        for _ in range(200):
            unit.period(0.03, **reading)
        assert unit.belief.record.air.coefficient[0] == 0.0


def test_the_prediction_has_the_torque_at_every_wheelset(make_context):
    context = make_context()
    rate, none = right_side(unit_model(context)), parameters(context, 0.1)
    with_air = none.copy()
    with_air[air_place(context)] = 500.0
    state = np.array([10.0, *[10.02 / context.radius] * context.axles, 300.0])
    change = rate(state, 300.0, with_air) - rate(state, 300.0, none)
    expected = [0.0, *[500.0 / context.inertia] * context.axles, 0.0]
    np.testing.assert_allclose(np.asarray(change).ravel(), expected, atol=1e-9)


@looped("air", [0.0, AIR, 0.5])
def test_the_motors_bound_is_what_the_air_brake_leaves(air):
    unit = SyntheticUnit(PiecewiseCurve(), 0.12)
    record, predicted = unit.belief.record, with_predicted_curve(unit.context)
    solver = RealTimeIteration(predicted, unit.settings)
    made = unit_problem(predicted, unit.settings, record, solver.period)
    record.air.coefficient[0] = air
    record.load[:] *= [0.7, 0.9, 1.2, 1.2]  # it lies with the axles as they are loaded
    pose(ByReference(made), 1e5, 1e5)
    least, c = record.axles.peak.min(), made.per_coefficient
    expected = max((1.0 + unit.settings.headroom) * least * c - air * c, 0.0)
    np.testing.assert_allclose(made.solver.now.upper, expected)
    torque = air * unit.context.axle_load * unit.context.radius
    np.testing.assert_allclose(made.solver.now.parameters[air_place(predicted)], torque)


def test_a_blended_stop_uses_what_the_rail_carries():
    event = drop_event(
        command=-0.9, speed=15.0, level=0.09, drop=0.7, truth=SlipRatioCurve(0.03, 0.8)
    )
    event = replace(event, onboard=replace(Onboard(), braking=Braking()))
    used = {
        name: evaluate(simulate(event, "alone", name))["utilisation_short"]
        for name in ("mpc", "cut-and-ramp")
    }
    # the slip that it starts with lies at twice that of this peak
    assert used["mpc"] > max(0.935, used["cut-and-ramp"] - 0.01)


def test_cars_and_trains_know_the_air_brake_as_a_unit_does():
    """Without it what shoes take of the rail passes for adhesion that is gone: seven points, and 5 % of the effort."""
    found = {
        name: evaluate(simulate(shipped_scenario("wet-stop").event(3), "alone", name))
        for name in ("mpc", "mpc-car", "mpc-train")
    }
    for name, least in (("mpc-car", 0.9), ("mpc-train", 0.87)):
        assert found[name]["utilisation_short"] > least
        assert found[name]["effort_ratio"] > found["mpc"]["effort_ratio"] - 0.01


WEIGHTS = MpcSettings().weights


def _most(held, slip):
    w = WEIGHTS
    return float(
        tracked_coefficient(held, slip, w.coefficient_scale, w.tracking, w.slip, w.slip_scale)
    )


@looped("peak_slip", [0.02, 0.05, 0.2])
@looped("steepness", [2.5, 4.0, 12.0])
@looped("demand", [0.2, 1.0, 5.0])
def test_at_rest_slip_exceeds_its_limit_by_no_more(peak_slip, steepness, demand):
    """The least of the cost at rest on a rational curve, by search over slips up to the peak."""
    curve, peak, w = RationalCurve(peak_slip, steepness), 0.12, WEIGHTS
    limit = 0.7 * peak_slip
    slip = np.linspace(1e-4, peak_slip, 20001)
    mu = curve.coefficient(slip, peak, 10.0)
    held = float(curve.coefficient(limit, peak, 10.0))

    def cost(target):
        excess = np.maximum(slip - limit, 0.0) / w.slip_scale
        return w.tracking * ((mu - target) / w.coefficient_scale) ** 2 + w.slip * excess**2

    tracked = min(demand, _most(held, limit))
    assert slip[np.argmin(cost(tracked))] <= limit * (1.0 + EXCESS) + 1e-5
    assert tracked >= min(demand, held), "what the rail carries is tracked"


def test_narrow_peaks_bound_the_demand_and_wide_ones_do_not():
    assert _most(0.12, 0.04) < 0.15
    assert _most(0.12, 0.3) > 0.6, "more than any motor gives"


def test_more_slip_and_less_adhesion_allow_more():
    slips = [_most(0.1, s) for s in (0.02, 0.04, 0.08)]
    assert slips == sorted(slips)
    assert _most(0.02, 0.03) > _most(0.2, 0.03) - 0.2
    assert np.isfinite(_most(0.0, 0.03))


def test_a_group_tracks_its_total_as_far_as_its_units_together_may():
    group = small_cars(2)
    problem = GroupProblem(group, MpcSettings())
    axles = problem.unit.size
    per = problem._scale / WEIGHTS.coefficient_scale
    rail = WheelsAndRail(
        np.full(axles, 0.12), np.full(axles, 0.03), 0.12 * per, *np.zeros((2, per.size))
    )
    state = 10.0, np.full(axles, 10.0 / 0.43), 0.1 * per
    little, much = 0.1 * per, 3.0 * per

    def tracked(target):
        limit = np.full(per.size, 1e6)
        return problem.problem(state, rail, (0.05, 4.0), target, 0.1 * per, limit).target

    np.testing.assert_array_equal(tracked(little), little)
    np.testing.assert_allclose(tracked(much), _most(0.12, 0.03) * per, rtol=1e-12)
    # one unit asks for less than it may: the other may ask for what is left
    uneven = np.where(np.arange(per.size) == 0, 0.01, 0.14) * per
    np.testing.assert_array_equal(tracked(uneven), uneven)
