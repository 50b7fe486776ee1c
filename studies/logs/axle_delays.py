"""How much later some axles of a log are recorded than the others: of several recorders, each has a clock of its own.

Wheels that roll turn as the train runs, all of them at the same time. So the speed u_i of an axle that is recorded d later
than the axle r is

    u_i(t + d) = (1 + e) u_r(t)

wherever neither slips, with an error e of their radii. The delay is the one with which this is true at most instants: each
counts by how near it comes, and slips do not count. Creep of a braked wheel looks like a delay of some 0.06 s against a
wheel that is free. So driven axles and the others count as recorded together where one delay below `CREEP` brings them
together.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import mean_rate, usual_period
from studies.logs.known_train import MeasuredTrain
from studies.logs.speed_shape import middle_speed

Floats = NDArray[np.float64]

LONGEST, STEP = 0.64, 0.04
"""Longest delay that is tried, and the step [s] between two of them."""
FINER = (0.02, 0.01, 0.005, 0.0025)
"""Steps [s] around the best of them."""
NEAR = 0.05
"""Difference of speed [m/s] at which an instant counts little more than half, and in deviations of a wheel's speed ..."""
OF_NOISE = 3.0
"""... if that is more."""
SLOWEST = 0.3
"""Speed [m/s] from which on wheels are compared."""
FEW, MANY = 600, 3000
"""Instants at which delays are tried, and at which the best is refined."""
MOST = 60_000
"""Instants, or up to twice as many, of which both are chosen."""
RATE_TIME = 1.0
"""Time [s] over which the train's acceleration is taken: delays show where it is large."""
FITS = 0.25
"""Share of the instants at which an axle must agree with another for its delay to be known ..."""
BETTER = 0.06
"""... and by which more must agree than without a delay."""
APART = 0.04
"""Delay [s] from which on axles are late, and between two groups of them."""
BEST = 4
"""Axles with which all are compared, to find one that seldom slips."""
CREEP, TOGETHER = 0.12, 0.015
"""Longest delay [s] that creep is taken for, and difference up to which two delays are the same."""
SYSTEMATIC = 0.001
"""Standard deviation of a delay [s] that no number of axles lessens."""
TIMES = 4
"""Improvements of the radii's error for one delay."""


class LateAxles(NamedTuple):
    """Axles that are recorded later than the others."""

    axles: NDArray[np.int64]
    """Their indices."""
    late: float
    """[s]; below 0: earlier."""
    deviation: float
    """Standard deviation [s]."""


class _Match(NamedTuple):
    late: float
    share: float
    without: float


def late_axles(time: Floats, rim: Floats, train: MeasuredTrain, noise: float) -> list[LateAxles]:
    """Groups of axles that are recorded later or earlier than most, by their `rim` speeds [m/s], (instants, axles).

    `noise` [m/s]: standard deviation of a wheel's speed. Empty where all agree, or nothing tells.
    """
    known = np.flatnonzero(np.isfinite(rim).mean(axis=0) > 0.5)
    if known.size < 2:
        return []
    at, busy = _telling(time, rim[:, known])
    some = _spread(at, busy, FEW)
    if some.size < FEW // 10:
        return []
    width = max(NEAR, OF_NOISE * noise)
    grid = np.round(np.arange(-LONGEST, LONGEST + 0.5 * STEP, STEP), 6)
    picked = known[np.unique(np.linspace(0, known.size - 1, BEST).astype(np.int64))]
    agree = [
        sum(_share(time, rim[:, i], rim[:, r], some, 0.0, width) for i in known) for r in picked
    ]
    reference = picked[int(np.argmax(agree))]
    coarse = {}
    for i in known.tolist():
        shares = [_share(time, rim[:, i], rim[:, reference], some, d, width) for d in grid]
        coarse[i] = float(grid[int(np.argmax(shares))])
    if max(coarse.values()) - min(coarse.values()) < APART:
        return []
    many = _spread(at, busy, MANY)
    found = {
        i: _refined(time, rim[:, i], rim[:, reference], many, late, width)
        for i, late in coarse.items()
    }
    return _groups(found, train)


def _telling(time: Floats, rim: Floats) -> tuple[Floats, Floats]:
    """Instants [s] at which the train moves, and the half of them at which its speed changes most."""
    period = usual_period(time)
    each = max(round(0.02 / period), time.size // MOST, 1) if period > 0.0 else 1
    at, middle = time[::each], np.nan_to_num(middle_speed(rim[::each]))
    moving = middle > SLOWEST
    if moving.sum() < 2:
        return at[:0], at[:0]
    rate = np.abs(mean_rate(at, middle, RATE_TIME))[moving]
    at = at[moving]
    return at, at[np.sort(np.argsort(rate, kind="stable")[at.size // 2 :])]


def _spread(at: Floats, busy: Floats, count: int) -> Floats:
    """About `count` instants [s] of both from all over, half of each."""
    each = max(-(-at.size // (count // 2)), 1)
    return np.union1d(at[::each], busy[:: max(each // 2, 1)])


def _share(
    time: Floats, own: Floats, other: Floats, at: Floats, late: float, width: float
) -> float:
    """Share of the instants `at` at which an axle that is `late` agrees with another, weighted by how well."""
    x, y = np.interp(at + late, time, own), np.interp(at, time, other)
    used = (x > SLOWEST) & (y > SLOWEST)
    if used.sum() < 0.3 * at.size:
        return 0.0
    x, y = x[used], y[used]
    scale = float(np.median(x / y))
    for _ in range(TIMES):
        weight = np.exp(-0.5 * ((x - scale * y) / width) ** 2)
        scale = float((weight * y) @ x / max(float((weight * y) @ y), 1e-9))
    return float(np.exp(-0.5 * ((x - scale * y) / width) ** 2).mean())


def _refined(
    time: Floats, own: Floats, other: Floats, at: Floats, late: float, width: float
) -> _Match:
    tried: dict[float, float] = {}

    def share(d: float) -> float:
        d = round(d, 6)
        if d not in tried:
            tried[d] = _share(time, own, other, at, d, width)
        return tried[d]

    for step in FINER:
        late = max((late - step, late, late + step), key=share)
    step = FINER[-1]
    before, here, after = share(late - step), share(late), share(late + step)
    bend = before - 2.0 * here + after
    if bend < 0.0:
        late += float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0)) * step
    return _Match(late, here, share(0.0))


def _groups(found: dict[int, _Match], train: MeasuredTrain) -> list[LateAxles]:
    """Axles by their delays; the group with most axles is in time, of two such the earlier one."""
    sure = {i: m for i, m in found.items() if m.share > FITS}
    late, groups = _apart(sure, train)
    # a driven axle that is alone creeps more than the others, or slips for long: it does not tell its delay
    alone = {group[0] for group in groups if len(group) == 1 and train.driven[group[0]]}
    if alone:
        sure = {i: m for i, m in sure.items() if i not in alone}
        late, groups = _apart(sure, train)
    if len(sure) < 2:
        return []
    members = {
        group[0]: [*group, *(i for i in found if i not in sure and _beside(i, group, sure, train))]
        for group in groups
    }
    in_time = max(groups, key=lambda group: len(members[group[0]]))
    # where those in time are not those of the reference, a delay of 0 fits neither better nor worse
    gained = {i: sure[i].share - sure[i].without for i in sure}
    of_most = float(np.median([gained[i] for i in in_time]))
    late_ones = []
    for group in groups:
        value, deviation = _later(group, in_time, late, train)
        of_group = float(np.median([gained[i] for i in group]))
        if group is in_time or abs(value) < APART or max(of_group, of_most) < BETTER:
            continue
        late_ones.append(LateAxles(np.array(sorted(members[group[0]])), value, deviation))
    return late_ones


def _apart(
    sure: dict[int, _Match], train: MeasuredTrain
) -> tuple[dict[int, float], list[list[int]]]:
    """Delays of axles without what creep adds to them [s], and the axles in groups that are `APART`."""
    offset = _by_creep(sure, train)
    late = {i: m.late - offset * bool(train.driven[i]) for i, m in sure.items()}
    groups: list[list[int]] = []
    for i in sorted(late, key=lambda i: late[i]):
        if not groups or late[i] - late[groups[-1][-1]] > APART:
            groups.append([])
        groups[-1].append(i)
    return late, groups


def _later(
    group: list[int], in_time: list[int], late: dict[int, float], train: MeasuredTrain
) -> tuple[float, float]:
    """By how much a group is later than another [s], and its standard deviation: by axles of a kind, if both have some."""
    values, weights = [], []
    for kind in (True, False):
        own, others = (
            np.array([late[i] for i in some if bool(train.driven[i]) is kind])
            for some in (group, in_time)
        )
        if own.size and others.size:
            spread = [np.ptp(one) / math.sqrt(one.size) for one in (own, others)]
            values.append(float(np.median(own)) - float(np.median(others)))
            weights.append(1.0 / (spread[0] ** 2 + spread[1] ** 2 + SYSTEMATIC**2))
    if not values:
        own, others = (np.array([late[i] for i in some]) for some in (group, in_time))
        return float(np.median(own)) - float(np.median(others)), 0.5 * TOGETHER
    return float(np.average(values, weights=weights)), 1.0 / math.sqrt(sum(weights))


def _beside(axle: int, group: list[int], sure: dict[int, _Match], train: MeasuredTrain) -> bool:
    """Whether an axle that slips or is locked too often to tell is in a group's car, or stands among its axles."""
    mates = [i for i in sure if train.axle_car[i] == train.axle_car[axle]]
    if mates:
        return all(i in group for i in mates)
    before, after = (
        max((i for i in sure if i < axle), default=None),
        min((i for i in sure if i > axle), default=None),
    )
    return all(i in group for i in (before, after) if i is not None)


def _by_creep(sure: dict[int, _Match], train: MeasuredTrain) -> float:
    """By how much later driven axles seem to be than the others [s]: by what brings most of them together."""
    driven, others = (
        np.array([m.late for i, m in sure.items() if bool(train.driven[i]) is kind])
        for kind in (True, False)
    )
    apart = (driven[:, None] - others).ravel()
    apart = apart[np.abs(apart) < CREEP]
    if apart.size == 0:
        return 0.0
    together = (np.abs(apart[:, None] - apart) < TOGETHER).sum(axis=1)
    return float(np.median(apart[together == together.max()]))
