"""The rule of JP5484215: the foremost unit's slip bounds all, the rear takes over what the front lost.

This is the description's reading of its step S210; `alloc.rules.greedy_claim` is that of claim 1. Like the patent both
count units, not masses, and know of no torque limits: a unit that cannot reach its limit simply falls short of it.
"""

from dataclasses import replace

from alloc.compilation import jit
from alloc.rules.reach import ROUNDING, highest_cap, within_reach
from alloc.rules.rule import RULES, Rule


@jit
def deficit_of_front(cap, expected):
    """j_e as the number of units before the first with cap >= expected, and their summed deficit (8)."""
    small = 0.0
    for j in range(cap.size):
        if cap[j] >= expected:
            return j, small
        small += expected - cap[j]
    return cap.size, small


@jit
def description_level(cap, expected):
    """Level by par. 0041 and 0049: each candidate's cap bounds all units behind j_e, equation (9); case B only."""
    front, small = deficit_of_front(cap, expected)
    enough = small - ROUNDING * cap.size * expected
    highest = 0.0
    for m in range(front, cap.size):
        large = 0.0
        for k in range(front, cap.size):
            large += min(cap[k], cap[m]) - expected
        if large >= enough:
            return cap[m]
        highest = max(highest, cap[m])
    return highest


@jit
def limits_under(level, cap, limit_max, limit_out):
    """Cases C and D, (10) and (11): min(cap, level); then each unit's torque limit, as the unit itself applies it."""
    for j in range(cap.size):
        limit_out[j] = min(min(cap[j], level), limit_max[j])


@jit
def greedy_law(units, expected, limit_out):
    """Limits by the description."""
    reached = within_reach(units.cap, expected)
    level = description_level(units.cap, expected) if reached else highest_cap(units.cap)
    limits_under(level, units.cap, units.limit_max, limit_out)
    return level, reached


GREEDY = Rule(
    "greedy", "the reference: rear caps bound at the next unit's cap (JP5484215 par. 0041, 0049)",
    law=greedy_law, colour="#d55e00", marker="s",
)  # fmt: skip
RULES.register("greedy", GREEDY)

GREEDY_LITERAL = replace(
    GREEDY, name="greedy-literal", on_slip=True, colour="#8c564b", marker="d",
    description="greedy asked as JP5484215 is printed: at the foremost unit's slip, held, lifted at once",
)  # fmt: skip
RULES.register("greedy-literal", GREEDY_LITERAL)

GREEDY_TUNED = replace(
    GREEDY_LITERAL, name="greedy-tuned", own_slips=True, colour="#f0027f", marker="h",
    onboard={"hold_time": 5.0},
    description="greedy at its best within the words of JP5484215",
)  # fmt: skip
RULES.register("greedy-tuned", GREEDY_TUNED)
