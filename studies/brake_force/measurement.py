"""A measuring system on a running train: what the RTRI report's running tests record, with the errors of real sensors."""

from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from alloc.estimation.brake_force import CalibrationErrors, rolling_mass
from alloc.metrics.registry import record_period
from alloc.plant.laws import running_resistance
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Train

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuringSystem:
    """Sampling and sensor errors; all assumed, of the order of good strain gauges and servo accelerometers.

    Noise is white, per sample, and drawn for every channel. `calibration`: errors that are constant over a run, drawn once
    per run and channel; offsets are those that remain after zeroing while the train coasts.
    """

    period: float = 0.02
    """Of the samples [s]."""
    cut_off: float = 15.0
    """Of the anti-aliasing filter [Hz], fourth order, alike on all channels so that they stay in step."""
    acceleration_noise: float = 0.02
    """[m/s2]"""
    coupler_noise: float = 1e3
    """[N]"""
    pressure_noise: float = 2e3
    """[Pa]"""
    speed_noise: float = 0.02
    """[m/s]"""
    calibration: CalibrationErrors = field(
        default_factory=lambda: CalibrationErrors(0.005, 300.0, 0.005, 0.005)
    )

    def every(self, run: xr.Dataset) -> int:
        """Recorded instants per sample."""
        return max(1, round(self.period / record_period(run)))

    def sampled(self, run: xr.Dataset, values: Floats) -> Floats:
        """`values` (time, channels) of a run after anti-aliasing filter and sampling, without sensor errors."""
        sections = butter(4, self.cut_off * 2.0 * record_period(run), output="sos")
        start = sosfilt_zi(sections)[..., None] * values[0]
        return np.asarray(sosfilt(sections, values, axis=0, zi=start)[0][:: self.every(run)])


class Measured(NamedTuple):
    """What was recorded of a run."""

    time: Floats
    """[s], (time,)"""
    speed: Floats
    """From the wheels of the foremost car [m/s], (time,)."""
    acceleration: Floats
    """Of each car [m/s2], (time, cars)."""
    coupler_force: Floats
    """[N], (time, cars - 1), tension positive."""
    pressure: Floats
    """Of the foremost cylinder of each car [Pa], (time, cars)."""
    bare_mass: Floats
    """As weighed [kg], (cars,)."""
    mass: Floats
    """With what the wheelsets add [kg], (cars,)."""
    resistance: Floats
    """Running resistance of each car by its formula [N], (time, cars)."""
    axle_speed: Floats
    """At the rims [m/s], (time, axles)."""


def turning_inertia(train: Train) -> tuple[Floats, Floats]:
    """Inertia [kg m2] of each car's wheelsets together, and its wheel radius [m]; two (cars,)."""
    return (
        np.array([sum(car.wheel_inertia) for car in train.cars]),
        np.array([car.wheel_radius for car in train.cars]),
    )


def record(run: xr.Dataset, train: Train, system: MeasuringSystem) -> Measured:
    """What `system` would record of a run of a train with couplers on level, dry track if its sensors had no errors."""
    group_car = [k for k, car in enumerate(train.cars) if car.air_brake is not None
                 for _ in range(car.bogie_of_axle[-1] + 1)]  # fmt: skip
    first_group = [group_car.index(k) for k in range(len(train.cars))]
    bare = np.array([car.mass for car in train.cars])
    speed = system.sampled(run, run["car_speed"].values[:, :1])[:, 0]
    return Measured(
        time=run["time"].values[:: system.every(run)],
        speed=speed,
        acceleration=system.sampled(run, run["car_acceleration"].values),
        coupler_force=system.sampled(run, run["coupler_force"].values),
        pressure=system.sampled(run, run["cylinder_pressure"].values[:, first_group]),
        bare_mass=bare,
        mass=rolling_mass(bare, *turning_inertia(train)),
        resistance=resistance_of_cars(train, speed),
        axle_speed=system.sampled(run, run["rim_speed"].values),
    )


def disturb(exact: Measured, train: Train, system: MeasuringSystem, seed: int) -> Measured:
    """The same with sensor errors drawn from `seed`."""
    draw = np.random.default_rng([seed, 41]).standard_normal
    errors = system.calibration
    a, force, pressure = exact.acceleration, exact.coupler_force, exact.pressure
    bare = exact.bare_mass * (1.0 + errors.mass * draw(exact.bare_mass.size))
    offsets = errors.acceleration_offset * draw(a.shape[1])
    gains = 1.0 + errors.coupler_gain * draw(force.shape[1])
    zeros = errors.coupler_offset * draw(force.shape[1])
    # noise after what is constant: that must not depend on how long the run is
    speed = np.abs(exact.speed + system.speed_noise * draw(exact.speed.shape))
    return Measured(
        time=exact.time,
        speed=speed,
        acceleration=a + offsets + system.acceleration_noise * draw(a.shape),
        coupler_force=gains * force + zeros + system.coupler_noise * draw(force.shape),
        pressure=pressure + system.pressure_noise * draw(pressure.shape),
        bare_mass=bare,
        mass=rolling_mass(bare, *turning_inertia(train)),
        resistance=resistance_of_cars(train, speed),
        axle_speed=exact.axle_speed + system.speed_noise * draw(exact.axle_speed.shape),
    )


def resistance_of_cars(train: Train, speed: Floats) -> Floats:
    """Running resistance [N] of each car at `speed` (time,) [m/s], (time, cars), by the train's formula."""
    return np.stack(
        [running_resistance(speed, a, b, c, 1.0) for a, b, c in _resistance(train)], axis=1
    )


@lru_cache(maxsize=8)
def _resistance(train: Train) -> Floats:
    """A, B, C of each car, (cars, 3), as the plant shares them."""
    return build(train, Rail(0.3)).structure.car_resistance


def rail_brake_forces(run: xr.Dataset) -> Floats:
    """True brake force [N] of each car at the rails, (time, cars)."""
    of_car = run["axle_car"].values[None, :] == np.arange(run.sizes["car"])[:, None]
    return np.asarray(-run["rail_force"].values @ of_car.T)


def true_brake_forces(run: xr.Dataset, train: Train) -> Floats:
    """True force [N] of the brakes of each car, as a force at the rims of wheels that roll, (time, cars)."""
    inertia, radius = turning_inertia(train)
    return rail_brake_forces(run) - inertia / radius**2 * run["car_acceleration"].values
