"""The samples that a channel of a log really has: held or interpolated between, rounded, counted in pulses, or noisy.

A logger writes all channels at one rate. What it fills in between the samples of a slower one is no measurement: a speed
held for a second would show slips of up to its change in that second. A count of pulses over the time of a row steps by
one pulse, at 80 pulses a turn and 20 ms by 1.7 m/s; the sum of counts is right to one pulse at all times, so the speed is
the slope of the way over `SPAN`. A rounded speed is known as it changes, in the middle of two values.
"""

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from alloc.estimation.series import excerpt, spans, usual_period
from studies.logs.recorder_files import numbers_of
from studies.logs.remarks import NAMED, Remark, faulty

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
Kind = Literal["sampled", "held", "interpolated", "quantised", "counted"]

WORDS = {
    "held": "held in between", "interpolated": "interpolated in between", "quantised": "rounded",
    "counted": "pulses: the slope of the way over {span:.2g} s", "sampled": "noise: mean over {span:.2g} s",
}  # fmt: skip
"""How each kind is told."""
BRIDGED = 0.12
"""Time [s] over which straight lines are drawn: a slip grows within some tenths of a second."""
FEWEST = 5
"""Changes of a value from which on a pattern can be detected."""
REPEATED = 0.4
"""Share of rows that repeat the one before, above which a channel may be held."""
COARSE = 0.05
"""Step [m/s] from which on multiples of one step may be pulses; a rounded speed is one from 0.02 on."""
APART = 0.05
"""Distance [m/s] from straight lines that hardly any row of an interpolated speed has."""
SPAN = 0.2
"""Time [s] over which pulses and noise are smoothed: a slip grows within some tenths of a second."""
NOISY, FINE = 0.03, 0.04
"""Noise of a wheel [m/s] above which it is smoothed, and longest period [s] for which that helps."""
ALIASED = 0.36
"""Standard deviation of a speed by pulses, in pulses over the span: pulses and rows may be in step."""
SEEN = 0.15
"""Time [s] between knots above which straight lines differ from a smooth motion."""
AWAY, MOST_AWAY = 0.8, 0.2
"""Jump there and back [m/s] of a value that is none, and share of such values above which none is left out."""


FEWEST_NUMBERS = 20
"""Values of a channel from which on one that stands for none can be told."""
MOST_STAND_INS = 0.3
"""Share of the values of a channel that one may be, if it stands for none."""
FAR = 2.0
"""Distance of such a value from all others, in their range and in their size."""
STAND_INS = (9999.0, 99999.0, 999.0, 999.9, 9999.9, 32767.0, 32768.0, 65535.0)
"""Sizes of values that recorders write for none; such a one counts even if it is there once, or alone differs."""


class Samples(NamedTuple):
    """Own samples of a channel, without nan, (samples,) each."""

    time: Floats
    """[s]"""
    value: Floats
    kind: Kind
    period: float
    """Median time between two of them [s]; nan for fewer than two."""
    noise: float
    """Standard deviation of a value: of what is white in it."""
    span: float = 0.0
    """Time [s] over which each is a mean, or by which the instant of a rounded one is uncertain."""
    steps: tuple[Floats, Floats, float] | None = None
    """Of a rounded one: instants and values of its rows, and its step."""
    left_out: Numbers = np.zeros(0, dtype=np.int64)
    """Rows with single values from which it would have to jump back."""


def numbers(values: NDArray[Any], name: str, source: str) -> tuple[Floats, list[Remark]]:
    """Values as numbers, and remarks; empty cells, words and infinite ones are nan. Raises for other texts."""
    remarks = []
    if values.dtype.kind == "b":
        raise faulty(source, name, 1, f"{str(values[0])!r} is not a number")
    if values.dtype.kind not in "iuf":
        found = numbers_of(values)
        if found.wrong is not None or np.isnan(found.values).all():
            row = found.wrong or 0
            raise faulty(source, name, row + 1, f"{str(values[row])!r} is not a number")
        values = found.values
        if found.words:
            words = ", ".join(repr(word) for word, _ in found.words.most_common(NAMED))
            text = f"{words} in {found.words.total()} rows: no value"
            remarks.append(Remark("missing", name, text))
    numbers = values.astype(np.float64, copy=False)
    infinite = np.flatnonzero(np.isinf(numbers))
    if infinite.size:
        numbers = np.where(np.isinf(numbers), np.nan, numbers)
        text = f"infinite in {infinite.size} rows: no value"
        remarks.append(Remark("missing", name, text, int(infinite[0]) + 1))
    stands_for_none = _in_place_of_none(numbers)
    if stands_for_none:
        for value in stands_for_none:
            alike = numbers == value
            text = f"{value:g} in {int(alike.sum())} rows, far from all others: no value"
            remarks.append(Remark("missing", name, text, int(np.flatnonzero(alike)[0]) + 1))
            numbers = np.where(alike, np.nan, numbers)
    return numbers, remarks


def _in_place_of_none(values: Floats) -> list[float]:
    """Numbers such as -9999 that stand for no value: an end of the range, far from all others, again and again."""
    found: list[float] = []
    known = values[np.isfinite(values)]
    for _ in range(2):
        if known.size < FEWEST_NUMBERS:
            break
        some = excerpt(known)
        for end in (float(known.min()), float(known.max())):
            if not _is_far(end, some[some != end]):  # nor is it from all others
                continue
            others = known[known != end]
            times = known.size - others.size
            usual = abs(end) in STAND_INS
            least = 1 if usual else 2
            if not least <= times <= MOST_STAND_INS * known.size:
                continue
            if not usual and np.unique(others[:FEWEST_NUMBERS]).size < 2:
                continue
            if _is_far(end, others):
                found.append(end)
                known = others
                break
        else:
            break
    return found


def _is_far(end: float, others: Floats) -> bool:
    """Whether an end of a range is far from all others, in their range and in their size; true where there are none."""
    if others.size == 0:
        return True
    apart = np.abs(others - end).min()
    return bool(apart / FAR > max(np.ptp(others), np.abs(others).max()))


def own_samples(time: Floats, values: Floats, speed: bool = False, counts: bool = False) -> Samples:
    """The own samples of a channel, (rows,) each, nan where a row has no value.

    `speed`: whether it is one, which may be rounded or counted; `counts`: whether others like it are counted.
    """
    finite = np.isfinite(values)
    t, y = (time, values) if finite.all() else (time[finite], values[finite])
    noise, left_out = noise_of(y), np.zeros(0, dtype=np.int64)
    if speed and y.size > FEWEST:
        quantum, whole, turns = _pattern(y)
        if (
            whole
            and quantum > COARSE
            and (counts or turns > 0.6 or (turns > 0.3 and quantum > 0.3))
        ):
            return _counted(t, y)
        keep = _without_spikes(y, noise)
        if not keep.all():
            left_out = np.flatnonzero(finite)[~keep]
            t, y = t[keep], y[keep]
    period = usual_period(t) if t.size > 1 else math.nan
    plain = Samples(t, y, "sampled", period, noise, left_out=left_out)
    moved = np.flatnonzero(np.diff(y))
    if moved.size < FEWEST:
        return plain
    quantum, whole, turns = _pattern(y) if speed else (0.0, False, 0.0)
    repeats = 1.0 - moved.size / (y.size - 1)
    if whole and repeats > 0.5 * REPEATED and turns < 0.2 and quantum > 0.02:
        return _rounded(t, y, moved, quantum)._replace(left_out=left_out)
    if repeats > REPEATED and (rows := _spacing(moved + 1)):
        gap = np.diff(moved, prepend=-1)
        before = np.round(moved + 1 - rows).astype(int)[gap > 1.5 * rows]
        keep = np.unique(np.clip(np.concatenate([[0], before, moved + 1]), 0, y.size - 1))
        return Samples(t[keep], y[keep], "held", usual_period(t[keep]), noise_of(y[keep]))
    knots = _knots_of(time, values, finite, left_out, y) if speed and noise < 0.02 else None
    if knots is not None and usual_period(t[knots]) > SEEN:
        return Samples(
            t[knots], y[knots], "interpolated", usual_period(t[knots]), noise_of(y[knots])
        )
    return plain


def smoothed(samples: Samples) -> Samples:
    """A wheel whose noise would make slips: its means over `SPAN` at most."""
    if samples.kind != "sampled" or samples.noise < NOISY or not samples.period <= FINE:
        return samples
    wanted = min(1.2 * (samples.noise / NOISY) ** 2, SPAN / samples.period)
    rows = max(5, 2 * round(0.5 * wanted) + 1)
    if samples.value.size <= rows:
        return samples
    value = savgol_filter(samples.value, rows, 1)
    noise = samples.noise / math.sqrt(rows)
    return samples._replace(value=value, noise=noise, span=rows * samples.period)


def at(time: Floats, samples: Samples, fill: float = math.inf) -> Floats:
    """A channel at instants [s], straight lines between its samples; nan between two that are further apart than `fill` [s].

    A rounded one stays within its steps, and where it says 0 for long it is 0.
    """
    if samples.time.size < 2:
        return np.full(time.size, np.nan)
    value = np.interp(time, samples.time, samples.value)
    if samples.steps is not None:
        rows, y, quantum = samples.steps
        y = y[np.clip(np.searchsorted(rows, time + 1e-6, "right") - 1, 0, y.size - 1)]
        value = np.clip(value, y - 0.5 * quantum, y + 0.5 * quantum)
        for begin, end in spans(np.abs(y) < 1e-6):
            if time[end - 1] - time[begin] > 0.5:
                value[begin:end] = 0.0
    reach = max(fill, 1.5 * samples.period)
    for k in np.flatnonzero(np.diff(samples.time) > reach):
        value[(time > samples.time[k]) & (time < samples.time[k + 1])] = np.nan
    value[(time < samples.time[0] - reach) | (time > samples.time[-1] + reach)] = np.nan
    return np.asarray(value)


def noise_of(values: Floats) -> float:
    """Standard deviation of the white noise in a series, by its second differences."""
    if values.size < 4:
        return 0.0
    bend = np.abs(np.diff(excerpt(values), 2))
    return float(1.4826 * np.median(bend)) / math.sqrt(6.0)


def pulse_step(values: Floats) -> float:
    """Speed [m/s] of one pulse in a row, of a speed that is a count of pulses; 0 for any other."""
    if np.count_nonzero(np.diff(values)) < FEWEST:
        return 0.0
    quantum, whole, turns = _pattern(values)
    return quantum if whole and quantum > COARSE and turns > 0.6 else 0.0


def of_counter(time: Floats, count: Floats, metres: float) -> tuple[Samples, int]:
    """A wheel by pulses of so many `metres`, and how often its counter was set back: a sum, or the count of each row."""
    change = np.diff(count)
    back = -change[change < 0.0]
    bridged = 0
    if back.size >= 0.1 * change.size and not (
        np.ptp(count) > 10.0 and np.median(back) > 0.5 * np.ptp(count)
    ):
        way = np.cumsum(np.abs(count))
    else:
        change, bridged = _gained(time, count)
        way = np.concatenate([[0.0], np.cumsum(change)])
    return _of_way(time, way * metres, metres), bridged


def _gained(time: Floats, count: Floats) -> tuple[Floats, int]:
    """Pulses from row to row of a counter, and how often it was set back.

    One of so many bits or digits goes on from where it began; one that was set back gained what it gains around.
    """
    change, step = np.diff(count), np.diff(time)
    forwards, size, bridged = change >= 0.0, float(np.ptp(count)) + 1.0, 0
    turns = (2.0 ** np.ceil(np.log2(size)), 10.0 ** np.ceil(np.log10(size)))
    for k in np.flatnonzero(~forwards):
        near = slice(max(k - 10, 0), k + 11)
        known = forwards[near]
        spent = float(step[near][known].sum())
        usual = float(change[near][known].sum()) / spent * step[k] if spent > 0.0 else 0.0
        gained = min((change[k] + turn for turn in turns), key=lambda g: abs(g - usual))
        fits = abs(gained - usual) <= max(3.0, 0.5 * usual)
        change[k] = gained if fits else usual
        bridged += not fits
    return change, bridged


def _pattern(y: Floats) -> tuple[float, bool, float]:
    """Smallest step of a channel, whether all are multiples of it, and the share of steps that go back on the one before."""
    step = np.diff(excerpt(y))
    step = step[step != 0.0]
    if step.size < FEWEST:
        return 0.0, False, 0.0
    size = np.abs(step)
    quantum = float(np.quantile(size, 0.02))
    whole = (
        quantum > 0.02 and np.mean(np.abs(size / quantum - np.round(size / quantum)) < 0.05) > 0.95
    )
    return quantum, bool(whole), float(np.mean(step[1:] * step[:-1] < 0.0))


def _without_spikes(y: Floats, noise: float) -> NDArray[np.bool_]:
    """Which values a speed does not jump to and back from; all of them where very many are."""
    far = np.zeros(y.size, dtype=np.bool_)
    middle = np.median(np.stack([y[:-2], y[1:-1], y[2:]]), axis=0)
    far[1:-1] = np.abs(y[1:-1] - middle) > AWAY + 8.0 * noise
    for end, near in ((0, (1, 2)), (-1, (-2, -3))):
        far[end] = all(abs(y[end] - y[k]) > 1.5 * AWAY for k in near)
    return ~far if far.mean() < MOST_AWAY else np.ones(y.size, dtype=np.bool_)


def _rounded(t: Floats, y: Floats, moved: Numbers, quantum: float) -> Samples:
    """A rounded speed: its samples are in the middle of two values, as one becomes the other."""
    held = max(_ticks(np.diff(moved)), 1) * usual_period(t)
    one = moved[np.abs(np.diff(y)[moved]) < 1.5 * quantum]
    time, value = t[one + 1] - 0.5 * held, 0.5 * (y[one] + y[one + 1])
    period = usual_period(time) if time.size > 1 else math.nan
    return Samples(time, value, "quantised", period, 2e-3, held / math.sqrt(12.0), (t, y, quantum))


def _spacing(index: Numbers) -> float:
    """Rows of which the distances of `index` are multiples; 0 if there is none."""
    gap = np.diff(index)
    for p in (
        (np.median(gap), np.median(gap) / 2, np.median(gap) / 3, gap.min()) if gap.size > 2 else ()
    ):
        near = gap[np.abs(gap - p) <= max(1.0, 0.2 * p)]
        p = near.mean() if near.size else p
        n = np.maximum(np.round(gap / p), 1)
        if p >= 1.7 and np.mean(np.abs(gap - n * p) <= max(0.95, 0.1 * p)) > 0.9:
            return float(p)
    return 0.0


def _ticks(gap: Numbers) -> int:
    """Rows between samples of a speed that is held and rounded: changes are different multiples of them apart; else 0."""
    for rows in range(int(gap.min()), 4, -1) if gap.size > FEWEST else ():
        times = np.round(gap / rows).astype(int)
        fits = np.abs(gap - rows * times) <= 0.05 * rows
        if np.mean(fits) > 0.9 and np.bincount(times).max() < 0.9 * times.size:
            return rows
    return 0


def _knots(y: Floats) -> Numbers | None:
    """Rows between which all others lie on straight lines, of a rounded or an exact channel; None where that is not so."""
    bend, size = np.abs(np.diff(y, 2)), 1e-6 * float(np.abs(y).max())
    for fine in (7e-4 + size, size):
        top = np.flatnonzero(bend > max(fine, 6.0 * float(np.median(bend)))) + 1
        if not 4 <= top.size <= 0.3 * y.size:
            continue
        top = top[np.concatenate([[True], np.diff(top) > 1])]
        rows = _spacing(top)
        if rows < 4:
            continue
        both = np.concatenate([np.arange(top[0], -0.5, -rows), np.arange(top[0], y.size, rows)])
        index = np.unique(np.minimum(np.round(both), y.size - 1).astype(np.int64))
        line = np.interp(np.arange(y.size), index, y[index])
        apart = np.abs(line - y)  # a wheel that slips now and then lies on lines in between
        if np.mean(apart < 1.4e-3 + 2.0 * size) > 0.9 and np.quantile(apart, 0.995) < APART:
            return index
    return None


def _knots_of(
    time: Floats, values: Floats, finite: NDArray[np.bool_], left_out: Numbers, y: Floats
) -> Numbers | None:
    """The same of a channel of which some rows are missing: a line goes on over them."""
    if y.size == values.size or y.size < 0.9 * values.size:
        return _knots(y)
    used = finite.copy()
    used[left_out] = False
    found = _knots(np.interp(time, time[used], y))
    return None if found is None else (np.cumsum(used) - 1)[found[used[found]]]


def _counted(t: Floats, y: Floats) -> Samples:
    """A speed of pulses counted in the time since the row before; a row that is missing was counted at the mean rate."""
    dt = usual_period(t)
    step = np.diff(t, prepend=t[0] - dt)
    mean = 0.5 * (y + np.concatenate([y[:1], y[:-1]]))
    way = np.cumsum(y * dt + np.where(step > 1.5 * dt, mean * (step - dt), 0.0))
    size = np.abs(np.diff(y))
    return _of_way(t, way, float(np.quantile(size[size > 0.0], 0.02)) * dt)


def _of_way(time: Floats, way: Floats, pulse: float) -> Samples:
    """Speed from the way [m] of a wheel at instants [s] in whole pulses [m]: its slope."""
    dt = usual_period(time)
    rows = max(5, 2 * round(0.5 * SPAN / dt) + 1)
    even = np.arange(time[0], time[-1] + 0.5 * dt, dt)
    if even.size <= rows:
        return Samples(time, np.gradient(way, time), "counted", dt, ALIASED * pulse / SPAN, SPAN)
    slope = savgol_filter(np.interp(even, time, way), rows, 2, deriv=1, delta=dt)
    speed = np.interp(time, even, slope)
    speed[np.abs(speed) < 1e-6] = 0.0
    return Samples(time, speed, "counted", dt, ALIASED * pulse / SPAN, SPAN)
