"""The electric brake in place of the shoes: same force, same distance lost while it rises, and it holds its wheels."""

from functools import cache

import numpy as np
import pytest
import xarray as xr

from alloc.metrics.use import damage, distance
from alloc.plant.laws import GRAVITY
from alloc.simulation import simulate
from studies.slides.electric import electric_event, electric_train
from studies.slides.jp4209318 import Undisclosed, brake, brake_event

CALIBRATED = Undisclosed()
DRY = Undisclosed(front_adhesion=0.4)
"""No plausible wet rail: nothing slides on it."""


@cache
def electric(undisclosed: Undisclosed, controller: str) -> xr.Dataset:
    return simulate(electric_event(undisclosed), "alone", controller)


def test_force_is_that_of_the_shoes():
    train = electric_train(3, "1C4M", 0.14)
    car = train.cars[0]
    assert car.motors is not None
    force = car.motors.brake.peak * car.motors.gear_ratio / car.wheel_radius
    assert force == pytest.approx(0.14 * 8000.0 * GRAVITY)
    assert train.axle_count == 12


def test_on_good_rail_it_stops_in_the_distance_of_the_shoes():
    run = electric(DRY, "cut-and-ramp")
    air = brake(brake_event(DRY, 3))
    reached = np.interp(-run.attrs["target_speed"], -air["speed"].values, air["position"].values)
    assert distance(run) == pytest.approx(reached, rel=2e-3)


def test_controllers_trade_distance_for_damage():
    free, held = electric(CALIBRATED, "none"), electric(CALIBRATED, "cut-and-ramp")
    assert damage(held) < 0.1 * damage(free)
    assert distance(held) > distance(electric(DRY, "none"))


def test_the_reference_does_not_drift_where_no_axle_runs_free():
    run = electric(CALIBRATED, "cut-and-ramp")
    error = np.abs(run["reference_speed"] - run["speed"]).values
    late = run["time"].values > 0.5 * float(run["time"][-1])
    assert error[late].max() < max(error[~late].max(), 0.3)
    assert error.max() < 0.02 * 100.0 / 3.6
