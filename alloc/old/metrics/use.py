"""Metrics of effort, adhesion used and shared, slip, damage, ride, energy, counts.

In: a recorded run. Out: one float each; nan where it does not apply.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.old.estimation.series import spans
from alloc.old.metrics.registry import (
    EITHER_WAY,
    METRICS,
    NEVER_NEGATIVE,
    SHARE,
    SLIP_FACTOR,
    Metric,
    acting_axles,
    adhesion_used,
    direction,
    force_along,
    force_available,
    instants_in,
    mean_or_nan,
    metric,
    once_per_run,
    record_period,
    series,
    under_demand,
)
from alloc.old.onboard.telegrams import WHOLE

JERK_CUT_OFF = 5.0
"""Cut-off frequency [Hz] of the low-pass on car acceleration before it is differentiated. Longitudinal ride comfort depends
on frequencies of a few hertz."""

MILD, SEVERE = 100.0, 200.0
"""T gamma of a wheel [N] up to which wear is mild, and above which it is catastrophic: regimes of British Rail Research, see
`wheel_wear`."""
STANDSTILL = 0.01
"""Speed [m/s] below which a braked train counts as standing: it has less than a millimetre to go."""


@metric("acceleration", "m/s2", "mean acceleration under demand, in its direction", +1)
def acceleration(run: xr.Dataset) -> float:
    """Mean acceleration of the train under demand [m/s2]."""
    return mean_or_nan((direction(run) * series(run, "acceleration"))[under_demand(run)])


@metric("acceleration_ratio", "1", "acceleration reached, relative to the plan", +1)
def acceleration_ratio(run: xr.Dataset) -> float:
    """Mean acceleration under demand over the mean acceleration asked for.

    Running resistance and gradients count as loss here; `effort_ratio` leaves them out.
    """
    demand = under_demand(run)
    asked = np.abs(series(run, "driver_command")[demand]).sum()
    reached = (direction(run) * series(run, "acceleration"))[demand].sum()
    return float(reached / asked) if asked else float("nan")


@metric("effort_ratio", "1", "tractive effort delivered, relative to the plan", +1)
def effort_ratio(run: xr.Dataset) -> float:
    """Mean rail force of the axles that pull or brake over the force that the plan asks for.

    The plan's force accelerates the train and its rotating parts. The rail carries the part for the train and the unpowered
    wheelsets. So a run without slip in which nothing limits the motors has a ratio close to 1.
    """
    demand = under_demand(run)
    force = (
        direction(run) * np.where(acting_axles(run), series(run, "rail_force"), 0.0).sum(axis=1)
    )[demand]
    planned = np.abs(series(run, "driver_command"))[demand] * run.attrs["train_mass"]
    return float(force.sum() / planned.sum()) if planned.sum() else float("nan")


@metric(
    "utilisation",
    "1",
    "adhesion used: rail force over the force available to acting axles",
    +1,
    EITHER_WAY,
)
def utilisation(run: xr.Dataset) -> float:
    """Sum of the acting axles' rail force over the sum of their available force, under demand."""
    return adhesion_used(run, acting_axles(run) & under_demand(run)[:, None])


@metric(
    "utilisation_slipping",
    "1",
    "adhesion used by units while their detector signals slip",
    +1,
    EITHER_WAY,
)
def utilisation_slipping(run: xr.Dataset) -> float:
    """Utilisation over the instants and units in which the unit's detector signals slip; nan where none does."""
    unit = series(run, "axle_unit")
    if run.sizes["unit"] == 0:
        return float("nan")
    slipping = series(run, "slipping").astype(bool)[:, unit] & (unit >= 0)
    return adhesion_used(run, slipping & under_demand(run)[:, None])


@metric("slip_time", "s", "time spent slipping, summed over axles", -1, NEVER_NEGATIVE)
def slip_time(run: xr.Dataset) -> float:
    """Axle-seconds beyond `SLIP_FACTOR` times the slip velocity of the curve's peak."""
    slip = np.abs(series(run, "slip_velocity"))
    slipping = slip > SLIP_FACTOR * series(run, "peak_slip")
    return float(slipping.sum() * record_period(run))


@metric("slip_peak", "m/s", "largest slip velocity of any axle", -1, NEVER_NEGATIVE)
def slip_peak(run: xr.Dataset) -> float:
    """Largest magnitude of the slip velocity [m/s]."""
    return float(np.abs(series(run, "slip_velocity")).max())


@metric(
    "damage", "kJ", "wheel damage Q: work dissipated between wheels and rail", -1, NEVER_NEGATIVE
)
def damage(run: xr.Dataset) -> float:
    """Wheel damage Q of JP4209318 (28), for driving too [kJ]; integrated with the plant's own step."""
    work = series(run, "friction_work")
    return float((work[-1] - work[0]).sum() / 1e3)


class Wear(NamedTuple):
    """What three metrics say of T gamma [N], creep force times creepage."""

    mean: float
    severe: float
    worn: float


@once_per_run
def wear(run: xr.Dataset) -> Wear:
    """Metrics of T gamma, at once: what lies between is as large as a recorded variable of all axles.

    Creep force times creepage is the work that a wheel dissipates per metre of its way. Half of an axle's belongs to each
    wheel; it is the mean from one record to the next. 0 at a stand.
    """
    number = np.diff(series(run, "friction_work"), axis=0)
    np.maximum(number, 0.0, out=number)
    number *= 0.5
    way = np.abs(np.diff(series(run, "position")))[:, None]
    moves = way[:, 0] > 0.0
    np.divide(number, way, out=number, where=moves[:, None])
    number[~moves] = 0.0
    severe, rate = number > SEVERE, np.minimum(number, MILD)
    rate *= 0.25
    rate[severe] = 1.19 * number[severe] - 154.0
    rate *= 1e-3 * way
    rate /= 2e3 * series(run, "axle_radius")
    worn, length = float(2.0 * rate.sum()), way.sum() * number.shape[1]
    work = np.multiply(number, way, out=number)
    whole = work.sum()
    mean = float(whole / length) if length else float("nan")
    work[~severe] = 0.0
    return Wear(mean, float(work.sum() / whole) if whole else float("nan"), worn)


@metric("wear_number", "N", "T gamma of a wheel, mean over way and axles", -1, NEVER_NEGATIVE)
def wear_number(run: xr.Dataset) -> float:
    """Mean T gamma of a wheel [N] over the way; nan where the train stands."""
    return wear(run).mean


@metric(
    "severe_work",
    "1",
    f"share of wheel damage Q done at T gamma above {SEVERE:g} N",
    -1,
    SHARE,
)
def severe_work(run: xr.Dataset) -> float:
    """Share of the dissipated work that wheels do in the regime of catastrophic wear; nan where there is none."""
    return wear(run).severe


@metric(
    "wheel_wear",
    "mm2",
    "cross-section worn off the treads, all wheels together",
    -1,
    NEVER_NEGATIVE,
)
def wheel_wear(run: xr.Dataset) -> float:
    """Loss of cross-section [mm2] of all wheels, by British Rail Research's function of T gamma.

    Per kilometre and wheel diameter D [mm] it is 0.25 T gamma / D up to 100 N, 25 / D up to 200 N, (1.19 T gamma - 154) / D
    beyond (Pearce and Sherratt, Prediction of wheel profile wear, Wear 144 (1991) 343-351).
    """
    return wear(run).worn


@metric("distance", "m", "distance run until the end, or until the target speed", 0)
def distance(run: xr.Dataset) -> float:
    """Distance [m] until the target speed is reached, or until the end of the run if there is no target speed.

    A target of 0 is the standstill, which a train approaches but does not pass. It counts as reached below `STANDSTILL`.
    Less than 0 where a train rolls back on a climb.
    """
    end = _target_index(run)
    if end < 0:
        return float("nan")
    position = series(run, "position")
    return float(position[end] - position[0])


@metric("time_to_speed", "s", "time from the first demand to the target speed", -1, NEVER_NEGATIVE)
def time_to_speed(run: xr.Dataset) -> float:
    """Time [s] from the first demand to the target speed; nan if no demand reaches it, or there is no target."""
    demand, end = under_demand(run), _target_index(run)
    if not np.isfinite(run.attrs["target_speed"]) or not demand[: end + 1].any():
        return float("nan")
    time = series(run, "time")
    return float(time[end] - time[int(np.argmax(demand))])


def _target_index(run: xr.Dataset) -> int:
    target = run.attrs["target_speed"]
    speed = series(run, "speed")
    if not np.isfinite(target):
        return int(speed.size - 1)
    if speed[0] > STANDSTILL:
        target = max(target, STANDSTILL)
    reached = (speed - target) * np.sign(target - speed[0]) >= 0.0
    return int(np.argmax(reached)) if reached.any() else -1


@lru_cache(maxsize=16)
def _low_pass(cut_off: float) -> NDArray[np.float64]:
    """Second-order sections of the low-pass; `cut_off` as a share of the Nyquist frequency."""
    from scipy.signal import butter

    return np.asarray(butter(2, cut_off, output="sos"))


@once_per_run
def jerk(run: xr.Dataset) -> NDArray[np.float64]:
    """Jerk of each car [m/s3], (time, car), from its acceleration below `JERK_CUT_OFF`; nan in a run of one instant."""
    period = record_period(run)
    values = series(run, "car_acceleration")
    if values.shape[0] < 2:
        return np.full_like(values, np.nan)
    cars = values.shape[1]
    if run.sizes.get("body") == 1:  # all cars move as one
        values = values[:, :1]
    nyquist = 0.5 / period
    if nyquist > JERK_CUT_OFF and values.shape[0] > 30:
        from scipy.signal import sosfiltfilt  # slow to import, and needed by a run alone

        # mirrored at its ends: an odd extension would turn what vibrates there into a step
        values = sosfiltfilt(_low_pass(JERK_CUT_OFF / nyquist), values, axis=0, padtype="even")
    return np.repeat(np.gradient(values, period, axis=0), cars // values.shape[1], axis=1)


@metric(
    "jerk_rms", "m/s3", "jerk of the worst car, root mean square under demand", -1, NEVER_NEGATIVE
)
def jerk_rms(run: xr.Dataset) -> float:
    """Root mean square jerk of the car with the largest value [m/s3]."""
    values = jerk(run)[under_demand(run)]
    return float(np.sqrt((values**2).mean(axis=0)).max()) if values.size else float("nan")


@metric("jerk_peak", "m/s3", "largest jerk of any car under demand", -1, NEVER_NEGATIVE)
def jerk_peak(run: xr.Dataset) -> float:
    """Largest magnitude of the jerk of any car [m/s3]."""
    values = jerk(run)[under_demand(run)]
    return float(np.abs(values).max()) if values.size else float("nan")


@metric("coupler_peak", "kN", "largest coupler force", -1, NEVER_NEGATIVE)
def coupler_peak(run: xr.Dataset) -> float:
    """Largest magnitude of any coupler force [kN]; nan for a rigid train."""
    force = series(run, "coupler_force")
    return float(np.abs(force).max() / 1e3) if force.size else float("nan")


@metric(
    "torsion_peak",
    "1",
    "largest torque in a twisting drive over the motor's largest",
    -1,
    NEVER_NEGATIVE,
)
def torsion_peak(run: xr.Dataset) -> float:
    """Largest torque that any drive's oscillation reaches, over the motor's largest at the wheel; nan for rigid drives."""
    unit = series(run, "axle_unit")
    driven = unit >= 0
    if "shaft_swing" not in run or not driven.any():
        return float("nan")
    motor = np.abs(series(run, "motor_torque")).max(axis=0) * series(run, "unit_gear")
    swing = series(run, "shaft_swing").max(axis=0)[driven]
    shares = swing / np.maximum(motor[unit[driven]], 1e-9)
    return float(shares.max())


@metric("energy", "MJ", "work of the motors at the wheels", 0)
def energy(run: xr.Dataset) -> float:
    """Work of the motors [MJ]."""
    work = series(run, "motor_work")
    return float((work[-1] - work[0]) / 1e6)


# What the rail and the motors allowed a train, how much of it was used, and how much of it only sharing could reach.
#
# All forces are at the rail, summed over the axles of a traction unit [N]. A unit has one torque for all its axles, so
# its weakest axle bounds it. Where a trailer brakes with air, nobody but itself can use its adhesion.


SETTLING = 2.0
"""Time [s] left out after the driver asks for more: torque rises in 1 s, and cylinders take as long to fill."""

Floats = NDArray[np.float64]


class TrainBounds(NamedTuple):
    """Forces [N] at the instants that count, (instants,) each."""

    plan: Floats
    """What the driver asks for, by the plant's masses; not what the train takes it for."""
    bound: Floats
    """The largest force that the train can deliver, but no more than the plan."""
    apart: Floats
    """The largest force if each unit delivers no more than its own part of the plan."""
    force: Floats
    """Delivered force; less than 0 where a train turns wheels that its motors do not."""
    held_back: Floats
    """Shortfall from the bound at units that deliver less than they could while their own controllers limit them."""
    equal: Floats
    """The bound if every motor of a unit gave the same torque, which its weakest axle then limits."""


@once_per_run
def settled(run: xr.Dataset) -> NDArray[np.bool_]:
    """Instants under demand at least `SETTLING` after the demand has grown, (time,)."""
    asked = np.abs(series(run, "driver_command"))
    wait = max(1, instants_in(run, SETTLING))
    grown = np.flatnonzero(np.diff(asked, prepend=0.0) > 0.0)
    calm = under_demand(run).copy()
    for k in grown:
        calm[k : k + wait] = False
    return calm


def _weakest(values: Floats, groups: NDArray[np.int64], count: int) -> Floats:
    """Number of its axles times the least of them, (time, group)."""
    found = np.empty((values.shape[0], count))
    for g in range(count):
        own = groups == g
        found[:, g] = own.sum() * values[:, own].min(axis=1)
    return found


def motor_bounds(run: xr.Dataset, chosen: Any) -> Floats:
    """Largest force [N] at the rail that the motors of each unit give at the `chosen` instants, (instants, units).

    inf under blended brakes: air makes up for the motors.
    """
    braking = direction(run)[chosen] < 0.0
    unit, units = series(run, "axle_unit"), run.sizes["unit"]
    driven = unit >= 0
    axles = np.bincount(unit[driven], minlength=units)
    at_rail = axles * series(run, "unit_gear") / series(run, "unit_radius")
    signed = np.where(
        braking[:, None],
        series(run, "brake_limit")[chosen],
        series(run, "drive_limit")[chosen],
    )
    # what turns the wheelsets comes from the motors and does not reach the rail
    turning = np.bincount(unit[driven], series(run, "axle_turning_mass")[driven], minlength=units)
    gained = np.maximum(direction(run) * series(run, "acceleration"), 0.0)[chosen]
    # less than 0 where the train turns wheels whose motors have failed
    motors = at_rail * signed - turning * gained[:, None]
    return np.where(braking[:, None] & bool(run.attrs["blended_brakes"]), np.inf, motors)


@once_per_run
def train_bounds(run: xr.Dataset) -> TrainBounds:
    """Plan, bounds and force at the instants that count.

    The bound is min(plan, sum over units of min(motor limit, what its axles carry)). A unit's axles carry the force that is
    available at the weakest one, times their number, where its motors give equal torques. Where motors share an inverter or
    a voltage, torque moves to the axles that slip less, and they carry the sum of what is available to each. Under blended
    brakes, air makes up for the motors. Each trailer's brake group adds its own part of the plan, as far as the rail carries
    it.
    """
    stretches = spans(settled(run))
    # a single stretch is looked at where it is; a mask would copy it
    return bounds_at(run, slice(*stretches[0]) if len(stretches) == 1 else settled(run))


def bounds_at(run: xr.Dataset, chosen: Any) -> TrainBounds:
    """As `train_bounds`, at the instants `chosen`, which index the recorded ones."""
    blended = bool(run.attrs["blended_brakes"])
    braking = direction(run)[chosen] < 0.0
    unit, group = series(run, "axle_unit"), series(run, "axle_group")
    available, force = force_available(run)[chosen], force_along(run)[chosen]
    planned = series(run, "planned_coefficient")[chosen, None]
    driven = unit >= 0
    own = planned * series(run, "unit_static_load")
    units = run.sizes["unit"]
    weakest, shared = _weakest(available, unit, units), series(run, "unit_parallel") > 0
    motors = motor_bounds(run, chosen)
    most = equal = np.minimum(weakest, motors)
    if shared.any():
        most = np.minimum(np.where(shared, _of_units(available, unit, units), weakest), motors)
    plan, bound, same = (
        own.sum(axis=1),
        *(np.maximum(one.sum(axis=1), 0.0) for one in (most, equal)),
    )
    apart = np.maximum(np.minimum(own, most).sum(axis=1), 0.0)
    delivered = force[:, driven].sum(axis=1)
    if blended and braking.any():
        trailing = ~driven & (group >= 0)
        numbers, inside = np.unique(group[trailing], return_inverse=True)
        wanted = planned * np.bincount(inside, series(run, "axle_static_load")[trailing])
        carried = np.minimum(wanted, _weakest(available[:, trailing], inside, numbers.size))
        for total, part in (
            (plan, wanted), (bound, carried), (same, carried), (apart, carried),
            (delivered, force[:, trailing]),
        ):  # fmt: skip
            total += np.where(braking, part.sum(axis=1), 0.0)
    bound = np.minimum(plan, bound)
    limited = series(run, "torque_factor")[chosen] < WHOLE
    # who resists has lost all that he could give, and no more
    unused = np.clip(most - _of_units(force, unit, units), 0.0, np.maximum(most, 0.0))
    short = bound - np.clip(delivered, 0.0, bound)
    held_back = np.minimum((limited * unused).sum(axis=1), short)
    return TrainBounds(
        plan, bound, np.minimum(plan, apart), delivered, held_back, np.minimum(plan, same)
    )


def _of_units(values: Floats, unit: NDArray[np.int64], units: int) -> Floats:
    """Sum over the axles of each unit, (time, unit)."""
    return values @ (unit[:, None] == np.arange(units)).astype(float)


def _share(part: Floats, whole: Floats) -> float:
    total = whole.sum()
    return float(part.sum() / total) if total else float("nan")


@metric(
    "bound_use",
    "1",
    "effort, at each instant within 0 and the bound, over the most that rail and motors allow",
    +1,
    SHARE,
)
def bound_use(run: xr.Dataset) -> float:
    """Effort over the true bound of the run; nan without demand, or where nothing could be delivered.

    At each instant it counts within 0 and the bound: wheels that slow down give back for a moment what turned them, which
    says nothing of how the bound is used later.
    """
    found = train_bounds(run)
    return _share(np.clip(found.force, 0.0, found.bound), found.bound)


@metric(
    "equal_torque_use",
    "1",
    "effort over the bound if all motors of a unit gave the same torque",
    +1,
    NEVER_NEGATIVE,
)
def equal_torque_use(run: xr.Dataset) -> float:
    """As `bound_use`, over the bound of motors with equal torques; above 1 where motors in parallel carry more.

    The two are the same where every motor has a torque control of its own.
    """
    found = train_bounds(run)
    return _share(np.clip(found.force, 0.0, found.bound), found.equal)


@metric(
    "held_back",
    "1",
    "share of the bound that readhesion controllers lose at the units they limit",
    -1,
    SHARE,
)
def held_back(run: xr.Dataset) -> float:
    """Shortfall from the bound at units whose own controllers limit them, over the bound.

    1 - `bound_use` - `held_back` is what sharing leaves: units that could carry more and are not asked to.
    """
    found = train_bounds(run)
    return _share(found.held_back, found.bound)


@metric("headroom", "1", "share of the plan that only sharing between units can reach", 0, SHARE)
def headroom(run: xr.Dataset) -> float:
    """Bound of the train less the sum of what each unit can deliver of its own part of the plan, over the plan."""
    found = train_bounds(run)
    return _share(found.bound - found.apart, found.plan)


@metric("over_delivery", "1", "effort beyond the plan, relative to it", -1, NEVER_NEGATIVE)
def over_delivery(run: xr.Dataset) -> float:
    """Effort beyond the plan, instant by instant, over the plan; `bound_use` does not count it."""
    found = train_bounds(run)
    return _share(np.maximum(found.force - found.plan, 0.0), found.plan)


# What the computers counted during a run.


def _attribute(
    name: str, unit: str, description: str, key: str, better: int = 0, scale: float = 1.0
) -> None:
    count = Metric(
        name, unit, description, lambda run: scale * float(run.attrs[key]), better, NEVER_NEGATIVE
    )
    METRICS.register(name, count)


_attribute("detections", "1", "slips detected by the foremost unit", "detections", -1)
_attribute("unit_detections", "1", "slips detected by all units", "unit_detections", -1)
_attribute("telegrams", "1", "telegrams sent", "telegrams_sent")
_attribute("telegrams_lost", "1", "telegrams lost", "telegrams_lost")
_attribute("fallbacks", "1", "units fallen back to the plan in silence", "fallbacks")
_attribute("blinded", "1", "units that lost the speed of their last axle", "blinded")
_attribute("locks", "1", "axles that slide protection found standing", "locks", -1)
_attribute("time_outs", "1", "valves made to supply by their time-out", "time_outs", -1)
_attribute("rule_calls", "1", "calls of the allocation rule", "rule_calls")
_attribute("rule_failures", "1", "calls in which the rule's solver failed", "rule_failures", -1)
_attribute("rule_time", "ms", "time in rules called from Python", "rule_time_s", 0, 1e3)
_attribute(
    "controller_failures",
    "1",
    "steps in which a controller's solver failed",
    "controller_failures",
    -1,
)
_attribute(
    "controller_median",
    "ms",
    "median time per unit and step that its computer takes",
    "controller_median_s",
    0,
    1e3,
)
_attribute("controller_p99", "ms", "99th percentile of it", "controller_p99_s", 0, 1e3)


# What sliding wheels cost under brakes: locked wheels, and compressed air.


LOCK_SPEED = 5.0 / 3.6
"""Train speed [m/s] above which a standing wheel counts as locked; slide protection is inactive below it."""

STANDING_SPEED = 0.1
"""Rim speed [m/s] below which a wheel counts as standing."""

ATMOSPHERE = 101325.0
"""Pressure [Pa] of a normal litre."""


@metric(
    "locked_time", "s", "time that wheels stood above 5 km/h, summed over axles", -1, NEVER_NEGATIVE
)
def locked_time(run: xr.Dataset) -> float:
    """Axle-seconds in which a wheel stands while its train runs faster than `LOCK_SPEED`."""
    standing = np.abs(series(run, "rim_speed")) < STANDING_SPEED
    running = np.abs(series(run, "speed")) > LOCK_SPEED
    return float((standing & running[:, None]).sum() * record_period(run))


@metric(
    "air_consumption",
    "l",
    "air let into the brake cylinders, at atmospheric pressure",
    -1,
    NEVER_NEGATIVE,
)
def air_consumption(run: xr.Dataset) -> float:
    """Volume of the brake cylinders times all rises of their pressure over that of the atmosphere [normal litres].

    Isothermal; the first application of the brakes counts too. nan for a train without air brakes.
    """
    pressure = series(run, "cylinder_pressure")
    if pressure.shape[1] == 0:
        return float("nan")
    rises = np.maximum(np.diff(pressure, axis=0), 0.0).sum(axis=0)
    return float(1e3 * (series(run, "group_volume") * rises).sum() / ATMOSPHERE)
