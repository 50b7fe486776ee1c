"""What a recorded run gives to its metrics: its arrays, and what several metrics need, computed once.

In: the Dataset of `alloc.run.simulation.simulate`. "Under demand" means while the driver asks for traction or braking;
forces count in the direction of the demand. A unit has one torque for all its axles, so its weakest axle bounds it, unless
its motors run in parallel on one frequency.
"""

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

SETTLING = 2.0
"""Time [s] left out after the driver asks for more: torque rises in 1 s, and cylinders take as long to fill."""
JERK_CUT_OFF = 5.0
"""Cut-off frequency [Hz] of the low-pass on a car's acceleration: ride comfort depends on a few hertz."""
STANDSTILL = 0.01
"""Speed [m/s] of a train that stands."""


class TrainBounds(NamedTuple):
    """Forces at the rail [N] at the settled instants, (instants,) each."""

    plan: Floats
    """What the driver asks for, by the true masses."""
    bound: Floats
    """The largest force that rail and motors allow, at most the plan."""
    apart: Floats
    """The same if each unit delivers no more than its own part of the plan."""
    force: Floats
    """Delivered; below 0 where the train turns wheels that failed motors do not."""


class RecordedRun:
    """A recorded run as arrays: `run[name]` is a variable, attributes are what several metrics need."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self.dataset, self.attrs = dataset, dataset.attrs
        self.period = record_period(dataset)
        self._computed: dict[Any, Any] = {}
        self.unit, self.group = self["axle_unit"], self["axle_group"]
        self.driven = self.unit >= 0
        self.trailing = ~self.driven & (self.group >= 0)
        """Axles that brake with air alone, (axle,)."""
        self.of_unit = (self.unit[:, None] == np.arange(self["unit_gear"].size)).astype(float)
        """(axle, unit): 1 where the axle is the unit's; `forces @ of_unit` are those of the units."""
        self.axles = self.of_unit.sum(axis=0)
        """Number of axles of each unit."""
        self.load, self.turning = self["axle_static_load"], self["axle_turning_mass"]
        self.command, self.planned = self["driver_command"], self["planned_coefficient"]
        self.demand, self.way = self.command != 0.0, np.sign(self.command)
        self.force = self.way[:, None] * self["rail_force"]
        """Force in the direction of the demand [N], (time, axle)."""
        self.slip = np.abs(self["slip_velocity"])
        """Magnitude of the slip velocity [m/s], (time, axle)."""
        self.gain = self.way * self["acceleration"]
        air = bool(self.attrs["blended_brakes"]) or not self.driven.any()
        self.air = (self.way < 0.0) & air & (self.group >= 0).any()
        """Instants at which every car brakes itself, with air where it has no motors, (time,)."""
        self.acting = self.driven | self.air[:, None]
        """Axles that pull or brake, (time, axle)."""

    def __getitem__(self, name: str) -> NDArray[Any]:
        return series(self.dataset, name)

    def compute_once(self, function: Callable[["RecordedRun"], Any]) -> Any:
        """`function(self)`, computed at its first call: what several metrics of a file need."""
        if function not in self._computed:
            self._computed[function] = function(self)
        return self._computed[function]

    def instants(self, time: float) -> int:
        """Number of recorded instants, 1 or more, in `time` [s]."""
        return 2 if math.isnan(self.period) else max(1, round(time / self.period))

    @cached_property
    def settled(self) -> Flags:
        """Instants under demand at least `SETTLING` after the demand has grown, (time,)."""
        calm = self.demand.copy()
        for k in np.flatnonzero(np.diff(np.abs(self.command), prepend=0.0) > 0.0):
            calm[k : k + self.instants(SETTLING)] = False
        return calm

    @cached_property
    def available(self) -> Floats:
        """Largest rail force [N], (time, axle); at least the one carried: the limit is that of a driving wheel."""
        return np.maximum(self["adhesion_limit"] * self["axle_load"], np.abs(self["rail_force"]))

    @cached_property
    def at_rim(self) -> Floats:
        """Force at the rim of each unit's motors at their limits [N], (time, unit); inf where air makes up for them."""
        braking = (self.way < 0.0)[:, None]
        limit = np.where(braking, self["brake_limit"], self["drive_limit"])
        pull = self.axles * self["unit_gear"] / self["unit_radius"] * limit
        return np.where(self.air[:, None], np.inf, pull)

    @cached_property
    def motors(self) -> Floats:
        """What of `at_rim` reaches the rail: the rest turns the wheelsets; below 0 where failed motors are turned."""
        turned = self.turning @ self.of_unit * np.maximum(self.gain, 0.0)[:, None]
        return np.asarray(self.at_rim - turned)

    @cached_property
    def bounds(self) -> TrainBounds:
        """In blended braking every trailer's brake group adds its own part of the plan, as far as the rail carries it."""
        calm, trailing = self.settled, self.trailing
        available, force, air = self.available[calm], self.force[calm], self.air[calm]
        planned, parallel = self.planned[calm, None], self["unit_parallel"] > 0
        carried = scale_weakest(available, self.unit, self.axles.size)
        if parallel.any():
            carried = np.where(parallel, available @ self.of_unit, carried)
        most, part = np.minimum(carried, self.motors[calm]), planned * self["unit_static_load"]
        plan, delivered = part.sum(axis=1), force[:, self.driven].sum(axis=1)
        bound = np.maximum(most.sum(axis=1), 0.0)
        apart = np.maximum(np.minimum(part, most).sum(axis=1), 0.0)
        if air.any() and trailing.any():
            groups, label = np.unique(self.group[trailing], return_inverse=True)
            part = planned * np.bincount(label, self.load[trailing])
            held = np.minimum(part, scale_weakest(available[:, trailing], label, groups.size))
            braked = force[:, trailing]
            for total, more in ((plan, part), (bound, held), (apart, held), (delivered, braked)):
                total += np.where(air, more.sum(axis=1), 0.0)
        return TrainBounds(plan, np.minimum(plan, bound), np.minimum(plan, apart), delivered)

    @cached_property
    def dry_gain(self) -> Floats:
        """Acceleration [m/s2] that the train would have at its speed and place on rail that carries everything, (time,).

        Each unit then delivers its own part of the plan, or what its motors give.
        """
        wanted = self.planned[:, None] * self.load  # of an axle that acts, at its rim
        wanted += self.turning * np.abs(self.command)[:, None]
        trailing = self.trailing & self.air[:, None]
        rim = np.minimum(wanted @ self.of_unit, self.at_rim).sum(axis=1)
        rim += (wanted * trailing).sum(axis=1)
        turned = self.driven | trailing  # these wheelsets take their part of the rim's force
        force = np.where(self.acting, self.force, 0.0).sum(axis=1)
        moved = self["car_mass"].sum() + (self.turning * ~turned).sum(axis=1)
        whole = moved + (self.turning * turned).sum(axis=1)
        return np.asarray((moved * self.gain + rim - force) / whole)

    @cached_property
    def end(self) -> int:
        """Instant of the target speed, -1 if it is not reached; the last one if there is none."""
        target, speed = self.attrs["target_speed"], self["speed"]
        if not np.isfinite(target):
            return int(speed.size - 1)
        if speed[0] > STANDSTILL:  # a train approaches its standstill, and does not pass it
            target = max(target, STANDSTILL)
        reached = (speed - target) * np.sign(target - speed[0]) >= 0.0
        return int(np.argmax(reached)) if reached.any() else -1

    @cached_property
    def jerk(self) -> Floats:
        """Jerk of each car under demand [m/s3], (instants, car)."""
        return car_jerk(self.dataset)[self.demand]


def scale_weakest(values: Floats, label: NDArray[np.int64], labels: int) -> Floats:
    """Number of its axles times the least of them, (time, label)."""
    weakest = np.empty((len(values), labels))
    for g in range(labels):
        weakest[:, g] = (label == g).sum() * values[:, label == g].min(axis=1)
    return weakest


def series(run: xr.Dataset, name: str) -> NDArray[Any]:
    """Recorded values of a variable; `run[name].values` is the same, but takes twenty times as long to look up."""
    return np.asarray(run.variables[name].values)


def record_period(run: xr.Dataset) -> float:
    """Time between two recorded instants [s]; nan where there is one."""
    time = series(run, "time")
    return float((time[-1] - time[0]) / (time.size - 1)) if time.size > 1 else math.nan


def car_jerk(run: xr.Dataset) -> Floats:
    """Jerk of each car [m/s3], (time, car), from its acceleration below `JERK_CUT_OFF`; nan in a run of one instant."""
    values, period = series(run, "car_acceleration").astype(float), record_period(run)
    shape = values.shape
    if len(values) < 2:
        return np.full(shape, np.nan)
    if (values == values[:, :1]).all():  # all cars move as one
        values = values[:, :1]
    # a Butterworth low-pass of second order to and fro; mirrored, since it takes what it filters for periodic
    mirrored = np.concatenate([values, values[::-1]])
    gain = 1.0 / (1.0 + (np.fft.rfftfreq(len(mirrored), period) / JERK_CUT_OFF) ** 4)
    passed = np.fft.rfft(mirrored, axis=0) * gain[:, None]
    values = np.fft.irfft(passed, len(mirrored), axis=0)[: len(values)]
    return np.broadcast_to(np.gradient(values, period, axis=0), shape)
