"""The speed over ground that axles tell, on motions whose forces and slips are stated here and not simulated."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from alloc.errors import EstimationError
from alloc.plant.laws import GRAVITY
from studies.logs.ground_speed import GroundSpeed, estimate_ground_speed
from studies.logs.known_train import MeasuredTrain
from studies.logs.logged_computers import FilterTrace
from studies.logs.speed_smoother import smooth

MASS, INERTIA, RADIUS = 40e3, 120.0, 0.43
TRAILING = MeasuredTrain(
    name="two motored axles of four",
    car_mass=np.array([MASS]),
    axle_car=np.zeros(4, dtype=np.int64),
    axle_load=np.full(4, MASS * GRAVITY / 4.0),
    radius=np.full(4, RADIUS),
    inertia=np.full(4, INERTIA),
    driven=np.array([True, True, False, False]),
    resistance=np.array([[500.0, 20.0, 2.0]]),
)
MOTORED = replace(TRAILING, driven=np.ones(4, dtype=bool))
NOISE = 0.04 / 3.6
STEP = 1e-3


class Motion(NamedTuple):
    """A motion sampled every millisecond."""

    train: MeasuredTrain
    time: np.ndarray
    speed: np.ndarray
    rim: np.ndarray
    force: np.ndarray

    def found(self, period=0.01, noise=NOISE, seed=0, **changed) -> tuple[GroundSpeed, np.ndarray]:
        """The estimate, and its error."""
        rows = slice(None, None, round(period / STEP))
        rng, rim = np.random.default_rng(seed), self.rim[rows]
        given = {
            "time": self.time[rows],
            "part": np.zeros(rim.shape[0], dtype=np.int64),
            "rim_speed": rim + rng.normal(0.0, noise, rim.shape),
            "applied_force": self.force[rows],
            "train": self.train,
        } | changed
        found = estimate_ground_speed(**given)
        return found, found.speed - self.speed[rows][: found.speed.size]


def move(train, force, slip, duration=20.0, start=15.0, grade=0.0) -> Motion:
    """Motion under `force(time)` [N] at each axle and `slip(time)` [m/s] of each, (instants, axles); `grade` from 5 s on."""
    time = np.arange(0.0, duration, STEP)
    axles = train.radius.size
    f, s = (np.broadcast_to(item(time[:, None]), (time.size, axles)) for item in (force, slip))
    turning = train.inertia / train.radius**2
    given = f.sum(axis=1) - (turning * np.gradient(s, STEP, axis=0)).sum(axis=1)
    total, a, b, c = train.car_mass.sum(), *train.resistance.sum(axis=0)
    speed = np.full(time.size, start)
    for k in range(time.size - 1):
        v = speed[k]
        climb = grade if time[k] >= 5.0 else 0.0
        net = given[k] - (a + b * v + c * v * v) - total * GRAVITY * climb
        speed[k + 1] = v + STEP * net / (total + turning.sum())
    return Motion(train, time, speed, speed[:, None] + s, f)


def first_rows(motion, rows):
    """The motion's first `rows` rows of 10 ms."""
    last = rows * round(0.01 / STEP)
    return Motion(motion.train, *(item[:last] for item in motion[1:]))


def pulse(time, begin, end):
    """A smooth rise from 0 to 1 and back between two instants."""
    inside = np.clip((time - begin) / (end - begin), 0.0, 1.0)
    return np.sin(np.pi * inside) ** 2


@pytest.fixture(scope="module")
def trailing():
    """Two driven axles that slip for five seconds, two that roll."""
    driven = np.array([1.0, 1.0, 0.0, 0.0])
    return move(TRAILING, lambda t: 9e3 * driven, lambda t: 2.0 * driven * pulse(t, 5.0, 10.0))


@pytest.fixture(scope="module")
def blind():
    """All axles driven; all slip from 4 s until the driver shuts off at 16 s."""
    return move(
        MOTORED, lambda t: 6e3 * ((t > 2.0) & (t < 16.0)), lambda t: 3.0 * pulse(t, 4.0, 16.0)
    )


@pytest.mark.parametrize("period", [0.01, 0.02, 0.05, 0.1])
def test_with_axles_that_roll_the_bias_is_below_two_millimetres_per_second(trailing, period):
    for seed in range(3):
        found, error = trailing.found(period, seed=seed)
        assert abs(error.mean()) < 0.002
        assert np.abs(error).max() < 0.012
        assert (np.abs(error) < 3.0 * found.deviation + 0.001).all()
        assert found.deviation.max() < 0.015
        assert found.told[1:].mean() > 0.95


@pytest.mark.parametrize("period", [0.01, 0.05, 0.1])
def test_where_all_axles_slip_forces_carry_the_estimate_and_the_error_is_stated(blind, period):
    found, error = blind.found(period)
    sliding = (blind.time[:: round(period / STEP)] > 6.0) & (
        blind.time[:: round(period / STEP)] < 14.0
    )
    assert found.told[sliding].mean() < 0.1
    assert (np.abs(error) < 3.0 * found.deviation + 0.005).all()
    assert np.abs(error).max() < 0.1  # of 3 m/s of slip
    assert found.deviation[sliding].min() > 2.0 * found.deviation[~sliding].min()


def test_wheels_that_roll_again_correct_what_lies_before(blind):
    """A mass that is wrong by 10 % is as much of the force, for as long as nobody rolls."""
    heavy = replace(MOTORED, car_mass=1.1 * MOTORED.car_mass, axle_load=1.1 * MOTORED.axle_load)
    _, error = blind.found(train=heavy)
    half = blind.time.size // 20
    until = 15 * half // 10  # the filter alone has no more than this
    cut, lost = first_rows(blind, until).found(train=heavy)
    assert cut.speed.size == until
    assert np.abs(error[:until]).max() < 0.6 * np.abs(lost).max()


def test_an_uneven_sampling_is_taken_as_it_is(trailing):
    rng = np.random.default_rng(4)
    rows = np.unique(np.cumsum(rng.integers(5, 60, 800)))
    rows = rows[rows < trailing.time.size]
    found = estimate_ground_speed(
        trailing.time[rows], np.zeros(rows.size, dtype=np.int64),
        trailing.rim[rows] + rng.normal(0.0, NOISE, (rows.size, 4)), trailing.force[rows], TRAILING,
    )  # fmt: skip
    error = found.speed - trailing.speed[rows]
    assert abs(error.mean()) < 0.002
    assert np.abs(error).max() < 0.012


def test_a_gap_restarts_the_estimate(trailing):
    part = np.zeros(2000, dtype=np.int64)
    part[1000:] = 1
    whole, error = trailing.found(part=part)
    spoilt = trailing.rim[::10].copy()
    spoilt[:1000] += 5.0
    other, _ = trailing.found(part=part, noise=0.0, rim_speed=spoilt)
    clean, _ = trailing.found(part=part, rim_speed=trailing.rim[::10])
    np.testing.assert_array_equal(other.speed[1000:], clean.speed[1000:])
    assert np.abs(error).max() < 0.012
    assert not whole.told[1000]


def test_forces_that_are_missing_for_a_moment_are_held_and_for_long_end_it(trailing):
    force = trailing.force[::10].copy()
    force[300:310, 0] = np.nan
    force[1200:1300, 1] = np.nan
    found, error = trailing.found(applied_force=force)
    known = np.isfinite(found.speed)
    assert known[:1200].all()
    assert not known[1225:1300].any()
    assert known[1300:].all()
    assert np.nanmax(np.abs(error)) < 0.015


def test_axles_without_signal_are_not_read(trailing):
    rim = trailing.rim[::10].copy()
    rim[:, 3] = np.nan
    rim[400:1200, 2] = np.nan  # the other that rolls, while the driven ones slip
    found, error = trailing.found(rim_speed=rim)
    assert np.isfinite(found.speed).all()
    assert (np.abs(error) < 3.0 * found.deviation + 0.002).all()
    assert found.deviation[400:1200].max() > 2.0 * found.deviation[300:400].min()


@pytest.mark.parametrize(("known", "most"), [(False, 0.5), (True, 0.02)])
def test_a_gradient_that_begins_unseen_is_known_by_its_column(known, most):
    climb = move(
        MOTORED,
        lambda t: 6e3 * ((t > 2.0) & (t < 16.0)),
        lambda t: 3.0 * pulse(t, 4.0, 16.0),
        grade=0.02,
    )
    grade = np.where(climb.time[::10] >= 5.0, 0.02, 0.0)
    _, error = climb.found(grade=grade if known else None)
    assert np.abs(error).max() < most


def test_a_train_that_stands_with_its_brakes_on_is_at_rest():
    time = np.arange(0.0, 30.0, 0.02)
    speed = np.maximum(8.0 - time, 0.0)
    turning = 4.0 * INERTIA / RADIUS**2
    force = np.tile(-(MASS + turning) / 4.0, (time.size, 4))
    train = replace(MOTORED, resistance=None)
    found = estimate_ground_speed(
        time, np.zeros(time.size, dtype=np.int64), np.tile(speed[:, None], 4), force, train
    )
    standing = time > 14.0
    np.testing.assert_allclose(found.speed[standing], 0.0, atol=0.01)
    assert found.deviation[standing].max() < 0.05
    np.testing.assert_allclose(found.speed, speed, atol=0.15)


def test_wheels_that_stand_without_a_brake_tell_that_the_train_stands():
    """All wheels lock at 6 m/s, by shoes that a log overstates; the brakes are released at the end."""
    time = np.arange(0.0, 20.0, 0.02)
    speed = np.maximum(10.0 - time, 0.0)
    rim = np.where(speed > 6.0, speed, 0.0)
    turning = 4.0 * INERTIA / RADIUS**2
    force = np.where(time < 15.0, -(MASS + turning) / 4.0 * np.where(speed > 6.0, 1.0, 0.7), 0.0)
    found = estimate_ground_speed(
        time, np.zeros(time.size, dtype=np.int64), np.tile(rim[:, None], 4),
        np.tile(force[:, None], 4), replace(MOTORED, resistance=None),
    )  # fmt: skip
    np.testing.assert_allclose(found.speed[time > 15.6], 0.0, atol=0.01)
    assert found.deviation[time > 15.6].max() < 0.02
    locked = (time > 4.5) & (time < 9.0)
    assert (np.abs(found.speed - speed)[locked] < 3.0 * found.deviation[locked]).all()


@pytest.mark.parametrize("quantum", [0.1 / 3.6, 1.0 / 3.6])
def test_quantised_speeds_are_known_to_a_part_of_their_quantum(trailing, quantum):
    rim = np.round(trailing.rim[::10] / quantum) * quantum
    found, error = trailing.found(rim_speed=rim)
    assert np.sqrt((error**2).mean()) < 0.03 * quantum
    assert (np.abs(error) < 3.0 * found.deviation).all()
    assert (found.deviation > 0.28 * quantum).all()


def test_who_begins_while_all_slip_says_that_it_is_unsure():
    late = move(
        MOTORED,
        lambda t: 6e3 * (t < 6.0),
        lambda t: 1.5 * np.clip((5.0 - t) / 5.0, 0.0, 1.0) * (t < 5.0),
    )
    found, error = late.found()
    assert abs(error[0]) < 3.0 * found.deviation[0]
    assert np.abs(error[700:]).max() < 0.02


@pytest.mark.parametrize(
    ("lost", "words"),
    [
        ((0,), "axle 1 has no force"),
        ((1,), "axle 2 has no force"),
        ((0, 1, 2, 3), "axle 1 has no force"),
    ],
)
def test_forces_of_driven_axles_are_needed(trailing, lost, words):
    force = trailing.force[::10].copy()
    force[:, list(lost)] = np.nan
    with pytest.raises(EstimationError, match=words):
        trailing.found(applied_force=force)


def test_a_trailing_axle_without_force_is_read_while_the_train_pulls(trailing):
    force = trailing.force[::10].copy()
    force[:, 2:] = np.nan
    found, error = trailing.found(applied_force=force)
    assert np.abs(error).max() < 0.012
    braked, _ = trailing.found(applied_force=-force)
    assert braked.deviation.mean() > 5.0 * found.deviation.mean()


def test_the_smoother_gives_what_least_squares_over_all_instants_gives():
    """Speed, its unknown rate and an error of a known force, by readings of the speed alone."""
    rng, count, walk, noise = np.random.default_rng(6), 12, 0.3, 0.5
    step, acting = rng.uniform(0.5, 1.5, count), rng.normal(0.0, 1.0, count)
    read = rng.normal(0.0, 2.0, count)
    moved = np.tile(np.eye(4), (count, 1, 1))
    moved[:, 0, 1], moved[:, 0, 3] = step, step * acting
    q = np.diag([0.1, walk, 1e-3, 1e-3])
    x, p = np.zeros(4), np.diag([4.0, 1.0, 0.5, 0.2])
    before = np.linalg.inv(p)
    trace = FilterTrace(
        np.zeros((count, 4)), np.zeros((count, 4, 4)), np.zeros((count, 4)), np.zeros((count, 4, 4)),
        acting, np.zeros(count), np.zeros(count, dtype=bool),
    )  # fmt: skip
    information, target = np.zeros((4 * count, 4 * count)), np.zeros(4 * count)
    information[:4, :4] += before
    for k in range(count):
        own = slice(4 * k, 4 * k + 4)
        if k > 0:
            x, p = moved[k] @ x, moved[k] @ p @ moved[k].T + q
            both = np.hstack([-moved[k], np.eye(4)])
            information[4 * k - 4 : 4 * k + 4, 4 * k - 4 : 4 * k + 4] += (
                both.T @ np.linalg.inv(q) @ both
            )
        trace.predicted[k], trace.predicted_covariance[k] = x, p
        gain = p[:, 0] / (p[0, 0] + noise**2)
        x, p = x + gain * (read[k] - x[0]), p - np.outer(gain, p[0])
        trace.state[k], trace.covariance[k] = x, p
        information[own.start, own.start] += 1.0 / noise**2
        target[own.start] += read[k] / noise**2
    state, covariance = smooth(step, trace)
    inverse = np.linalg.inv(information)
    np.testing.assert_allclose(state.ravel(), inverse @ target, rtol=1e-8, atol=1e-8)
    for k in range(count):
        np.testing.assert_allclose(
            covariance[k], inverse[4 * k : 4 * k + 4, 4 * k : 4 * k + 4], rtol=1e-7, atol=1e-9
        )
