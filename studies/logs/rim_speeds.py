"""Wheel speeds from pulses and from noisy sensors: integrated to a distance, and differentiated over a longer time.

A speed computed as a count of pulses over the time of a row steps by one pulse: at 80 pulses a turn and 20 ms by 1.7 m/s.
The sum of counts is right to one pulse at all times. So the speed is the slope of a straight line through the distances of
`SPAN` seconds T. Where pulses and rows are in step, as with nearly one pulse a row, rounding errors do not average out. For
pulses of p metres the error then reaches 1.5 p / T, and `ALIASED` p / T is stated as its standard deviation.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import excerpt, usual_period
from studies.logs.own_samples import Samples

Floats = NDArray[np.float64]

SPAN = 0.2
"""Time [s] over which a speed of pulses is the slope of the way: a slip grows within some tenths of a second."""
COARSE = 0.05
"""Step [m/s] above which the multiples of one step count as pulses."""
NOISY = 0.03
"""Standard deviation [m/s] of a wheel's speed above which it is smoothed, over `SPAN` at most."""
LEAST_SPAN = 5
"""Rows that a slope needs."""
ALIASED = 0.36
"""Standard deviation of a speed by pulses, in pulses over the span."""
ENDS = 3
"""Spans at an end of which the acceleration is told: half a span alone leaves the speed there open."""
STILL = 1e-6
"""Speed [m/s] that rounding of the computer makes of none: a locked wheel stands."""
ALTERNATING = 0.6
"""Share of the changes that go back on the one before, of counts whose rests are carried on."""
RARELY = 0.03
"""Share of rows that change, of counts at least."""


class RimSpeed(NamedTuple):
    """Speeds of a wheel at its own samples, (samples,) each."""

    time: Floats
    """[s]"""
    speed: Floats
    """[m/s]"""
    deviation: float
    """Standard deviation of each [m/s]."""
    span: float
    """Time [s] over which each is the mean; 0: as measured."""
    step: float
    """Speed [m/s] that one pulse more in a row makes; 0: no pulses."""


def rim_speed(samples: Samples) -> RimSpeed:
    """The speed of a wheel from the own samples of its channel [m/s]."""
    step = pulse_step(samples.value)
    if step > 0.0:
        return of_way(*_summed(samples), step * samples.period, step)
    if samples.noise > NOISY and samples.period < SPAN / LEAST_SPAN:
        wanted = 1.2 * (samples.noise / NOISY) ** 2 * samples.period
        way = np.zeros(samples.value.size)
        np.cumsum(
            0.5 * (samples.value[1:] + samples.value[:-1]) * np.diff(samples.time), out=way[1:]
        )
        speed, rows = _slope(samples.time, way, samples.period, min(wanted, SPAN))
        left = samples.noise * math.sqrt(1.2 / rows)
        return RimSpeed(samples.time, speed, left, rows * samples.period, 0.0)
    return RimSpeed(samples.time, samples.value, samples.noise, 0.0, 0.0)


def of_way(time: Floats, way: Floats, pulse: float, step: float = 0.0) -> RimSpeed:
    """Speed from the way [m] of a wheel at instants [s], whole `pulse`s [m]."""
    period = usual_period(time)
    speed, rows = _slope(time, way, period, SPAN)
    span = (rows - 1) * period
    return RimSpeed(time, speed, ALIASED * pulse / span, span, step or pulse / period)


def pulse_step(speed: Floats) -> float:
    """Speed [m/s] of one pulse in a row, of a speed that is a count of pulses; 0 for any other."""
    whole, speed = speed, excerpt(speed)
    change = np.diff(speed)
    moved = change[np.abs(change) > 0.5 * COARSE]
    if moved.size < max(LEAST_SPAN, RARELY * speed.size):
        return 0.0
    guess = float(np.quantile(np.abs(moved), 0.1))
    if guess < COARSE:
        return 0.0
    count = np.round(speed / guess)
    if not count.any():
        return 0.0
    step = float(speed @ count / (count @ count))
    count = np.round(whole / step)
    speed = whole
    fits = np.abs(speed - step * count) < 0.02 * step
    back = moved[1:] * moved[:-1] < 0.0
    return step if fits.mean() > 0.99 and back.mean() > ALTERNATING else 0.0


def _summed(samples: Samples) -> tuple[Floats, Floats]:
    """Instants and ways of counts: each row has what was counted since the row before."""
    step = np.diff(samples.time, prepend=samples.time[0] - samples.period)
    # a row that is missing was counted all the same, and how much is not known
    mean = 0.5 * (samples.value + np.concatenate([samples.value[:1], samples.value[:-1]]))
    lost = step > 1.5 * samples.period
    own = samples.value * samples.period
    gained = np.where(lost, own + mean * (step - samples.period), own)
    return samples.time, np.cumsum(gained)


def _slope(time: Floats, way: Floats, period: float, span: float) -> tuple[Floats, int]:
    """Slope of straight lines through `span` seconds of `way`, and the rows of each; gaps are not bridged."""
    rows = max(LEAST_SPAN, 2 * (round(span / period) // 2) + 1)
    slope = np.empty(way.size)
    ends = np.flatnonzero(np.diff(time) > LEAST_SPAN * period) + 1
    for begin, end in pairwise([0, *ends.tolist(), way.size]):
        inside = slice(begin, end)
        slope[inside] = _slope_between_gaps(time[inside], way[inside], period, rows)
    return slope, rows


def _slope_between_gaps(time: Floats, way: Floats, period: float, rows: int) -> Floats:
    if way.size < 2:
        return np.full(way.size, np.nan)
    if time[-1] - time[0] < (rows - 0.5) * period:
        return np.gradient(way, time)
    if np.all(np.abs(np.diff(time) - period) < 0.01 * period):
        return _even_slope(way, period, rows)
    instants = np.arange(time[0], time[-1] + 0.5 * period, period)
    return np.interp(time, instants, _even_slope(np.interp(instants, time, way), period, rows))


def _even_slope(way: Floats, period: float, rows: int) -> Floats:
    """The same on even instants. At the ends the way goes on with the acceleration that it had over `ENDS` as many rows."""
    from scipy.signal import savgol_filter  # slow to import, and needed for pulses and noise alone

    half, count = rows // 2, min(ENDS * rows, way.size)
    index = np.arange(count, dtype=float)
    beyond = np.arange(1.0, half + 1.0)
    first = np.polynomial.Polynomial.fit(index, way[:count], 2)(-beyond[::-1])
    last = np.polynomial.Polynomial.fit(index, way[-count:], 2)(count - 1.0 + beyond)
    longer = np.concatenate([first, way, last])
    slope = np.asarray(savgol_filter(longer, rows, 2, deriv=1, delta=period))[half:-half]
    return np.where(np.abs(slope) < STILL, 0.0, slope)
