"""Metrics of detection, of the search for lost adhesion, and of readhesion as the readhesion paper counts it.

In: a recorded run. Out: one float each; nan where it does not apply.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from alloc.estimation.series import bridged_spans, spans
from alloc.metrics.registry import (
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


# Indices of the readhesion paper, section 3.2, from time series of one driven axle: did a wheel readhere?
#
# Time series are (instants,) or (instants, runs), a column per run; SI units. Torque cycles run from one start of torque
# rise to the next. Slip is micro below the slip velocity of the curve's maximum (stable) and macro from there on.


PROMINENCE = 0.01
"""A minimum of the torque starts a cycle if the torque falls and rises by this share of the plan around it."""
SAME_CYCLE = 0.05
"""Cycles count as the same if their swings differ by no more than this share."""


@dataclass(frozen=True)
class Signals:
    """Signals from which the indices are computed, recorded at equal intervals; (instants, runs) each except `time`."""

    time: Floats
    """(instants,)"""
    torque: Floats
    """Motor torque."""
    slip: Floats
    peak_slip: Floats
    """Slip velocity of the adhesion curve's maximum."""
    coefficient: Floats
    """Tangential force coefficient."""
    plan: float
    """Torque of the plan."""


def of_run(run: xr.Dataset) -> Signals:
    """Signals of a recorded run of one unit with one axle, one run; raises `ValueError` for any other train."""
    if run.sizes["unit"] != 1 or run.sizes["axle"] != 1:
        raise ValueError(
            f"readhesion indices: the run has {run.sizes['unit']} units and {run.sizes['axle']} axles; "
            "only a run of one unit with one axle has one torque and one slip velocity"
        )
    return Signals(
        time=run["time"].values,
        torque=run["motor_torque"].values,
        slip=run["slip_velocity"].values,
        peak_slip=run["peak_slip"].values,
        coefficient=run["coefficient"].values,
        plan=float(run["torque_target"].values.max()),
    )


def rise_starts(torque: Floats, plan: float) -> NDArray[np.int64]:
    """Instants (indices) at which the torque (instants,) starts to rise: minima of at least `PROMINENCE` of the plan.

    Where the torque stays at its minimum, this is the last instant at the minimum.
    """
    from scipy.signal import find_peaks  # slow to import

    _, found = find_peaks(-torque, prominence=PROMINENCE * plan, plateau_size=1)
    return np.asarray(found["right_edges"], dtype=np.int64)


def readhesion_possible(signals: Signals, drop: float = 6.0, instant: float = 14.0) -> Flags:
    """Readhesion possibility of each run, (runs,): section 3.2.

    The torque cycle that contains `instant` [s] must visit both micro and macro slip. In the paper's scenario the rail
    recovers at that instant. After that every controller returns to micro slip, and all of them would meet the criterion. So
    the signals must come from a rail that stays low until the cycle is complete. A cycle that is incomplete at the end of
    the signals counts as failed. If no slip is macro from `drop` [s] to the end, readhesion counts as possible.
    """
    after = signals.time >= drop
    middle = int(np.searchsorted(signals.time, instant))
    macro = signals.slip >= signals.peak_slip
    possible = np.zeros(macro.shape[1], dtype=bool)
    for run in range(macro.shape[1]):
        starts = rise_starts(signals.torque[:, run], signals.plan)
        k = int(np.searchsorted(starts, middle, side="right"))
        if not macro[after, run].any():
            possible[run] = True
        elif 0 < k < starts.size:
            cycle = macro[starts[k - 1] : starts[k], run]
            possible[run] = cycle.any() and not cycle.all()
    return possible


def used_coefficient(
    time: Floats, coefficient: Floats, begin: float = 6.0, end: float = 14.0
) -> Floats:
    """Used coefficient mu_use, (runs,) or a scalar array: mean of the tangential force coefficient over time, (10)."""
    inside = (time >= begin) & (time <= end)
    if inside.sum() < 2:
        raise ValueError(f"used coefficient: the signals have no two instants in {begin}..{end} s")
    total = np.trapezoid(coefficient[inside], time[inside], axis=0)
    return np.asarray(total / (time[inside][-1] - time[inside][0]))


def utilisation(used: ArrayLike, limit: ArrayLike) -> Floats:
    """Utilisation mu_r: used coefficient over the lowered adhesion coefficient mu_lim, (11)."""
    return np.asarray(np.asarray(used, dtype=float) / np.asarray(limit, dtype=float))


@dataclass(frozen=True)
class LimitCycle:
    """The cycle in which a run ends, as the mean of its last complete torque cycles; nan where there are too few."""

    period: float
    """[s]"""
    slip_swing: float
    """Largest minus smallest slip velocity [m/s]."""
    torque_swing: float
    """Largest minus smallest torque [N m]."""
    slips_before: int
    """Slips before the first cycle from which on all cycles swing like the last ones, in slip and torque (`SAME_CYCLE`)."""

    @property
    def exists(self) -> bool:
        """Whether the run had enough cycles."""
        return bool(np.isfinite(self.period))


def limit_cycle(
    signals: Signals,
    run: int,
    cycles: int = 3,
    drop: float = 6.0,
    until: float = np.inf,
) -> LimitCycle:
    """The last `cycles` complete torque cycles of a run between `drop` and `until` [s]."""
    starts = rise_starts(signals.torque[:, run], signals.plan)
    instants = signals.time[starts]
    starts = starts[(instants >= drop) & (instants <= until)]
    if starts.size < cycles + 1:
        return LimitCycle(np.nan, np.nan, np.nan, -1)
    pairs = list(pairwise(starts))
    slip = np.array([np.ptp(signals.slip[a:b, run]) for a, b in pairs])
    torque = np.array([np.ptp(signals.torque[a:b, run]) for a, b in pairs])
    last_slip, last_torque = slip[-cycles:].mean(), torque[-cycles:].mean()
    same = (np.abs(slip / last_slip - 1.0) <= SAME_CYCLE) & (
        np.abs(torque / last_torque - 1.0) <= SAME_CYCLE
    )
    # one slip per cycle, and one before the first cycle, which starts where that slip has been answered
    before = int(np.flatnonzero(~same)[-1]) + 2 if not same.all() else 1
    time = signals.time[starts]
    return LimitCycle(
        float((time[-1] - time[-1 - cycles]) / cycles), float(last_slip), float(last_torque), before
    )


def settled_at(time: Floats, values: Floats, tolerance: float) -> float:
    """Instant [s] from which on `values` (instants,) stay within `tolerance` of the last one."""
    away = np.flatnonzero(np.abs(values - values[-1]) > tolerance)
    return float(time[0] if away.size == 0 else time[away[-1] + 1])


@dataclass(frozen=True)
class LimitSearch:
    """Limit adhesion coefficient of each search, (searches,) each."""

    limit: Floats
    """Smallest mu_lim with readhesion, to the tolerance; nan where there is none at or below `high`."""
    fails_at: Floats
    """Largest mu_lim tried below it without readhesion; nan where readhesion was possible down to `low`."""
    monotone: Flags
    """Whether readhesion was possible at every mu_lim tried above the limit, as the paper assumes."""


def limit_coefficient(
    possible: Callable[[NDArray[np.int64], Floats], Flags],
    searches: int,
    low: ArrayLike,
    high: ArrayLike,
    tolerance: float,
    points: int = 1,
) -> LimitSearch:
    """Limit adhesion coefficient by bisection in [low, high], for many controllers at once; one bracket or one for each.

    `possible(search, limit)` returns whether readhesion is possible in trials (n,), each the number of a search and a
    coefficient mu_lim. The first call tries both ends and the `points` between them. Each later call tries `points`
    coefficients between the two that enclose the limit. With more points, the search is more likely to notice that
    readhesion is possible at one coefficient and not at a larger one.
    """
    low, high = (np.broadcast_to(np.asarray(end, dtype=float), searches) for end in (low, high))
    if not (np.all(low < high) and tolerance > 0.0 and points >= 1):
        raise ValueError(
            f"limit coefficient: needs low < high, a tolerance and a point, got {low}, {high}, {tolerance}, {points}"
        )

    def asked(which: NDArray[np.int64], trial: Floats) -> Flags:
        return possible(np.repeat(which, trial.shape[1]), trial.ravel()).reshape(trial.shape)

    every = np.arange(searches)
    share = np.arange(points + 2) / (points + 1)
    trial = low[:, None] + share * (high - low)[:, None]
    upper, lower, monotone = _enclosed(trial, asked(every, trial))
    while True:
        # nan, that is possible everywhere or nowhere, is never wider than the tolerance
        active = every[upper - lower > tolerance * (1.0 + 1e-9)]
        if active.size == 0:
            return LimitSearch(upper, lower, monotone)
        trial = lower[active, None] + share * (upper - lower)[active, None]
        found = np.ones(trial.shape, dtype=bool)
        found[:, 0] = False
        found[:, 1:-1] = asked(active, trial[:, 1:-1])
        upper[active], lower[active], whole = _enclosed(trial, found)
        monotone[active] &= whole


def _enclosed(trial: Floats, found: Flags) -> tuple[Floats, Floats, Flags]:
    """Least coefficient with readhesion, the one tried below it, and whether every one above it has it too."""
    first = found.argmax(axis=1)
    rows = np.arange(len(found))
    some = found.any(axis=1)
    upper = np.where(some, trial[rows, first], np.nan)
    lower = np.where(some & (first > 0), trial[rows, np.maximum(first - 1, 0)], np.nan)
    beyond = np.arange(found.shape[1]) >= first[:, None]
    return upper, lower, (found | ~beyond).all(axis=1) | ~some
