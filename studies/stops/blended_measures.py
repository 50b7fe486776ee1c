"""What a blended stop is judged by beside the metrics: the error of the reference speed, the weakest unit, locked wheels."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.registry import (
    force_along,
    force_available,
    record_period,
    series,
    under_demand,
)
from alloc.metrics.search import LEAST_EPISODE, shortage
from alloc.metrics.use import LOCK_SPEED, STANDING_SPEED

LEAST_SPEED = 2.0
"""Speed [m/s] below which the error counts no more: slide protection has long ceased to act."""
WITHIN = 2.0
"""Number of stated deviations within which an error is expected, 95 % of them if they are normal."""

Floats = NDArray[np.float64]


def measure(run: xr.Dataset) -> dict[str, float]:
    """Numbers of a recorded stop.

    - reference_error, reference_rms, reference_bias [m/s]: largest magnitude, root mean square and mean of the reference
      speed's error; positive where it is above the speed. reference_worst_time [s]: instant of the largest.
    - reference_ratio: root mean square of error over stated deviation; 1 where that is right. reference_within: share of
      instants at which the error is at most `WITHIN` deviations. Both are nan where the computers have the true speed.
    - least_unit_use: adhesion used where short by the unit that uses least; nan where none is short for a second.
      least_unit: its number, 1 = foremost.
    - air_of_units: air brake force commanded to the units, over their part of the plan; what motors could have done counts.
    - locked_driven [s]: time that driven wheels stood above 5 km/h, summed over axles.
    """
    error, deviation = reference_error(run)
    counted = series(run, "speed") > LEAST_SPEED
    time, error, deviation = series(run, "time")[counted], error[counted], deviation[counted]
    known = bool(counted.any())
    worst = int(np.abs(error).argmax()) if known else 0
    stated = known and run_estimates(deviation)
    uses = unit_use(run)
    short = bool(np.isfinite(uses).any())
    return {
        "reference_error": float(np.abs(error[worst])) if known else np.nan,
        "reference_rms": float(np.sqrt((error**2).mean())) if known else np.nan,
        "reference_bias": float(error.mean()) if known else np.nan,
        "reference_worst_time": float(time[worst]) if known else np.nan,
        "reference_ratio": float(np.sqrt(((error / deviation) ** 2).mean())) if stated else np.nan,
        "reference_within": float((np.abs(error) <= WITHIN * deviation).mean())
        if stated
        else np.nan,
        "least_unit_use": float(np.nanmin(uses)) if short else np.nan,
        "least_unit": float(1 + np.nanargmin(uses)) if short else np.nan,
        "air_of_units": air_of_units(run),
        "locked_driven": locked_driven(run),
    }


def run_estimates(deviation: Floats) -> bool:
    """Whether the computers estimate the speed; the true one has no deviation."""
    return bool((deviation > 0.0).all())


def reference_error(run: xr.Dataset) -> tuple[Floats, Floats]:
    """Reference speed less the speed of the foremost unit's car, and the stated deviation, (time,) each [m/s]."""
    unit, car = series(run, "axle_unit"), series(run, "axle_car")
    foremost = int(car[np.flatnonzero(unit == 0)[0]])
    cars = series(run, "car_speed") if "car_speed" in run.variables else None
    true = series(run, "speed") if cars is None else cars[:, min(foremost, cars.shape[1] - 1)]
    return series(run, "reference_speed") - true, series(run, "reference_deviation")


def unit_use(run: xr.Dataset) -> Floats:
    """Adhesion that each unit used where it was short, (unit,); nan where it was short for less than a second."""
    unit, short = series(run, "axle_unit"), shortage(run)
    force, available = force_along(run), force_available(run)
    found = np.full(run.sizes["unit"], np.nan)
    for j in range(found.size):
        counted = short[:, j]
        if counted.sum() * record_period(run) >= LEAST_EPISODE:
            own = unit == j
            found[j] = force[counted][:, own].sum() / available[counted][:, own].sum()
    return found


def air_of_units(run: xr.Dataset) -> float:
    """Air brake force commanded to the units over what the plan asks of them, summed over time; nan without demand."""
    asked = under_demand(run)
    unit, load = series(run, "axle_unit"), series(run, "unit_static_load")
    axles = np.bincount(unit[unit >= 0], minlength=run.sizes["unit"])
    plan = float(series(run, "expected")[asked].sum() * load.sum())
    return float((series(run, "air_brake_force")[asked] @ axles).sum() / plan) if plan else np.nan


def locked_driven(run: xr.Dataset) -> float:
    """Axle-seconds in which a driven wheel stands while its train runs faster than `LOCK_SPEED`."""
    driven = series(run, "axle_unit") >= 0
    standing = np.abs(series(run, "rim_speed"))[:, driven] < STANDING_SPEED
    running = np.abs(series(run, "speed")) > LOCK_SPEED
    return float((standing & running[:, None]).sum() * record_period(run))
