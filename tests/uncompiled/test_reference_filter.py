"""The reference speed, its reliefs and the wheels' radii, period by period, as plain Python."""

import itertools
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from alloc.balance import coupler_spring_energy
from alloc.onboard import reference_speed as kalman_filter
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Onboard, ReferenceSpeed, Sensors, TorqueRelief
from alloc.onboard.reference_speed import (
    BOUND_SHARE,
    SEEN,
    estimate_speed,
    has_settled,
    reference_pace,
    relieve,
    take_reading,
)
from alloc.onboard.sensing import AFTER, GATE, sense
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.plant.laws import GRAVITY, coupler_stretch
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from studies.jp4209318 import train as slide_train
from tests.cases import looped
from tests.onboard.uneven import uneven_train

SPEED, PERIOD = 20.0, 0.01


class Computers:
    """The computers of a train at `SPEED`, which are told whatever the test says."""

    def __init__(self, train, **options):
        onboard = Onboard(period=PERIOD, **options)
        self.model = build(train, Rail(0.1))
        self.eq = equipment(self.model, onboard)
        self.st = settings(onboard, RuleSettings(0), "none")
        self.m = memory(self.eq, SPEED, 0.1)
        self.filter = self.m.estimate

    def sense(self, rim, torque=0.0, pressure=0.0, commanded=-1.0):
        n, groups = self.eq.axles.size, self.eq.group.unit.size
        omega = np.broadcast_to(rim, self.eq.axle_radius.shape) / self.eq.axle_radius
        torque, pressure = np.full(n, torque), np.full(groups, pressure)
        sense(
            self.eq, self.st, self.m, 0.0, commanded, omega, torque, pressure, np.zeros(omega.size)
        )

    def estimate(self, rim, pressure):
        """One period of the filter alone, braked by air."""
        self.m.axle_omega[:] = rim / self.eq.axle_radius
        groups = self.eq.group.unit.size
        estimate_speed(self.eq, self.st, self.m, -1.0, np.zeros(0), np.full(groups, pressure))


def assert_covariance(p):
    scale = np.sqrt(np.diag(p))
    assert (scale > 0.0).all()
    correlation = p / np.outer(scale, scale)
    np.testing.assert_allclose(correlation, correlation.T, atol=1e-9)
    assert np.linalg.eigvalsh(correlation).min() > -1e-9


@looped("coupled", [False, True])
@looped("direction", [1.0, -1.0])
def test_the_covariance_stays_symmetric_and_positive_whatever_is_read(direction, coupled):
    train, rng = Computers(uneven_train(coupled)), np.random.default_rng(3)
    speed, axles = SPEED, train.eq.axle_radius.size
    deviations = []
    for tick in range(150):
        commanded = direction * (tick % 50 > 20)
        speed += 0.8 * commanded * PERIOD
        slip = direction * rng.exponential(0.5, axles) * (rng.random() < 0.5)
        pressure = rng.uniform(0.0, 3e5) if commanded < 0.0 else 0.0
        train.m.estimate.full[:] = pressure * rng.choice([1.0, 1.2])
        train.sense(
            speed + slip + 0.02 * rng.standard_normal(axles), direction * rng.uniform(0.0, 600.0),
            pressure, commanded,
        )  # fmt: skip
        assert_covariance(train.filter.covariance)
        deviations.append(train.m.train.reference_deviation[0])
        assert deviations[-1] == pytest.approx(np.sqrt(train.filter.covariance[0, 0]))
    assert max(deviations) > 3.0 * min(deviations)  # it has known more, and less


def chain(rng, damping, stiffening, resistance=0.0):
    """A coupled train whose believed cars are apart and move against each other."""
    train = Computers(uneven_train(True))
    q = train.eq.chain.coupler
    q[:, 1], q[:, 2] = stiffening, damping
    train.eq.chain.resistance[:] = [0.0, resistance, 0.0]
    train.m.reference[:] += rng.uniform(-0.5, 0.5, q.shape[0] + 1)
    train.filter.place[:] = rng.uniform(-0.02, 0.02, q.shape[0] + 1)
    train.filter.force[:] = rng.uniform(-1e4, 1e4, q.shape[0] + 1)
    return train


def energy_apart(train):
    """Energy of the believed cars' motion about their mean, and of their springs [J]."""
    q, mass = train.eq.chain.coupler, train.eq.chain.mass
    about = train.m.reference - np.average(train.m.reference, weights=mass)
    stretch = coupler_stretch(-np.diff(train.filter.place), q[:, 3])
    return 0.5 * mass @ about**2 + coupler_spring_energy(stretch, q[:, 0], q[:, 1]).sum()


def test_believed_cars_keep_their_momentum_and_gain_no_energy_however_stiff_their_couplers_are():
    for damping, stiffening in itertools.product((0.0, 2e5, 3e6, 1e7, 1e9, 1e15), (0.0, 1e9, 1e15)):
        train = chain(np.random.default_rng(7), damping, stiffening)
        mass, reference = train.eq.chain.mass, train.m.reference
        train.filter.force[:] = 0.0
        momentum, energy = mass @ reference, energy_apart(train)
        for _ in range(500):
            kalman_filter._move(train.eq, train.st, train.m, train.filter)
            assert mass @ reference == pytest.approx(momentum, rel=1e-9)
            assert energy_apart(train) < 2.0 * energy  # a step's length from what it keeps
        assert energy_apart(train) < 1.1 * energy


def test_the_cars_step_is_that_of_the_whole_system_of_equations():
    train = chain(np.random.default_rng(8), 3e7, 1e11, resistance=500.0)
    eq, k, v = train.eq.chain, train.filter, train.m.reference.copy()
    h = train.st.period / eq.steps
    net = k.force - 500.0 * v * v / np.hypot(v, 0.05)
    matrix = np.diag(eq.mass)
    for b, (stiffness, stiffening, damping, slack) in enumerate(eq.coupler):
        apart = k.place[b] - k.place[b + 1]
        s = apart - np.clip(apart, -0.5 * slack, 0.5 * slack)
        full = damping * min(abs(s) * 1e3, 1.0)
        pair = [1.0, -1.0]
        net[b : b + 2] -= np.multiply(
            pair, stiffness * s + stiffening * s**3 + full * (v[b] - v[b + 1])
        )
        matrix[b : b + 2, b : b + 2] += (
            h * (full + 3.0 * h * stiffening * s**2) * np.outer(pair, pair)
        )
    train.eq = train.eq._replace(chain=eq._replace(steps=1))
    train.st = train.st._replace(period=h)
    kalman_filter._move(train.eq, train.st, train.m, k)
    np.testing.assert_allclose(train.m.reference, v + h * np.linalg.solve(matrix, net), rtol=1e-12)


def test_resistance_stops_believed_cars_and_does_not_turn_them_round():
    train = chain(np.random.default_rng(9), 0.0, 0.0, resistance=1e12)
    train.eq.chain.coupler[:] = 0.0
    train.filter.force[:] = 0.0
    kalman_filter._move(train.eq, train.st, train.m, train.filter)
    np.testing.assert_allclose(train.m.reference, 0.0, atol=1e-12)


def braked(rim, share=BOUND_SHARE):
    """Two braked cars whose wheels turn at `rim` [m/s], none of them at ease or light; their bound counts by `share`."""
    train = Computers(slide_train(2))
    train.st = train.st._replace(pace=train.st.pace._replace(bound_share=share))
    train.filter.full[:] = 3e5
    for _ in range(30):
        train.estimate(rim, 2e5)
    return train


def test_a_braking_wheel_that_runs_ahead_lifts_the_estimate_and_makes_nobody_surer():
    bound, free = braked(SPEED + 0.5), braked(SPEED + 0.5, 0.0)
    assert free.m.reference[0] < SPEED - 0.1
    assert bound.m.reference[0] > SPEED + 0.2
    np.testing.assert_allclose(bound.filter.covariance, free.filter.covariance, rtol=1e-9)
    assert_covariance(bound.filter.covariance)
    # what speed and force have in common moves with it
    assert bound.filter.state[1] > free.filter.state[1]


def test_a_braking_wheel_that_lags_tells_nothing():
    bound, free = braked(SPEED - 2.0), braked(SPEED - 2.0, 0.0)
    np.testing.assert_array_equal(bound.m.reference, free.m.reference)


@looped("lead", [-6.0, 6.0])
def test_a_light_wheels_odd_reading_is_not_believed_at_once(lead):
    persist = ReferenceSpeed().persist
    for told, believed in ((0.4 * persist, False), (0.9 * persist, False), (1.1 * persist, True)):
        train = Computers(slide_train(1))
        train.estimate(SPEED, 2e5)
        before = train.filter.state.copy(), train.filter.covariance.copy()
        train.filter.rim[0] = train.m.reference[0] + lead
        train.filter.rolling_time[0] = told
        kalman_filter._take_light(train.eq, train.st, train.m, train.filter, -1.0, 0, 0.0)
        if believed:
            moved = train.filter.state[0] - before[0][0]
            assert moved == pytest.approx(lead, rel=0.05)
            assert_covariance(train.filter.covariance)
        else:
            np.testing.assert_array_equal(train.filter.state, before[0])
            np.testing.assert_array_equal(train.filter.covariance, before[1])


@looped(("told", "taken"), [(0.4, False), (0.6, True)])
def test_a_light_wheels_likely_reading_is_taken_before(told, taken):
    train = Computers(slide_train(1))
    for _ in range(100):
        train.estimate(train.m.reference[0], 2e5)
    before, variance = train.filter.state[0], train.filter.covariance[0, 0]
    train.filter.rim[0] = train.m.reference[0] - np.sqrt(variance)
    train.filter.rolling_time[0] = told * ReferenceSpeed().persist
    kalman_filter._take_light(train.eq, train.st, train.m, train.filter, -1.0, 0, 0.0)
    assert (train.filter.state[0] < before) == taken
    assert (train.filter.covariance[0, 0] < variance) == taken


def test_a_wagons_axles_are_not_read():
    freight = find_set("freight-5")
    found = []
    for wrong in (0.0, 9.0, np.nan):
        train = Computers(freight)
        sensed = train.eq.axle_sensed
        assert sensed.tolist() == [
            car.speed_sensors for car in freight.cars for _ in car.axle_positions
        ]
        assert 0 < sensed.sum() < sensed.size
        for tick in range(20):
            train.sense(np.where(sensed, SPEED + 0.01 * tick, SPEED + wrong), 800.0, 0.0, 0.5)
        rim = train.eq.axle_radius * train.m.axle_omega
        # what needs a speed of theirs gets the estimate
        np.testing.assert_allclose(rim[~sensed], SPEED, atol=0.5)
        for kept in (train.filter.ease, train.filter.carried, train.filter.rolling_time):
            assert not kept[~sensed].any()  # nor does their agreement make anybody surer
        found.append(train.filter.state.copy())
    np.testing.assert_array_equal(found[1], found[0])
    np.testing.assert_array_equal(found[2], found[0])
    everyone = tuple(replace(car, speed_sensors=True) for car in freight.cars)
    other = Computers(replace(freight, cars=everyone))
    for tick in range(20):
        other.sense(np.where(sensed, SPEED + 0.01 * tick, SPEED + 9.0), 800.0, 0.0, 0.5)
    assert other.filter.state[0] != found[0][0]


def reliefs(train, deviation, ticks, anyone=False, told=True):
    """Torque shares (ticks, units) under a given deviation [m/s]; `told`: whether a wheel tells the speed at once."""
    shares = []
    for _ in range(ticks):
        train.filter.relief.measured[0] = told
        train.m.train.reference_deviation[0] = deviation
        relieve(train.eq, train.st, train.m, anyone)
        shares.append(train.filter.relief.share.copy())
    return np.array(shares)


SHORT = TorqueRelief(time=0.1, longest=0.2, return_time=0.05, pause=0.2, share=0.3)


@looped("told", [True, False])
def test_a_sounding_lasts_as_said_and_takes_one_unit_after_the_other(told):
    train = Computers(uneven_train(), reference=ReferenceSpeed(relief=SHORT))
    train.m.torque[:] = 500.0
    lasting = SHORT.time if told else SHORT.longest
    share = reliefs(train, 5.0, 300, told=told)
    cut = share == SHORT.share
    assert (cut.sum(axis=1) <= 1).all()
    assert ((share < 1.0).sum(axis=1) <= 1).all()
    starts = [(t, int(j)) for t, j in np.argwhere(cut[1:] & ~cut[:-1])]
    assert [j for _, j in starts][:6] == [(starts[0][1] + k) % 4 for k in range(6)]
    for (t, j), (following, _) in pairwise(starts):
        lasted = cut[t + 1 :, j].argmin() * PERIOD
        assert lasted == pytest.approx(lasting, abs=1.5 * PERIOD)
        back = (share[t + 1 :, j] == 1.0).argmax() * PERIOD - lasted
        assert back == pytest.approx(SHORT.return_time * (1.0 - SHORT.share), abs=1.5 * PERIOD)
        assert (following - t) * PERIOD == pytest.approx(lasting + SHORT.pause, abs=2.5 * PERIOD)


def test_who_knows_the_speed_and_who_does_not_pull_is_not_sounded():
    limit = max(SHORT.doubt, SHORT.doubt_ratio * SPEED)
    for deviation, torque, anyone, relieved in (
        (0.99 * limit, 500.0, False, False), (1.01 * limit, 500.0, False, True), (5.0, 0.0, False, False),
        (0.99 * SHORT.ease * limit, 500.0, True, False), (1.01 * SHORT.ease * limit, 500.0, True, True),
    ):  # fmt: skip
        train = Computers(uneven_train(), reference=ReferenceSpeed(relief=SHORT))
        train.m.torque[:] = torque
        assert (reliefs(train, deviation, 40, anyone).min() < 1.0) == relieved


def test_only_a_unit_whose_sliding_wheels_would_be_seen_to_return_is_sounded():
    train = Computers(uneven_train(), reference=ReferenceSpeed(relief=SHORT))
    eq, (*_, last) = train.eq, range(4)
    # torque whose relief accelerates a wheel that slides by just what is seen
    relief = SEEN * eq.own_inertia[last] / GRAVITY / (1.0 - SHORT.share)
    just = relief * eq.axle_load[last] * eq.radius[last] / eq.gear[last]
    for torque, relieved in ((0.99 * just, False), (1.01 * just, True)):
        train.m.torque[:] = 0.0
        train.m.torque[last] = torque
        share = reliefs(train, 5.0, 100)
        assert (share.min(axis=0) < 1.0).tolist() == [False, False, False, relieved]


def test_a_wheel_that_slides_under_its_air_brake_tells_nothing():
    """The rail gives 5 kN to a sliding wheel; it returns by what the cut leaves, and has settled at no time."""
    memory, rail, turning = Computers(uneven_train()).filter.relief, 5e3, 500.0
    memory.clock[0] = SHORT.time + PERIOD

    def settled(applied, rate, before=rail):
        return has_settled(SHORT, memory, before, applied, turning, rate)

    for applied in (0.0, 2e3, 4e3):
        returning = (rail - applied) / turning
        for rate in (returning, -returning):
            assert not settled(applied, rate)
        for rate in (0.0, min(0.49 * returning, 2.9)):
            assert settled(applied, rate)
    # motors that give little, or a wheel that runs away: cutting them moves nothing
    assert not settled(rail - 0.99 * SEEN * turning, 0.0)
    assert not settled(1.2 * rail, 0.0)
    memory.clock[0] = SHORT.time - PERIOD
    assert not settled(2e3, 0.0)


def test_a_unit_without_speed_signals_is_not_sounded():
    train = Computers(uneven_train(), reference=ReferenceSpeed(relief=SHORT))
    train.m.torque[:] = 500.0
    train.m.unit.axles_seen[2] = 0.0
    share = reliefs(train, 5.0, 200)
    assert (share.min(axis=0) < 1.0).tolist() == [True, True, False, True]


def test_one_bogie_is_released_from_doubt_until_the_speed_is_known():
    train = Computers(slide_train(2))
    s, group = train.st.reference.relief, train.filter.relief.group
    train.filter.full[:] = 3e5
    train.filter.pressure[:] = 2e5, 2e5, 1e5, 2e5
    train.filter.rim[:] = 0.9 * SPEED  # all slide
    for deviation, released in (
        (0.99 * s.air_doubt, -1), (1.01 * s.air_doubt, 2), (1.01 * s.air_known, 2), (0.99 * s.air_known, -1)
    ):  # fmt: skip
        reliefs(train, deviation * SPEED, 3)
        assert group[0] == released
    train.filter.rim[0] = SPEED  # one of them rolls: there is time
    reliefs(train, 0.99 * s.patience * s.air_doubt * SPEED, 3)
    assert group[0] == -1
    reliefs(train, 1.01 * s.patience * s.air_doubt * SPEED, 1)
    assert group[0] == 2
    train.filter.full[:] = 0.0  # the brakes are released
    reliefs(train, 5.0, 1)
    assert group[0] == -1


@looped("noise", [0.0, 0.04 / 3.6])
def test_a_reading_is_as_uncertain_as_its_sensor(noise):
    train = Computers(slide_train(1), sensors=Sensors(speed_noise=noise, speed_quantum=0.03))
    expected = ReferenceSpeed().sensor ** 2 + noise**2 + 0.03**2 / 12.0
    assert train.st.reference.noise**2 == pytest.approx(expected)


def test_what_depends_on_the_period_is_the_same_over_a_second():
    given = ReferenceSpeed()
    usual, slow = (reference_pace(given, period) for period in (PERIOD, 4.0 * PERIOD))
    assert usual.bound_share == pytest.approx(BOUND_SHARE)
    assert usual.repeat == pytest.approx(given.repeat)
    for kept in (
        lambda pace: 1.0 - pace.observer_gain,
        lambda pace: pace.carried_kept,
        lambda pace: pace.slid_kept,
    ):
        assert kept(slow) == pytest.approx(kept(usual) ** 4)
    for name in ("repeat", "light_repeat", "relieved_repeat"):
        assert getattr(slow, name) == pytest.approx(getattr(usual, name) / 4.0)
    long = reference_pace(given, 0.5)
    assert max(long.mean_share, long.bound_share) <= 0.5  # beyond 1 they would overshoot


@pytest.mark.parametrize("seed", [1, 2])
def test_a_reading_corrects_as_a_library_s_update(seed):
    filterpy = pytest.importorskip("filterpy.kalman")
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 4))
    state, covariance, slip = rng.normal(size=4), root @ root.T + 0.1 * np.eye(4), 0.07
    known = filterpy.KalmanFilter(4, 1)
    known.x, known.P = state[:, np.newaxis].copy(), covariance.copy()
    known.update(12.3, R=0.04, H=np.array([[1.0, 0.0, slip, 0.0]]))
    innovation = 12.3 - (state[0] + slip * state[2])
    take_reading(state, covariance, slip, innovation, 0.04)
    np.testing.assert_allclose(state, known.x[:, 0], atol=1e-10)
    np.testing.assert_allclose(covariance, known.P, atol=1e-10)


ROLLING, NOISE, PERIODS = 15.0, 0.02, 150


NOISY = Onboard(
    reference=ReferenceSpeed(source="truth", radii_compared=False),
    sensors=Sensors(radius_error=0.005, speed_noise=NOISE, seed=6),
)


class Rolling:
    """Computers that know the speed, and are told of wheels that roll at it, with noise."""

    def __init__(self, onboard=NOISY):
        self.model = build(uneven_train(), Rail(0.1))
        self.eq, self.onboard = equipment(self.model, onboard), onboard
        self.st = settings(onboard, RuleSettings(0), "none")
        self.m = memory(self.eq, ROLLING, 0.1)
        self.rng, self.read = np.random.default_rng(3), []

    def period(self, commanded=0.0, torque=0.0, pressure=0.0, slip=None):
        eq = self.eq
        omega = ROLLING / self.model.structure.radius
        if slip is not None:
            omega = omega * (1.0 + slip)
        noise = NOISE * self.rng.standard_normal(omega.size)
        torque, pressure = np.full(eq.axles.size, torque), np.full(eq.group.unit.size, pressure)
        sense(eq, self.st, self.m, 0.0, commanded, omega, torque, pressure, noise)
        self.read.append(eq.axle_radius * omega + noise)

    @property
    def factor(self):
        return self.m.estimate.radii.factor


def test_the_factors_are_the_posterior_means_of_the_radii():
    """Gaussian prior of every radius, Gaussian readings, mean of all radii unobservable: least squares over all readings."""
    one = Rolling()
    for _ in range(PERIODS):
        one.period()
    taken = np.array(one.read)[-(PERIODS - round(AFTER / 0.01)) :] / ROLLING - 1.0
    variance = 2.0 * one.st.reference.noise**2 / ROLLING**2
    prior = one.onboard.reference.radius_deviation**2
    ahead = taken - taken.mean(axis=1, keepdims=True)
    expected = ahead.sum(axis=0) / variance / (taken.shape[0] / variance + 1.0 / prior)
    # of the filter's start, and of the second order in the errors
    np.testing.assert_allclose(1.0 - one.factor, expected, atol=1e-4)
    true = one.eq.axle_radius / one.model.structure.radius
    assert np.abs(true / true.mean() - 1.0).max() > 3e-3
    np.testing.assert_allclose(one.factor * true, (one.factor * true).mean(), atol=5e-4)
    assert one.factor.mean() == pytest.approx(1.0, abs=1e-5)


@looped("doing", [{"commanded": -0.5}, {"torque": 200.0}, {"pressure": 50e3}])
def test_nothing_is_learnt_while_a_force_acts_or_shortly_after(doing):
    one = Rolling()
    for _ in range(60):
        one.period(**doing)
    for _ in range(round(AFTER / 0.01) - 1):
        one.period()
    np.testing.assert_array_equal(one.factor, 1.0)
    for _ in range(3):
        one.period()
    assert (one.factor != 1.0).all()


def test_a_wheel_that_cannot_roll_is_left_out():
    one, other = Rolling(), Rolling()
    slip = np.zeros(one.eq.axle_radius.size)
    slip[2] = -1.5 * GATE * NOISY.reference.radius_deviation
    for _ in range(PERIODS):
        one.period(slip=slip)
        other.period()
    assert one.factor[2] == 1.0
    kept = np.delete(one.factor / other.factor, 2)
    np.testing.assert_allclose(kept, kept.mean(), atol=2e-4)


def test_what_is_learnt_is_no_acceleration_and_no_slip():
    """Radii wrong by half a per cent at 15 m/s are 0.08 m/s, which the first readings correct at once."""
    one, detections = Rolling(), []
    for _ in range(PERIODS):
        before = one.factor.copy()
        one.period()
        detections.append(int(one.m.counter.unit_detections[0]))
        if (one.factor != before).any():
            np.testing.assert_array_equal(one.m.unit.computed_acceleration, 0.0)
    assert (one.factor != 1.0).all()
    assert detections[-1] == detections[round(AFTER / 0.01) - 2]


def test_without_a_deviation_the_radii_stand():
    one = Rolling(replace(NOISY, reference=ReferenceSpeed(source="truth", radius_deviation=0.0)))
    for _ in range(PERIODS):
        one.period()
    np.testing.assert_array_equal(one.factor, 1.0)
