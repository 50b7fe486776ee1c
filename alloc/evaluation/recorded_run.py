"""What a recorded run gives to its metrics: its arrays, and what several metrics need, computed once.

In: the Dataset of `alloc.run.simulation.simulate`. "Under demand" means while the driver asks for traction or braking;
forces count in the direction of the demand. A unit has one torque for all its axles, so its weakest axle bounds it, unless
its motors run in parallel on one frequency.
"""

import math
from collections.abc import Callable
from functools import cached_property, reduce
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.compilation import jit

SUMMED = "rail_force", "adhesion_limit", "axle_load", "slip_velocity", "peak_slip", "rim_speed"
"""Variables that `sum_axles` reads, in its order."""
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

JERK_CUT_OFF = 5.0
"""Cut-off frequency [Hz] of the low-pass on a car's acceleration: ride comfort depends on a few hertz."""
SLIP_FACTOR = 2.0
"""An axle slips where its slip velocity exceeds this multiple of that of the curve's peak."""
LOCK_SPEED, STANDING_SPEED = 5.0 / 3.6, 0.1
"""Speeds [m/s]: of a train above which a wheel whose rim is slower than the second is locked."""
STANDSTILL = 0.01
"""Speed [m/s] of a train that stands."""


class TrainBounds(NamedTuple):
    """Forces at the rail [N] at the instants under demand, (instants,) each."""

    plan: Floats
    """What the driver asks for, by the true masses, rising within the jerk limit."""
    bound: Floats
    """The largest force that rail and motors allow, at most the plan behind the lags of motors and cylinders."""
    apart: Floats
    """The same if each unit delivers no more than its own part of the plan."""
    force: Floats
    """Delivered; below 0 where the train turns wheels that failed motors do not."""


class AxleSums(NamedTuple):
    """What is summed over axles; forces at the rail [N] in the direction of the demand."""

    acting: Floats
    """Of the axles that pull or brake, (time,)."""
    delivered: Floats
    """Of driven axles, and of those that brake with air alone, (2, time)."""
    carried: Floats
    """The most that each part of the train carries, which its weakest axle bounds, (time, part)."""
    used: Floats
    """Of each axle that acts under demand, and the most that it could have, (2, axles of all instants)."""
    slipping: int
    """Number of axles that slip, of all instants."""
    locked: int
    """Number of axles whose wheels are locked, of all instants."""


class RecordedRun:
    """A recorded run as arrays: `run[name]` is a variable, attributes are what several metrics need."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self.dataset, self.attrs = dataset, dataset.attrs
        self.period = record_period(dataset)
        self._computed: dict[Any, Any] = {}
        self.unit, group = self["axle_unit"], self["axle_group"]
        self.driven = self.unit >= 0
        self.of_unit = (self.unit[:, None] == np.arange(self["unit_gear"].size)).astype(float)
        """(axle, unit): 1 where the axle is the unit's; `forces @ of_unit` are those of the units."""
        self.axles = self.of_unit.sum(axis=0)
        """Number of axles of each unit."""
        self.load, self.turning = self["axle_static_load"], self["axle_turning_mass"]
        self.command, self.planned = self["driver_command"], self["planned_coefficient"]
        self.demand, self.way = self.command != 0.0, np.sign(self.command)
        self.gain = self.way * self["acceleration"]
        air = bool(self.attrs["blended_brakes"]) or not self.driven.any()
        self.air = (self.way < 0.0) & air & (group >= 0).any()
        """Instants at which every car brakes itself, with air where it has no motors, (time,)."""
        self.trailing = ~self.driven & (group >= 0) & self.air.any()
        """Axles that brake with air alone, if any do, (axle,)."""
        self.part = self.unit.astype(np.int64)
        """Unit of each axle, behind all units the brake group of a trailing one, -1: neither, (axle,)."""
        _, number = np.unique(group[self.trailing], return_inverse=True)
        self.part[self.trailing] = self.axles.size + number

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
    def first_axles(self) -> NDArray[np.int64]:
        """Foremost axle of each part: of each unit, then of each brake group of trailing axles."""
        number, first = np.unique(self.part, return_index=True)
        return first[number >= 0]

    def risen(
        self, plan: Floats, ceiling: float, lag: Floats, dead: Floats | float = 0.0
    ) -> Floats:
        """`plan` (time,) within the jerk limit, as a coefficient, behind dead times and lags [s] of parts, (time, part).

        It ends at `ceiling` of the plan. A stretch of a run begins as it is asked for then.
        """
        step, rise = self.period, float(self.attrs["rise_time"])
        # commands are held for a period, so their mean is half of it ahead of a straight rise
        lead = 0.5 * float(self.attrs["control_period"])
        level = np.empty((self.demand.size, lag.size))
        dead = np.broadcast_to(dead, lag.shape)
        begun = float(self["time"][0]) > 0.0
        build_up(plan * self.way, begun, step, lead, rise, ceiling, lag, dead, level)
        return level

    @cached_property
    def built_up(self) -> Floats:
        """What each part gives of the plan on rail that carries everything, as a coefficient, (time, part).

        A unit has its motors, and under blended brakes air where they give less; where motors fail later, or the line comes
        to take less, that is there at once.
        """
        units, first = self.axles.size, self.first_axles
        level = self.risen(self.planned, 1.0, self["unit_lag"])
        if not self.air.any():
            return level
        braked = np.where(self.air, self.planned, 0.0)
        air = self.risen(
            braked, 1.0, *(self[f"axle_{name}_time"][first] for name in ("fill", "dead"))
        )
        electric = self.limits / np.maximum(self["unit_static_load"], 1.0)
        both = np.where(self.air[:, None], np.minimum(level, electric + air[:, :units]), level)
        return np.append(both, air[:, units:], axis=1)

    @cached_property
    def stretches(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First instants between changes of the command, which are few; and number of the stretch of each, (time,)."""
        new = np.diff(self.command, prepend=np.nan) != 0.0
        new |= np.diff(self.planned, prepend=np.nan) != 0.0
        return np.flatnonzero(new), np.cumsum(new) - 1

    @cached_property
    def sums(self) -> AxleSums:
        """Found in one pass over the axles of all instants."""
        force, *more = (np.require(self[name], float, ["C", "W"]) for name in SUMMED)
        instants, runs = len(force), np.abs(self["speed"]) > LOCK_SPEED
        count = np.bincount(self.part[self.part >= 0], minlength=self.axles.size)
        acting, used = np.empty(force.shape), np.empty((2, force.size))
        total, carried = np.empty((2, instants)), np.full((instants, count.size), np.inf)
        each = self.way, self.air, runs, self.driven, self.part
        n, *times = sum_axles(*each, force, *more, acting, total, carried, used)
        return AxleSums(acting.sum(axis=1), total, carried * count, used[:, :n], *times)

    @cached_property
    def limits(self) -> Floats:
        """Force at the rim of each unit's motors at their limits [N], (time, unit)."""
        braking = (self.way < 0.0)[:, None]
        limit = np.where(braking, self["brake_limit"], self["drive_limit"])
        return np.asarray(self.axles * self["unit_gear"] / self["unit_radius"] * limit)

    @cached_property
    def at_rim(self) -> Floats:
        """The same; inf where air makes up for them."""
        return np.where(self.air[:, None], np.inf, self.limits)

    @cached_property
    def motors(self) -> Floats:
        """What of `at_rim` reaches the rail: the rest turns the wheelsets; below 0 where failed motors are turned."""
        turned = self.turning @ self.of_unit * np.maximum(self.gain, 0.0)[:, None]
        return np.asarray(self.at_rim - turned)

    @cached_property
    def bounds(self) -> TrainBounds:
        """In blended braking every trailer's brake group adds its own part of the plan, as far as the rail carries it.

        No unit rises faster than the jerk limit and its lag let it, and no train has to make up for what its lags cost.
        """
        pulls, units = self.demand, self.axles.size
        air, carried = self.air[pulls], self.sums.carried.compress(pulls, axis=0)
        delivered, braked = self.sums.delivered.compress(pulls, axis=1)
        wanted = self.risen(self.planned, 1.0, np.zeros(1)).compress(pulls, axis=0)[:, 0]
        built, most = self.built_up.compress(pulls, axis=0), carried[:, :units]
        parallel = self["unit_parallel"] > 0
        if parallel.any():
            limit = self["adhesion_limit"] * self["axle_load"]
            available = np.maximum(limit, np.abs(self["rail_force"]))[pulls]
            most = np.where(parallel, available @ self.of_unit, most)
        load = self["unit_static_load"]
        part = built[:, :units] * load
        free = self.risen(self.planned, math.inf, self["unit_lag"]) * load
        most = np.minimum(most, self.motors.compress(pulls, axis=0))
        most = np.minimum(most, free.compress(pulls, axis=0))
        plan, reach, bound = wanted * load.sum(), sum_columns(part), sum_columns(most)
        apart = sum_columns(np.minimum(part, most))
        if self.trailing.any():
            load = np.bincount(self.part[self.trailing] - units, self.load[self.trailing])
            part = built[:, units:] * load
            held = np.minimum(part, carried[:, units:]).sum(axis=1)
            more = wanted * load.sum(), part.sum(axis=1), held, held, braked
            for total, trailers in zip((plan, reach, bound, apart, delivered), more, strict=True):
                total += np.where(air, trailers, 0.0)
        reach = np.minimum(plan, reach)
        bound, apart = (np.clip(total, 0.0, reach) for total in (bound, apart))
        return TrainBounds(plan, bound, apart, delivered)

    @cached_property
    def dry_gains(self) -> tuple[Floats, Floats]:
        """Acceleration [m/s2] that the train would have at its speed and place on rail that carries everything, (time,).

        Each unit then delivers its own part of the plan, or what its motors give; and the same as it has built up.
        """
        first, k = self.stretches
        wanted = self.planned[first, None] * self.load  # of an axle that acts, at its rim
        wanted += self.turning * np.abs(self.command[first, None])
        trailing = self.trailing & self.air[first, None]
        turned = self.driven | trailing  # these wheelsets take their part of the rim's force
        moved = self["car_mass"].sum() + (self.turning * ~turned).sum(axis=1)
        whole = moved + (self.turning * turned).sum(axis=1)
        of_unit = (wanted @ self.of_unit).take(k, axis=0)
        of_trailer = (wanted * trailing)[:, self.trailing].take(k, axis=0)
        beside = moved[k] * self.gain - self.sums.acting
        built = self.built_up / np.where(self.planned > 0.0, self.planned, 1.0)[:, None]

        def gain(units: Any, trailers: Any) -> Floats:
            rim = sum_columns(np.minimum(of_unit * units, self.at_rim))
            return np.asarray((beside + rim + (of_trailer * trailers).sum(axis=1)) / whole[k])

        units, number = self.axles.size, self.part[self.trailing]
        return gain(1.0, 1.0), gain(built[:, :units], built[:, number])

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


@jit
def sum_axles(
    way, air, runs, motors, part, force, limit, load, slip, top, rim, acting, total, carried, used
):
    """`AxleSums` into (time, axle), (2, time), (time, part), (2, axles); returns how many are used, slip, are locked.

    `way`, `air`, `runs` (time,); `motors`, `part` (axle,); variables of the run from `force` to `rim` (time, axle).
    """
    n = slipping = locked = 0
    for k in range(way.size):
        demand, brakes, driven, braked = way[k], air[k], 0.0, 0.0
        for i in range(part.size):
            f, j = demand * force[k, i], part[i]
            # at least the force carried: the limit is that of a driving wheel
            most = max(limit[k, i] * load[k, i], abs(force[k, i]))
            if j >= 0:
                carried[k, j] = min(carried[k, j], most)
                if motors[i]:
                    driven += f
                else:
                    braked += f
            acts = motors[i] or brakes
            acting[k, i] = f if acts else 0.0
            if acts and demand != 0.0:
                used[0, n], used[1, n] = f, most
                n += 1
        total[0, k], total[1, k] = driven, braked
        for i in range(part.size):
            slipping += abs(slip[k, i]) > SLIP_FACTOR * top[k, i]
            locked += runs[k] and abs(rim[k, i]) < STANDING_SPEED
    return n, slipping, locked


@jit
def build_up(plan, begun, step, lead, rise, ceiling, lag, dead, level):
    """What parts have risen to, into `level` (time, part): `plan` (time,), negative braking, every `step` [s], within its
    jerk limit, up to `ceiling` of it, behind `dead` times and `lag` [s]. `begun`: it has risen before the first instant.

    It rises by itself in the time `rise`, `lead` [s] ahead of the first instant. The recursion is exact where it is linear
    from instant to instant. What a part still gives of the other direction is none of this.
    """
    risen, value = np.empty(plan.size), 0.0
    for k in range(plan.size):
        if k == 0 and begun:
            value = abs(plan[k])
        elif k == 0 or plan[k] * plan[k - 1] <= 0.0:
            value = lead / rise * abs(plan[k])
        else:
            value += step / rise * abs(plan[k])
        value = min(value, ceiling * abs(plan[k])) if plan[k] != 0.0 else 0.0
        risen[k] = math.copysign(value, plan[k])
    first = risen[0] if begun else 0.0
    for j in range(lag.size):
        keep, mean, late, last, value = 0.0, 0.0, round(dead[j] / step), first, first
        if lag[j] > 0.0:
            keep = math.exp(-step / lag[j])
            mean = (1.0 - keep) * lag[j] / step
        for k in range(plan.size):
            now = risen[k - late] if k >= late else first
            value = keep * value + (mean - keep) * last + (1.0 - mean) * now
            level[k, j], last = max(math.copysign(1.0, plan[k]) * value, 0.0), now


def sum_columns(values: Floats) -> Floats:
    """`values.sum(axis=1)`, to the last bit, in a fifth of its time where there are few columns."""
    few = 0 < values.shape[1] < 8
    return np.asarray(reduce(np.add, values.T) if few else values.sum(axis=1))


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
