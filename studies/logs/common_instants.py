"""Channels of a log at common instants, each from its own samples, with a standard deviation.

The instants are those of the wheel with the highest sampling rate. A channel is interpolated linearly between two of its own
samples, over `BRIDGED` or one and a half of its own periods. A longer distance is a gap, and remains one.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from studies.logs.own_samples import Samples

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

BRIDGED = 0.12
"""Time [s] over which straight lines are drawn: a slip grows within some tenths of a second."""
PERIODS = 1.5
"""The same in periods of the channel: one lost sample of a slow channel is a gap."""


class Instants(NamedTuple):
    """Common instants of a log."""

    time: Floats
    """[s], (instants,), growing."""
    part: Numbers
    """Number of the part, from gap to gap, that each belongs to, (instants,)."""


class Series(NamedTuple):
    """A channel at the common instants, (instants,) each; nan where it has no value that can be used."""

    value: Floats
    deviation: Floats
    """Standard deviation: noise and rounding of the samples, and what a straight line between two of them leaves out."""


def longest(period: float) -> float:
    """Time [s] over which a channel with a sample every `period` [s] is interpolated."""
    return max(BRIDGED, PERIODS * period)


def common_instants(times: Iterable[Floats]) -> Instants:
    """The instants of the channel that has most of them; gaps divide them into parts."""
    time = max(times, key=len)
    apart = np.diff(time)
    gap = apart > longest(float(np.median(apart)) if apart.size else 0.0)
    return Instants(time, np.concatenate([[0], np.cumsum(gap)]))


def resample(samples: Samples, time: Floats) -> Series:
    """A channel at `time` [s], (instants,)."""
    t, v = samples.time, samples.value
    if t.size == time.size and np.array_equal(t, time):
        return Series(v, np.broadcast_to(samples.noise, time.shape))
    if t.size < 2:
        return Series(*np.full((2, time.size), np.nan))
    reach = longest(samples.period)
    after = np.clip(np.searchsorted(t, time), 1, t.size - 1)
    step = t[after] - t[after - 1]
    share = np.clip((time - t[after - 1]) / step, 0.0, 1.0)
    value = (1.0 - share) * v[after - 1] + share * v[after]
    bend = np.zeros(t.size)
    bend[1:-1] = np.abs(np.diff(v, 2)) / 8.0  # an arc over a chord
    arc = 4.0 * share * (1.0 - share) * np.maximum(bend[after - 1], bend[after])
    deviation = np.hypot(samples.noise, arc)
    unknown = (share > 0.0) & (share < 1.0) & (step > reach * (1.0 + 1e-9))
    unknown |= (time < t[0] - reach) | (time > t[-1] + reach)
    value[unknown] = deviation[unknown] = np.nan
    return Series(value, deviation)
