"""Brake force per car: (2) to (8) give back what a train was built with; the window; the smoother; constant errors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.errors import EstimationError
from alloc.estimation.brake_force import (
    BrakeRigging,
    CalibrationErrors,
    braking_window,
    car_brake_forces,
    coupler_force_between,
    group_brake_force,
    level_acceleration,
    rolling_mass,
    smooth_brake_forces,
)
from alloc.plant.laws import GRAVITY
from tests.cases import looped

few = settings(max_examples=60, deadline=None, derandomize=True)


FOUR_MASSES = np.array([96e3, 59e3, 60e3, 40e3])


TURNING = np.array([5e3, 1.3e3, 1.3e3, 1.3e3])


FORCE = np.array([60e3, 30e3, 0.0, 37e3])


def rigid_train(force, mass, resistance, grade, turning):
    """A train in which all cars share one acceleration: that acceleration and the coupler forces that follow."""
    slope = GRAVITY * mass * grade / np.sqrt(1.0 + grade**2)
    a = -(force + resistance + slope).sum() / (mass + turning).sum()
    # newton's law of each car from the front: (m + J/r2) a = -f - W - G + R_before - R_behind
    rest = -(mass + turning) * a - force - resistance - slope
    return a, np.cumsum(rest)[:-1]


@few
@given(
    seed=st.integers(0, 10_000),
    cars=st.integers(2, 18),
    grade=st.floats(-0.03, 0.03),
    turning=st.booleans(),
)
def test_a_train_at_constant_acceleration_is_recovered_exactly(seed, cars, grade, turning):
    draw = np.random.default_rng(seed)
    mass = draw.uniform(15e3, 100e3, cars)
    turning = mass * draw.uniform(0.01, 0.1, cars) * turning
    force, resistance = draw.uniform(-20e3, 60e3, cars), draw.uniform(0.0, 3e3, cars)
    a, couplers = rigid_train(force, mass, resistance, grade, turning)
    series = level_acceleration(np.full((3, cars), a), grade, turning / mass)
    found = car_brake_forces(series, np.tile(couplers, (3, 1)), mass + turning, resistance)
    np.testing.assert_allclose(found, np.tile(force, (3, 1)), atol=1e-6)


@few
@given(seed=st.integers(0, 10_000), own=st.booleans())
def test_couplers_cancel_in_the_sum_of_all_cars(seed, own):
    draw = np.random.default_rng(seed)
    a = draw.normal(size=(5, 4) if own else 5)
    found = car_brake_forces(a, draw.normal(0.0, 1e5, (5, 3)), FOUR_MASSES)
    total = -(FOUR_MASSES * a).sum(axis=1) if own else -FOUR_MASSES.sum() * a
    np.testing.assert_allclose(found.sum(axis=1), total, rtol=1e-9, atol=1e-6)


def test_groups_are_sums_of_their_cars():
    draw = np.random.default_rng(0)
    a, couplers = draw.normal(size=50), draw.normal(0.0, 1e5, (50, 3))
    cars = car_brake_forces(a, couplers, FOUR_MASSES, 1e3)
    locomotive = group_brake_force(a, FOUR_MASSES[0], rear=couplers[:, 0], resistance=1e3)
    wagons = group_brake_force(a, FOUR_MASSES[1:].sum(), front=couplers[:, 0], resistance=3e3)
    middle = group_brake_force(a, FOUR_MASSES[1:3].sum(), couplers[:, 0], couplers[:, 2], 2e3)
    np.testing.assert_allclose(locomotive, cars[:, 0])
    np.testing.assert_allclose(wagons, cars[:, 1:].sum(axis=1))
    np.testing.assert_allclose(middle, cars[:, 1:3].sum(axis=1))


def test_a_train_read_from_its_rear_has_the_same_forces():
    draw = np.random.default_rng(1)
    a, couplers = draw.normal(size=(9, 4)), draw.normal(0.0, 1e5, (9, 3))
    forward = car_brake_forces(a, couplers, FOUR_MASSES)
    # seen from the rear everything moves the other way: accelerations and brake forces change their sign, tension not
    backward = -car_brake_forces(-a[:, ::-1], couplers[:, ::-1], FOUR_MASSES[::-1])[:, ::-1]
    np.testing.assert_allclose(forward, backward)


def test_forces_scale_with_masses_and_couplers():
    draw = np.random.default_rng(2)
    a, couplers = draw.normal(size=(9, 4)), draw.normal(0.0, 1e5, (9, 3))
    np.testing.assert_allclose(
        car_brake_forces(a, 3.0 * couplers, 3.0 * FOUR_MASSES),
        3.0 * car_brake_forces(a, couplers, FOUR_MASSES),
    )


def test_shared_acceleration_is_the_same_as_equal_ones():
    a, couplers = np.array([-0.5, -0.6]), np.ones((2, 3))
    np.testing.assert_array_equal(
        car_brake_forces(a, couplers, FOUR_MASSES),
        car_brake_forces(np.repeat(a[:, None], 4, axis=1), couplers, FOUR_MASSES),
    )


@few
@given(decrement=st.floats(-3.0, 3.0), m=st.floats(1e3, 1e6), n=st.floats(1e3, 1e6))
def test_forces_in_proportion_to_masses_leave_the_coupler_free(decrement, m, n):
    between = coupler_force_between(decrement * m, m, decrement * n, n)
    assert abs(between) <= 1e-9 * (abs(decrement) + 1.0) * max(m, n)


def test_the_coupler_force_of_6_is_that_of_a_train_without_relative_motion():
    _, couplers = rigid_train(FORCE, FOUR_MASSES, 0.0 * FOUR_MASSES, 0.0, 0.0 * FOUR_MASSES)
    for k in range(3):
        parts = (
            FORCE[: k + 1].sum(),
            FOUR_MASSES[: k + 1].sum(),
            FORCE[k + 1 :].sum(),
            FOUR_MASSES[k + 1 :].sum(),
        )
        assert coupler_force_between(*parts) == pytest.approx(couplers[k])
    # only the front braked: the rear pushes
    assert coupler_force_between(60e3, 96e3, 0.0, 295e3) < 0.0


def test_the_mass_decides_which_force_is_meant():
    """With the rolling mass the force at the brakes, with the bare mass what the rail gets."""
    a, couplers = rigid_train(FORCE, FOUR_MASSES, 0.0 * FOUR_MASSES, 0.0, TURNING)
    rolling = rolling_mass(FOUR_MASSES, TURNING * 0.43**2, 0.43 * np.ones(4))
    np.testing.assert_allclose(rolling, FOUR_MASSES + TURNING)
    at_brakes, at_rails = (car_brake_forces([a], [couplers], m)[0] for m in (rolling, FOUR_MASSES))
    np.testing.assert_allclose(at_brakes, FORCE, atol=1e-6)
    np.testing.assert_allclose(at_brakes - at_rails, -TURNING * a)


def test_theoretical_force_is_a_product_and_sums_over_cars():
    rigging = BrakeRigging(cylinders=2, lever_ratio=5.0, efficiency=0.9, piston_area=0.05)
    assert rigging.force(350e3, 0.2) == pytest.approx(2 * 5.0 * 0.9 * 0.05 * 350e3 * 0.2)
    pressure, friction = np.linspace(0.0, 4e5, 7), np.linspace(0.15, 0.25, 7)
    np.testing.assert_allclose(
        rigging.force(pressure, friction, 17), 17 * rigging.force(pressure, friction)
    )


def test_one_car_alone_has_no_couplers():
    found = car_brake_forces([-1.0, -0.5], np.zeros((2, 0)), [10e3])
    np.testing.assert_allclose(found[:, 0], [10e3, 5e3])


@looped(
    ("arguments", "named"),
    [
        (([-1.0, np.nan], np.zeros((2, 3)), FOUR_MASSES), r"acceleration holds nan at \(1,\)"),
        (([-1.0, -1.0], np.zeros((2, 4)), FOUR_MASSES), r"coupler_force has shape \(2, 4\)"),
        ((np.zeros((2, 3)), np.zeros((2, 3)), FOUR_MASSES), r"acceleration has shape \(2, 3\)"),
        (([], np.zeros((0, 3)), FOUR_MASSES), "acceleration is empty"),
        (([-1.0], np.zeros((1, 3)), -FOUR_MASSES), "mass = .* must exceed 0"),
        (([-1.0], [[0.0, np.inf, 0.0]], FOUR_MASSES), r"coupler_force holds inf at \(0, 1\)"),
        (([-1.0], np.zeros((1, 3)), FOUR_MASSES, np.zeros(3)), "resistance has shape"),
    ],
)
def test_bad_series_are_refused(arguments, named):
    with pytest.raises(EstimationError, match=named):
        car_brake_forces(*arguments)


def test_bad_groups_are_refused():
    with pytest.raises(EstimationError, match="front has shape"):
        group_brake_force([-1.0, -1.0], 1e3, front=[0.0])
    with pytest.raises(EstimationError, match="mass"):
        group_brake_force([-1.0], 0.0)
    with pytest.raises(EstimationError, match="radius"):
        rolling_mass([1e3], [10.0], [0.0])


TIME = np.arange(0.0, 30.0, 0.02)


PRESSURE = 350e3 * -np.expm1(-np.maximum(TIME - 1.0, 0.0) / 1.5)


SPEED = np.maximum(15.0 - 0.6 * TIME, 0.0)


def test_the_window_runs_from_one_time_constant_to_standstill():
    window = braking_window(PRESSURE, SPEED)
    assert TIME[window.start] == pytest.approx(1.0 + 1.5, abs=0.02)
    assert SPEED[window.stop] <= 0.5 < SPEED[window.stop - 1]
    assert braking_window(PRESSURE, SPEED, steady=300e3).start < window.start
    assert braking_window(PRESSURE, SPEED, standstill=5.0).stop < window.stop


@looped(
    ("pressure", "speed", "options", "named"),
    [
        (PRESSURE, SPEED + 1.0, {}, "speed stays above 0.5"),
        (0.0 * PRESSURE, SPEED, {}, "is it braked"),
        (PRESSURE, 0.0 * SPEED, {}, "stands at the first sample"),
        (PRESSURE, SPEED, {"steady": 1e6}, "does not reach 63.2%"),
        (PRESSURE[:5], SPEED, {}, "speed has shape"),
        (PRESSURE, SPEED * np.nan, {}, "speed holds nan"),
    ],
)
def test_a_stop_without_a_window_is_refused(pressure, speed, options, named):
    with pytest.raises(EstimationError, match=named):
        braking_window(pressure, speed, **options)


def test_steady_pressure_is_that_of_the_last_quarter():
    # 63.2 % of 300 kPa are 189.6 kPa, which the second quarter has; of the 200 kPa before it would be the first
    pressure = np.repeat([150e3, 200e3, 200e3, 300e3], 10)
    speed = np.where(np.arange(41) < 40, 10.0, 0.0)
    assert braking_window(np.append(pressure, 0.0), speed) == slice(10, 40)


MASS = np.array([96e3, 59e3, 62e3, 55e3, 59e3])


PERIOD, A_NOISE, R_NOISE, WALK = 0.02, 0.02, 1e3, 0.1


def wandering(seed, samples=400, walk=WALK):
    """Forces whose rates wander as the smoother believes, and noisy measurements of a train that oscillates anyhow."""
    draw = np.random.default_rng(seed)
    bends = walk * PERIOD**1.5 * draw.standard_normal((samples, MASS.size))
    force = MASS * (0.6 + np.cumsum(np.cumsum(bends, axis=0), axis=0))
    couplers = 5e4 * np.sin(np.arange(samples)[:, None] * 0.1 + np.arange(MASS.size - 1))
    between = np.pad(couplers, ((0, 0), (1, 1)))
    a = (-force + between[:, :-1] - between[:, 1:]) / MASS
    return (
        force,
        a + A_NOISE * draw.standard_normal(a.shape),
        couplers + R_NOISE * draw.standard_normal(couplers.shape),
    )


def smoothed(a, couplers, walk=WALK):
    return smooth_brake_forces(a, couplers, MASS, PERIOD, A_NOISE, R_NOISE, walk)


def dense_smoother(a, couplers):
    """All forces at once by weighted least squares, (time, cars) and covariance: what the recursion must give."""
    y = car_brake_forces(a, couplers, MASS)
    n, samples = MASS.size, y.shape[0]
    d = np.eye(n, n - 1, -1) - np.eye(n, n - 1)
    noise = np.diag((A_NOISE * MASS) ** 2) + R_NOISE**2 * d @ d.T
    step = np.diag(MASS**2) * WALK**2 * PERIOD**3
    change = np.diff(np.eye(samples), 2, axis=0)
    information = np.kron(np.eye(samples), np.linalg.inv(noise)) + np.kron(
        change.T @ change, np.linalg.inv(step)
    )
    covariance = np.linalg.inv(information)
    mean = covariance @ np.kron(np.eye(samples), np.linalg.inv(noise)) @ y.ravel()
    return mean.reshape(y.shape), covariance


def test_the_recursion_is_the_least_squares_solution():
    _, a, couplers = wandering(0, 30)
    found = smoothed(a, couplers)
    mean, covariance = dense_smoother(a, couplers)
    np.testing.assert_allclose(found.force, mean, rtol=1e-7)
    np.testing.assert_allclose(found.deviation.ravel(), np.sqrt(np.diag(covariance)), rtol=1e-8)
    wagons = np.kron(np.eye(30), np.array([0.0, 1.0, 1.0, 1.0, 1.0]))
    force, deviation = found.total(slice(1, None))
    np.testing.assert_allclose(force, found.force[:, 1:].sum(axis=1))
    np.testing.assert_allclose(
        deviation, np.sqrt(np.diag(wagons @ covariance @ wagons.T)), rtol=1e-8
    )


def test_deviation_is_that_of_the_errors():
    normalised = []
    for seed in range(20):
        force, a, couplers = wandering(seed)
        found = smoothed(a, couplers)
        normalised.append((found.force - force) / found.deviation)
    assert np.mean(np.square(normalised)) == pytest.approx(1.0, abs=0.1)
    assert np.mean(np.abs(normalised) < 1.96) == pytest.approx(0.95, abs=0.02)


def test_smoothing_reduces_the_error_of_every_car():
    force, a, couplers = wandering(3)
    raw = car_brake_forces(a, couplers, MASS) - force
    error = smoothed(a, couplers).force - force
    assert np.all(error.std(axis=0) < 0.55 * raw.std(axis=0))


@looped("build_up", [1.0, 3.0])
def test_a_smooth_force_lies_within_the_intervals_as_often_as_they_say(build_up):
    """A cylinder fills, friction rises: no walk at all. A force that is one made the stated variance twice the errors'."""
    time = PERIOD * np.arange(600)[:, None]
    force = MASS * (0.4 + 0.02 * time) * -np.expm1(-np.maximum(time - 2.0, 0.0) / build_up)
    normalised, covered = [], []
    for seed in range(12):
        _, a, couplers = wandering(seed, 600, walk=0.0)
        found = smoothed(a - (force - 0.6 * MASS) / MASS, couplers, walk=None)
        error = (found.force - force)[150:]
        normalised.append(np.mean(np.square(error / found.deviation[150:])))
        covered.append(np.mean(np.abs(error) < 1.96 * found.deviation[150:]))
    assert 0.65 < np.mean(normalised) < 1.15
    assert 0.93 < np.mean(covered) < 0.985


def test_a_steady_force_is_met_by_the_line():
    """Without a walk all samples lie on a line: in its middle the deviation tends to 1/sqrt(n), as that of a mean."""
    _, a, couplers = wandering(4, 301, walk=0.0)
    found = smoothed(a, couplers, walk=3e-4)
    mean = car_brake_forces(a, couplers, MASS).mean(axis=0)
    np.testing.assert_allclose(found.force[150], mean, rtol=1e-3)
    own = np.sqrt((A_NOISE * MASS[2]) ** 2 + 2.0 * R_NOISE**2) / np.sqrt(301)
    assert found.deviation[150, 2] == pytest.approx(own, rel=1e-2)


@looped("true", [0.03, 0.1, 0.6])
def test_the_walk_is_found(true):
    _, a, couplers = wandering(6, 1500, walk=true)
    found = smoothed(a, couplers, walk=None)
    assert found.walk == pytest.approx(true, rel=0.15)
    assert found.log_likelihood >= smoothed(a, couplers, walk=true).log_likelihood - 0.1


def test_the_walk_is_sought_up_to_a_full_brake_within_a_sample():
    jumping = 5e3 * np.where(np.arange(60)[:, None] % 2, 1.0, -1.0)
    found = smooth_brake_forces(jumping, np.zeros((60, 0)), [10e3], PERIOD, A_NOISE, R_NOISE)
    assert found.walk == pytest.approx(1e3, rel=0.03)


def test_impossible_options_are_refused():
    _, a, couplers = wandering(0, 5)
    with pytest.raises(EstimationError, match=r"acceleration has shape \(5,\)"):
        smoothed(a[:, 0], couplers)
    with pytest.raises(EstimationError, match="walk = 0"):
        smoothed(a, couplers, walk=0.0)
    with pytest.raises(EstimationError, match="walk = 1e-09 is too slow"):
        smoothed(a, couplers, walk=1e-9)
    with pytest.raises(EstimationError, match="2 samples have no second difference"):
        smoothed(a[:2], couplers[:2])
    with pytest.raises(EstimationError, match="period = nan"):
        smooth_brake_forces(a, couplers, MASS, float("nan"), A_NOISE, R_NOISE)
    a[2, 1] = np.nan
    with pytest.raises(EstimationError, match=r"acceleration holds nan at \(2, 1\)"):
        smoothed(a, couplers)


def test_likelihood_of_three_measurements_by_hand():
    """One car: the second difference, 0.5, has the walk's variance 100^2 x 0.02^3 and six times the noise's 0.02^2."""
    found = smooth_brake_forces(
        np.array([[-1.0], [-1.2], [-0.9]]),
        np.zeros((3, 0)),
        [10e3],
        PERIOD,
        A_NOISE,
        R_NOISE,
        100.0,
    )
    variance = 0.08 + 6.0 * 4e-4
    expected = -0.5 * (np.log(2 * np.pi * variance) + 0.5**2 / variance)
    assert found.log_likelihood == pytest.approx(expected, rel=1e-9)


CARS = 8


EQUAL_MASSES = np.full(CARS, 30e3)


ERRORS = CalibrationErrors(0.005, 300.0, 0.005, 0.01)


def test_each_constant_error_adds_its_share():
    couplers = np.array([-10e3, 20e3])
    mass, a = np.array([30e3, 40e3, 50e3]), np.full(3, -0.8)

    def alone(**errors):
        return CalibrationErrors(**errors).deviation(mass, a, couplers)

    np.testing.assert_allclose(alone(acceleration_offset=0.01), 0.01 * mass)
    np.testing.assert_allclose(alone(mass=0.02), 0.02 * 0.8 * mass)
    np.testing.assert_allclose(alone(coupler_offset=500.0), [500.0, 500.0 * np.sqrt(2.0), 500.0])
    np.testing.assert_allclose(alone(coupler_gain=0.01), [100.0, np.hypot(100.0, 200.0), 200.0])
    np.testing.assert_allclose(alone(), 0.0)


def test_deviation_at_each_instant_is_that_of_its_values():
    draw = np.random.default_rng(3)
    a, couplers = draw.normal(size=(5, CARS)), 1e4 * draw.normal(size=(5, CARS - 1))
    each = [ERRORS.deviation(EQUAL_MASSES, *one) for one in zip(a, couplers, strict=True)]
    np.testing.assert_allclose(ERRORS.deviation(EQUAL_MASSES, a, couplers), each)
