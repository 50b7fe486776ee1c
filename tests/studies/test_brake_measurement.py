"""The measuring system: without errors it records the run, with errors those that it states."""

import numpy as np
import pytest

from alloc.estimation.brake_force import CalibrationErrors, car_brake_forces
from studies.brake_force.measurement import (
    MeasuringSystem,
    disturb,
    rail_brake_forces,
    record,
    resistance_of_cars,
    true_brake_forces,
)
from studies.brake_force.running_tests import BRAKED_AT, TESTS, drive_test, train_of_test

EXACT = MeasuringSystem(0.02, 15.0, 0.0, 0.0, 0.0, 0.0, CalibrationErrors())


@pytest.fixture(scope="module")
def stop():
    train = train_of_test(TESTS["all"], 0)
    return drive_test(TESTS["all"], train), train


def test_without_errors_the_estimate_is_the_truth_at_every_instant(stop):
    """(2) with own accelerations, of a plant with slack, stiffening draft gear and slipping wheels: what it must give."""
    run, train = stop
    measured = record(run, train, EXACT)
    drag = EXACT.sampled(
        run, np.stack([resistance_of_cars(train, v)[:, k] for k, v in enumerate(run["car_speed"].values.T)], axis=1)
    )  # fmt: skip
    for mass, true in (
        (measured.mass, true_brake_forces(run, train)),
        (measured.bare_mass, rail_brake_forces(run)),
    ):
        found = car_brake_forces(measured.acceleration, measured.coupler_force, mass, drag)
        # creep of the wheels changes as they are braked: the rim is not quite as fast as the car
        np.testing.assert_allclose(found, EXACT.sampled(run, true), atol=60.0)


def test_all_cars_brake_the_train(stop):
    run, train = stop
    total = true_brake_forces(run, train).sum(axis=1)
    drag = resistance_of_cars(train, run["speed"].values).sum(axis=1)
    rolling = train.mass + train.rotating_mass
    built_up = run["time"].values > BRAKED_AT + 5.0
    np.testing.assert_allclose(
        (-rolling * run["acceleration"].values - drag)[built_up], total[built_up], rtol=1e-2
    )


def test_errors_are_those_stated(stop):
    run, train = stop
    system = MeasuringSystem()
    exact = record(run, train, system)
    many = [disturb(exact, train, system, seed) for seed in range(40)]
    noise = np.stack([m.acceleration - exact.acceleration for m in many])
    offset = noise.mean(axis=1)
    assert offset.std() == pytest.approx(system.calibration.acceleration_offset, rel=0.15)
    assert (noise - offset[:, None]).std() == pytest.approx(system.acceleration_noise, rel=0.02)
    masses = np.stack([m.bare_mass / exact.bare_mass for m in many])
    assert masses.std() == pytest.approx(system.calibration.mass, rel=0.15)
    force = np.stack([m.coupler_force - exact.coupler_force for m in many])
    still = force[:, exact.time < BRAKED_AT]  # couplers are free: neither gain nor force
    assert still.mean(axis=1).std() == pytest.approx(system.calibration.coupler_offset, rel=0.2)
    assert (still - still.mean(axis=1, keepdims=True)).std() == pytest.approx(1e3, rel=0.03)


def test_the_seed_draws_and_constant_errors_do_not_depend_on_the_runs_length(stop):
    run, train = stop
    system = MeasuringSystem(acceleration_noise=0.0, coupler_noise=0.0)
    exact, short = (record(one, train, system) for one in (run, run.isel(time=slice(0, 701))))
    whole, same, other = (disturb(exact, train, system, seed) for seed in (1, 1, 2))
    part = disturb(short, train, system, 1)
    np.testing.assert_array_equal(whole.acceleration, same.acceleration)
    np.testing.assert_allclose(whole.acceleration[: part.time.size], part.acceleration, atol=1e-12)
    np.testing.assert_allclose(whole.coupler_force[: part.time.size], part.coupler_force, atol=1e-6)
    np.testing.assert_array_equal(whole.bare_mass, part.bare_mass)
    assert not np.allclose(whole.bare_mass, other.bare_mass)
