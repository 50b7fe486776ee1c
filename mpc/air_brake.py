"""What the air brake of a unit gives, as far as the unit knows it.

The unit's own estimate of its tangential coefficient knows of the shoes (`alloc.onboard.sensing`), that of the motors alone
does not. The difference is the coefficient of the air brake. Both estimates answer the swing of the slip a little
differently, and both are noisy, so it is smoothed. Its force changes slowly and is taken for constant over the horizon.
"""

import math
from typing import NamedTuple

import numpy as np

from alloc.plant.structure import Floats
from mpc.arrays import inlined

AIR_TIME = 0.2
"""Time [s] over which the difference is taken: that of a swing, and short against the filling of a brake cylinder."""
LEAST_AIR = 0.01
"""Coefficient from which on it is believed."""


class AirBrake(NamedTuple):
    """What is known of the air brake of one unit."""

    share: float
    """Of a new value in the mean, per period."""
    mean: Floats
    """Mean difference, (1,)."""
    coefficient: Floats
    """Coefficient of the air brake, in the direction of the demand, (1,)."""


def air_brake_of(period: float) -> AirBrake:
    """A brake that is released."""
    return AirBrake(-math.expm1(-period / AIR_TIME), np.zeros(1), np.zeros(1))


@inlined
def hear_air_brake(air, axles, estimate):
    """Take in the unit's `estimate` of its coefficient, nan: it has none, and add the air brake to what the axles feel."""
    mean = 0.0
    for i in range(axles.coefficient.size):
        mean += axles.coefficient[i] / axles.coefficient.size
    if math.isnan(estimate):
        air.mean[0] = 0.0
    else:
        air.mean[0] += air.share * (estimate - mean - air.mean[0])
    air.coefficient[0] = air.mean[0] if air.mean[0] > LEAST_AIR else 0.0
    for i in range(axles.coefficient.size):
        axles.coefficient[i] += air.coefficient[0]
