"""Brake force per car: (2) to (8) give back what a train was built with; the window; the smoother; constant errors."""

import numpy as np
import pytest

from alloc.evaluation.brake_force import (
    BrakeRigging,
    CalibrationErrors,
    braking_window,
    car_brake_forces,
    coupler_force_between,
    group_brake_force,
    rolling_mass,
    smooth_brake_forces,
)
from alloc.schema.errors import EstimationError

FOUR_MASSES = np.array([96e3, 59e3, 60e3, 40e3])

TURNING = np.array([5e3, 1.3e3, 1.3e3, 1.3e3])

FORCE = np.array([60e3, 30e3, 0.0, 37e3])


def rigid_train(force, mass, resistance, turning):
    """A train in which all cars share one acceleration: that acceleration and the coupler forces that follow."""
    a = -(force + resistance).sum() / (mass + turning).sum()
    # Newton's law of each car from the front: (m + J/r2) a = -f - W + R_before - R_behind
    return a, np.cumsum(-(mass + turning) * a - force - resistance)[:-1]


@pytest.mark.parametrize("cars", [2, 5, 18])
def test_a_train_at_constant_acceleration_is_recovered_exactly(cars):
    draw = np.random.default_rng(cars)
    mass, turning = draw.uniform(15e3, 100e3, cars), draw.uniform(0.5e3, 5e3, cars)
    force, resistance = draw.uniform(-20e3, 60e3, cars), draw.uniform(0.0, 3e3, cars)
    a, couplers = rigid_train(force, mass, resistance, turning)
    found = car_brake_forces([a] * 3, [couplers] * 3, mass + turning, resistance)
    np.testing.assert_allclose(found, np.tile(force, (3, 1)), atol=1e-6)


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


def test_the_coupler_force_of_6_is_that_of_a_train_without_relative_motion():
    _, couplers = rigid_train(FORCE, FOUR_MASSES, 0.0, 0.0 * FOUR_MASSES)
    for k in (1, 2, 3):
        front = FORCE[:k].sum(), FOUR_MASSES[:k].sum()
        rear = FORCE[k:].sum(), FOUR_MASSES[k:].sum()
        assert coupler_force_between(*front, *rear) == pytest.approx(couplers[k - 1])
    only_front = coupler_force_between(60e3, 96e3, 0.0, 295e3)
    assert only_front < 0.0  # the rear pushes
    assert coupler_force_between(0.5 * 96e3, 96e3, 0.5 * 60e3, 60e3) == pytest.approx(0.0)


def test_the_mass_decides_which_force_is_meant():
    """With the rolling mass the force at the brakes, with the bare mass what the rail gets."""
    a, couplers = rigid_train(FORCE, FOUR_MASSES, 0.0, TURNING)
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


TIME = np.arange(0.0, 30.0, 0.02)

PRESSURE = 350e3 * -np.expm1(-np.maximum(TIME - 1.0, 0.0) / 1.5)

SPEED = np.maximum(15.0 - 0.6 * TIME, 0.0)


def test_the_window_runs_from_one_time_constant_to_standstill():
    window = braking_window(PRESSURE, SPEED)
    assert TIME[window.start] == pytest.approx(1.0 + 1.5, abs=0.02)
    assert SPEED[window.stop] <= 0.5 < SPEED[window.stop - 1]


MASS = np.array([96e3, 59e3, 62e3, 55e3, 59e3])

PERIOD, A_NOISE, R_NOISE = 0.02, 0.02, 1e3


def wandering(seed, samples=400, walk=0.03):
    """Forces whose rates wander as the smoother believes, and noisy measurements of a train that oscillates anyhow."""
    draw = np.random.default_rng(seed)
    bends = walk * PERIOD**1.5 * draw.standard_normal((samples, MASS.size))
    force = MASS * (0.6 + np.cumsum(np.cumsum(bends, axis=0), axis=0))
    couplers = 5e4 * np.sin(np.arange(samples)[:, None] * 0.1 + np.arange(MASS.size - 1))
    between = np.pad(couplers, ((0, 0), (1, 1)))
    a = (-force + between[:, :-1] - between[:, 1:]) / MASS
    noise = (
        deviation * draw.standard_normal(one.shape)
        for deviation, one in ((A_NOISE, a), (R_NOISE, couplers))
    )
    return force, *(one + own for one, own in zip((a, couplers), noise, strict=True))


def smoothed(a, couplers):
    return smooth_brake_forces(a, couplers, MASS, A_NOISE, R_NOISE)


def test_smoothed_forces_balance_misfit_and_bending():
    """At the optimum a small bump anywhere changes neither: misfit times bump over the bending of both is one number."""
    _, a, couplers = wandering(0, 300)
    y, f = car_brake_forces(a, couplers, MASS), smoothed(a, couplers)
    stiffness = []
    for middle in (80, 150, 210):
        bump = np.exp(-np.square((np.arange(300) - middle) / 12.0))[:, None]
        bend = (np.diff(f, 2, axis=0) * np.diff(bump, 2, axis=0)).sum(axis=0)
        stiffness.append(((y - f) * bump).sum(axis=0) / bend)
    np.testing.assert_allclose(stiffness[1:], stiffness[:-1], rtol=1e-3)


@pytest.mark.parametrize(("walk", "left"), [(0.003, 0.15), (0.1, 0.3), (3.0, 0.7)])
def test_smoothing_takes_noise_away_however_fast_forces_change(walk, left):
    force, a, couplers = wandering(3, 600, walk)
    errors = (smoothed(a, couplers) - force, car_brake_forces(a, couplers, MASS) - force)
    smooth, raw = (np.sqrt(np.mean(np.square(one / MASS))) for one in errors)
    assert smooth < left * raw


def test_a_brake_that_pulses_is_followed():
    time = PERIOD * np.arange(1000)[:, None]
    force = MASS * (0.6 + 0.3 * np.sin(np.pi * time))
    noise = np.random.default_rng(1).standard_normal((2, 1000, MASS.size))
    couplers = R_NOISE * noise[1, :, 1:]
    errors = smoothed(-force / MASS + A_NOISE * noise[0], couplers) - force
    raw = car_brake_forces(-force / MASS + A_NOISE * noise[0], couplers, MASS) - force
    assert np.std(errors) < 0.4 * np.std(raw)


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


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: car_brake_forces([-1.0, np.nan], np.zeros((2, 3)), FOUR_MASSES), r"acceleration holds nan at \(1,\)"),
        (lambda: car_brake_forces([-1.0], np.zeros((1, 4)), FOUR_MASSES), r"coupler_force has shape \(1, 4\)"),
        (lambda: car_brake_forces([-1.0], np.zeros((1, 3), "timedelta64[s]"), FOUR_MASSES), "coupler_force holds time"),
        (lambda: coupler_force_between(np.ma.array([1.0], mask=True), 1.0, [1.0], 1.0), r"front_force holds nan at \(0,\)"),
        (lambda: group_brake_force([-1.0], 0.0), "mass = .* must exceed 0"),
        (lambda: braking_window(PRESSURE, SPEED + 1.0), "speed stays above 0.5"),
        (lambda: braking_window(0.0 * PRESSURE, SPEED), "is the train braked"),
        (lambda: smooth_brake_forces([[-1.0]] * 9, np.zeros((9, 0)), [1e4], 0.0, 1e3), "acceleration_noise = 0.0"),
        (lambda: smoothed(*wandering(0, 2)[1:]), "2 samples have no second difference"),
    ],
)  # fmt: skip
def test_what_cannot_be_estimated_is_refused_by_its_name(call, named):
    with pytest.raises(EstimationError, match=named):
        call()
