"""The rule of JP5484215: the foremost unit's slip bounds all, the rear takes over what the front lost.

Both readings of its step S210: the description's, and the running sum of claim 1. Like the patent they count
units, not masses, and know of no torque limits: a unit that cannot reach its limit simply falls short of it.
"""

from alloc.compilation import jit

ROUNDING = 1e-12
"""Relative slack of comparisons between sums, so that a tie in exact arithmetic is one in floating point."""


@jit
def within_reach(cap, expected):
    """Step S207: whether the mean cap (7) exceeds the plan, which is case B."""
    total = 0.0
    for j in range(cap.size):
        total += cap[j]
    return total > cap.size * expected * (1.0 + ROUNDING)


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
def limits_under(level, cap, limit_max, limit_out):
    """Cases C and D, (10) and (11): min(cap, level); then each unit's torque limit, as the unit itself applies it."""
    for j in range(cap.size):
        limit_out[j] = min(min(cap[j], level), limit_max[j])


@jit
def highest_cap(cap):
    """The level of case A, where every unit works at its cap."""
    highest = cap[0]
    for j in range(1, cap.size):
        highest = max(highest, cap[j])
    return highest
