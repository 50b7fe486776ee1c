"""Effort, adhesion used, slip, damage, ride and energy of a run."""

from functools import lru_cache

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.registry import (
    EITHER_WAY,
    NEVER_NEGATIVE,
    SLIP_FACTOR,
    acting_axles,
    adhesion_used,
    direction,
    mean_or_nan,
    metric,
    once_per_run,
    record_period,
    series,
    under_demand,
)

JERK_CUT_OFF = 5.0
"""Cut-off frequency [Hz] of the low-pass on car acceleration before it is differentiated. Longitudinal ride comfort depends
on frequencies of a few hertz."""

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
    nyquist = 0.5 / period
    if nyquist > JERK_CUT_OFF and values.shape[0] > 30:
        from scipy.signal import sosfiltfilt  # slow to import, and needed by a run alone

        # mirrored at its ends: an odd extension would turn what vibrates there into a step
        values = sosfiltfilt(_low_pass(JERK_CUT_OFF / nyquist), values, axis=0, padtype="even")
    return np.asarray(np.gradient(values, period, axis=0))


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


@metric("energy", "MJ", "work of the motors at the wheels", 0)
def energy(run: xr.Dataset) -> float:
    """Work of the motors [MJ]."""
    work = series(run, "motor_work")
    return float((work[-1] - work[0]) / 1e6)
