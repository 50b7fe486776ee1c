"""Braked and driven runs whose wheels slide or slip, shared by tests of what is learnt from their series."""

from dataclasses import replace

import numpy as np
import xarray as xr

from alloc.old.driving import Controls, TrainSense, drive
from alloc.old.plant.adhesion import SlipRatioCurve
from alloc.old.plant.model import build
from alloc.old.plant.rail import Patch, Rail
from alloc.old.plant.sets import find_set
from alloc.old.plant.train import Coupler, Train
from studies.jp4209318 import train as slide_train

START = 100.0 / 3.6
TRAIN = slide_train(3, shoe_force_share=0.14)
PLAIN_RAIL = Rail(
    0.125, (150.0, 150.0, 0.0), curve=SlipRatioCurve(peak_slip_ratio=0.03, residual_ratio=1.0)
)
"""The same for all axles and not calibrated on anything, so that a test can state its adhesion in one line."""
CLEANED_RAIL = replace(PLAIN_RAIL, conditioning=0.25, conditioning_slip=0.05)
"""The same, better behind wheels that slide."""


def readhering(time: float) -> float:
    """Valves that release for one second of every two and a half: wheels slide and readhere."""
    return 2.0 if time % 2.5 > 1.5 else 0.0


def braked(
    valve=lambda time: 0.0,
    *,
    train: Train = TRAIN,
    rail: Rail = PLAIN_RAIL,
    pressure: float = 550e3,
    until: float = 2.0,
    duration: float = 40.0,
    step: float = 1e-3,
    period: float = 0.01,
) -> xr.Dataset:
    """The train braked from 100 km/h at full pressure until it is slower than `until` [m/s]."""

    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.pressure[:] = pressure
        controls.valve[:] = valve(round(sense.time, 6))
        return sense.speed > until

    model = build(train, rail)
    return drive(model, driver, duration, initial_speed=START, period=period, step=step)


def without_slide() -> xr.Dataset:
    """A stop on a rail that carries three times the brake force."""
    return braked(rail=replace(PLAIN_RAIL, level=0.4))


def driven(coupler: Coupler | None = None) -> xr.Dataset:
    """Eight cars that start on a rail that is too slippery for their torque between 2 and 4 s."""
    train = find_set("commuter-8car")
    rail = Rail(0.2, patches=(Patch(0.4, begin=2.0, until=4.0),))

    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.torque[:] = 1000.0 if sense.time < 3.0 else 300.0
        return True

    model = build(train if coupler is None else train.coupled(coupler), rail)
    return drive(model, driver, 6.0, initial_speed=5.0, period=0.01)


def omega(run: xr.Dataset, train: Train = TRAIN) -> np.ndarray:
    """Angular speeds [rad/s], (instants, axles)."""
    radius = np.concatenate([[car.wheel_radius] * len(car.axle_positions) for car in train.cars])
    return np.asarray(run["rim_speed"].values / radius)


def applied_force(run: xr.Dataset, train: Train = TRAIN) -> np.ndarray:
    """Force of motors and shoes at the rims [N], (instants, axles)."""
    radius = np.concatenate([[car.wheel_radius] * len(car.axle_positions) for car in train.cars])
    unit = run["axle_unit"].values
    motor = np.zeros(run["rail_force"].shape)
    motor[:, unit >= 0] = (run["motor_torque"].values * run["unit_gear"].values)[:, unit[unit >= 0]]
    return np.asarray(motor / radius - run["brake_force"].values)
