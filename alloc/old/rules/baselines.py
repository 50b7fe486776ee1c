"""Baselines that a method must beat: the plan times a constant, one that all get alike by feedback, and a pseudo-inverse.

In: the problem; for feedback what the units deliver. Out: limits. Each answers one question about every other rule: does its
gain come from knowing where the adhesion is, or would simply asking for more, or the textbook's allocation, do as well?
"""

import numpy as np

from alloc.old.compilation import jit
from alloc.old.rules.problem import bounds_allow_plan
from alloc.old.rules.rule import RULES, Caps, Rule

# The plan times a constant: what a rule reaches that knows nothing.


TIMES = 1.3
"""What all units are asked for, over the plan. Chosen, not tuned: as much as the motors of most shipped trains can give."""


@jit
def plan_times_law(units, expected, limit_out):
    """`TIMES` the plan for every unit, within its torque limit, whatever the rail carries."""
    reached = bounds_allow_plan(units.cap, expected, units.mass, units.limit_max)
    for j in range(limit_out.size):
        limit_out[j] = min(TIMES * expected, units.limit_max[j])
    return np.nan, reached


PLAN_TIMES = Rule(
    "plan-times", f"every unit asked for {TIMES:g} times the plan: what a rule reaches that knows nothing",
    law=plan_times_law, promise="baseline", colour="#61587a", marker="x",
)  # fmt: skip
RULES.register("plan-times", PLAN_TIMES)


# Feedback of the train's effort alone: who lacks adhesion is not asked.


GAIN = 0.1
"""Part of the train's shortfall that is added per telegram. Tuned on 20 events with headroom (`headroom`, seed 1000), both
controllers together: 0.03, 0.1 and 0.3 use 95.3, 95.6 and 95.5 % of the bound under cut-and-ramp, 98.6, 99.2 and 99.3 %
under perturb-observe. Asked with every telegram, whether or not a unit is limited, it uses as much at three times the
delivery beyond the plan."""


@jit
def uniform_law(units, expected, limit_out):
    """One step; call it with every telegram: the largest limit in force and `GAIN` times what the train lacks, for all.

    No unit is asked for less than the plan, or for more than its torque limit. The sum is an integral of the shortfall: it
    also grows where the rail carries no more, as far as torque limits let it.
    """
    reached = bounds_allow_plan(units.cap, expected, units.mass, units.limit_max)
    lacking, total, before = 0.0, 0.0, 0.0
    for j in range(limit_out.size):
        lacking += units.mass[j] * (expected - units.delivered[j])
        total += units.mass[j]
        before = max(before, units.previous[j])
    level = max(before + GAIN * lacking / total, expected)
    for j in range(limit_out.size):
        limit_out[j] = min(level, units.limit_max[j])
    return np.nan, reached


UNIFORM = Rule(
    "uniform", "all asked for the same, more while the train lacks effort: what sharing is worth without knowing who can",
    law=uniform_law, caps=Caps.DELIVERED, promise="baseline", colour="#9bacd0", marker="+",
)  # fmt: skip
RULES.register("uniform", UNIFORM)


# The redistributed pseudo-inverse of control allocation, as Johansen and Fossen survey it: the textbook's rival of the water
# level.
#
#     minimise  sum m (x / cap)^2   subject to   sum m x = expected sum m
#
# is solved without bounds by the pseudo-inverse of the weighted row: x = s cap^2 with one scale s. Units beyond their bound
# are frozen there, and the others are solved for the rest. With the norm sum m (x - expected)^2 the same method is the
# exact level: `alloc.old.rules.exact.exact_limits` freezes the same units. So the two rules differ in their norm alone: this one
# is about the used share of each unit's adhesion, that one about distance from the plan.


@jit
def erp_law(units, expected, limit_out):
    """Least norm of the used shares of the caps, bounds by redistribution.

    Freezing a unit at its upper bound raises the scale of the others, so a frozen one stays frozen, and n passes suffice.
    """
    cap, mass, limit_max = units.cap, units.mass, units.limit_max
    reached = bounds_allow_plan(cap, expected, mass, limit_max)
    scale = 0.0
    for _ in range(limit_out.size):
        wanted, free = 0.0, 0.0
        for j in range(limit_out.size):
            upper, share = min(cap[j], limit_max[j]), cap[j] * (cap[j] / expected)
            frozen = scale * share >= upper
            wanted += mass[j] * (expected - upper if frozen else expected)
            free += 0.0 if frozen else mass[j] * share
        if free <= 0.0 or wanted <= scale * free:
            break
        scale = wanted / free
    for j in range(limit_out.size):
        limit_out[j] = min(scale * cap[j] * (cap[j] / expected), min(cap[j], limit_max[j]))
    return np.nan, reached


ERP = Rule(
    "erp", "redistributed pseudo-inverse of control allocation: least used shares of the caps, the textbook's way",
    law=erp_law, colour="#95583f", marker="1",
)  # fmt: skip
RULES.register("erp", ERP)
