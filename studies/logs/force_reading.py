"""What the forces of a log are: at the rims or between wheel and rail, and recorded with the wheels or later.

Forces at the rims, of motors and brakes, accelerate the train and its wheelsets; those between wheel and rail the train
alone. And two computers may record forces and wheels with different delays. The right reading explains how the train's speed
changes; the others do not, where wheels slip or forces change. The measured speed has a delay of its own, which is found
together with them.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import mean_rate, usual_period
from studies.logs.known_train import MeasuredTrain
from studies.logs.own_samples import Samples
from studies.logs.speed_fixes import Delay, find_delay
from studies.logs.speed_shape import (
    LOCKED,
    filled,
    goes_on,
    locked_share,
    shape_of_forces,
    standing,
    with_locked,
)
from studies.logs.train_readings import TrainReadings

Floats = NDArray[np.float64]

DELAYS = np.round(np.arange(-0.5, 1.21, 0.1), 6)
"""Delays of the forces that are tried [s]."""
FINER = (0.06, 0.04, 0.02)
"""Steps [s] around the best of them."""
AROUND = np.round(np.arange(-0.04, 0.041, 0.008), 6)
"""Delays around it [s] through whose misfits a parabola is laid: noise and drift of each are found on a grid."""
BETTER = 0.4
"""Misfit per measurement by which another reading of the forces must explain the speed better."""
MUCH = 2.0
"""The same, where soft couplers may be the reason."""
TOO_EARLY, NOT_BY_WHEELS = 5.0, 20.0
"""Misfit per measurement for each second by which a speed would be measured before it happens, or not when wheels say it."""
FAR = 0.5
"""Misfit per measurement for each second of the delay of the forces: of two that explain as much, the smaller one."""
SURE, NEARER = 3.0, 0.3
"""Number of deviations by which it surely is, and share of that time to which another reading must bring it."""
FINE = 0.04
"""Time between two rows [s] up to which wheels that slip show whether forces act at the rims or at the rail."""
SAMPLED = 0.15
"""Standard deviation of a delay, by forces that are sampled, in periods of theirs beyond one of the wheels."""
MOST = 20_000
"""Rows of a log in which the delay of the forces is looked for."""
LESS = 2.5
"""Ratio of noise or drift by which it must leave less unexplained."""
LEAST = 0.015
"""Delay [s] below which forces are in time."""
POOR = 0.01
"""Drift [m/s2 per root second] or noise [m/s] from which on a reading explains the speed poorly ..."""
UNLIKE = 0.02
"""Drift [m/s2 per root second] from which on a reading contradicts the speed."""
NOISIER = 1.7
"""... if that noise also is so many times that of neighbouring measurements."""


class ForceReading(NamedTuple):
    """What the forces of a log are."""

    late: float
    """Time by which they are recorded later than the wheels [s]; below 0: earlier."""
    at_contact: bool
    """Whether they act between wheel and rail; else at the rims."""
    shape: Floats
    """Speed [m/s] by the forces in time, (instants,), except for a constant."""
    delay: Delay
    """That of the measured speed, with the forces in time; its deviation has what is not known of theirs."""
    perhaps_late: float = 0.0
    """As `late`, where that would explain more but the forces as recorded are not in contradiction to the speed."""
    perhaps_at_contact: bool = False
    """Whether they explain the speed with the train's known mass only if they act between wheel and rail."""


class _Shapes:
    """Speeds by the forces of a log, by their delay."""

    def __init__(self, readings: TrainReadings, guess: Floats, at_contact: bool) -> None:
        time, rim, force, train = readings.time, readings.rim, readings.force, readings.train
        # the shape is linear in the forces: that without any, and what they give
        none = np.where(np.isfinite(force), 0.0, force)
        without = shape_of_forces(readings._replace(force=none), guess, at_contact)
        assert without is not None
        self.time, self.guess = time, guess
        self.without = np.diff(without, prepend=without[0])
        self.locked = locked_share(readings, guess) > LOCKED
        self.mass = float(train.car_mass.sum())
        if not at_contact:
            unknown = ~np.isfinite(rim).any(axis=0)
            self.mass += float((train.inertia / train.radius**2)[unknown].sum())
        self.total = np.zeros(time.size)
        for i in np.flatnonzero(np.isfinite(force).any(axis=0)).tolist():
            self.total += filled(time, force[:, i])
        self.rests = goes_on(standing(readings, guess))

    def __call__(self, late: float) -> Floats:
        moved = np.interp(self.time + late, self.time, self.total)
        given = np.zeros(self.time.size)
        given[1:] = 0.5 * (moved[1:] + moved[:-1]) * np.diff(self.time)
        rise = self.without + np.where(self.rests, 0.0, given) / self.mass
        return with_locked(self.time, self.guess, rise, self.rests, self.locked)


def read_forces(
    readings: TrainReadings,
    guess: Floats,
    fixes: Samples,
    under_way: Floats,
    at_contact: bool | None = None,
    by_wheels: Delay | None = None,
) -> ForceReading | None:
    """The reading that explains the measured speed best, the usual one unless another is much better; None without forces.

    `guess` of the speed [m/s] and time `under_way` [s], (instants,); else as `studies.logs.train_speed.measured_speed`.
    `by_wheels`: how late the speed is by wheels that roll freely; None where none do.
    """
    time, part = readings.time, readings.part
    sampled = 2.0 * SAMPLED * readings.force_period
    clock = _Clock(by_wheels, max(LEAST, usual_period(time), sampled))
    shape = shape_of_forces(readings, guess, bool(at_contact))
    if shape is None:
        return None
    found = ForceReading(
        0.0, bool(at_contact), shape, find_delay(time, part, shape, fixes, under_way)
    )
    if not _poor(found.delay, fixes, clock):
        return found
    if at_contact is None and usual_period(time) <= FINE:
        other = shape_of_forces(readings, guess, at_contact=True)
        assert other is not None
        delay = find_delay(time, part, other, fixes, under_way)
        explains = explains_more(delay, found.delay) and not clock.out_of_time(delay)
        if explains or clock.brings(delay, found.delay):
            found = ForceReading(0.0, True, other, delay)
        elif delay.sure > found.delay.sure and delay.misfit < found.delay.misfit:
            found = found._replace(perhaps_at_contact=True)
    if not _poor(found.delay, fixes, clock):
        return found
    # both at once would explain too much: forces that nobody says to be at the contact are late at the rims
    contact = bool(at_contact)
    some = _busiest(readings.force)
    few = readings.rows(some)
    seen = (fixes.time >= few.time[0]) & (fixes.time <= few.time[-1])
    own = fixes._replace(time=fixes.time[seen], value=fixes.value[seen])
    shapes = _Shapes(few, guess[some], contact)
    late, spread = _late(shapes, few.part, own, under_way[some], clock)
    moved = _Shapes(readings, guess, contact)(late)
    delay = find_delay(time, part, moved, fixes, under_way)
    delay = delay._replace(deviation=math.hypot(delay.deviation, spread))
    best = ForceReading(late, contact, moved, delay)
    if abs(best.late) < clock.least:
        return found
    brings = clock.brings(best.delay, found.delay)
    if not (brings or explains_more(best.delay, found.delay)):
        return found
    if brings or _unlike(found.delay, fixes) or best.delay.misfit < found.delay.misfit - MUCH:
        return best
    # soft couplers delay what the front feels of the forces, too: that is no reason to move them
    return found._replace(perhaps_late=best.late)


def in_time(
    time: Floats, part: NDArray[np.int64], values: Floats, late: float, held: bool = False
) -> Floats:
    """Series (instants, axles) less their delay [s]; nan where that reaches out of a part, or `held` as at its end."""
    moved = np.full_like(values, np.nan)
    bounds = np.flatnonzero(np.diff(part)) + 1
    for begin, end in zip([0, *bounds.tolist()], [*bounds.tolist(), time.size], strict=True):
        t = time[begin:end]
        for i in range(values.shape[1]):
            own = np.interp(t + late, t, values[begin:end, i])
            if not held:
                own[(t + late < t[0]) | (t + late > t[-1])] = np.nan
            moved[begin:end, i] = own
    return moved


def at_rims(
    time: Floats, rim: Floats, force: Floats, train: MeasuredTrain, window: float
) -> Floats:
    """Forces at the rims (instants, axles) of those between wheel and rail: what accelerates the wheelsets comes to them."""
    rotating = train.inertia / train.radius**2
    rates = [mean_rate(time, rim[:, i], window) for i in range(rim.shape[1])]
    return np.asarray(force + rotating * np.stack(rates, axis=1))


class _Clock(NamedTuple):
    """What is known beforehand of the delay of the speed: none is measured before the train has it, and what wheels say."""

    by_wheels: Delay | None
    """By wheels that roll freely; None where none do."""
    least: float
    """Time [s] below which it is none: what happens between two rows looks like a delay too."""

    def off(self, delay: Delay) -> float:
        """By what time [s] a reading of the forces contradicts that."""
        if self.by_wheels is None:
            return max(-delay.value, 0.0)
        return abs(delay.value - self.by_wheels.value)

    def costs(self, delay: Delay) -> float:
        """What that adds to the misfit of a reading."""
        each = TOO_EARLY if self.by_wheels is None else NOT_BY_WHEELS
        return each * max(self.off(delay) - LEAST, 0.0)

    def out_of_time(self, delay: Delay) -> bool:
        """Whether it surely does."""
        wheels = 0.0 if self.by_wheels is None else self.by_wheels.deviation
        return self.off(delay) > max(self.least, SURE * math.hypot(delay.deviation, wheels))

    def brings(self, other: Delay, found: Delay) -> bool:
        """Whether another reading does not, and explains the speed as well as what was `found`."""
        worse = max(BETTER, self.costs(found) if self.by_wheels is not None else 0.0)
        as_well = other.misfit < found.misfit + worse and other.sure >= found.sure
        nearer = self.off(other) < max(NEARER * self.off(found), self.least)
        return as_well and nearer and self.out_of_time(found)


def _poor(delay: Delay, fixes: Samples, clock: _Clock) -> bool:
    """Whether a reading leaves much of the speed unexplained, or has it measured at another time than it happens."""
    early = delay.value < -LEAST or clock.out_of_time(delay)
    return delay.drift >= POOR or early or _unlike(delay, fixes)


def _unlike(delay: Delay, fixes: Samples) -> bool:
    """Whether a reading contradicts the speed: by a drift that no gradient has, by a wrong start, by noise."""
    noisy = delay.noise > max(NOISIER * fixes.noise, POOR)
    return delay.drift >= UNLIKE or not delay.sure or noisy


def explains_more(one: Delay, other: Delay) -> bool:
    """Whether a reading leaves much less unexplained than another: noise, drift, and what is unknown from the start on."""
    less = LESS * one.noise < other.noise or LESS * one.drift < other.drift or one.sure > other.sure
    return one.misfit < other.misfit - BETTER and one.sure >= other.sure and less


def _busiest(force: Floats) -> slice:
    """Of a long log, the rows in which the forces change most: a delay shows there."""
    if len(force) <= MOST:
        return slice(None)
    change = np.abs(np.diff(np.nansum(force, axis=1)))
    pieces = change[: change.size // MOST * MOST].reshape(-1, MOST).sum(axis=1)
    begin = int(pieces.argmax()) * MOST
    return slice(begin, begin + MOST)


def _late(
    shapes: _Shapes,
    part: NDArray[np.int64],
    fixes: Samples,
    under_way: Floats,
    clock: _Clock,
) -> tuple[float, float]:
    """The delay of the forces that explains the speed best, and its standard deviation [s]."""

    @cache
    def reading(late: float) -> Delay:
        return find_delay(shapes.time, part, shapes(late), fixes, under_way)

    def score(late: float) -> float:
        found = reading(late)
        return found.misfit + clock.costs(found) + FAR * abs(late)

    best = min(DELAYS.tolist(), key=score)
    for step in FINER:
        best = min((round(best - step, 6), best, round(best + step, 6)), key=score)
    near = [round(best + d, 6) for d in AROUND.tolist()]
    curve = np.polynomial.Polynomial.fit(near, [score(d) for d in near], 2, domain=[-1, 1])
    bend = float(curve.coef[2])
    spread = FINER[-1]
    if bend > 0.0:
        best = float(np.clip(-0.5 * curve.coef[1] / bend, near[0], near[-1]))
        spread = min(1.0 / math.sqrt(fixes.time.size * bend), spread)
    return min(best, *near, key=score), spread  # where the misfit is no parabola
