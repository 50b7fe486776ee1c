"""How good was a run? Pure functions of a recorded run (`alloc.recording`).

"Under demand" means while the driver asks for traction or braking. All results are floats; nan where a metric does not
apply to the run (no coupler, target speed not reached).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

SLIP_FACTOR = 2.0
"""An axle counts as slipping where its slip velocity exceeds this multiple of the curve's peak slip velocity."""

JERK_CUT_OFF = 5.0
"""Cut-off frequency [Hz] of the low-pass on car acceleration before it is differentiated.

Longitudinal ride comfort is a matter of a few hertz."""


class Metric(NamedTuple):
    """A figure of merit."""

    name: str
    unit: str
    description: str
    function: Callable[[xr.Dataset], float]
    better: int = 0
    """-1: less is better, +1: more is better, 0: neither."""


METRICS: dict[str, Metric] = {}


def _metric(
    name: str, unit: str, description: str, better: int = 0
) -> Callable[[Callable[[xr.Dataset], float]], Callable[[xr.Dataset], float]]:
    def register(function: Callable[[xr.Dataset], float]) -> Callable[[xr.Dataset], float]:
        METRICS[name] = Metric(name, unit, description, function, better)
        return function

    return register


def evaluate(run: xr.Dataset) -> dict[str, float]:
    """All metrics of a run, by name."""
    return {name: float(metric.function(run)) for name, metric in METRICS.items()}


def _demand(run: xr.Dataset) -> NDArray[np.bool_]:
    return np.asarray(run["driver_command"].values != 0.0)


def _sign(run: xr.Dataset) -> NDArray[np.float64]:
    return np.sign(run["driver_command"].values)


def _driven(run: xr.Dataset) -> NDArray[np.bool_]:
    return np.asarray(run["axle_unit"].values >= 0)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean()) if values.size else float("nan")


@_metric("acceleration", "m/s2", "mean acceleration under demand, in its direction", +1)
def acceleration(run: xr.Dataset) -> float:
    """Mean acceleration of the train under demand [m/s2]."""
    return _mean((_sign(run) * run["acceleration"].values)[_demand(run)])


@_metric("acceleration_ratio", "1", "acceleration reached, relative to the plan", +1)
def acceleration_ratio(run: xr.Dataset) -> float:
    """Mean acceleration under demand over the mean acceleration asked for.

    Running resistance and gradients count as loss here; `effort_ratio` leaves them out.
    """
    demand = _demand(run)
    asked = np.abs(run["driver_command"].values[demand]).sum()
    reached = (_sign(run) * run["acceleration"].values)[demand].sum()
    return float(reached / asked) if asked else float("nan")


@_metric("effort_ratio", "1", "tractive effort delivered, relative to the plan", +1)
def effort_ratio(run: xr.Dataset) -> float:
    """Mean rail force of the driven axles over the force that the plan asks for.

    The plan's force accelerates the train and its rotating parts; the rail carries what is left for the train and the
    unpowered wheelsets, so a run without slip on which nothing limits the motors has a ratio close to 1.
    """
    demand = _demand(run)
    force = (_sign(run) * run["rail_force"].values[:, _driven(run)].sum(axis=1))[demand]
    planned = np.abs(run["driver_command"].values)[demand] * run.attrs["train_mass"]
    return float(force.sum() / planned.sum()) if planned.sum() else float("nan")


@_metric(
    "utilisation", "1", "adhesion used: rail force over the force available at the driven axles", +1
)
def utilisation(run: xr.Dataset) -> float:
    """Sum of the driven axles' rail force over the sum of their available force, under demand."""
    demand, driven = _demand(run), _driven(run)
    used = (_sign(run)[:, None] * run["rail_force"].values)[demand][:, driven].sum()
    available = (run["adhesion_limit"].values * run["axle_load"].values)[demand][:, driven].sum()
    return float(used / available) if available else float("nan")


@_metric("utilisation_slipping", "1", "adhesion used while any driven axle slips", +1)
def utilisation_slipping(run: xr.Dataset) -> float:
    """Utilisation over the instants and units in which an axle of the unit slips or its detector has signalled."""
    sign, driven = _sign(run), _driven(run)
    unit = run["axle_unit"].values
    active = run["slipping"].values.astype(bool)[:, unit] & driven & _demand(run)[:, None]
    used = (sign[:, None] * run["rail_force"].values)[active].sum()
    available = (run["adhesion_limit"].values * run["axle_load"].values)[active].sum()
    return float(used / available) if available else float("nan")


@_metric("slip_time", "s", "time spent slipping, summed over axles", -1)
def slip_time(run: xr.Dataset) -> float:
    """Axle-seconds beyond `SLIP_FACTOR` times the slip velocity of the curve's peak."""
    slip = np.abs(run["slip_velocity"].values)
    slipping = slip > SLIP_FACTOR * run["peak_slip"].values
    return float(slipping.sum() * _period(run))


@_metric("slip_peak", "m/s", "largest slip velocity of any axle", -1)
def slip_peak(run: xr.Dataset) -> float:
    """Largest magnitude of the slip velocity [m/s]."""
    return float(np.abs(run["slip_velocity"].values).max())


@_metric("damage", "kJ", "wheel damage Q: work dissipated between wheels and rail", -1)
def damage(run: xr.Dataset) -> float:
    """Wheel damage Q of JP4209318 (28), for driving too [kJ]; integrated with the plant's own step."""
    work = run["friction_work"].values
    return float((work[-1] - work[0]).sum() / 1e3)


@_metric("distance", "m", "distance run until the end, or until the target speed", 0)
def distance(run: xr.Dataset) -> float:
    """Distance [m] until the target speed is reached; until the end of the run where there is none."""
    end = _target_index(run)
    if end < 0:
        return float("nan")
    position = run["position"].values
    return float(position[end] - position[0])


@_metric("time_to_speed", "s", "time from the first demand to the target speed", -1)
def time_to_speed(run: xr.Dataset) -> float:
    """Time [s] from the first demand to the target speed; nan if it is not reached or none is set."""
    if not np.isfinite(run.attrs["target_speed"]):
        return float("nan")
    end = _target_index(run)
    if end < 0:
        return float("nan")
    time = run["time"].values
    return float(time[end] - time[int(np.argmax(_demand(run)))])


def _target_index(run: xr.Dataset) -> int:
    target = run.attrs["target_speed"]
    speed = run["speed"].values
    if not np.isfinite(target):
        return int(speed.size - 1)
    reached = (speed - target) * np.sign(target - speed[0]) >= 0.0
    return int(np.argmax(reached)) if reached.any() else -1


def jerk(run: xr.Dataset) -> NDArray[np.float64]:
    """Jerk of each car [m/s3], (time, car), from its acceleration below `JERK_CUT_OFF`."""
    period = _period(run)
    values = run["car_acceleration"].values
    nyquist = 0.5 / period
    if nyquist > JERK_CUT_OFF and values.shape[0] > 30:
        sections = butter(2, JERK_CUT_OFF / nyquist, output="sos")
        # mirrored at its ends: an odd extension would turn what vibrates there into a step
        values = sosfiltfilt(sections, values, axis=0, padtype="even")
    return np.asarray(np.gradient(values, period, axis=0))


@_metric("jerk_rms", "m/s3", "jerk of the worst car, root mean square under demand", -1)
def jerk_rms(run: xr.Dataset) -> float:
    """Root mean square jerk of the car that has it worst [m/s3]."""
    values = jerk(run)[_demand(run)]
    return float(np.sqrt((values**2).mean(axis=0)).max()) if values.size else float("nan")


@_metric("jerk_peak", "m/s3", "largest jerk of any car under demand", -1)
def jerk_peak(run: xr.Dataset) -> float:
    """Largest magnitude of the jerk of any car [m/s3]."""
    values = jerk(run)[_demand(run)]
    return float(np.abs(values).max()) if values.size else float("nan")


@_metric("coupler_peak", "kN", "largest coupler force", -1)
def coupler_peak(run: xr.Dataset) -> float:
    """Largest magnitude of any coupler force [kN]; nan for a rigid train."""
    force = run["coupler_force"].values
    return float(np.abs(force).max() / 1e3) if force.size else float("nan")


@_metric("energy", "MJ", "work of the motors at the wheels", 0)
def energy(run: xr.Dataset) -> float:
    """Work of the motors [MJ]."""
    work = run["motor_work"].values
    return float((work[-1] - work[0]) / 1e6)


@_metric(
    "estimate_error",
    "1",
    "error of B1's held estimate against the true adhesion at its detections",
    0,
)
def estimate_error(run: xr.Dataset) -> float:
    """Mean over the foremost unit's detections of estimate minus true adhesion coefficient (mean of its axles)."""
    signal = run["slipping"].values[:, 0].astype(bool)
    onset = np.flatnonzero(signal[1:] & ~signal[:-1]) + 1
    if onset.size == 0:
        return float("nan")
    axles = run["axle_unit"].values == 0
    truth = run["adhesion_limit"].values[:, axles].mean(axis=1)
    return float((run["coefficient_estimate"].values[onset, 0] - truth[onset]).mean())


def _period(run: xr.Dataset) -> float:
    time = run["time"].values
    return float((time[-1] - time[0]) / (time.size - 1)) if time.size > 1 else float("nan")


def _attribute(
    name: str, unit: str, description: str, key: str, better: int = 0, scale: float = 1.0
) -> None:
    METRICS[name] = Metric(
        name, unit, description, lambda run: scale * float(run.attrs[key]), better
    )


_attribute("detections", "1", "slips detected by the foremost unit", "detections", -1)
_attribute("unit_detections", "1", "slips detected by all units", "unit_detections", -1)
_attribute("telegrams", "1", "telegrams sent", "telegrams_sent")
_attribute("telegrams_lost", "1", "telegrams lost", "telegrams_lost")
_attribute("fallbacks", "1", "units fallen back to the plan in silence", "fallbacks")
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
    "controller_median", "ms", "median solver time per unit and step", "controller_median_s", 0, 1e3
)
_attribute("controller_p99", "ms", "99th percentile of it", "controller_p99_s", 0, 1e3)
