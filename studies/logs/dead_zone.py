"""Wheel sensors that say 0 below a speed: no wheel ever turns slower, and wheels that roll seem to jump to it."""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import spans
from studies.logs.checks import STILL
from studies.logs.remarks import Remark

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LEAST = 0.2
"""Speed [m/s] from which on it matters that a sensor leaves slower ones out."""
NEAR, SHARE, FEWEST = 1.25, 0.3, 4
"""Ratio to the slowest jump up to which others are like it; share and number of them that are, if a sensor makes them and
not wheels that lock, which stop from any speed."""
ROLLS = 1.2
"""Ratio of the train's speed to that bound up to which a wheel at 0 may roll."""


def filled_dead_zone(
    names: dict[int, str], speed: Floats, rim: Floats
) -> tuple[Flags | None, list[Remark]]:
    """Where wheels at 0 may roll, (instants, axles): they get the train's speed there, in place. None: all speeds are told.

    `speed` of the train (instants,) and `rim` (instants, axles) [m/s]. What slips there nobody knows: it is to be left out
    as soon as the speed has been found.
    """
    wheels = [
        rim[:, number - 1] for number in names
    ]  # one by one: a long log has little room for more of its kind
    sizes = np.concatenate([np.zeros(0), *map(_jumps, wheels)])
    if sizes.size < FEWEST or (bound := float(sizes.min())) < LEAST:
        return None, []
    alike = np.count_nonzero(sizes < NEAR * bound)
    if alike < max(FEWEST, SHARE * sizes.size) or min(map(_slowest, wheels)) < bound:
        return None, []
    unknown = np.zeros(rim.shape, dtype=bool)
    slow = ~(speed > ROLLS * bound)
    rolls = slow & (speed > STILL)
    for number in names:
        own = rim[:, number - 1]
        for begin, end in spans(np.abs(own) <= STILL).tolist():
            if slow[begin]:  # else it locked, and has stood since
                unknown[begin:end, number - 1] = rolls[begin:end]
        own[unknown[:, number - 1]] = speed[unknown[:, number - 1]]
    text = f"all wheels say 0 below {bound:.2g} m/s: unknown there while the train moves"
    return unknown, [Remark("stuck", "axleN_speed", text)]


def _jumps(rim: Floats) -> Floats:
    """Speeds [m/s] from which a wheel jumps to 0, or to which it does from there."""
    size = np.abs(rim)
    stands = size <= STILL
    change = np.flatnonzero(stands[1:] != stands[:-1])
    sizes = np.maximum(size[change], size[change + 1])
    return np.asarray(sizes[np.isfinite(sizes)])


def _slowest(rim: Floats) -> float:
    """The least speed of a wheel while it turns [m/s]."""
    size = np.abs(rim)
    return float(np.min(size, where=size > STILL, initial=np.inf))
