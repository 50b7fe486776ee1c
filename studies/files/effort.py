"""Tractive or braking effort given as a table over speed, as published curves are, and the torque limit that follows."""

import math
from collections.abc import Sequence

import numpy as np

from alloc.plant.train import EFFORT_TABLE_LENGTH, TorqueLimit


def effort_limit(
    speeds_kmh: Sequence[float],
    efforts: Sequence[float],
    radius: float,
    gear_ratio: float,
    motors: int,
) -> TorqueLimit:
    """Limit of each of `motors` motors that together have these efforts [N] at the rims of wheels of `radius` [m].

    Linear between the given speeds [km/h]; before the first and beyond the last the nearest effort applies.
    """
    speed = np.arange(min(EFFORT_TABLE_LENGTH, math.ceil(speeds_kmh[-1]) + 1))
    torque = radius / (gear_ratio * motors) * np.interp(speed, speeds_kmh, efforts)
    return TorqueLimit(peak=float(torque[0]), power=0.0, table=tuple(torque.tolist()))
