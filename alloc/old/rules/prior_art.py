"""Prior art that JP5484215 names: a preset pattern (JP H05-276606) and dynamic sharing (JP 4225233).

In: the problem, and for sharing who slipped before. Out: limits.
"""

import numpy as np

from alloc.old.compilation import jit
from alloc.old.rules.problem import bounds_allow_plan
from alloc.old.rules.rule import RULES, Rule, Trigger

# A preset pattern, JP H05-276606 as JP5484215 par. 0007 describes it.


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
    law=preset_law, trigger=Trigger.TELEGRAM, colour="#553900", marker="v",
)  # fmt: skip
RULES.register("preset", PRESET)


# Dynamic sharing, JP 4225233 as JP5484215 par. 0007 and 0009 describe it.


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
    law=sharing_law, trigger=Trigger.STEPWISE, colour="#e69f00", marker="^",
)  # fmt: skip
RULES.register("sharing", SHARING)
