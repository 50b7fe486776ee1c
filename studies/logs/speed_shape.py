"""How the speed of a train changes between measurements of it: by the impulse of its forces, or by its wheels.

    M v + sum_i J_i / R_i^2 (R_i omega_i) = integral of (sum_i F_i - resistance - M g grade) dt

So forces and wheel speeds give the speed except for a constant and for what is unknown: gradient, resistance, errors of the
forces. Creep and slides have no effect. An axle that rolls freely turns as the train runs. Without either, the fastest wheel
represents the train under braking and the slowest under traction; creep then counts as the train's motion.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import mean_rate
from alloc.plant.laws import GRAVITY
from studies.logs.known_train import MeasuredTrain
from studies.logs.train_readings import OF_NOISE, STANDING, TrainReadings

Floats = NDArray[np.float64]

NEARLY = 1.0
"""Measured speed [m/s] below which a train whose wheels stand may stand."""
AT_REST = 0.2
"""Measured speed [m/s] below which it surely does: above it, wheels that stand may be locked."""
AFTER = 2.0
"""Time [s] from which on a train whose wheels stand, and whose measured speed is 0, surely is at rest."""
LOCKED = 0.25
"""Share of the forces on wheels that stand, from which on the forces do not tell how the train slows down."""
FREE = 2e-3
"""Force over load below which an axle rolls freely."""
ALWAYS = 0.98
"""Share of the instants at which one must."""
RATE_TIME = 2.0
"""Time [s] over which the train's acceleration distinguishes braking from traction."""


def shape_of_forces(
    readings: TrainReadings, speed: Floats, at_contact: bool = False
) -> Floats | None:
    """Speed [m/s] by the forces, (instants,), except for a constant; None without forces.

    `speed` (instants,) is a first guess, for the resistance alone. `at_contact`: the forces act between wheel and rail, and
    the wheelsets take nothing of them; else at the rims.
    """
    time, rim, force, train = readings.time, readings.rim, readings.force, readings.train
    told = np.isfinite(force).any(axis=0)
    if not told.any():
        return None
    total = np.zeros(time.size)
    for i in np.flatnonzero(told).tolist():
        total += filled(time, force[:, i])
    mass = float(train.car_mass.sum())
    rotating = np.zeros(train.radius.size) if at_contact else train.inertia / train.radius**2
    wheels = np.zeros(time.size)
    for i, inertia in enumerate(rotating):
        if np.isfinite(rim[:, i]).any():
            own = filled(time, rim[:, i])
            wheels += inertia * own
        else:
            mass += float(inertia)
    if train.resistance is not None:
        total -= _resistance(readings, speed, train.resistance)
    if readings.grade is not None:
        total -= train.car_mass.sum() * GRAVITY * np.nan_to_num(readings.grade)
    gained = np.diff(wheels, prepend=wheels[0])
    given = np.zeros(time.size)
    given[1:] = 0.5 * (total[1:] + total[:-1]) * np.diff(time)
    # what holds a train at rest is no less than what pulls it: there its wheels tell how it moves
    stands = standing(readings, speed)
    middle = np.zeros(time.size)
    middle[stands] = _mean_of_cars(rim[stands], train)
    rolled = np.diff(middle, prepend=middle[0])
    rests = goes_on(stands)
    rise = np.where(rests, rolled, (given - gained) / mass)
    return with_locked(time, speed, rise, rests, locked_share(readings, speed) > LOCKED)


def _mean_of_cars(rim: Floats, train: MeasuredTrain) -> Floats:
    """Speed [m/s] of the train's centre of mass by its wheels (instants, axles): one car may move before the others."""
    total, mass = np.zeros(len(rim)), np.zeros(len(rim))
    for car, own in enumerate(train.car_mass):
        wheels = rim[:, train.axle_car == car]
        known = np.isfinite(wheels)
        count = known.sum(axis=1)
        total += own * np.where(known, wheels, 0.0).sum(axis=1) / np.maximum(count, 1)
        mass += own * (count > 0)
    return total / mass


def _resistance(readings: TrainReadings, speed: Floats, by_power: Floats) -> Floats:
    """Running resistance [N] against the motion, (instants,), `by_power` of the speed (cars, 3).

    A car that still stands has none: behind slack couplers, cars start one after another.
    """
    time, size = readings.time, np.abs(speed)
    a, b, c = by_power.sum(axis=0)
    against = np.asarray(a + size * (b + size * c))
    slow = np.flatnonzero(size < NEARLY)
    starts = slow[mean_rate(time, speed, RATE_TIME, at=time[slow]) > 0.0]
    for car, own in enumerate(by_power):
        wheels = np.abs(readings.rim[np.ix_(starts, readings.train.axle_car == car)])
        at = starts[np.isfinite(wheels).any(axis=1) & ~(wheels > readings.still).any(axis=1)]
        against[at] -= own[0] + size[at] * (own[1] + size[at] * own[2])
    return np.where(speed < 0.0, -against, against)  # a train may roll back


def with_locked(
    time: Floats,
    speed: Floats,
    rise: Floats,
    rests: NDArray[np.bool_],
    locked: NDArray[np.bool_],
) -> Floats:
    """Speed [m/s] of which each instant's `rise` is known by the forces but where wheels are `locked`, (instants,) each.

    Their brakes give what the rail carries, which nobody knows: there the measured `speed` goes on, less what the forces
    lack everywhere else while the train does not rest, as a gradient that nobody told.
    """
    if not locked.any():
        return np.asarray(np.cumsum(rise))
    step, gained = np.diff(time, prepend=time[0]), np.diff(speed, prepend=speed[0])
    other = ~(locked | rests)
    lacking = float(np.sum((gained - rise)[other])) / max(float(np.sum(step[other])), 1e-9)
    return np.asarray(np.cumsum(np.where(locked, gained - lacking * step, rise)))


def locked_share(readings: TrainReadings, speed: Floats) -> Floats:
    """Share of all forces that act on wheels that stand while the train moves, (instants,)."""
    rim, force = readings.rim, readings.force
    moving, at_rest, total = speed > NEARLY, np.zeros(speed.size), np.zeros(speed.size)
    for i in range(rim.shape[1]):  # axle by axle: a long log has little room for more of its kind
        own = np.nan_to_num(np.abs(force[:, i]))
        total += own
        at_rest += np.where(moving & (np.abs(rim[:, i]) < STANDING), own, 0.0)
    return at_rest / np.maximum(total, 1e-9)


def shape_of_wheels(readings: TrainReadings, speed: Floats) -> Floats:
    """Speed [m/s] by the wheels, (instants,): the fastest wheel under braking, the slowest under traction."""
    time, rim = readings.time, readings.rim
    known = rim[:, np.isfinite(rim).any(axis=0)]
    fastest, slowest = (
        filled(time, _extreme(known, np.fmax)),
        filled(time, _extreme(known, np.fmin)),
    )
    rate = mean_rate(time, speed, RATE_TIME)
    # a step from one to the other would be a change of speed: what counts is how both change
    share = np.clip(0.5 - rate / 0.2, 0.0, 1.0)
    middle = 0.5 * (share[1:] + share[:-1])
    gained = middle * np.diff(fastest) + (1.0 - middle) * np.diff(slowest)
    return np.concatenate([[fastest[0]], fastest[0] + np.cumsum(gained)])


def rolls_always(force: Floats, load: Floats) -> NDArray[np.bool_]:
    """Which axles nothing pulls or brakes, (axles,); `force` (instants, axles) and `load` (axles,) [N]."""
    free = [np.mean(np.abs(force[:, i]) < FREE * one) > ALWAYS for i, one in enumerate(load)]
    return np.array(free, dtype=bool)


class FreeWheels(NamedTuple):
    """What axles say that nothing pulls or brakes."""

    speed: Floats
    """Of the train [m/s], (instants,)."""
    noise: float
    """Standard deviation that it is known to have, by errors of the wheels that last [m/s]."""


def free_wheels(readings: TrainReadings) -> FreeWheels | None:
    """Speed by axles that nothing pulls or brakes; None unless one nearly always rolls freely."""
    time, rim, load = readings.time, readings.rim, readings.train.axle_load
    count, gained = np.zeros(time.size - 1), np.zeros(time.size - 1)
    number, total = np.zeros(time.size), np.zeros(time.size)
    for i in range(rim.shape[1]):
        free = np.isfinite(rim[:, i]) & (np.abs(readings.force[:, i]) < FREE * load[i])
        if free.any():
            number += free
            total += np.where(free, rim[:, i], 0.0)
            both = free[1:] & free[:-1]
            count += both
            gained += np.where(both, np.diff(rim[:, i]), 0.0)
    known = count > 0.0
    if np.mean(known) < ALWAYS:
        return None
    gained[known] /= count[known]
    gained[~known] = np.interp(time[1:][~known], time[1:][known], gained[known])
    shape = np.concatenate([[0.0], np.cumsum(gained)])
    # not their mean: it jumps where one more rolls freely, whose radius differs
    rolls = number > 0.0
    shape += np.median(total[rolls] / number[rolls] - shape[rolls])
    lasting = readings.rim_noise if readings.rim_span > 0.0 else 0.0
    return FreeWheels(shape, lasting / math.sqrt(float(np.median(number[rolls]))))


def _extreme(rim: Floats, choose: np.ufunc) -> Floats:
    return np.asarray(choose.reduce(rim, axis=1))


def standing(readings: TrainReadings, speed: Floats) -> NDArray[np.bool_]:
    """Where a train stands, (instants,): it was slow, and no wheel turns; one at least must say so."""
    fastest = np.full(speed.size, -np.inf)
    for i in range(readings.rim.shape[1]):
        np.fmax(fastest, np.abs(readings.rim[:, i]), out=fastest)
    return np.asarray((fastest >= 0.0) & (fastest < readings.still) & (speed < NEARLY))


def goes_on(stands: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where a train stands as it did an instant before, (instants,): its wheels tell what it gained in between."""
    return np.concatenate([[False], stands[1:] & stands[:-1]])


def middle_speed(rim: Floats) -> Floats:
    """Median speed of the wheels [m/s], (instants,); nan where none is known. `rim` (instants, axles)."""
    finite = np.isfinite(rim)
    if finite.all():  # in a third of the time
        return np.asarray(np.median(rim, axis=1))
    known, middle = finite.any(axis=1), np.full(len(rim), np.nan)
    middle[known] = np.nanmedian(rim[known], axis=1)
    return middle


class Motion(NamedTuple):
    """When a train moves, as far as its wheels and a measured speed that may be late say it, (instants,) each."""

    under_way: Floats
    """Time [s] for which it has moved until each instant."""
    unclear: NDArray[np.bool_]
    """Where it may stand, or move with all wheels locked."""


def motion_of(readings: TrainReadings, speed: Floats, noise: float = 0.0) -> Motion:
    """When a train moves, by its wheels and a measured `speed` [m/s], (instants,), whose values have this `noise`."""
    time = readings.time
    still, slow = standing(readings, speed), speed < AT_REST
    under_way = np.concatenate([[0.0], np.cumsum(np.diff(time) * ~(still & slow)[1:])])
    # a speed that noise alone may give a train at rest does not make its rest unclear
    unclear = still & (speed > min(readings.still + OF_NOISE * noise, AT_REST))
    since = time - np.maximum.accumulate(np.where(unclear, time, -np.inf))
    return Motion(under_way, still & (since < AFTER))


def filled(time: Floats, values: Floats) -> Floats:
    """A series without nan: straight lines over what is missing."""
    known = np.isfinite(values)
    return values if known.all() else np.interp(time, time[known], values[known])
