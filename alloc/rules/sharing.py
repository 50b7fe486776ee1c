"""Dynamic sharing, JP 4225233 as JP5484215 par. 0007 and 0009 describe it."""

import numpy as np

from alloc.compilation import jit
from alloc.rules.reach import bounds_allow_plan
from alloc.rules.rule import RULES, Rule

GAIN = 0.15
"""Share of the shortfall handed on per telegram; its source names none. With `TOLERANCE` it was tuned on 80 events of the
claims (seeds 1000 and 1001, 40 each), over 0.05, 0.1, 0.15, 0.25, 0.5 and tolerances of 0.5, 1, 2, 4, 8 %. Of all 25
pairs this one uses most of the bound, both controllers together: 96.25 % under cut-and-ramp, 99.20 % under
perturb-observe. A gain of 0.25 with 2 % uses 96.04 and 99.11 %, with 2.3 axle s less slip under the former and 1.8 axle s
more under the latter."""
TOLERANCE = 0.04
"""Shortfall, as a share of the plan, that counts as none; see `GAIN`."""


@jit
def sharing_law(units, expected, limit_out):
    """One step; call it with every telegram.

    A unit is short if it delivers less than its limit by more than `TOLERANCE` of the plan. The train's shortfall against
    the plan is divided in equal parts among the units that are not short. A limit that is not reached is lowered towards
    what is delivered. Both happen by the share `GAIN` per step. A negative estimate counts as nothing delivered.
    """
    reached = bounds_allow_plan(units.cap, expected, units.mass, units.limit_max)
    previous, delivered = units.previous, units.delivered
    lacking, able = 0.0, 0.0
    for j in range(limit_out.size):
        got = max(delivered[j], 0.0)
        lacking += units.mass[j] * (expected - got)
        if previous[j] - got <= TOLERANCE * expected:
            able += units.mass[j]
    handed = GAIN * lacking / able if able > 0.0 else 0.0
    for j in range(limit_out.size):
        over = max(previous[j] - max(delivered[j], 0.0), 0.0)
        limit = previous[j] - GAIN * over
        if over <= TOLERANCE * expected:
            limit += handed
        limit_out[j] = min(max(limit, 0.0), units.limit_max[j])
    return np.nan, reached


SHARING = Rule(
    "sharing", "each unit's shortfall handed to the others step by step (JP 4225233)",
    law=sharing_law, periodic=True, colour="#e69f00", marker="^",
)  # fmt: skip
RULES.register("sharing", SHARING)
