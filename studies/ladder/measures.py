"""What the ladder reads from a run beside the metrics: whether slip moves towards the peak, on rail that changes or not."""

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.search import shortage, unit_shares

INTERVAL = 0.3
"""Time [s] over which slip is averaged: that of a searching controller's step."""
OFF_PEAK = 0.3
"""Distance from the peak, as a share of its slip, above which a step has a right direction."""
NOTICEABLE = 2e-3
"""Change of the mean slip [m/s] below which nothing has moved."""
CHANGED = 0.01
"""Change of the adhesion from interval to interval, as a share of it, above which the rail counts as changing."""

Floats = NDArray[np.float64]


def measure(run: xr.Dataset) -> dict[str, float]:
    """Shares of the steps of slip that lead away from the peak, of units that are short of adhesion.

    A step is the change of the unit's largest slip between the means of two intervals. It has a right direction where the
    first mean lies off the peak by `OFF_PEAK` or more.

    - wrong_steps_still, wrong_steps_changing: share of wrong steps where the adhesion stayed within `CHANGED`, and where
      it did not; nan where there are no steps.
    - steps_still, steps_changing: number of such steps.
    """
    time = run["time"].values
    ticks = max(1, round(INTERVAL / float(time[1] - time[0])))
    slip, peak = _largest_slip(run)
    short = _means(shortage(run).astype(float), ticks) == 1.0
    slip, peak = _means(slip, ticks), _means(peak, ticks)
    available = _means(unit_shares(run)[2], ticks)
    step = np.diff(slip, axis=0)
    ahead = peak[:-1] - slip[:-1]
    counted = short[1:] & short[:-1] & (np.abs(step) > NOTICEABLE)
    counted &= np.abs(ahead) > OFF_PEAK * peak[:-1]
    changing = np.abs(np.diff(available, axis=0)) > CHANGED * available[:-1]
    wrong = step * ahead < 0.0
    result = {}
    for name, chosen in (("still", counted & ~changing), ("changing", counted & changing)):
        result[f"steps_{name}"] = float(chosen.sum())
        result[f"wrong_steps_{name}"] = float(wrong[chosen].mean()) if chosen.any() else np.nan
    return result


def _largest_slip(run: xr.Dataset) -> tuple[Floats, Floats]:
    """Slip of each unit's worst axle in the direction of the demand, and the slip of that axle's peak, (time, unit)."""
    sign = np.sign(run["driver_command"].values)[:, None]
    slip, peak = sign * run["slip_velocity"].values, run["peak_slip"].values
    unit_of_axle = run["axle_unit"].values
    rows = np.arange(slip.shape[0])
    largest, tops = [], []
    for unit in range(run.sizes["unit"]):
        own = unit_of_axle == unit
        worst = slip[:, own].argmax(axis=1)
        largest.append(slip[:, own][rows, worst])
        tops.append(peak[:, own][rows, worst])
    return np.stack(largest, axis=1), np.stack(tops, axis=1)


def _means(values: Floats, ticks: int) -> Floats:
    """Means over intervals of `ticks` rows; what does not fill one is left out."""
    count = values.shape[0] // ticks
    means: Floats = values[: count * ticks].reshape(count, ticks, -1).mean(axis=1)
    return means
