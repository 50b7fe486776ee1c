"""When a train moves: by its wheels, which may be locked, and a measured speed, which may be late."""

from dataclasses import replace

import numpy as np

from studies.logs.known_train import MeasuredTrain
from studies.logs.speed_shape import AFTER, motion_of, shape_of_forces, standing
from studies.logs.train_readings import TrainReadings
from tests.simulation.slides import TRAIN

TIME = np.arange(0.0, 10.0, 0.1)


TRAIN_READ = MeasuredTrain.of(TRAIN)


def readings(
    time: np.ndarray, rim: np.ndarray, force: np.ndarray | None = None, train=TRAIN_READ, noise=0.0
) -> TrainReadings:
    force = np.zeros(rim.shape) if force is None else force
    return TrainReadings(time, np.zeros(time.size, np.int64), rim, force, train, None, noise)


def wheels(speed: np.ndarray, noise: float = 0.0) -> TrainReadings:
    rim = np.stack([speed, speed, np.full(speed.size, np.nan)], axis=1)
    return readings(TIME[: speed.size], rim, noise=noise)


def test_a_train_that_stands_is_not_under_way():
    speed = np.maximum(TIME - 4.0, 0.0)
    under_way, unclear = motion_of(wheels(speed), speed)
    assert np.all(under_way[TIME < 4.0] == 0.0)
    assert np.isclose(under_way[-1], TIME[-1] - 4.0, atol=0.2)
    assert not unclear[TIME > 4.3].any()


def test_a_train_that_rolls_back_is_known():
    """Wheels below 0 are as well known as others: a start on a hill is at rest until it moves."""
    rolls = np.where(TIME < 3.0, -0.02, 2.0 * (TIME - 3.0))
    assert standing(wheels(rolls, 0.01), np.maximum(rolls, 0.0))[TIME < 3.0].all()
    assert not standing(wheels(rolls), np.maximum(rolls, 0.0))[TIME < 3.0].any()
    assert not standing(wheels(np.full(TIME.size, -0.3)), np.full(TIME.size, 0.5)).any()


def test_wheels_that_all_lock_leave_it_open_whether_the_train_moves():
    speed = np.maximum(5.0 - TIME, 0.0)
    locked = np.where(TIME < 4.2, speed, 0.0)
    under_way, unclear = motion_of(wheels(locked), speed)
    slides = (TIME > 4.25) & (speed > 0.25)
    assert unclear[slides].all()
    assert np.all(np.diff(under_way)[slides[1:]] > 0.0)
    assert not unclear[TIME > 5.0 + AFTER].any()


def test_wheels_that_lock_in_the_last_moment_leave_it_open_too():
    speed = np.maximum(0.3 - 0.1 * TIME, 0.0)
    locked = np.where(speed > 0.18, speed, 0.0)
    unclear = motion_of(wheels(locked), speed).unclear
    assert unclear[(locked == 0.0) & (speed > 0.06)].all()


def test_noise_does_not_make_a_rest_unclear():
    speed = np.maximum(TIME - 4.0, 0.0)
    noisy = speed + 0.05 * np.random.default_rng(3).standard_normal(TIME.size)
    assert motion_of(wheels(speed), noisy).unclear[TIME < 4.0].any()
    assert not motion_of(wheels(speed), noisy, 0.05).unclear.any()


def test_a_train_that_comes_to_rest_while_it_rolls_leaves_no_jump():
    """On a hill that nobody told, the shape drifts from the speed evenly, and not while the train stands."""
    train = replace(MeasuredTrain.of(TRAIN), resistance=None)
    time = np.arange(0.0, 20.0, 0.01)
    speed = 1.2 - 0.12 * time
    rim = np.repeat(speed[:, None], train.radius.size, axis=1)
    shape = shape_of_forces(readings(time, rim, train=train), speed)
    apart = np.diff(shape - speed) / 0.01
    assert np.ptp(apart[:800]) < 1e-9
    assert apart.min() > -1e-9
    assert apart.max() < 0.13


def test_unknown_wheels_do_not_stand():
    assert not standing(readings(TIME[:3], np.full((3, 2), np.nan)), np.zeros(3)).any()
    assert not standing(readings(TIME[:3], np.zeros((3, 0))), np.zeros(3)).any()


def shape_of(
    time: np.ndarray, cars: np.ndarray, against: np.ndarray, train: MeasuredTrain
) -> np.ndarray:
    """The shape by the force that gives `cars` (instants, cars) their speeds `against` the rest, (instants,)."""
    rim = cars[:, train.axle_car]
    return shape_of_rims(time, cars @ train.car_mass / train.car_mass.sum(), rim, against, train)


def shape_of_rims(
    time: np.ndarray, speed: np.ndarray, rim: np.ndarray, against: np.ndarray, train: MeasuredTrain
) -> np.ndarray:
    momentum = train.car_mass.sum() * speed + rim @ (train.inertia / train.radius**2)
    force = np.gradient(momentum, time) + against
    forces = np.repeat(force[:, None] / rim.shape[1], rim.shape[1], axis=1)
    shape = shape_of_forces(readings(time, rim, forces, train), speed)
    return shape - shape[0]


def against_of(cars: np.ndarray, train: MeasuredTrain) -> np.ndarray:
    """Running resistance of the cars that move."""
    a, b, c = train.resistance.T
    return (np.sign(cars) * (a + np.abs(cars) * (b + np.abs(cars) * c))).sum(axis=1)


def test_a_car_that_stands_has_no_resistance():
    """Cars that start one after another, as behind slack couplers."""
    train, time = MeasuredTrain.of(TRAIN), np.arange(0.0, 12.0, 0.01)
    cars = 0.3 * np.maximum(time[:, None] - [0.0, 2.0, 5.0], 0.0)
    speed = cars @ train.car_mass / train.car_mass.sum()
    shape = shape_of(time, cars, against_of(cars, train), train)
    np.testing.assert_allclose(shape, speed, atol=0.01)


def test_resistance_turns_round_with_a_train_that_rolls_back():
    train, time = MeasuredTrain.of(TRAIN), np.arange(0.0, 12.0, 0.01)
    cars = np.repeat((3.0 - 0.5 * time)[:, None], train.car_mass.size, axis=1)
    shape = shape_of(time, cars, against_of(cars, train), train)
    np.testing.assert_allclose(shape, cars[:, 0] - cars[0, 0], atol=2e-3)


def test_locked_wheels_do_not_change_how_an_unknown_gradient_drifts():
    """The shape lacks the gradient all the time, also where the measured speed stands in for the forces."""
    train = replace(MeasuredTrain.of(TRAIN), resistance=None)
    time, lacking = np.arange(0.0, 12.0, 0.01), 0.2
    speed = 20.0 - 0.8 * time
    turns = np.interp(time, [4.5, 5.0, 7.0, 7.5], [1.0, 0.0, 0.0, 1.0])
    rim = np.repeat((turns * speed)[:, None], train.radius.size, axis=1)
    shape = shape_of_rims(
        time, speed, rim, np.full(time.size, lacking * train.car_mass.sum()), train
    )
    np.testing.assert_allclose(shape - (speed - speed[0]), lacking * time, atol=0.03)


def test_wheels_that_all_roll_back_do_not_stand():
    assert not standing(wheels(np.full(TIME.size, -0.1)), np.zeros(TIME.size)).any()
