"""Brake force per car: (2) to (8) give back what a train was built with, and keep the laws of mechanics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.errors import EstimationError
from alloc.estimation.brake_force import (
    BrakeRigging,
    car_brake_forces,
    coupler_force_between,
    group_brake_force,
    level_acceleration,
    rolling_mass,
)
from alloc.plant.laws import GRAVITY

few = settings(max_examples=60, deadline=None, derandomize=True)
MASS = np.array([96e3, 59e3, 60e3, 40e3])
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
    found = car_brake_forces(a, draw.normal(0.0, 1e5, (5, 3)), MASS)
    total = -(MASS * a).sum(axis=1) if own else -MASS.sum() * a
    np.testing.assert_allclose(found.sum(axis=1), total, rtol=1e-9, atol=1e-6)


def test_groups_are_sums_of_their_cars():
    draw = np.random.default_rng(0)
    a, couplers = draw.normal(size=50), draw.normal(0.0, 1e5, (50, 3))
    cars = car_brake_forces(a, couplers, MASS, 1e3)
    locomotive = group_brake_force(a, MASS[0], rear=couplers[:, 0], resistance=1e3)
    wagons = group_brake_force(a, MASS[1:].sum(), front=couplers[:, 0], resistance=3e3)
    middle = group_brake_force(a, MASS[1:3].sum(), couplers[:, 0], couplers[:, 2], 2e3)
    np.testing.assert_allclose(locomotive, cars[:, 0])
    np.testing.assert_allclose(wagons, cars[:, 1:].sum(axis=1))
    np.testing.assert_allclose(middle, cars[:, 1:3].sum(axis=1))


def test_a_train_read_from_its_rear_has_the_same_forces():
    draw = np.random.default_rng(1)
    a, couplers = draw.normal(size=(9, 4)), draw.normal(0.0, 1e5, (9, 3))
    forward = car_brake_forces(a, couplers, MASS)
    # seen from the rear everything moves the other way: accelerations and brake forces change their sign, tension not
    backward = -car_brake_forces(-a[:, ::-1], couplers[:, ::-1], MASS[::-1])[:, ::-1]
    np.testing.assert_allclose(forward, backward)


def test_forces_scale_with_masses_and_couplers():
    draw = np.random.default_rng(2)
    a, couplers = draw.normal(size=(9, 4)), draw.normal(0.0, 1e5, (9, 3))
    np.testing.assert_allclose(
        car_brake_forces(a, 3.0 * couplers, 3.0 * MASS), 3.0 * car_brake_forces(a, couplers, MASS)
    )


def test_shared_acceleration_is_the_same_as_equal_ones():
    a, couplers = np.array([-0.5, -0.6]), np.ones((2, 3))
    np.testing.assert_array_equal(
        car_brake_forces(a, couplers, MASS),
        car_brake_forces(np.repeat(a[:, None], 4, axis=1), couplers, MASS),
    )


@few
@given(decrement=st.floats(-3.0, 3.0), m=st.floats(1e3, 1e6), n=st.floats(1e3, 1e6))
def test_forces_in_proportion_to_masses_leave_the_coupler_free(decrement, m, n):
    between = coupler_force_between(decrement * m, m, decrement * n, n)
    assert abs(between) <= 1e-9 * (abs(decrement) + 1.0) * max(m, n)


def test_the_coupler_force_of_6_is_that_of_a_train_without_relative_motion():
    _, couplers = rigid_train(FORCE, MASS, 0.0 * MASS, 0.0, 0.0 * MASS)
    for k in range(3):
        parts = FORCE[: k + 1].sum(), MASS[: k + 1].sum(), FORCE[k + 1 :].sum(), MASS[k + 1 :].sum()
        assert coupler_force_between(*parts) == pytest.approx(couplers[k])
    # only the front braked: the rear pushes
    assert coupler_force_between(60e3, 96e3, 0.0, 295e3) < 0.0


def test_the_mass_decides_which_force_is_meant():
    """With the rolling mass the force at the brakes, with the bare mass what the rail gets."""
    a, couplers = rigid_train(FORCE, MASS, 0.0 * MASS, 0.0, TURNING)
    rolling = rolling_mass(MASS, TURNING * 0.43**2, 0.43 * np.ones(4))
    np.testing.assert_allclose(rolling, MASS + TURNING)
    at_brakes, at_rails = (car_brake_forces([a], [couplers], m)[0] for m in (rolling, MASS))
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


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (([-1.0, np.nan], np.zeros((2, 3)), MASS), r"acceleration holds nan at \(1,\)"),
        (([-1.0, -1.0], np.zeros((2, 4)), MASS), r"coupler_force has shape \(2, 4\)"),
        ((np.zeros((2, 3)), np.zeros((2, 3)), MASS), r"acceleration has shape \(2, 3\)"),
        (([], np.zeros((0, 3)), MASS), "acceleration is empty"),
        (([-1.0], np.zeros((1, 3)), -MASS), "mass = .* must exceed 0"),
        (([-1.0], [[0.0, np.inf, 0.0]], MASS), r"coupler_force holds inf at \(0, 1\)"),
        (([-1.0], np.zeros((1, 3)), MASS, np.zeros(3)), "resistance has shape"),
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
