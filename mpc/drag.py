"""Forces that hold a unit back beside those of its own rails: gradient, resistance, and deviations of the other cars.

The prediction moves the unit with its share of the train's mass. Drag is its believed rail forces over that mass, less the
acceleration of the reference speed. It changes slowly and is assumed to be constant over the horizon, as an equivalent
gradient.
"""

from typing import NamedTuple

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.equations import GRAVITY
from alloc.plant.structure import Floats
from mpc.arrays import inlined

DRAG_TIME = 0.5
"""Averaging time [s] of drag: long against the noise of a differentiated speed, short against a gradient's length."""


class Drag(NamedTuple):
    """Estimate of the drag of one unit."""

    share: float
    """Weight of a new value in the mean, per period."""
    weight: float
    """Weight of the unit's share of the train [N]."""
    rate: float
    """Control periods per second over gravity."""
    speed: Floats
    """Speed of the period before [m/s], (1,)."""
    grade: Floats
    """Gradient equivalent to all drag, rise per run in the direction of the demand, (1,)."""


def drag_of(context: UnitContext) -> Drag:
    """Drag before any reading."""
    share = float(-np.expm1(-context.period / DRAG_TIME))
    weight, rate = context.mass * GRAVITY, 1.0 / (context.period * GRAVITY)
    return Drag(share, float(weight), float(rate), np.zeros(1), np.zeros(1))


@inlined
def estimate_drag(drag, axles, load, speed, fresh):
    """Use the car's speed [m/s] and the coefficients of its axles; `load` [N], (axles,)."""
    if not fresh:
        force = 0.0
        for i in range(load.size):
            force += axles.coefficient[i] * load[i]
        found = force / drag.weight - (speed - drag.speed[0]) * drag.rate
        drag.grade[0] += drag.share * (found - drag.grade[0])
    drag.speed[0] = speed
