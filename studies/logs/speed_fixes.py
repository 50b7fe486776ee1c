"""The speed of a train from measurements of it that are late, sparse or lost, such as those of a satellite receiver.

Their delay is the one with the best fit to the shape that the forces, or the wheels, give the speed
(`studies.logs.speed_shape`); between measurements the speed follows the shape. Noise of the measurements and drift of
the shape are maximum-likelihood estimates (`studies.logs.random_slope`).

A delay is visible only where the acceleration changes. A log with constant acceleration throughout gives no information on
it, and the stated deviation of the delay says so.
"""

import math
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from studies.logs.own_samples import Samples
from studies.logs.random_slope import STARTS, Work, likelihood, smoothed

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
Complexes = NDArray[np.complex128]

DELAYS = np.arange(-0.5, 2.51, 0.05)
"""Delays that are tried [s]: a recorder that stamps too early, to a receiver that smooths."""
FIRST = (0.0, 0.25, 0.5, 1.0)
"""Those that noise and drift are first found with [s]."""
NOISES = (0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Standard deviations of a measurement that are tried [m/s]."""
DRIFTS = (0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Drifts that are tried [m/s2 per root second]: from a level line to forces that are half wrong."""
SPARSE = 0.15
"""Time between measurements [s] above which the speed follows the shape between them."""
MEAN_TIME = 0.2
"""Time [s] over which measurements that lie closer are averaged to find their delay."""
MOST = 6_000
"""Largest number of measurements used to find a delay; of a longer series every n-th."""
AROUND = 3.0
"""Time [s] before and after a motion from which on measurements of a train at rest tell nothing of a delay."""
TICK = 0.2
"""Time [s] between two instants of the drift."""
MOST_TURNS = 4
"""Number of times that noise and drift are found anew at a delay that they have improved."""
SYSTEMATIC = 0.002
"""Standard deviation of a delay [s] by errors of the shape, which no number of measurements lessens."""
EARLY = 0.02
"""Time [s] by which a measurement may lie outside of a part and still belong to it."""
END_TIME, FAR = 0.3, 5.0
"""Time [s] over which the shape's slope at an end counts, to continue it, and for how long it is."""
OF_FORCES = "level", "hill", "unsure"
"""What may be known beforehand of the shape by forces or by creeping wheels."""
ROLLING = ("rolling",)
"""The same of the shape by wheels that roll freely."""


class Delay(NamedTuple):
    """How late the measurements are."""

    value: float
    """[s]"""
    deviation: float
    """Its standard deviation [s]."""
    noise: float
    """Of a measurement, as found [m/s]."""
    drift: float
    """Of the shape, as found [m/s2 per root second]."""
    start: str
    """What is known of the shape beforehand, by the likelihood: a name in `studies.logs.random_slope.STARTS`."""
    misfit: float
    """Minus twice the logarithm of the likelihood, per measurement."""

    @property
    def sure(self) -> bool:
        """Whether the shape is right but for 2 % and a gradient."""
        return self.start != "unsure"


class FollowedSpeed(NamedTuple):
    """Speed of the train at all instants, (instants,) each."""

    speed: Floats
    """[m/s]"""
    deviation: Floats
    """Standard deviation [m/s], with that of the delay."""


def find_delay(
    time: Floats,
    part: Numbers,
    shape: Floats,
    fixes: Samples,
    under_way: Floats,
    starts: tuple[str, ...] = OF_FORCES,
    least_noise: float = 0.0,
) -> Delay:
    """Find how late `fixes` are, by a `shape` [m/s] at instants [s] of a number of parts, (instants,) each.

    `under_way` [s]: time for which the train has moved until each instant; the shape drifts while it does. `starts`: what
    may be known of the shape beforehand, names in `studies.logs.random_slope.STARTS`. `least_noise` [m/s]: standard
    deviation that the shape is known to have.
    """
    at, value, width = _averaged(fixes)
    ends = (np.interp(at + s * AROUND, time, under_way) for s in (1.0, -1.0))
    last, first = ends
    if (moves := last > first).any():
        at, value = at[moves], value[moves]
    every = max(-(-at.size // MOST), 1)
    at, value = at[::every], value[::every]
    number = part[np.clip(np.searchsorted(time, at, "right") - 1, 0, time.size - 1)]
    margin = 0.5 * width if width > 0.0 else -EARLY
    average, work = _Average(time, shape, under_way, width), Work.allocate()

    earliest, latest = average.known(margin)

    @cache
    def moved(delay: float) -> tuple[Floats, Floats, Floats]:
        then = at - delay
        use = (then > earliest) & (then < latest)
        there, moving = average(then)
        return moving, there, np.where(use, value, math.nan)

    @cache
    def misfit(delay: float, noise: float, drift: float, known: str) -> float:
        squares = noise**2, drift**2
        found = likelihood(*moved(delay), number, *squares, STARTS[known], *work)
        # those that are left out are neither better nor worse than the others
        return at.size * float(found)

    def of_delays(start: tuple[float, float, str]) -> Floats:
        return np.array([misfit(d, *start) for d in DELAYS.tolist()])

    noises: tuple[float, ...] = NOISES
    if least_noise > NOISES[0]:
        noises = (least_noise, *(noise for noise in NOISES if noise > least_noise))
    drifts = DRIFTS[:1] if starts == ROLLING else DRIFTS  # wheels that roll do not drift
    trials = list(product(noises, drifts, starts))
    decades = product(noises[::2], drifts[::2], starts)
    start = min(decades, key=lambda trial: min(misfit(d, *trial) for d in FIRST))
    delay = float(DELAYS[of_delays(start).argmin()])
    for _ in range(2):
        start = min(trials, key=lambda trial: misfit(delay, *trial))
        delay = float(DELAYS[of_delays(start).argmin()])
    # noise and drift at the best of a grid are those of a delay that is wrong by half a step
    best = math.inf
    for _ in range(MOST_TURNS):
        found = minimize_scalar(
            misfit, args=start, bounds=(delay - 0.05, delay + 0.05), method="bounded",
            options={"xatol": 5e-4},
        )  # fmt: skip
        delay, best = float(found.x), float(found.fun)
        better = min(trials, key=lambda trial: misfit(delay, *trial))
        if better == start:
            break
        start = better
    scores = of_delays(start)
    weight = np.exp(-0.5 * (scores - scores.min()))
    wide = math.sqrt(float(weight @ (DELAYS - delay) ** 2 / weight.sum()))
    step = 0.01
    bend = (misfit(delay + step, *start) + misfit(delay - step, *start) - 2.0 * best) / step**2
    narrow = math.sqrt(2.0 / bend) if bend > 0.0 else wide
    deviation = math.hypot(max(narrow, wide if wide > 0.03 else 0.0), SYSTEMATIC)
    noise, drift, known = start
    return Delay(delay, deviation, noise, drift, known, best / max(at.size, 1))


def follow(
    time: Floats,
    part: Numbers,
    shape: Floats,
    fixes: Samples,
    delay: Delay,
    under_way: Floats,
) -> FollowedSpeed:
    """Speed at all instants, from `fixes` less their `delay`; nan in parts in which there is none. Else as `find_delay`."""
    speed, variance = np.full(time.size, np.nan), np.full(time.size, np.nan)
    at, value, width = _averaged(fixes)
    at = at - delay.value
    margin = 0.5 * width if width > 0.0 else -EARLY
    average = _Average(time, shape, under_way, width)
    bounds = np.flatnonzero(np.diff(part)) + 1
    for begin, end in zip([0, *bounds.tolist()], [*bounds.tolist(), time.size], strict=True):
        inside = slice(begin, end)
        t = time[inside]
        own = (at > t[0] + margin) & (at < t[-1] - margin)
        if not own.any():
            continue
        ticks = np.append(np.arange(t[0], t[-1], TICK), t[-1])
        instants = np.concatenate([ticks, at[own]])
        read = np.concatenate([np.full(ticks.size, np.nan), value[own]])
        order = np.argsort(instants, kind="stable")
        instants, read = instants[order], read[order]
        there, moved = average(instants)
        here = np.where(np.isnan(read), np.interp(instants, t, shape[inside]), there)
        moving = np.where(np.isnan(read), np.interp(instants, t, under_way[inside]), moved)
        start = STARTS[delay.start]
        found, spread = smoothed(
            np.maximum.accumulate(moving), here, read, delay.noise, delay.drift, start
        )
        speed[inside] = shape[inside] + np.interp(t, instants, found - here)
        variance[inside] = np.interp(t, instants, spread)
    rate = np.gradient(np.nan_to_num(speed), time)
    return FollowedSpeed(speed, np.sqrt(variance + (rate * delay.deviation) ** 2))


class _Average:
    """Means of a shape and of the time under way over `width` [s] around any instant, as of measurements; 0: themselves."""

    def __init__(self, time: Floats, shape: Floats, under_way: Floats, width: float) -> None:
        # as one complex series: each instant is then looked up once
        self.rests = bool(under_way[1] == under_way[0]), bool(under_way[-1] == under_way[-2])
        self.time, self.both = _extended(time, shape + 1j * under_way, self.rests)
        self.width = width
        if width > 0.0:
            step = 0.5 * (self.both[1:] + self.both[:-1]) * np.diff(self.time)
            self.both = np.concatenate([[0.0], np.cumsum(step)])

    def known(self, margin: float) -> tuple[float, float]:
        """Between which instants [s] the shape is known: a train at rest was so before, or remains so."""
        first, last = (
            end if rests else end + inside
            for end, rests, inside in zip(
                self.time[[0, -1]], self.rests, (FAR + margin, -FAR - margin), strict=True
            )
        )
        return float(first), float(last)

    def __call__(self, at: Floats) -> tuple[Floats, Floats]:
        if self.width == 0.0:
            found = np.interp(at, self.time, self.both)
        else:
            first, last = (
                np.interp(at + end, self.time, self.both)
                for end in (-0.5 * self.width, 0.5 * self.width)
            )
            found = (last - first) / self.width
        return found.real.copy(), found.imag.copy()


def _averaged(fixes: Samples) -> tuple[Floats, Floats, float]:
    """Instants and values of the measurements, averaged where they lie close, and the time over which they are [s]."""
    count = max(int(MEAN_TIME / fixes.period), 1) if fixes.period < SPARSE else 1
    whole = fixes.value.size // count * count
    at, value = (np.asarray(v[:whole]).reshape(-1, count).mean(axis=1) for v in fixes[:2])
    if count == 1:
        return at, value, 0.0
    near = np.ptp(fixes.time[:whole].reshape(-1, count), axis=1) < 1.5 * MEAN_TIME
    return at[near], value[near], count * fixes.period  # a mean over a gap is none


def _extended(time: Floats, shape: Complexes, rests: tuple[bool, bool]) -> tuple[Floats, Complexes]:
    """Instants and shape with an instant before and after, at the slope that it has there; none where a train rests."""
    first = max(int(np.searchsorted(time, time[0] + END_TIME)), 1)
    last = min(int(np.searchsorted(time, time[-1] - END_TIME)), time.size - 2)
    begins = 0.0 if rests[0] else shape[first] - shape[0]
    ends = 0.0 if rests[1] else shape[-1] - shape[last]
    before = shape[0] - FAR * begins / (time[first] - time[0])
    after = shape[-1] + FAR * ends / (time[-1] - time[last])
    return (
        np.concatenate([[time[0] - FAR], time, [time[-1] + FAR]]),
        np.concatenate([[before], shape, [after]]),
    )
