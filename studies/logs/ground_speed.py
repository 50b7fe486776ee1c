"""Speed over ground of a measured run whose log has none, from the rim speeds and forces of its axles, and its error.

The filter of the on-board computers runs over the log (`studies.logs.logged_computers`), followed by a backward smoother
(`studies.logs.speed_smoother`). Gaps restart both.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError
from alloc.onboard.parameters import Onboard, ReferenceSpeed, Sensors
from alloc.onboard.reference_speed import SPEED
from alloc.onboard.state import reference_settings
from alloc.records import ByReference
from studies.logs.known_train import MeasuredTrain
from studies.logs.logged_computers import (
    FilterTrace,
    LoggedSeries,
    logged_equipment,
    logged_memory,
    run_filter,
)
from studies.logs.measured_run import SHORTEST_PART
from studies.logs.speed_smoother import smooth

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = NDArray[np.int64]

LOGGED = ReferenceSpeed(creep=0.02, repeat=500.0)
"""The filter trusts axles at ease less than on board: a log does not state that nobody limits them, and they may creep
together."""
LONGEST_HOLD = 0.2
"""Time [s] for which a missing force counts as unchanged; the estimate ends where it is missing for longer."""
FREE = 2e-3
"""Force over load below which an axle without motor rolls freely."""
UNKNOWN_START = (0.1, 0.03)
"""Deviation of the first speed where no axle rolls freely [m/s], and its part in proportion to the speed."""
COARSE = 0.01
"""Quantum of the speeds [m/s] above which their readings are treated as steps."""
LONGEST_STEP = 2.0
"""Time [s] between two steps above which the speed counts as constant in between."""
MEDIAN_DEVIATION = 1.4826
"""Standard deviation over the median of the magnitude, of normally distributed numbers."""


class GroundSpeed(NamedTuple):
    """Estimated speed over ground, (instants,) each; nan where it is unknown."""

    speed: Floats
    """Speed of the train [m/s]."""
    deviation: Floats
    """Standard deviation stated by the estimator [m/s]."""
    told: Flags
    """Whether an axle measured the speed; otherwise the forces alone predict it."""


def estimate_ground_speed(
    time: Floats,
    part: Numbers,
    rim_speed: Floats,
    applied_force: Floats,
    train: MeasuredTrain,
    grade: Floats | None = None,
    least_noise: float = 0.0,
) -> GroundSpeed:
    """Estimate the speed over ground from the speeds and forces of all axles.

    `time` [s] and `part` (instants,), `rim_speed` [m/s] and `applied_force` [N] (instants, axles) as of `MeasuredRun`, nan
    where unknown; `grade` (instants,), the rise per run at the train; `least_noise` [m/s]: smallest white noise of a rim
    speed, for speeds that were averaged. Raises `EstimationError` where a driven axle has no forces, and if at no instant
    forces and a wheel are known.
    """
    told = np.asarray(np.isfinite(applied_force).any(axis=0))
    _check(told, train)
    held = _held(time, part, applied_force)
    grade = np.zeros(time.size) if grade is None else grade
    known = np.isfinite(held).all(axis=1) & np.isfinite(grade)
    seen = np.isfinite(rim_speed) & (np.isfinite(applied_force) | ~told)
    found = GroundSpeed(
        np.full(time.size, np.nan), np.full(time.size, np.nan), np.zeros(time.size, dtype=bool)
    )
    for stretch in _stretches(known, part):
        begin = stretch.start + int(np.argmax(seen[stretch].any(axis=1)))
        inside = slice(begin, stretch.stop)
        if not seen[begin].any() or inside.stop - begin <= SHORTEST_PART:
            continue
        step = np.diff(time[inside])
        step = np.concatenate([[np.median(step)], step])
        of_stretch = rim_speed[inside], seen[inside], held[inside], told, grade[inside]
        trace, variance = _filtered(step, *of_stretch, train, least_noise)
        for whole, own in zip(found, _smoothed(step, trace, variance), strict=True):
            whole[inside] = own
    if not np.isfinite(found.speed).any():
        raise EstimationError("speed over ground: at no instant are forces and a wheel known")
    return found


def _check(told: Flags, train: MeasuredTrain) -> None:
    """Raise for driven axles without forces, and where there are none at all."""
    lacking = np.flatnonzero((train.driven | ~told.any()) & ~told)
    if lacking.size:
        raise EstimationError(
            f"speed over ground: axle {lacking[0] + 1} has no force; the estimate needs those of all driven axles"
        )


def _held(time: Floats, part: Numbers, force: Floats) -> Floats:
    """Forces with the last value where one is missing for a moment, and 0 for an axle that has none at all."""
    held = force.copy()
    held[:, ~np.isfinite(force).any(axis=0)] = 0.0
    for values in held.T:
        last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(time.size), -1))
        fills = (last >= 0) & (part[last] == part) & (time - time[last] <= LONGEST_HOLD)
        values[fills] = values[last[fills]]
    return held


def _stretches(known: Flags, part: Numbers) -> Iterator[slice]:
    """Stretches of known instants that no gap divides."""
    number = np.where(known, part, -1)
    bounds = np.flatnonzero(np.diff(number)) + 1
    for begin, end in pairwise([0, *bounds.tolist(), number.size]):
        if known[begin]:
            yield slice(begin, end)


def _filtered(
    step: Floats,
    rim: Floats,
    seen: Flags,
    force: Floats,
    told: Flags,
    grade: Floats,
    train: MeasuredTrain,
    least_noise: float,
) -> tuple[FilterTrace, float]:
    """What the filter did in one stretch, and the variance of its speeds by their rounding."""
    # the copies go as this returns: smoothing a long log needs their room
    series = LoggedSeries(
        step, np.ascontiguousarray(rim), np.ascontiguousarray(seen), np.ascontiguousarray(force), told,
        np.ascontiguousarray(grade),
    )  # fmt: skip
    count, axles = rim.shape
    noise, quantum = _sensor_errors(series)
    noise = max(noise, least_noise)
    coarse = quantum if quantum > max(COARSE, 2.0 * noise) else 0.0
    if coarse > 0.0:
        series = series._replace(rim=_between_steps(series))
    onboard = Onboard(
        sensors=Sensors(speed_noise=noise, speed_quantum=quantum), reference=LOGGED
    )  # fmt: skip
    equipment = logged_equipment(train, float(series.step.max()))
    speed, deviation = _first_speed(series, train)
    memory = logged_memory(equipment.chain.mass.size, axles, speed)
    states = (np.zeros((count, 4)), np.zeros((count, 4, 4)))
    trace = FilterTrace(
        *states, states[0].copy(), states[1].copy(), np.zeros(count), np.zeros(count),
        np.zeros(count, dtype=bool),
    )  # fmt: skip
    trace.covariance[0, SPEED, SPEED] = deviation**2
    run_filter(
        *map(ByReference, (equipment, reference_settings(onboard), memory, series, trace))
    )  # fmt: skip
    return trace, coarse**2 / 12.0


def _smoothed(step: Floats, trace: FilterTrace, variance: float) -> tuple[Floats, Floats, Flags]:
    """Speed, its deviation, and whether an axle told it; `variance`: of its own, beyond the filter's."""
    state, covariance = smooth(step, trace)
    # what the smoother had to move the estimate by, beyond what the filter held possible
    moved = (state[:, SPEED] - trace.state[:, SPEED]) ** 2 - 9.0 * trace.covariance[:, SPEED, SPEED]
    variances = covariance[:, SPEED, SPEED] + variance + np.maximum(moved, 0.0)
    return state[:, SPEED] + trace.lead, np.sqrt(variances), trace.told


def _sensor_errors(series: LoggedSeries) -> tuple[float, float]:
    """Noise and quantum of the speeds [m/s], by their second differences and their smallest change."""
    noise, quantum = [0.0], [np.inf]
    for rim, seen in zip(series.rim.T, series.seen.T, strict=True):
        values = rim[seen]
        if values.size > SHORTEST_PART:
            bend = MEDIAN_DEVIATION * np.median(np.abs(np.diff(values, 2)))
            noise.append(float(bend) / math.sqrt(6.0))
            changes = np.abs(np.diff(values))
            quantum.append(float(changes[changes > 1e-9].min(initial=np.inf)))
    least = min(quantum)
    return float(np.median(noise[1:] or noise)), least if np.isfinite(least) else 0.0


def _between_steps(series: LoggedSeries) -> Floats:
    """Rim speeds on straight lines between the instants at which their quantised readings change; others as they are.

    All axles have the same rounding error where they roll, which no mean over them removes.
    """
    time, lines = np.cumsum(series.step), series.rim.copy()
    for rim, line in zip(series.rim.T, lines.T, strict=True):
        change = np.flatnonzero(np.diff(rim) != 0.0)  # nan: both before and after it count
        change = change[np.isfinite(rim[change] + rim[change + 1])]
        for a, b in pairwise(change.tolist()):
            if time[b] - time[a] < LONGEST_STEP and np.isfinite(rim[a + 1 : b + 1]).all():
                ends = 0.5 * (rim[a] + rim[a + 1]), 0.5 * (rim[b] + rim[b + 1])
                at = 0.5 * (time[a] + time[a + 1]), 0.5 * (time[b] + time[b + 1])
                line[a + 1 : b + 1] = np.interp(time[a + 1 : b + 1], at, ends)
    return lines


def _first_speed(series: LoggedSeries, train: MeasuredTrain) -> tuple[float, float]:
    """First speed and its deviation [m/s]: of axles that roll freely, or the bound that the others are."""
    rim, force, seen = series.rim[0], series.force[0], series.seen[0]
    free = seen & ~train.driven & (np.abs(force) < FREE * train.axle_load)
    free &= series.told | (force.sum() > 0.0)
    if free.any():
        return float(np.median(rim[free])), 0.0
    speed = float(rim[seen].min() if force.sum() > 0.0 else rim[seen].max())
    return speed, UNKNOWN_START[0] + UNKNOWN_START[1] * abs(speed)
