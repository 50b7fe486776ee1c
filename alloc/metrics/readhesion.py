"""Indices of the readhesion paper, section 3.2, from time series of one driven axle: did a wheel readhere?

Time series are (instants,) or (instants, lanes), a lane per run; SI units. Torque cycles run from one start of torque rise
to the next. Slip is micro below the slip velocity of the curve's maximum (stable) and macro from there on.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

PROMINENCE = 0.01
"""A minimum of the torque starts a cycle if the torque falls and rises by this share of the plan around it."""
SAME_CYCLE = 0.05
"""Cycles count as the same if their swings differ by no more than this share."""


@dataclass(frozen=True)
class Signals:
    """Signals from which the indices are computed, recorded at equal intervals; (instants, lanes) each except `time`."""

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
    """Signals of a recorded run of one unit with one axle, one lane; raises `ValueError` for any other train."""
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
    """Readhesion possibility of each lane, (lanes,): section 3.2.

    The torque cycle that contains `instant` [s] must visit both micro and macro slip. In the paper's scenario the rail
    recovers at that instant. After that every controller returns to micro slip, and all of them would meet the criterion. So
    the signals must come from a rail that stays low until the cycle is complete. A cycle that is incomplete at the end of
    the signals counts as failed. If no slip is macro from `drop` [s] to the end, readhesion counts as possible.
    """
    after = signals.time >= drop
    middle = int(np.searchsorted(signals.time, instant))
    macro = signals.slip >= signals.peak_slip
    possible = np.zeros(macro.shape[1], dtype=bool)
    for lane in range(macro.shape[1]):
        starts = rise_starts(signals.torque[:, lane], signals.plan)
        k = int(np.searchsorted(starts, middle, side="right"))
        if not macro[after, lane].any():
            possible[lane] = True
        elif 0 < k < starts.size:
            cycle = macro[starts[k - 1] : starts[k], lane]
            possible[lane] = cycle.any() and not cycle.all()
    return possible


def used_coefficient(
    time: Floats, coefficient: Floats, begin: float = 6.0, end: float = 14.0
) -> Floats:
    """Used coefficient mu_use, (lanes,) or a scalar array: mean of the tangential force coefficient over time, (10)."""
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
    lane: int,
    cycles: int = 3,
    drop: float = 6.0,
    until: float = np.inf,
) -> LimitCycle:
    """The last `cycles` complete torque cycles of a lane between `drop` and `until` [s]."""
    starts = rise_starts(signals.torque[:, lane], signals.plan)
    instants = signals.time[starts]
    starts = starts[(instants >= drop) & (instants <= until)]
    if starts.size < cycles + 1:
        return LimitCycle(np.nan, np.nan, np.nan, -1)
    pairs = list(pairwise(starts))
    slip = np.array([np.ptp(signals.slip[a:b, lane]) for a, b in pairs])
    torque = np.array([np.ptp(signals.torque[a:b, lane]) for a, b in pairs])
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
