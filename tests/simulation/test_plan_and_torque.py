"""Limits, caps and plan are coefficients at the rail, whatever the wheelsets weigh and the wagons carry."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.parameters import Onboard
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.simulation import DriverCommand, Event, simulate


def _steady(run):
    return run.isel(time=slice(run.sizes["time"] // 2, None))


def test_rail_coefficient_of_every_unit_is_its_limit(make_event):
    run = _steady(simulate(make_event(0.30), "greedy"))
    for j in range(run.sizes["unit"]):
        axles = run["axle_unit"].values == j
        felt = run["coefficient"].values[:, axles].mean(axis=1)
        np.testing.assert_allclose(felt, run["limit"].values[:, j], rtol=0.03)


def test_limit_as_printed_delivers_less_by_the_wheelsets_inertia(make_event):
    with_inertia, as_printed = (
        _steady(simulate(make_event(0.30, onboard=Onboard(inertia_in_limit=flag)), "greedy"))
        for flag in (True, False)
    )
    # both ask the motors for the same torque where nothing slips; as printed, the limit names more than the rail receives
    np.testing.assert_allclose(
        as_printed["motor_torque"].values, with_inertia["motor_torque"].values, rtol=0.01
    )
    ratio = as_printed["limit"].values / with_inertia["limit"].values
    assert np.all(ratio > 1.02)


@pytest.mark.parametrize("loaded", [False, True])
def test_plan_counts_what_the_wagons_carry(loaded):
    train = find_set("freight-17")
    wagons = tuple(
        car if k == 0 else replace(car, load=car.load if loaded else 0.0)
        for k, car in enumerate(train.cars)
    )
    event = Event(
        "start",
        build(replace(train, cars=wagons), Rail(0.6)),
        DriverCommand((0.0,), (0.1,)),
        duration=20.0,
    )
    run = simulate(event, "alone", "none")
    late = run.sel(time=slice(10.0, None))
    force = late["rail_force"].values[:, late["axle_unit"].values >= 0].sum(axis=1)
    # a few per cent more: the wagons' wheelsets have to be turned as well
    ratio = force.mean() / (0.1 * run.attrs["train_mass"])
    assert 1.0 < ratio < 1.08


def test_a_coupled_cars_reference_speed_is_its_own():
    train = find_set("freight-17")
    event = Event("start", build(train, Rail(0.6)), DriverCommand((0.0,), (0.1,)), duration=6.0)
    run = simulate(event, "alone", "none")
    # while the couplers stretch one after another the locomotive is faster than the last wagon, and does not slip
    spread = run["car_speed"].values[:, 0] - run["car_speed"].values[:, -1]
    assert spread.max() > 0.05
    error = np.abs(run["reference_speed"].values - run["car_speed"].values[:, 0])
    assert error.max() < 0.5 * spread.max()
    assert not run["slipping"].values.any()
    own = run["slide_reference"].values
    np.testing.assert_array_equal(own[:, 0], run["reference_speed"])
    assert np.abs(own[:, -1] - run["car_speed"].values[:, -1]).max() < 0.5 * spread.max()


def test_the_reference_speed_of_a_rigid_train_is_recorded_once():
    train = find_set("jp4209318-3car")
    event = Event("start", build(train, Rail(0.6)), DriverCommand((0.0,), (-0.1,)), duration=0.1)
    assert "slide_reference" not in simulate(event, "alone", "none")
