"""How well slip was detected and adhesion was estimated, compared with the plant's truth."""

import math
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.registry import (
    NEVER_NEGATIVE,
    SLIP_FACTOR,
    instants_in,
    mean_or_nan,
    metric,
    once_per_run,
    record_period,
    series,
    under_demand,
)
from alloc.spans import spans

BEFORE, AFTER = 0.1, 0.3
"""A detection belongs to a slip from this time [s] before the slip until this time [s] after its end."""


class Slip(NamedTuple):
    """A slip of one unit: from the instant that an axle passes the curve's peak until all axles are back below it."""

    unit: int
    start: int
    stop: int
    """Index of the first instant after the slip."""


@metric(
    "estimate_error",
    "1",
    "error of the foremost unit's held estimate against the true adhesion at its detections",
    0,
)
def estimate_error(run: xr.Dataset) -> float:
    """Mean over the foremost unit's detections of estimate minus true adhesion coefficient (mean of its axles)."""
    if run.sizes["unit"] == 0:
        return float("nan")
    onset = _rising(series(run, "slipping")[:, 0].astype(bool))
    if onset.size == 0:
        return float("nan")
    axles = series(run, "axle_unit") == 0
    truth = series(run, "adhesion_limit")[:, axles].mean(axis=1)
    return float((series(run, "coefficient_estimate")[onset, 0] - truth[onset]).mean())


@once_per_run
def slips(run: xr.Dataset) -> list[Slip]:
    """The slips of all units: those in which an axle exceeds `SLIP_FACTOR` times the slip velocity of the peak."""
    found = []
    relative = np.abs(series(run, "slip_velocity")) / series(run, "peak_slip")
    relative = np.where(under_demand(run)[:, None], relative, 0.0)
    unit_of_axle = series(run, "axle_unit")
    for unit in range(run.sizes["unit"]):
        worst = relative[:, unit_of_axle == unit].max(axis=1)
        for start, stop in spans(worst > 1.0).tolist():
            if worst[start:stop].max() > SLIP_FACTOR:
                found.append(Slip(unit, start, stop))
    return found


@once_per_run
def _onsets(run: xr.Dataset) -> list[NDArray[np.int64]]:
    """First instants of each unit's signals of slip under demand."""
    slipping, demand = series(run, "slipping").astype(bool), under_demand(run)
    return [_rising(signal & demand) for signal in slipping.T]


def _rising(signal: NDArray[np.bool_]) -> NDArray[np.int64]:
    return np.asarray(np.flatnonzero(signal[1:] & ~signal[:-1]) + 1)


@once_per_run
def _delays(run: xr.Dataset) -> list[float]:
    """Time from each slip's start to its detection [s]; nan where it was missed."""
    period = record_period(run)
    before, after = instants_in(run, BEFORE), instants_in(run, AFTER)
    delays = []
    for slip in slips(run):
        onsets = _onsets(run)[slip.unit]
        own = onsets[(onsets >= slip.start - before) & (onsets < slip.stop + after)]
        delays.append(float((own[0] - slip.start) * period) if own.size else float("nan"))
    return delays


@metric(
    "detection_delay",
    "s",
    "mean time from an axle passing the curve's peak to the detection",
    -1,
    (-2.0 * BEFORE, math.inf),
)
def detection_delay(run: xr.Dataset) -> float:
    """Mean over the slips that were detected [s]; nan where there were none.

    A detector that sees the slip grow may be early: by `BEFORE`, rounded to whole periods of the record.
    """
    delays = np.array(_delays(run))
    return mean_or_nan(delays[np.isfinite(delays)])


@metric("missed_slips", "1", "slips that were not detected", -1, NEVER_NEGATIVE)
def missed_slips(run: xr.Dataset) -> float:
    """Number of slips without a detection."""
    return float(np.isnan(_delays(run)).sum())


@metric(
    "false_alarms",
    "1",
    "detections while no axle of the unit was past the curve's peak",
    -1,
    NEVER_NEGATIVE,
)
def false_alarms(run: xr.Dataset) -> float:
    """Number of detections that belong to no axle past the peak."""
    before, after = instants_in(run, BEFORE), instants_in(run, AFTER)
    past = np.abs(series(run, "slip_velocity")) > series(run, "peak_slip")
    unit_of_axle = series(run, "axle_unit")
    alarms = 0
    for unit in range(run.sizes["unit"]):
        slipping = past[:, unit_of_axle == unit].any(axis=1)
        for onset in _onsets(run)[unit]:
            alarms += not slipping[max(onset - after, 0) : onset + before + 1].any()
    return float(alarms)
