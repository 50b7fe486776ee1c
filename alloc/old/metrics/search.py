"""Metrics of detection and of the search for lost adhesion.

In: a recorded run. Out: one float each; nan where it does not apply.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.old.estimation.series import bridged_spans, spans
from alloc.old.metrics.registry import (
    EITHER_WAY,
    NEVER_NEGATIVE,
    SHARE,
    SLIP_FACTOR,
    adhesion_used,
    direction,
    force_along,
    instants_in,
    mean_or_nan,
    metric,
    once_per_run,
    record_period,
    series,
    under_demand,
)

# How well slip was detected and adhesion was estimated, compared with the plant's truth.


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
    relative = np.abs(series(run, "slip_velocity"))
    relative /= series(run, "peak_slip")
    relative[~under_demand(run)] = 0.0
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


# How long a readhesion controller searches for adhesion that was lost, and how much its torque varies meanwhile.
#
# A unit is *short* while its target asks for more than its rail offers: only then is there something to search for. The
# weakest axle determines what the rail offers a unit. One inverter gives all its axles the same torque, and at a larger
# torque the weakest axle runs away.


FOUND = 0.9
"""Share of the available adhesion from which on it counts as used, and its peak as found."""
STAY = 0.5
"""Time [s] for which the used share must stay there."""
TURNING = 0.05
"""Part of a target that accelerates the unit's own wheelsets; a smaller excess over the rail's force is no shortage."""
LEAST_EPISODE = 1.0
"""A shortage shorter than this [s] leaves no time to search."""
DROP = 0.1
"""Fall of the adhesion within `STAY`, as a share of it, that starts a new search."""
MEAN_TIME = 1.0
"""Time [s] over which torque is averaged: slower changes are the course of the event."""

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Episode(NamedTuple):
    """A stretch of a unit's shortage in which adhesion does not drop again; `stop` is the first instant after it."""

    unit: int
    start: int
    stop: int


class Search(NamedTuple):
    """How long a unit needed to find adhesion again in one episode."""

    time: float
    """Time from the loss until the used share stays above `FOUND` [s]; 0 if never lost, the rest of the episode if not
    found."""
    finished: bool


@once_per_run
def unit_shares(run: xr.Dataset) -> tuple[Floats, Floats, Floats]:
    """Coefficients of the units, (time, unit) each: asked for by the target, used, and available by the weakest axle."""
    unit_of_axle = series(run, "axle_unit")
    sign = direction(run)
    load, limit = series(run, "axle_load"), series(run, "adhesion_limit")
    force = force_along(run)
    units = run.sizes["unit"]
    used, available = np.empty((sign.size, units)), np.empty((sign.size, units))
    for unit in range(units):
        own = unit_of_axle == unit
        used[:, unit] = force[:, own].sum(axis=1) / load[:, own].sum(axis=1)
        available[:, unit] = limit[:, own].min(axis=1)
    axles = np.bincount(unit_of_axle[unit_of_axle >= 0], minlength=units)
    at_rim = np.abs(series(run, "torque_target")) * (
        series(run, "unit_gear") / series(run, "unit_radius")
    )
    asked = (at_rim + series(run, "air_brake_force")) * axles / series(run, "unit_static_load")
    return asked, used, available


@once_per_run
def shortage(run: xr.Dataset) -> Flags:
    """Whether a unit's target asks for more than its rail offers, (time, unit); false without demand."""
    asked, _, available = unit_shares(run)
    return (asked > (1.0 + TURNING) * available) & under_demand(run)[:, None]


def episodes(run: xr.Dataset) -> Iterator[Episode]:
    """The shortages of all units, cut where adhesion drops; gaps shorter than `STAY` are bridged, short ones left out."""
    stay, least = max(1, instants_in(run, STAY)), instants_in(run, LEAST_EPISODE)
    short, available = shortage(run), unit_shares(run)[2]
    for unit in range(run.sizes["unit"]):
        fallen = np.zeros(short.shape[0], dtype=bool)
        fallen[stay:] = available[stay:, unit] < (1.0 - DROP) * available[:-stay, unit]
        onsets = np.flatnonzero(np.diff(fallen.astype(np.int8)) == 1) + 1
        for start, stop in bridged_spans(short[:, unit], lambda stop, start: start - stop < stay):
            cuts = [start, *onsets[(onsets > start) & (onsets < stop)].tolist(), stop]
            for first, end in pairwise(cuts):
                if end - first >= least:
                    yield Episode(unit, first, end)


@once_per_run
def searches(run: xr.Dataset) -> list[Search]:
    """One search per episode."""
    period = record_period(run)
    stay = max(1, instants_in(run, STAY))
    _, used, available = unit_shares(run)
    found = []
    for unit, start, stop in episodes(run):
        lost = used[start:stop, unit] < FOUND * available[start:stop, unit]
        if not lost[:-stay].any():  # what is lost at the very end cannot be found in time
            found.append(Search(0.0, finished=True))
            continue
        first = int(np.argmax(lost))
        losses = np.concatenate([[0], np.cumsum(lost[first:])])
        held = np.flatnonzero(losses[stay:] == losses[:-stay])
        finished = held.size > 0
        ticks = int(held[0]) if finished else lost.size - first
        found.append(Search(ticks * period, finished))
    return found


@metric(
    "search_time",
    "s",
    "mean time from a loss of adhesion until 90 % of it is used again",
    -1,
    NEVER_NEGATIVE,
)
def search_time(run: xr.Dataset) -> float:
    """Mean over the episodes of shortage [s]; nan where there are none.

    A search starts when the used coefficient falls below `FOUND` of what the rail offers. It ends when the coefficient has
    returned for at least `STAY`. A search that is cut off, by adhesion's return, its next drop or the end of the run, counts
    until then, which is a lower bound.
    """
    times = [search.time for search in searches(run)]
    return float(np.mean(times)) if times else float("nan")


@metric(
    "unfinished_searches",
    "1",
    "share of the searches for adhesion that found none in time",
    -1,
    SHARE,
)
def unfinished_searches(run: xr.Dataset) -> float:
    """Share of the episodes of shortage in which adhesion was lost and not found again."""
    unfinished = [not search.finished for search in searches(run)]
    return float(np.mean(unfinished)) if unfinished else float("nan")


@metric(
    "utilisation_short",
    "1",
    "adhesion used by units whose target asks for more of it",
    +1,
    EITHER_WAY,
)
def utilisation_short(run: xr.Dataset) -> float:
    """Rail force over what all axles of the short units could carry, summed over time; nan without shortage."""
    unit = series(run, "axle_unit")
    if run.sizes["unit"] == 0:
        return float("nan")
    return adhesion_used(run, shortage(run)[:, unit] & (unit >= 0))


@metric(
    "torque_fluctuation",
    "1",
    "rms of torque commands about their 1 s mean, over the plan's",
    -1,
    NEVER_NEGATIVE,
)
def torque_fluctuation(run: xr.Dataset) -> float:
    """Root mean square, over units and time under demand, of a command less its centred moving mean over `MEAN_TIME`.

    Relative to the torque that the plan's coefficient asks of the unit; nan without demand.
    """
    from scipy.ndimage import uniform_filter1d  # slow to import, and needed by a run alone

    demand = under_demand(run)
    if not demand.any() or run.sizes["unit"] == 0:
        return float("nan")
    window = max(1, instants_in(run, MEAN_TIME))
    units = run.sizes["unit"]
    unit_of_axle = series(run, "axle_unit")
    axles = np.bincount(unit_of_axle[unit_of_axle >= 0], minlength=units)
    load, radius, gear = (
        series(run, name) for name in ("unit_static_load", "unit_radius", "unit_gear")
    )
    planned = series(run, "planned_coefficient")[demand].mean() * (load * radius / (gear * axles))
    command = series(run, "torque_command")[demand] / planned
    deviation = command - uniform_filter1d(command, window, axis=0, mode="nearest")
    return float(np.sqrt((deviation**2).mean()))
