"""The rule of JP5484215 as its claim 1 words it: a running sum that stops at the candidate."""

from alloc.compilation import jit
from alloc.rules.greedy import deficit_of_front, limits_under
from alloc.rules.reach import ROUNDING, highest_cap, within_reach
from alloc.rules.rule import RULES, Rule


@jit
def claim_level(cap, expected):
    """Level by claim 1: units are added until the running sum covers the deficit; case B only."""
    front, small = deficit_of_front(cap, expected)
    enough = small - ROUNDING * cap.size * expected
    large = 0.0
    for m in range(front, cap.size):
        large += cap[m] - expected
        if large >= enough:
            return cap[m]
    return cap[cap.size - 1]


@jit
def greedy_claim_law(units, expected, limit_out):
    """Limits by claim 1."""
    reached = within_reach(units.cap, expected)
    level = claim_level(units.cap, expected) if reached else highest_cap(units.cap)
    limits_under(level, units.cap, units.limit_max, limit_out)
    return level, reached


GREEDY_CLAIM = Rule(
    "greedy-claim", "the reference as claim 1 of JP5484215 words it: a running sum",
    law=greedy_claim_law, colour="#8ec6c6", marker="D",
)  # fmt: skip
RULES.register("greedy-claim", GREEDY_CLAIM)
