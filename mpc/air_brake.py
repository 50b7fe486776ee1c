"""Estimate of the force of a unit's air brake, from what the unit can observe.

The unit's own estimate of its tangential coefficient includes the shoes (`alloc.onboard.sensing`); the estimate from the
motors alone does not. The difference is the coefficient of the air brake. The two estimates respond to the oscillation of
the slip a little differently, and both are noisy, so the difference is smoothed. The brake's force changes slowly and is
assumed to be constant over the horizon.
"""

import math
from typing import NamedTuple

import numpy as np

from alloc.plant.structure import Floats
from mpc.arrays import inlined

AIR_TIME = 0.2
"""Averaging time [s] of the difference: one period of the swing, short compared with the filling of a brake cylinder."""
LEAST_AIR = 0.01
"""Coefficient above which it is believed."""


class AirBrake(NamedTuple):
    """Estimate of the air brake of one unit."""

    share: float
    """Weight of a new value in the mean, per period."""
    mean: Floats
    """Mean difference, (1,)."""
    coefficient: Floats
    """Coefficient of the air brake, in the direction of the demand, (1,)."""


def air_brake_of(period: float) -> AirBrake:
    """A brake that is released."""
    return AirBrake(-math.expm1(-period / AIR_TIME), np.zeros(1), np.zeros(1))


@inlined
def hear_air_brake(air, axles, estimate):
    """Use the unit's `estimate` of its coefficient, nan if it has none, and add the air brake to the axles' coefficients."""
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
