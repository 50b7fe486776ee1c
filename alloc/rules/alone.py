"""No redistribution: every unit works alone."""

import numpy as np

from alloc.compilation import jit
from alloc.rules.reach import bounds_allow_plan
from alloc.rules.rule import RULES, Rule


@jit
def alone_law(units, expected, limit_out):
    """Every unit keeps the plan, within its torque limit; only its own readhesion control acts."""
    for j in range(limit_out.size):
        limit_out[j] = min(expected, units.limit_max[j])
    return np.nan, bounds_allow_plan(units.cap, expected, units.mass, units.limit_max)


ALONE = Rule(
    "alone", "every unit keeps the plan and looks after its own slip", law=alone_law,
    colour="#7f7f7f", marker="o",
)  # fmt: skip
RULES.register("alone", ALONE)
