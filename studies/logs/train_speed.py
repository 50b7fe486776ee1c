"""The measured speed of a train at the instants of its wheels: as it stands, or from measurements that are late or rare."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import usual_period
from studies.logs.common_instants import resample
from studies.logs.force_reading import SAMPLED, ForceReading, read_forces
from studies.logs.own_samples import Samples
from studies.logs.speed_fixes import SPARSE, Delay, find_delay, follow
from studies.logs.speed_shape import LOCKED, free_wheels, locked_share, motion_of, shape_of_wheels
from studies.logs.train_readings import TrainReadings

Floats = NDArray[np.float64]

SURE = 3.0
"""Number of deviations above which a delay is not due to chance."""
LATE, LATE_OF_MEANS = 0.006, 0.02
"""Delay [s] from which on a dense speed is followed less its delay; the second where wheels are means over a time."""
ROWS = 0.6
"""The same in periods of the wheels."""
LATE_OF_SHAPE, UNLIKE = 0.1, 0.02
"""The same [s] where the speed is not that of the shape, by a drift from this on [m/s2 per root second]."""
NOISY = 0.03
"""Standard deviation of a measurement [m/s] above which the speed follows the shape."""
OF_FREE_WHEELS = {"rolling": "free wheels", "unsure": "free wheels but for an offset"}
"""What may be known beforehand of the shape by free wheels, and its name then."""
PENALTY = {"free wheels": 0.0, "forces": 0.5, "free wheels but for an offset": 1.0, "wheels": 1.0}
"""Misfit per measurement that is added to that of a shape: free wheels are right, and creep looks like a delay."""
AGAIN = 0.05
"""Delay [s] from which on, if wheels lock, it is found again with a first guess of the speed that is in time."""
FEWEST = 3
"""Measurements of which a delay is found."""
LOST = 1.0
"""Distance [m/s] between the measurements and a speed that follows them, in the middle, from which on it does not."""
OF_COUPLERS = 0.006
"""Standard deviation of a delay [s] by the forces of a train whose couplers give way."""
SLACK, OF_SLACK = 0.03, 0.05
"""Noise of a speed by wheels that roll freely that slack couplers make at a start [m/s], and what it leaves open of the
delay of a rare speed [s]."""
UNKNOWN = 0.3
"""Standard deviation [m/s] above which a speed counts as unknown."""


@dataclass(frozen=True, eq=False)
class MeasuredSpeed:
    """Speed of the train, (instants,)."""

    speed: Floats
    """[m/s]; nan where not known."""
    deviation: Floats
    """Standard deviation [m/s]."""
    delay: Delay | None
    """Delay of the measurements; None if it cannot be determined."""
    followed: bool
    """Whether the speed is that of the shape between measurements, else it is as measured."""
    shape: str
    """Of what the shape was: forces, free wheels or wheels."""
    forces: ForceReading | None = None
    """What the forces are, as far as the speed says it; None without forces."""


def measured_speed(
    readings: TrainReadings,
    fixes: Samples,
    least_delay: float = LATE,
    at_contact: bool | None = None,
) -> MeasuredSpeed:
    """Speed at the instants of the wheels from `fixes` [m/s].

    `least_delay` [s]: one that is made up for where the measurements are dense. What they leave out for long is followed.
    `at_contact`: whether the forces act between wheel and rail; None: as the speed says.
    """
    time, part = readings.time, readings.part
    plain = resample(fixes, time)
    if fixes.time.size < FEWEST:
        return MeasuredSpeed(*plain, None, False, "")
    best = _best_shape(readings, fixes, at_contact)
    if abs(best.delay.value) > AGAIN and _some_locked(readings, fixes):
        best = _best_shape(readings, fixes, at_contact, best.delay.value)
    name, delay, reading, moving = best.name, best.delay, best.forces, best.under_way
    rows = usual_period(time)
    if name == "forces":
        # between its samples a force is not known, and what it does there comes early or late
        sampled = SAMPLED * max(readings.force_period - rows, 0.0)
        # and what couplers do to a car is no motion of the train
        coupled = 0.0 if readings.train.coupler is None else OF_COUPLERS
        delay = delay._replace(deviation=math.hypot(delay.deviation, sampled, coupled))
    # what happens between two rows, and what the shape does not follow, looks like a delay too
    of_rows = ROWS * rows
    of_shape = LATE_OF_SHAPE if delay.drift > UNLIKE else 0.0
    late = abs(delay.value) > max(least_delay, SURE * delay.deviation, of_rows, of_shape)
    sparse = fixes.kind in ("quantised", "interpolated") or fixes.period >= SPARSE
    as_measured = not (sparse or late or fixes.noise > NOISY)
    lacking = ~np.isfinite(plain.value)
    if as_measured and not lacking.any():
        return MeasuredSpeed(*plain, delay, False, name, reading)
    used = delay if late or sparse else delay._replace(value=0.0)
    if reading is not None and name == "forces":
        unsure = math.hypot(used.deviation, reading.perhaps_late)
        used = used._replace(deviation=unsure)
    speed, deviation = follow(time, part, best.shape, fixes, used, moving)
    apart = np.abs(np.interp(fixes.time - used.value, time, speed) - fixes.value)
    if np.nanmedian(apart) > LOST:  # the shape misled: better late than wrong
        return MeasuredSpeed(*plain, delay, False, name, reading)
    if as_measured:
        speed[~lacking], deviation[~lacking] = plain.value[~lacking], plain.deviation[~lacking]
    else:
        delay = used
    by_delay = np.gradient(np.nan_to_num(speed), time) * delay.deviation
    # where measurements are far apart nothing tells the speed; a delay that is not known is stated instead
    speed[deviation**2 - by_delay**2 > UNKNOWN**2] = np.nan
    return MeasuredSpeed(speed, deviation, delay, not as_measured, name, reading)


class _BestShape(NamedTuple):
    """The shape to which the measurements fit best."""

    name: str
    shape: Floats
    delay: Delay
    forces: ForceReading | None
    under_way: Floats


def _best_shape(
    readings: TrainReadings, fixes: Samples, at_contact: bool | None, late: float = 0.0
) -> _BestShape:
    """By a first guess of the speed, its measurements less a delay `late` [s]."""
    time = readings.time
    guess = np.interp(time, fixes.time - late, fixes.value)
    moving, unclear = motion_of(readings, guess, fixes.noise)
    clear, part = clear_of_rest(readings, unclear, fixes, late)
    shape = shape_of_wheels(readings, guess)
    found = {"wheels": (shape, find_delay(time, part, shape, clear, moving))}
    rolling = free_wheels(readings)
    if rolling is not None:
        for start, name in OF_FREE_WHEELS.items():
            delay = find_delay(time, part, rolling.speed, clear, moving, (start,), rolling.noise)
            found[name] = rolling.speed, delay
    told = _told_by_wheels({name: delay for name, (_, delay) in found.items()}, fixes)
    reading = read_forces(readings._replace(part=part), guess, clear, moving, at_contact, told)
    if reading is not None:
        found["forces"] = reading.shape, reading.delay
    name = min(found, key=lambda n: found[n][1].misfit + PENALTY[n])
    return _BestShape(name, *found[name], reading, moving)


def _told_by_wheels(found: dict[str, Delay], fixes: Samples) -> Delay | None:
    """The delay by wheels that roll freely, where they turn as the train runs but for slack; None where none do."""
    rolling, unsure = (found.get(name) for name in OF_FREE_WHEELS.values())
    if rolling is None or unsure is None or rolling.noise > SLACK:
        return None
    if fixes.period < SPARSE or rolling.misfit < unsure.misfit:
        return rolling
    # slack that runs out is all that a few measurements see of a start
    return rolling._replace(deviation=math.hypot(rolling.deviation, OF_SLACK))


def _some_locked(readings: TrainReadings, fixes: Samples) -> bool:
    """Whether the measured speed itself is part of the shape, where wheels are locked."""
    guess = np.interp(readings.time, fixes.time, fixes.value)
    return bool((locked_share(readings, guess) > LOCKED).any())


def clear_of_rest(
    readings: TrainReadings, unclear: NDArray[np.bool_], fixes: Samples, late: float = 0.0
) -> tuple[Samples, NDArray[np.int64]]:
    """Measurements without those at which a train may stand or slide on locked wheels, and parts that begin anew after.

    `unclear` (instants,) as of `Motion`; `late` [s]: how late the measurements are.
    """
    time, part = readings.time, readings.part
    own = np.clip(np.searchsorted(time, fixes.time - late, "right") - 1, 0, time.size - 1)
    keep = ~unclear[own]
    if keep.all() or keep.sum() < FEWEST:
        return fixes, part
    changes = np.diff(unclear, prepend=unclear[0])
    clear = fixes._replace(time=fixes.time[keep], value=fixes.value[keep])
    return clear, part + np.cumsum(changes)
