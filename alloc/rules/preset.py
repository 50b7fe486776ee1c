"""A preset pattern, JP H05-276606 as JP5484215 par. 0007 describes it."""

import numpy as np

from alloc.compilation import jit
from alloc.rules.reach import bounds_allow_plan
from alloc.rules.rule import RULES, Rule

MOVED = 0.1
"""Part of the plan that the pattern moves between the train's ends. Its source names none. A tenth is what the increments
(15) add along 8 motor cars, so the pattern is right for the rail for which it was preset. It is also the best for the
mean of 80 events of the claims (seeds 1000 and 1001, 40 each): of 0.03, 0.06, 0.08, 0.1, 0.12, 0.15, 0.2, 0.25 it uses
most of the bound, both controllers together: 96.04 % under cut-and-ramp, 99.24 % under perturb-observe; 0.15 uses 95.88
and 98.97 %."""


@jit
def preset_law(units, expected, limit_out):
    """A fixed part of the front's effort moved to the rear, whatever happens.

    The limits are linear along the train with the plan as their mean, weighted with mass: of n equal units the foremost has
    (1 - `MOVED`) expected and the rearmost (1 + `MOVED`) expected.
    """
    n = limit_out.size
    reached = bounds_allow_plan(units.cap, expected, units.mass, units.limit_max)
    spacing = 2.0 / (n - 1) if n > 1 else 0.0
    total, moment = 0.0, 0.0
    for j in range(n):
        total += units.mass[j]
        moment += units.mass[j] * spacing * j
    centre = moment / total
    for j in range(n):
        limit_out[j] = min(expected * (1.0 + MOVED * (spacing * j - centre)), units.limit_max[j])
    return np.nan, reached


PRESET = Rule(
    "preset", "a fixed part of the front's effort moved to the rear (JP H05-276606)",
    law=preset_law, always=True, colour="#553900", marker="v",
)  # fmt: skip
RULES.register("preset", PRESET)
