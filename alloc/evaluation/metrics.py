"""How good was a run? Metrics of a recorded run: effort, adhesion, time lost, slip, wheel damage, ride.

In: the Dataset of `simulate`. Out: one float each, nan where it does not apply. Every metric judges by the truth: forces,
adhesion and motors of the plant, and the driver's plan by the train's true masses (`planned_coefficient`). So equal forces
have equal metrics, whatever was commanded.

"Under demand" means while the driver asks for traction or braking; forces count in the direction asked for. A unit has one
torque for all its axles, so its weakest axle bounds it, unless its motors run in parallel on one frequency.
"""

import math
from collections.abc import Callable
from functools import cached_property, wraps
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.evaluation.least_damage import Fronts, find_fronts
from alloc.schema.errors import UnsoundRun
from alloc.schema.registry import Registry

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

SLIP_FACTOR = 2.0
"""An axle slips where its slip velocity exceeds this multiple of that of the curve's peak."""
SETTLING = 2.0
"""Time [s] left out after the driver asks for more: torque rises in 1 s, and cylinders take as long to fill."""
JERK_CUT_OFF = 5.0
"""Cut-off frequency [Hz] of the low-pass on a car's acceleration: ride comfort depends on a few hertz."""
LOCK_SPEED, STANDING_SPEED, STANDSTILL = 5.0 / 3.6, 0.1, 0.01
"""Speeds [m/s]: of a train above which a wheel whose rim is slower than the second is locked; of a train that stands."""
LEAST_GAIN = 0.1
"""Acceleration [m/s2] that dry rail must allow for time to be lost."""
MEAN_TIME = 1.0
"""Time [s] over which torque is averaged: slower changes are the course of the event."""

UNLIMITED, NEVER_NEGATIVE = (-math.inf, math.inf), (0.0, math.inf)
"""Ranges of metrics."""
SHARE, EITHER_WAY, EXCESS = (0.0, 1.0), (-1.0, 1.0), (-1.0, math.inf)
"""Of a share, of a force over the largest possible one, of an excess over the least."""
ROUNDING = 1e-6
"""How far rounding may take a metric out of its range."""


class Metric(NamedTuple):
    """A figure of merit."""

    name: str
    unit: str
    description: str
    function: Callable[[Any], float]
    """Of a recorded run, or of its `Run`."""
    better: int = 0
    """-1: less is better, +1: more is better, 0: neither."""
    within: tuple[float, float] = UNLIMITED
    """Smallest and largest value that it can have; intervals of its mean end there."""


METRICS: Registry[Metric] = Registry("metric")
"""Every metric by name."""

Measure = Callable[[Any], float]


def metric(
    name: str, unit: str, description: str, better: int = 0, within: tuple[float, float] = UNLIMITED
) -> Callable[[Measure], Measure]:
    """Decorator that registers a function of a recorded run as a metric; arguments as in `Metric`."""

    def register(function: Measure) -> Measure:
        @wraps(function)
        def measured(run: Any) -> float:
            return float(function(run.dataset if isinstance(run, Run) else run))

        made = Metric(name, unit, description, measured, better, within)
        METRICS.register(name, made, function.__module__)
        return measured

    return register


def evaluate(run: xr.Dataset) -> dict[str, float]:
    """All metrics of a run, by name; raises `UnsoundRun` where one is outside the range that it declares."""
    known = Run(run)
    values = {name: one.function(known) for name, one in METRICS.items()}
    for name, value in values.items():
        least, most = METRICS[name].within
        if value < least - ROUNDING or value > most + ROUNDING or math.isinf(value):
            raise UnsoundRun(
                f"metric {name!r} = {value:g} is outside its range, {least:g} to {most:g}"
            )
    return values


def series(run: xr.Dataset, name: str) -> NDArray[Any]:
    """Recorded values of a variable; `run[name].values` is the same, but takes twenty times as long to look up."""
    return np.asarray(run.variables[name].values)


def share(part: Floats, whole: Floats) -> float:
    """Sum over sum; nan where there is nothing to have a share of."""
    total = whole.sum()
    return float(part.sum() / total) if total else math.nan


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


class Run:
    """A recorded run as arrays, and what several metrics need of it, found once."""

    def __init__(self, dataset: xr.Dataset) -> None:
        self.dataset, self.attrs = dataset, dataset.attrs
        self.period = period_of(dataset)
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
        self.force, self.slip = (
            self.way[:, None] * self["rail_force"],
            np.abs(self["slip_velocity"]),
        )
        """Force in the direction of the demand [N], magnitude of the slip velocity [m/s], (time, axle)."""
        self.gain = self.way * self["acceleration"]
        air = bool(self.attrs["blended_brakes"]) or not self.driven.any()
        self.air = (self.way < 0.0) & air & (self.group >= 0).any()
        """Instants at which every car brakes itself, with air where it has no motors, (time,)."""
        self.acting = self.driven | self.air[:, None]
        """Axles that pull or brake, (time, axle)."""

    def __getitem__(self, name: str) -> NDArray[Any]:
        return series(self.dataset, name)

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
        carried = _weakest(available, self.unit, self.axles.size)
        if parallel.any():
            carried = np.where(parallel, available @ self.of_unit, carried)
        most, own = np.minimum(carried, self.motors[calm]), planned * self["unit_static_load"]
        plan, delivered = own.sum(axis=1), force[:, self.driven].sum(axis=1)
        bound = np.maximum(most.sum(axis=1), 0.0)
        apart = np.maximum(np.minimum(own, most).sum(axis=1), 0.0)
        if air.any() and trailing.any():
            groups, label = np.unique(self.group[trailing], return_inverse=True)
            part = planned * np.bincount(label, self.load[trailing])
            held = np.minimum(part, _weakest(available[:, trailing], label, groups.size))
            given = force[:, trailing]
            for total, more in ((plan, part), (bound, held), (apart, held), (delivered, given)):
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
        return jerk(self.dataset)[self.demand]

    @cached_property
    def fronts(self) -> Fronts | None:
        """Best splits of the effort; None without driven axles or demand, or where the run names no curve."""
        return find_fronts(self)


def _weakest(values: Floats, label: NDArray[np.int64], labels: int) -> Floats:
    """Number of its axles times the least of them, (time, label)."""
    found = np.empty((len(values), labels))
    for g in range(labels):
        found[:, g] = (label == g).sum() * values[:, label == g].min(axis=1)
    return found


# What follows from a `Run`


def _utilisation(run: Run) -> float:
    counted = run.acting & run.demand[:, None]
    return share(run.force[counted], run.available[counted])


def _effort_ratio(run: Run) -> float:
    force = np.where(run.acting, run.force, 0.0).sum(axis=1)[run.demand]
    return share(force, np.abs(run.command)[run.demand] * run["car_mass"].sum())


def _time_to_speed(run: Run) -> float:
    if not np.isfinite(run.attrs["target_speed"]) or not run.demand[: run.end + 1].any():
        return math.nan
    return float(run["time"][run.end] - run["time"][np.argmax(run.demand)])


# A train gains a dt in the time dt; on dry rail it would gain as much in a / a_dry of that time. So what it loses until it
# has its last speed is the integral of 1 - a / a_dry over the settled instants, in time or along its way: no second run, a
# lead counts as well as a lag, and the end of the event does not matter.


def _lost(run: Run, way: float, weight: Any = 1.0) -> float:
    counted = run.settled & (run.way == way) & (run.dry_gain > LEAST_GAIN)
    late = (1.0 - run.gain / np.maximum(run.dry_gain, LEAST_GAIN)) * weight
    return float(late[counted].sum() * run.period) if counted.any() else math.nan


def _locked_time(run: Run) -> float:
    standing = np.abs(run["rim_speed"]) < STANDING_SPEED
    return float((standing & (np.abs(run["speed"]) > LOCK_SPEED)[:, None]).sum() * run.period)


def period_of(run: xr.Dataset) -> float:
    """Time between two recorded instants [s]; nan where there is one."""
    time = series(run, "time")
    return float((time[-1] - time[0]) / (time.size - 1)) if time.size > 1 else math.nan


def jerk(run: xr.Dataset) -> Floats:
    """Jerk of each car [m/s3], (time, car), from its acceleration below `JERK_CUT_OFF`; nan in a run of one instant."""
    every, period = series(run, "car_acceleration").astype(float), period_of(run)
    if len(every) < 2:
        return np.full_like(every, np.nan)
    values = every[:, :1] if (every == every[:, :1]).all() else every  # all cars move as one
    # a Butterworth low-pass of second order to and fro; mirrored, since it takes what it filters for periodic
    mirrored = np.concatenate([values, values[::-1]])
    gain = 1.0 / (1.0 + (np.fft.rfftfreq(len(mirrored), period) / JERK_CUT_OFF) ** 4)
    kept = np.fft.rfft(mirrored, axis=0) * gain[:, None]
    values = np.fft.irfft(kept, len(mirrored), axis=0)[: len(values)]
    return np.broadcast_to(np.gradient(values, period, axis=0), every.shape)


def _torque_fluctuation(run: Run) -> float:
    if not run.demand.any() or not run.driven.any():
        return math.nan
    planned = run.planned[run.demand].mean() * run["unit_static_load"]
    planned *= run["unit_radius"] / (run["unit_gear"] * run.axles)
    torque, width = run["motor_torque"][run.demand] / planned, run.instants(MEAN_TIME)
    padded = np.pad(torque, ((width // 2, width - width // 2), (0, 0)), "edge").cumsum(axis=0)
    rest = torque - (padded[width:] - padded[:-width]) / width
    return float(np.sqrt((rest**2).mean()))


def of_run(
    name: str, unit: str, better: int, within: tuple[float, float], description: str, function: Callable[[Run], Any]
) -> Metric:  # fmt: skip
    """A metric of what follows from a `Run`."""

    def measure(run: Any) -> float:
        return float(function(run if isinstance(run, Run) else Run(run)))

    return Metric(name, unit, description, measure, better, within)


# Every metric: name, unit, whether more or less is better, range, meaning, function of a `Run`. Excess over the least damage
# may be a little below 0: wheels that change their speed are not in balance. The best course of a whole event is never above
# the plan; it has one marginal cost over units and time: effort goes where it is cheap.

_METRICS = (
    # effort and adhesion
    of_run("bound_use", "1", +1, SHARE,
     "effort, at each instant within 0 and the bound, over the most that rail and motors allow",
     lambda run: share(np.clip(run.bounds.force, 0.0, run.bounds.bound), run.bounds.bound)),
    of_run("bound", "1", 0, SHARE, "the most that rail and motors allow, at most the plan, over the plan",
     lambda run: share(run.bounds.bound, run.bounds.plan)),
    of_run("headroom", "1", 0, SHARE, "share of the plan that only sharing between units can reach",
     lambda run: share(run.bounds.bound - run.bounds.apart, run.bounds.plan)),
    of_run("over_delivery", "1", -1, NEVER_NEGATIVE, "effort beyond the plan, relative to it",
     lambda run: share(np.maximum(run.bounds.force - run.bounds.plan, 0.0), run.bounds.plan)),
    of_run("utilisation", "1", +1, EITHER_WAY,
     "adhesion used: rail force over the force available to acting axles", _utilisation),
    of_run("effort_ratio", "1", +1, UNLIMITED, "rail force of the acting axles over what accelerates the train as asked for",
     _effort_ratio),
    of_run("acceleration_ratio", "1", +1, UNLIMITED,
     "acceleration reached, relative to the plan; running resistance and gradients count as loss",
     lambda run: share(run.gain[run.demand], np.abs(run.command[run.demand]))),
    of_run("energy", "MJ", 0, UNLIMITED, "work of the motors at the wheels",
     lambda run: (run["motor_work"][-1] - run["motor_work"][0]) / 1e6),
    of_run("distance", "m", 0, UNLIMITED,
     "distance run until the end, or until the target speed; nan where that is not reached",
     lambda run: run["position"][run.end] - run["position"][0] if run.end >= 0 else math.nan),
    of_run("time_to_speed", "s", -1, NEVER_NEGATIVE, "time from the first demand to the target speed", _time_to_speed),
    of_run("time_lost", "s", -1, UNLIMITED,
     "time lost in pulling to the last speed, against the same train on rail that carries everything",
     lambda run: _lost(run, 1.0)),
    of_run("distance_lost", "m", -1, UNLIMITED,
     "way lost in braking to the last speed, against the same train on rail that carries everything",
     lambda run: _lost(run, -1.0, np.abs(run["speed"]))),
    # slip, damage, ride
    of_run("slip_time", "s", -1, NEVER_NEGATIVE, "time spent slipping, summed over axles",
     lambda run: (run.slip > SLIP_FACTOR * run["peak_slip"]).sum() * run.period),
    of_run("slip_peak", "m/s", -1, NEVER_NEGATIVE, "largest slip velocity of any axle", lambda run: run.slip.max()),
    of_run("locked_time", "s", -1, NEVER_NEGATIVE, "time that wheels stood above 5 km/h, summed over axles", _locked_time),
    of_run("damage", "kJ", -1, NEVER_NEGATIVE,
     "wheel damage Q: work dissipated between wheels and rail, JP4209318 (28), for driving too",
     lambda run: float((run["friction_work"][-1] - run["friction_work"][0]).sum()) / 1e3),
    of_run("excess_damage", "1", -1, EXCESS,
     "wheel damage Q of driven axles over the least of the same effort at each instant, less 1",
     lambda run: run.fronts.excess(run.fronts.force) if run.fronts else math.nan),
    of_run("event_excess", "1", -1, EXCESS,
     "wheel damage Q of driven axles over the least of the same impulse in the whole event, less 1",
     lambda run: run.fronts.excess(run.fronts.best_course()) if run.fronts else math.nan),
    of_run("jerk_rms", "m/s3", -1, NEVER_NEGATIVE, "jerk of the worst car, root mean square under demand",
     lambda run: np.sqrt((run.jerk**2).mean(axis=0)).max() if run.jerk.size else math.nan),
    of_run("jerk_peak", "m/s3", -1, NEVER_NEGATIVE, "largest jerk of any car under demand",
     lambda run: np.abs(run.jerk).max() if run.jerk.size else math.nan),
    of_run("coupler_peak", "kN", -1, NEVER_NEGATIVE, "largest coupler force; nan for a rigid train",
     lambda run: float(np.abs(run["coupler_force"]).max()) / 1e3 if run["coupler_force"].any() else math.nan),
    of_run("torque_fluctuation", "1", -1, NEVER_NEGATIVE, "rms of the motors' torques about their 1 s mean, over the plan's",
     _torque_fluctuation),
    of_run("rule_failures", "1", -1, NEVER_NEGATIVE, "calls in which the rule's solver failed",
     lambda run: run.attrs["rule_failures"]),
    of_run("controller_failures", "1", -1, NEVER_NEGATIVE, "steps in which a controller's solver failed",
     lambda run: run.attrs["controller_failures"]),
)  # fmt: skip


for _metric in _METRICS:
    METRICS.register(_metric.name, _metric)
damage, distance, locked_time = (
    METRICS[one].function for one in ("damage", "distance", "locked_time")
)
