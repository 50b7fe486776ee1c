"""How good was a run? Metrics of a recorded run: effort, adhesion, time lost, slip, wheel damage, ride.

In: the Dataset of `simulate`. Out: one float each, nan where it does not apply. Every metric judges by the truth: forces,
adhesion and motors of the plant, and the driver's plan by the train's true masses (`planned_coefficient`). So equal forces
have equal metrics, whatever was commanded.
"""

import math
from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from alloc.evaluation.least_damage import find_best_splits
from alloc.evaluation.recorded_run import Floats, RecordedRun
from alloc.schema.errors import UnsoundRun
from alloc.schema.registry import Registry

LEAST_GAIN = 0.1
"""Acceleration [m/s2] that dry rail must allow for time to be lost."""
MEAN_TIME = 1.0
"""Time [s] over which torque is averaged: slower changes are the course of the event."""

Range = tuple[float, float]
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
    """Of a recorded run, or of its `RecordedRun`."""
    better: int = 0
    """-1: less is better, +1: more is better, 0: neither."""
    within: Range = UNLIMITED
    """Smallest and largest value that it can have; intervals of its mean end there."""


METRICS: Registry[Metric] = Registry("metric")
"""Every metric by name."""

Measure = Callable[[Any], float]


def metric(
    name: str, unit: str, description: str = "", better: int = 0, within: Range = UNLIMITED
) -> Callable[[Measure], Measure]:
    """Decorator that registers a function of a recorded run as a metric; arguments as in `Metric`.

    Without a `description` the first sentences of the function's docstring are it. The function gets the Dataset of the run;
    one whose argument is annotated as a `RecordedRun` gets that, which is computed once for all metrics.
    """

    def register(function: Measure) -> Measure:
        takes_arrays = RecordedRun in function.__annotations__.values()
        text = " ".join((function.__doc__ or name).split("\n\n")[0].split()).rstrip(".")
        meaning = description or (text if text[:2].isupper() else text[:1].lower() + text[1:])

        @wraps(function)
        def measure(run: Any) -> float:
            if takes_arrays and not isinstance(run, RecordedRun):
                run = RecordedRun(run)
            elif isinstance(run, RecordedRun) and not takes_arrays:
                run = run.dataset
            return float(function(run))

        part = Metric(name, unit, meaning, measure, better, within)
        METRICS.register(name, part, function.__module__)
        return measure

    return register


def evaluate(run: xr.Dataset) -> dict[str, float]:
    """All metrics of a run, by name; raises `UnsoundRun` where one is outside the range that it declares."""
    arrays = RecordedRun(run)
    values = {name: metric.function(arrays) for name, metric in METRICS.items()}
    for name, value in values.items():
        least, most = METRICS[name].within
        if value < least - ROUNDING or value > most + ROUNDING or math.isinf(value):
            bounds = f"{least:g} to {most:g}"
            raise UnsoundRun(f"metric {name!r} = {value:g} is outside its range, {bounds}")
    return values


def divide_sums(part: Floats, whole: Floats) -> float:
    """Sum over sum; nan where there is nothing to have a share of."""
    total = whole.sum()
    return float(part.sum() / total) if total else math.nan


# Effort and adhesion


@metric("bound_use", "1", better=+1, within=SHARE)
def bound_use(run: RecordedRun) -> float:
    """Effort, at each instant within 0 and the bound, over the most that rail and motors allow."""
    return divide_sums(np.clip(run.bounds.force, 0.0, run.bounds.bound), run.bounds.bound)


@metric("bound", "1", within=SHARE)
def bound(run: RecordedRun) -> float:
    """The most that rail and motors allow, at most the plan, over the plan."""
    return divide_sums(run.bounds.bound, run.bounds.plan)


@metric("headroom", "1", within=SHARE)
def headroom(run: RecordedRun) -> float:
    """Share of the plan that only sharing between units can reach."""
    return divide_sums(run.bounds.bound - run.bounds.apart, run.bounds.plan)


@metric("over_delivery", "1", better=-1, within=NEVER_NEGATIVE)
def over_delivery(run: RecordedRun) -> float:
    """Effort beyond the plan, relative to it."""
    return divide_sums(np.maximum(run.bounds.force - run.bounds.plan, 0.0), run.bounds.plan)


@metric("utilisation", "1", better=+1, within=EITHER_WAY)
def utilisation(run: RecordedRun) -> float:
    """Adhesion used: rail force over the force available to acting axles."""
    return divide_sums(*run.sums.used)


@metric("effort_ratio", "1", better=+1)
def effort_ratio(run: RecordedRun) -> float:
    """Rail force of the acting axles over what accelerates the train as asked for."""
    return divide_sums(
        run.sums.acting[run.demand], np.abs(run.command)[run.demand] * run["car_mass"].sum()
    )


@metric("acceleration_ratio", "1", better=+1)
def acceleration_ratio(run: RecordedRun) -> float:
    """Acceleration reached, relative to the plan; running resistance and gradients count as loss."""
    return divide_sums(run.gain[run.demand], np.abs(run.command[run.demand]))


@metric("energy", "MJ")
def energy(run: RecordedRun) -> float:
    """Work of the motors at the wheels."""
    return (run["motor_work"][-1] - run["motor_work"][0]) / 1e6


@metric("distance", "m")
def distance(run: RecordedRun) -> float:
    """Distance run until the end, or until the target speed; nan where that is not reached."""
    return run["position"][run.end] - run["position"][0] if run.end >= 0 else math.nan


@metric("time_to_speed", "s", better=-1, within=NEVER_NEGATIVE)
def time_to_speed(run: RecordedRun) -> float:
    """Time from the first demand to the target speed."""
    if not np.isfinite(run.attrs["target_speed"]) or not run.demand[: run.end + 1].any():
        return math.nan
    return run["time"][run.end] - run["time"][np.argmax(run.demand)]


# A train gains a dt in the time dt; on dry rail it would gain as much in a / a_dry of that time. So what it loses until it
# has its last speed is the integral of 1 - a / a_dry, in time or along its way: no second run, a lead counts as well as a
# lag, and the end of the event does not matter. While the plan builds up, what that leaves takes the place of the 1.


def integrate_loss(run: RecordedRun, way: float, weight: Any = 1.0) -> float:
    """Integral of `weight` (time,) times 1 - a / a_dry over the instants of this direction of the demand."""
    dry, built_up = run.dry_gains
    counted = (run.way == way) & (dry > LEAST_GAIN)
    late = (built_up - run.gain) / np.maximum(dry, LEAST_GAIN) * weight
    return float(late[counted].sum() * run.period) if counted.any() else math.nan


@metric("time_lost", "s", better=-1)
def time_lost(run: RecordedRun) -> float:
    """Time lost in pulling to the last speed, against the same train on rail that carries everything."""
    return integrate_loss(run, 1.0)


@metric("distance_lost", "m", better=-1)
def distance_lost(run: RecordedRun) -> float:
    """Way lost in braking to the last speed, against the same train on rail that carries everything."""
    return integrate_loss(run, -1.0, np.abs(run["speed"]))


# Slip, damage, ride. Excess over the least damage may be a little below 0: wheels that change their speed are not in
# balance. The best course of a whole event is never above the plan; it has one marginal cost over units and time: effort
# goes where it is cheap.


@metric("slip_time", "s", better=-1, within=NEVER_NEGATIVE)
def slip_time(run: RecordedRun) -> float:
    """Time spent slipping, summed over axles."""
    return run.sums.slipping * run.period


@metric("slip_peak", "m/s", better=-1, within=NEVER_NEGATIVE)
def slip_peak(run: RecordedRun) -> float:
    """Largest slip velocity of any axle."""
    slip = run["slip_velocity"]
    return max(slip.max(), -slip.min())


@metric("locked_time", "s", better=-1, within=NEVER_NEGATIVE)
def locked_time(run: RecordedRun) -> float:
    """Time that wheels stood above 5 km/h, summed over axles."""
    return run.sums.locked * run.period


@metric("damage", "kJ", better=-1, within=NEVER_NEGATIVE)
def damage(run: RecordedRun) -> float:
    """Wheel damage Q: work dissipated between wheels and rail, JP4209318 (28), for driving too."""
    return (run["friction_work"][-1] - run["friction_work"][0]).sum() / 1e3


@metric("excess_damage", "1", better=-1, within=EXCESS)
def excess_damage(run: RecordedRun) -> float:
    """Wheel damage Q of driven axles over the least of the same effort at each instant, less 1."""
    best = run.compute_once(find_best_splits)
    return best.excess(best.force) if best else math.nan


@metric("event_excess", "1", better=-1, within=EXCESS)
def event_excess(run: RecordedRun) -> float:
    """Wheel damage Q of driven axles over the least of the same impulse in the whole event, less 1."""
    best = run.compute_once(find_best_splits)
    return best.excess(best.best_course()) if best else math.nan


@metric("jerk_rms", "m/s3", better=-1, within=NEVER_NEGATIVE)
def jerk_rms(run: RecordedRun) -> float:
    """Jerk of the worst car, root mean square under demand."""
    return np.sqrt((run.jerk**2).mean(axis=0)).max() if run.jerk.size else math.nan


@metric("jerk_peak", "m/s3", better=-1, within=NEVER_NEGATIVE)
def jerk_peak(run: RecordedRun) -> float:
    """Largest jerk of any car under demand."""
    return np.abs(run.jerk).max() if run.jerk.size else math.nan


@metric("coupler_peak", "kN", better=-1, within=NEVER_NEGATIVE)
def coupler_peak(run: RecordedRun) -> float:
    """Largest coupler force; nan for a rigid train."""
    force = np.abs(run["coupler_force"])
    return float(force.max()) / 1e3 if force.any() else math.nan


@metric("torque_fluctuation", "1", better=-1, within=NEVER_NEGATIVE)
def torque_fluctuation(run: RecordedRun) -> float:
    """Rms of the motors' torques about their 1 s mean, over the plan's."""
    if not run.demand.any() or not run.driven.any():
        return math.nan
    planned = run.planned[run.demand].mean() * run["unit_static_load"]
    planned *= run["unit_radius"] / (run["unit_gear"] * run.axles)
    torque, width = (
        run["motor_torque"].compress(run.demand, axis=0) / planned,
        run.instants(MEAN_TIME),
    )
    around = np.arange(-(width // 2), len(torque) + width - width // 2)
    padded = torque.take(around, axis=0, mode="clip").cumsum(axis=0)
    rest = torque - (padded[width:] - padded[:-width]) / width
    return float(np.sqrt((rest**2).mean()))


@metric("rule_failures", "1", better=-1, within=NEVER_NEGATIVE)
def rule_failures(run: RecordedRun) -> float:
    """Calls in which the rule's solver failed."""
    return run.attrs["rule_failures"]


@metric("controller_failures", "1", better=-1, within=NEVER_NEGATIVE)
def controller_failures(run: RecordedRun) -> float:
    """Steps in which a controller's solver failed."""
    return run.attrs["controller_failures"]
