"""What holds a unit back beside its own rails: gradient, resistance, and cars that give less or more than their part.

The prediction moves the unit with its share of the train's mass. Its believed rail forces over that mass, less the
acceleration that the reference speed shows, are drag. It changes slowly and is taken for constant over the horizon: as the
gradient that would be felt as much.
"""

from typing import NamedTuple

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.equations import GRAVITY
from alloc.plant.structure import Floats
from mpc.arrays import inlined

DRAG_TIME = 0.5
"""Time [s] over which drag is taken: long against the noise of a differentiated speed, short against a gradient's length."""


class Drag(NamedTuple):
    """What is known of the drag of one unit."""

    share: float
    """Of a new value in the mean, per period."""
    weight: float
    """Of the unit's share of the train [N]."""
    rate: float
    """Control periods per second over gravity."""
    speed: Floats
    """Of the period before [m/s], (1,)."""
    grade: Floats
    """Gradient that stands for all drag, rise per run in the direction of the demand, (1,)."""


def drag_of(context: UnitContext) -> Drag:
    """Drag before anything is known."""
    share = float(-np.expm1(-context.period / DRAG_TIME))
    weight, rate = context.mass * GRAVITY, 1.0 / (context.period * GRAVITY)
    return Drag(share, float(weight), float(rate), np.zeros(1), np.zeros(1))


@inlined
def estimate_drag(drag, axles, load, speed, fresh):
    """Take in the car's speed [m/s] and what its axles feel; `load` [N], (axles,)."""
    if not fresh:
        force = 0.0
        for i in range(load.size):
            force += axles.coefficient[i] * load[i]
        found = force / drag.weight - (speed - drag.speed[0]) * drag.rate
        drag.grade[0] += drag.share * (found - drag.grade[0])
    drag.speed[0] = speed
