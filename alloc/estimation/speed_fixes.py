"""The speed of a train from measurements of it that are late, rare or lost, such as those of a satellite receiver.

How late they are is what makes them fit best to the shape that the forces, or the wheels, give the speed
(`alloc.estimation.speed_shape`); between them the shape is followed. Noise of the measurements and drift of the shape are
those of the greatest likelihood (`alloc.estimation.random_slope`).

A delay shows where the acceleration changes. A log with one and the same acceleration throughout does not have it, and the
stated deviation of the delay says so.
"""

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from alloc.estimation.own_samples import Samples
from alloc.estimation.random_slope import STARTS, Work, likelihood, smoothed

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

DELAYS = np.arange(-0.5, 2.51, 0.05)
"""Delays that are tried [s]: a recorder that stamps too early, to a receiver that smooths."""
NOISES = (0.002, 0.006, 0.02, 0.06, 0.2)
"""Standard deviations of a measurement that are tried [m/s]."""
DRIFTS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Drifts that are tried [m/s2 per root second]: from a level line to forces that are half wrong."""
SPARSE = 0.15
"""Time between measurements [s] from which on the shape is followed between them."""
MEAN_TIME = 0.2
"""Time [s] over which measurements that lie closer are averaged to find their delay."""
MOST = 20_000
"""Measurements that a delay is found from; of more, every so many."""
TICK = 0.2
"""Time [s] between two instants of the drift."""
END_TIME = 0.3
"""Time [s] over which the shape's slope at an end counts, to continue it."""


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
    misfit: float
    """Minus twice the logarithm of the likelihood, per measurement."""


class FollowedSpeed(NamedTuple):
    """Speed of the train at all instants, (instants,) each."""

    speed: Floats
    """[m/s]"""
    deviation: Floats
    """Standard deviation [m/s], with that of the delay."""


def find_delay(time: Floats, part: Numbers, shape: Floats, fixes: Samples) -> Delay:
    """Find how late `fixes` are, by a `shape` [m/s] at instants [s] of a number of parts, (instants,) each."""
    at, value = _averaged(fixes)
    number = part[np.clip(np.searchsorted(time, at, "right") - 1, 0, time.size - 1)]
    reach, work = _extended(time, shape), Work.allocate()

    def misfit(delay: float, noise: float, drift: float) -> float:
        read = value.copy()
        moved = at - delay
        use = (moved > time[0] - 0.02) & (moved < time[-1] + 0.02)
        read[~use] = math.nan
        return float(
            likelihood(moved, np.interp(moved, *reach), read, number, noise**2, drift**2, STARTS, *work)
        )

    trials = list(product(NOISES, DRIFTS))
    coarse = DELAYS[::5]
    start = min(trials, key=lambda pair: min(misfit(d, *pair) for d in coarse[:6]))
    scores = np.array([misfit(d, *start) for d in DELAYS])
    delay = float(DELAYS[scores.argmin()])
    for _ in range(2):
        start = min(trials, key=lambda pair: misfit(delay, *pair))
        scores = np.array([misfit(d, *start) for d in DELAYS])
        delay = float(DELAYS[scores.argmin()])
    found = minimize_scalar(
        lambda d: misfit(d, *start), bounds=(delay - 0.05, delay + 0.05), method="bounded",
        options={"xatol": 5e-4},
    )  # fmt: skip
    delay, best = float(found.x), float(found.fun)
    weight = np.exp(-0.5 * (scores - scores.min()))
    wide = math.sqrt(float(weight @ (DELAYS - delay) ** 2 / weight.sum()))
    step = 0.01
    bend = (misfit(delay + step, *start) + misfit(delay - step, *start) - 2.0 * best) / step**2
    narrow = math.sqrt(2.0 / bend) if bend > 0.0 else wide
    deviation = max(narrow, wide if wide > 0.03 else 0.0)
    return Delay(delay, deviation, *start, best / max(at.size, 1))


def follow(
    time: Floats, part: Numbers, shape: Floats, fixes: Samples, delay: Delay
) -> FollowedSpeed:
    """Speed at all instants, from `fixes` less their `delay`; nan in parts in which there is none."""
    speed, variance = np.full(time.size, np.nan), np.full(time.size, np.nan)
    at, value = fixes.time - delay.value, fixes.value
    bounds = np.flatnonzero(np.diff(part)) + 1
    for begin, end in zip([0, *bounds.tolist()], [*bounds.tolist(), time.size], strict=True):
        inside = slice(begin, end)
        t = time[inside]
        own = (at > t[0] - 0.02) & (at < t[-1] + 0.02)
        if not own.any():
            continue
        ticks = np.append(np.arange(t[0], t[-1], TICK), t[-1])
        instants = np.concatenate([ticks, at[own]])
        read = np.concatenate([np.full(ticks.size, np.nan), value[own]])
        order = np.argsort(instants, kind="stable")
        instants, read = instants[order], read[order]
        here = np.interp(instants, t, shape[inside])
        found, spread = smoothed(instants, here, read, delay.noise, delay.drift)
        speed[inside] = shape[inside] + np.interp(t, instants, found - here)
        variance[inside] = np.interp(t, instants, spread)
    rate = np.gradient(np.nan_to_num(speed), time)
    return FollowedSpeed(speed, np.sqrt(variance + (rate * delay.deviation) ** 2))


def _averaged(fixes: Samples) -> tuple[Floats, Floats]:
    """Instants and values of the measurements, averaged where they lie close."""
    count = max(int(MEAN_TIME / fixes.period), 1) if fixes.period < SPARSE else 1
    whole = fixes.value.size // count * count
    at, value = (np.asarray(v[:whole]).reshape(-1, count).mean(axis=1) for v in fixes[:2])
    if count > 1:  # a mean over a gap is none
        near = np.ptp(fixes.time[:whole].reshape(-1, count), axis=1) < 1.5 * MEAN_TIME
        at, value = at[near], value[near]
    every = max(-(-at.size // MOST), 1)
    return at[::every], value[::every]


def _extended(time: Floats, shape: Floats) -> tuple[Floats, Floats]:
    """Instants and shape with an instant before and after, at the slope that it has there."""
    first = int(np.searchsorted(time, time[0] + END_TIME))
    last = int(np.searchsorted(time, time[-1] - END_TIME))
    far = 5.0
    before = shape[0] - far * (shape[first] - shape[0]) / (time[first] - time[0])
    after = shape[-1] + far * (shape[-1] - shape[last]) / (time[-1] - time[last])
    return (
        np.concatenate([[time[0] - far], time, [time[-1] + far]]),
        np.concatenate([[before], shape, [after]]),
    )
