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

from alloc.estimation.finite_series import mean_rate
from alloc.estimation.known_train import MeasuredTrain
from alloc.estimation.long_series import usual_period
from alloc.estimation.own_samples import Samples
from alloc.estimation.speed_fixes import Delay, find_delay
from alloc.estimation.speed_shape import (
    LOCKED,
    filled,
    goes_on,
    locked_share,
    shape_of_forces,
    standing,
    with_locked,
)

Floats = NDArray[np.float64]

DELAYS = np.round(np.arange(-0.5, 1.21, 0.1), 6)
"""Delays of the forces that are tried [s]."""
FINER = (0.04, 0.02)
"""Steps [s] around the best of them."""
AROUND = np.round(np.arange(-0.04, 0.041, 0.008), 6)
"""Delays around it [s] through whose misfits a parabola is laid: noise and drift of each are found on a grid."""
BETTER = 0.4
"""Misfit per measurement by which another reading of the forces must explain the speed better."""
MUCH = 2.0
"""The same, where soft couplers may be the reason."""
TOO_EARLY = 5.0
"""Misfit per measurement for each second by which a speed would be measured before it happens."""
SURE, NEARER = 3.0, 0.3
"""Number of deviations by which it surely is, and share of that time to which another reading must bring it."""
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


class _Shapes:
    """Speeds by the forces of a log, by their delay."""

    def __init__(
        self,
        time: Floats,
        guess: Floats,
        rim: Floats,
        force: Floats,
        train: MeasuredTrain,
        grade: Floats | None,
        at_contact: bool,
    ) -> None:
        # the shape is linear in the forces: that without any, and what they give
        none = np.where(np.isfinite(force), 0.0, force)
        without = shape_of_forces(time, guess, rim, none, train, grade, at_contact)
        assert without is not None
        self.time, self.guess = time, guess
        self.without = np.diff(without, prepend=without[0])
        self.locked = locked_share(guess, rim, force) > LOCKED
        self.mass = float(train.car_mass.sum())
        if not at_contact:
            unknown = ~np.isfinite(rim).any(axis=0)
            self.mass += float((train.inertia / train.radius**2)[unknown].sum())
        self.total = np.zeros(time.size)
        for i in np.flatnonzero(np.isfinite(force).any(axis=0)).tolist():
            self.total += filled(time, force[:, i])
        self.rests = goes_on(standing(guess, rim))

    def __call__(self, late: float) -> Floats:
        moved = np.interp(self.time + late, self.time, self.total)
        given = np.zeros(self.time.size)
        given[1:] = 0.5 * (moved[1:] + moved[:-1]) * np.diff(self.time)
        rise = self.without + np.where(self.rests, 0.0, given) / self.mass
        return with_locked(self.time, self.guess, rise, self.rests, self.locked)


def read_forces(
    time: Floats,
    part: NDArray[np.int64],
    guess: Floats,
    rim: Floats,
    force: Floats,
    train: MeasuredTrain,
    grade: Floats | None,
    fixes: Samples,
    under_way: Floats,
    at_contact: bool | None = None,
) -> ForceReading | None:
    """The reading that explains the measured speed best, the usual one unless another is much better; None without forces.

    Arguments as of `alloc.estimation.train_speed.measured_speed`.
    """
    shape = shape_of_forces(time, guess, rim, force, train, grade, bool(at_contact))
    if shape is None:
        return None
    found = ForceReading(
        0.0, bool(at_contact), shape, find_delay(time, part, shape, fixes, under_way)
    )
    if not _poor(found.delay, fixes):
        return found
    arguments = (time, guess, rim, force, train, grade)
    if at_contact is None:
        other = shape_of_forces(*arguments, at_contact=True)
        assert other is not None
        delay = find_delay(time, part, other, fixes, under_way)
        if explains_more(delay, found.delay):
            found = ForceReading(0.0, True, other, delay)
    if not _poor(found.delay, fixes):
        return found
    # both at once would explain too much: forces that nobody says to be at the contact are late at the rims
    contact = bool(at_contact)
    some = _busiest(force)
    few = (time[some], guess[some], rim[some], force[some])
    seen = (fixes.time >= few[0][0]) & (fixes.time <= few[0][-1])
    shapes = _Shapes(*few, train, None if grade is None else grade[some], contact)
    own = fixes._replace(time=fixes.time[seen], value=fixes.value[seen])
    late, spread = _late(shapes, part[some], own, under_way[some])
    moved = _Shapes(*arguments, contact)(late)
    delay = find_delay(time, part, moved, fixes, under_way)
    delay = delay._replace(deviation=math.hypot(delay.deviation, spread))
    best = ForceReading(late, contact, moved, delay)
    # what happens between two rows looks like a delay too
    least = max(LEAST, usual_period(time))
    if abs(best.late) < least:
        return found
    # a speed that is measured before the train has it is none: then the forces are late
    as_well = best.delay.misfit < found.delay.misfit + BETTER
    as_well &= best.delay.sure >= found.delay.sure
    too_early = as_well and _too_early(found.delay, best.delay)
    if not (too_early or explains_more(best.delay, found.delay)):
        return found
    if too_early or _unlike(found.delay, fixes) or best.delay.misfit < found.delay.misfit - MUCH:
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


def _too_early(found: Delay, other: Delay) -> bool:
    """Whether a reading surely has the speed measured before it happens, and another one has it in time."""
    early = -found.value
    return early > max(LEAST, SURE * found.deviation) and abs(other.value) < NEARER * early


def _poor(delay: Delay, fixes: Samples) -> bool:
    """Whether a reading leaves much of the speed unexplained, or has it measured before it happens."""
    return delay.drift >= POOR or delay.value < -LEAST or _unlike(delay, fixes)


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
    shapes: _Shapes, part: NDArray[np.int64], fixes: Samples, under_way: Floats
) -> tuple[float, float]:
    """The delay of the forces that explains the speed best, and its standard deviation [s]."""

    @cache
    def reading(late: float) -> Delay:
        return find_delay(shapes.time, part, shapes(late), fixes, under_way)

    def misfit(late: float) -> float:
        return reading(late).misfit

    def not_early(late: float) -> float:
        return misfit(late) + TOO_EARLY * max(-reading(late).value - LEAST, 0.0)

    best = min(DELAYS.tolist(), key=not_early)
    for step in FINER:
        best = min((round(best - step, 6), best, round(best + step, 6)), key=not_early)
    near = [round(best + d, 6) for d in AROUND.tolist()]
    curve = np.polynomial.Polynomial.fit(near, [misfit(d) for d in near], 2, domain=[-1, 1])
    bend = float(curve.coef[2])
    spread = FINER[-1]
    if bend > 0.0:
        best = float(np.clip(-0.5 * curve.coef[1] / bend, near[0], near[-1]))
        spread = min(1.0 / math.sqrt(fixes.time.size * bend), spread)
    return min(best, *near, key=misfit), spread  # where the misfit is no parabola
