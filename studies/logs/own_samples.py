"""The samples that a channel of a log really has: rows may repeat a value, or be interpolated between two of them.

A logger writes all channels at one rate. A slower channel is then empty in between, held at its last value, or interpolated.
These filled-in values are no measurements: if they were used as such, a speed held for a second would show slips of up to
its change in that second.
"""

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import excerpt, usual_period

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

Kind = Literal["sampled", "held", "interpolated", "quantised"]

FEWEST = 4
"""Smallest number of own samples in which a pattern can be detected."""
REPEATED = 0.4
"""Share of rows that repeat the one before, above which a channel may be held."""
REGULAR = 0.9
"""Share of the distances between own samples that must be multiples of one of them."""
STRAIGHT = 0.02
"""Noise [m/s, of forces N] above which straight lines cannot be detected."""
COARSE = 0.02
"""Step of a rounded speed [m/s] above which rounding matters."""
STAYS = 1.0
"""Time [s] after a change from which on a rounded speed of 0 counts as standstill."""
LEAST_PART = 10
"""Rows between two own samples from which on all distances are hardly multiples of them by chance."""
LEAST_KNOTS = 4
"""Rows between two own samples of an interpolated channel, at least."""
LEAST_TICKS = 6
"""Distances between changes of a rounded channel that show whether it is held as well."""
SEEN = 0.15
"""Time [s] between knots above which straight lines differ from a smooth motion; below it they do no harm."""
MOSTLY = 0.9
"""Share of the rows that have a value, above which the others do not break a straight line."""
SINGLE = 1e-6
"""Change over the largest value that the rounding of single precision may make."""
MEDIAN_DEVIATION = 1.4826
"""Standard deviation over the median of the magnitude, of normally distributed numbers."""


class Samples(NamedTuple):
    """Own samples of a channel, without nan, (samples,) each."""

    time: Floats
    """[s]"""
    value: Floats
    kind: Kind
    period: float
    """Median time between two of them [s]; nan for fewer than two."""
    noise: float
    """Standard deviation of a value: of what is white in it, and of its rounding."""


def own_samples(time: Floats, values: Floats, rounded: bool = False) -> Samples:
    """Find the own samples of a channel, (rows,) each; nan where a row has no value.

    `rounded`: whether a channel that changes by one step now and then is a smooth one that is rounded; a force may jump.
    """
    finite = np.isfinite(values)
    t, v = (time, values) if finite.all() else (time[finite], values[finite])
    if v.size < FEWEST:
        return Samples(t, v, "sampled", usual_period(t) if t.size > 1 else math.nan, 0.0)
    repeats = _repeats(v)
    if rounded and repeats and _quantised(v):
        noise = quantum_of(v) / math.sqrt(12.0)
        t, v = _crossings(t, v)
        return Samples(t, v, "quantised", usual_period(t), noise)
    noise = noise_of(v)
    kind: Kind = "held"
    found = _held(v) if repeats else None
    if found is None and noise <= STRAIGHT:
        kind, found = "interpolated", _interpolated(time, values, finite)
        if found is not None and usual_period(t[found]) < SEEN:
            found = None
    if found is None:
        return Samples(t, v, "sampled", usual_period(t), noise)
    t, v = t[found], v[found]
    return Samples(t, v, kind, usual_period(t), noise_of(v))


def smoothed_steps(time: Floats, values: Floats, crossings: Samples) -> Samples:
    """A rounded speed (rows,) at all rows: straight lines between the instants at which it changes.

    As it becomes 0 the line goes on until it is 0, and the wheel stands, unless it passes to the other direction.
    """
    changes = crossings.value != 0.0
    t, v = crossings.time[changes], crossings.value[changes]
    slope = np.diff(v) / np.diff(t)
    steep = np.where(slope == 0.0, 1.0, slope)
    stops, starts = t.copy(), t.copy()
    stops[1:] -= np.where(slope * v[1:] < 0.0, v[1:] / steep, 0.0)
    starts[:-1] -= np.where(slope * v[:-1] > 0.0, v[:-1] / steep, 0.0)
    stands = values[np.clip(np.searchsorted(time, t), 0, time.size - 1)] == 0.0
    between = stands[:-1] & (v[:-1] * v[1:] > 0.0) & (stops[:-1] <= starts[1:])
    first, last = starts[:1][values[:1] == 0.0], stops[-1:][stands[-1:]]
    zeros = np.concatenate([first, stops[:-1][between], starts[1:][between], last])
    at, said = np.concatenate([t, zeros]), np.concatenate([v, np.zeros(zeros.size)])
    order = np.argsort(at, kind="stable")
    value = np.interp(time, at[order], said[order])
    return Samples(time, value, "sampled", usual_period(time), crossings.noise)


def noise_of(values: Floats) -> float:
    """Standard deviation of the white noise in a series, by its second differences, and of its rounding."""
    if values.size < FEWEST:
        return 0.0
    values = excerpt(values)
    bend = float(MEDIAN_DEVIATION * np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6.0)
    return math.hypot(bend, quantum_of(values) / math.sqrt(12.0))


def quantum_of(values: Floats) -> float:
    """Smallest change between two values, where most of them are nothing or a multiple of it; else 0."""
    change = np.abs(np.diff(values))
    moving = change[change > 1e-9]
    if moving.size == 0:
        return 0.0
    least = float(moving.min())
    share = moving / least
    return least if np.mean(np.abs(share - np.round(share)) < 0.05) > REGULAR else 0.0


def _spacing(index: Numbers) -> float | None:
    """Number of rows, 2 or more, of which the distances between `index` are multiples; None if there is none."""
    distance = np.diff(index)
    if distance.size < FEWEST - 1:
        return None
    usual = int(np.bincount(distance).argmax())
    # where an evenly changing value hides most samples, twice or three times the spacing is the usual distance
    parts = [part for part in (distance.min(), usual // 2, usual // 3) if part >= LEAST_PART]
    found = (_multiples_of(distance, float(one)) for one in (usual, *parts))
    return next((spacing for spacing in found if spacing is not None), None)


def _multiples_of(distance: Numbers, usual: float) -> float | None:
    """The same if it is about `usual`."""
    near = distance[np.abs(distance - usual) <= max(0.3 * usual, float(usual > 1))]
    spacing = float(near.mean()) if near.size else usual
    if spacing < 1.5:
        return None
    times = np.round(distance / spacing)
    # a period that is no multiple of the rows' comes up to a row early or late
    apart = max(min(0.95, 0.35 * spacing), 0.1 * spacing)
    fits = (times >= 1.0) & (np.abs(distance - times * spacing) <= apart)
    return spacing if fits.mean() > REGULAR else None


def _between(index: Numbers, spacing: float) -> Numbers:
    """`index` with the rows in between at which a value was sampled that did not change."""
    count = np.maximum(np.round(np.diff(index) / spacing).astype(np.int64), 1)
    if count.max(initial=1) == 1:
        return index
    first = np.cumsum(count) - count
    number = np.arange(int(count.sum())) - np.repeat(first, count)
    share = number / np.repeat(count, count)
    between = np.repeat(index[:-1], count) + share * np.repeat(np.diff(index), count)
    return np.append(np.round(between).astype(np.int64), index[-1])


def _ends(index: Numbers, spacing: float, count: int) -> Numbers:
    """`index` continued to the first and the last row at the same spacing."""
    before = np.arange(index[0] - spacing, -0.5, -spacing)[::-1]
    after = np.arange(index[-1] + spacing, count - 0.5, spacing)
    return np.concatenate([np.round(before), index, np.round(after)]).astype(np.int64)


def _repeats(values: Floats) -> bool:
    """Whether so many rows repeat the one before that a channel may be held or rounded."""
    some = excerpt(values)
    return bool(np.mean(some[1:] == some[:-1]) >= 0.5 * REPEATED)


def _held(values: Floats) -> Numbers | None:
    """Rows at which a held channel was sampled; None if it is not held."""
    change = np.flatnonzero(np.diff(values)) + 1
    if change.size < FEWEST or 1.0 - change.size / values.size < REPEATED:
        return None
    spacing = _spacing(change)
    if spacing is None:
        # a logger that resampled a held channel leaves a value in between at each step
        follows = np.diff(change) == 1
        if np.any(follows[1:] & follows[:-1]):
            return None
        change = change[np.concatenate([~follows, [True]])]
        spacing = _spacing(change)
    if spacing is None or spacing < 2.0:
        return None
    return _ends(_between(change, spacing), spacing, values.size)


def _quantised(values: Floats) -> bool:
    """Whether a channel repeats values because it is rounded: it goes on by one step, not at even times."""
    change = np.flatnonzero(np.diff(values)) + 1
    if change.size < FEWEST or 1.0 - change.size / values.size < REPEATED:
        return False
    step = values[change] - values[change - 1]
    least, apart = np.abs(step).min(), np.diff(change)
    one = np.mean(np.abs(step) < 1.5 * least) > 0.95
    onwards = np.mean(step[1:] * step[:-1] > 0.0) > REGULAR
    return bool(one and onwards and least > COARSE and np.std(apart) > 0.02 * apart.mean())


def _crossings(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """As a rounded value changes, the true one is in the middle; in between it is not known, but at rest it is none.

    A value that is held as well has become another one since it was sampled before.
    """
    change = np.flatnonzero(np.diff(values))
    before = np.maximum(change + 1 - _ticks(change), 0)
    at, middle = (
        0.5 * (time[before] + time[change + 1]),
        0.5 * (values[change] + values[change + 1]),
    )
    stays = np.arange(time[0], time[-1], STAYS)
    after = np.searchsorted(at, stays)
    before = np.where(after > 0, at[np.maximum(after - 1, 0)], -np.inf)
    behind = np.where(after < at.size, at[np.minimum(after, at.size - 1)], np.inf)
    stays = stays[(stays - before > STAYS) & (behind - stays > STAYS)]
    stays = stays[values[np.clip(np.searchsorted(time, stays), 0, time.size - 1)] == 0.0]
    said = np.zeros(stays.size)
    order = np.argsort(np.concatenate([at, stays]), kind="stable")
    return np.concatenate([at, stays])[order], np.concatenate([middle, said])[order]


def _ticks(change: Numbers) -> int:
    """Number of rows of which the distances between changes are multiples: those between two samples; 1 if there is none."""
    distance = np.diff(change)
    if distance.size < LEAST_TICKS:
        return 1
    for rows in range(int(distance.min()), LEAST_KNOTS, -1):
        times = np.round(distance / rows).astype(np.int64)
        # a speed that changes evenly has changes at even distances, too: but not at different multiples of one
        fits = np.abs(distance - rows * times) <= 0.05 * rows
        if fits.mean() > REGULAR and np.bincount(times).max() < MOSTLY * times.size:
            return rows
    return 1


def _interpolated(time: Floats, values: Floats, finite: NDArray[np.bool_]) -> Numbers | None:
    """At which of the `finite` values an interpolated channel was sampled, its knots; None if it is not interpolated."""
    if not MOSTLY < finite.mean() < 1.0:
        return _knots(values[finite])
    # a line on which a value is missing goes on
    found = _knots(np.interp(time, time[finite], values[finite]))
    return None if found is None else (np.cumsum(finite) - 1)[found[finite[found]]]


def _knots(values: Floats) -> Numbers | None:
    bend = np.abs(np.diff(values, 2))
    single = SINGLE * float(np.abs(values).max())
    moving = bend[bend > max(1e-9, single)]
    if moving.size < FEWEST:
        return None
    # few rows bend at all where nothing is rounded
    rounding = float(moving.min()) if moving.size > REPEATED * bend.size else 0.0
    bound = max(6.0 * float(np.median(bend)), 3.0 * rounding, single, 1e-9)
    knot = np.flatnonzero(bend > bound) + 1
    if knot.size < FEWEST or knot.size > 0.5 * values.size:
        return None
    # a knot between two rows bends at both
    knot = knot[np.concatenate([[True], np.diff(knot) > 1])]
    spacing = _spacing(knot)
    if spacing is None or spacing < LEAST_KNOTS:
        return None
    index = _ends(_between(knot, spacing), spacing, values.size)
    line = np.interp(np.arange(values.size), index, values[index])
    inside = slice(index[0], index[-1] + 1)
    reach = 4.0 * rounding + single + 2.0 * bound / spacing
    off = np.abs(values - line)[inside]
    return index if np.mean(off <= reach) > REGULAR else None
