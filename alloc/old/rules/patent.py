"""The rule of JP5484215: the slip of the foremost unit bounds all units, and the rear takes over what the front lost.

In: caps that grow along the train. Out: limits by Fig. 8 and 9 (`greedy`), or as claim 1 words them (`greedy-claim`).
"""

from dataclasses import replace

from alloc.old.compilation import jit
from alloc.old.rules.problem import ROUNDING, highest_cap, within_reach
from alloc.old.rules.rule import RULES, Caps, Rule, Trigger

# The rule of JP5484215: the slip of the foremost unit bounds all units, and the rear takes over what the front lost.
#
# This is the description's reading of its step S210; `alloc.old.rules.patent` is that of claim 1. Like the patent,
# both count units, not masses, and take no torque limits into account: a unit that cannot reach its limit simply falls
# short of it.


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
    """Level by par. 0041 and 0049: each candidate's cap bounds all units behind j_e, equation (9); case B only.

    The sum (9) is a concave, rising function of its bound. From a candidate that falls short on, its tangent says up to
    which cap the next ones do too. They are passed over, so about log n candidates are summed up, not n.
    """
    front, small = deficit_of_front(cap, expected)
    slack = ROUNDING * cap.size * expected
    enough, behind = small - slack, cap.size - front
    highest, short = 0.0, expected + (enough - slack) / behind if behind > 0 else 0.0
    for m in range(front, cap.size):
        highest = max(highest, cap[m])
        if cap[m] <= short:
            continue
        large, above = 0.0, 0
        for k in range(front, cap.size):
            large += min(cap[k], cap[m]) - expected
            above += cap[k] > cap[m]
        if large >= enough:
            return cap[m]
        # twice the slack of the comparison: rounding passes over none that would do
        short = max(cap[m], cap[m] + (enough - large - slack) / max(above, 1))
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
    law=greedy_law, promise="reference", colour="#d55e00", marker="s",
)  # fmt: skip
RULES.register("greedy", GREEDY)

GREEDY_LITERAL = replace(
    GREEDY, name="greedy-literal", trigger=Trigger.SLIP, colour="#551c8e", marker="d",
    description="greedy by the steps of JP5484215: at the foremost unit's slip, held, lifted at once; corrected equations",
)  # fmt: skip
"""The steps of Fig. 7 to 9 as the patent has them, on equipment that deviates from the text in `PRINTED`."""
RULES.register("greedy-literal", GREEDY_LITERAL)

PRINTED = {
    "detector.speed_on": 600.0 / 3.6,
    "inertia_in_limit": False,
    "braking.inertia_in_estimate": False,
    "braking.air_force": "command",
}
"""The four deviations of the equipment taken back: Fig. 5 tests the acceleration alone, so no slip velocity counts as slip;
(6) is without the wheelsets' inertia, and so is (18); (18) and par. 0071 have the command of the air brake for its force."""

GREEDY_PRINTED = replace(
    GREEDY_LITERAL, name="greedy-printed", onboard=PRINTED, colour="#000040", marker="8",
    description="greedy with every equation and test of JP5484215 as printed: Fig. 5, (6) and (18) too",
)  # fmt: skip
RULES.register("greedy-printed", GREEDY_PRINTED)

HOLD_TIME = 5.0
"""Time [s] for which a detection counts; par. 0036 calls it "a certain time" and lifts the limits at its end at once.
`GREEDY_TUNED` describes the runs on which this and the next two numbers were tuned."""
DIFFERENTIATOR_POLE = 20.0
"""Pole [1/s] of the differentiator that computes the axles' accelerations; the detector's own is 40."""
SLIP_ON = 0.3
"""Slip [m/s] from which a unit counts as slipping whatever its acceleration; the detector's own is 0.6."""

GREEDY_TUNED = replace(
    GREEDY_LITERAL, name="greedy-tuned", trigger=Trigger.ANY_SLIP, caps=Caps.DETECTED, colour="#aa71ff", marker="h",
    onboard={"hold_time": HOLD_TIME, "detector.pole": DIFFERENTIATOR_POLE, "detector.speed_on": SLIP_ON},
    description="greedy at its best within the words of JP5484215: all units' slips heard, "
    f"held {HOLD_TIME:g} s, differentiator {DIFFERENTIATOR_POLE:g} 1/s, slip from {SLIP_ON:g} m/s",
)  # fmt: skip
"""The rule at its best within the patent's words.

The freedom that the text leaves is used. Embodiment 2 sends every unit's own estimate so that increments can be learnt; here
the estimate is the unit's cap at once (`alloc.old.onboard.telegrams`). Hold time and detector are tuned. What the text states is
kept: limits are set at a detection and lifted at once (par. 0036, step S216).

Tuned on 80 events of the claims (seeds 1000 and 1001, 40 each) for the used share of the bound, both controllers together:
hold 1, 2, 3, 5, 8, 12 s; differentiator 10 to 40 1/s; slip 0.15 to 0.6 m/s. Under cut-and-ramp the units' own slips bring
0.9 points (95.5 to 96.4 %), the detector 0.06 and a quarter of the slip (8.2 to 6.1 axle s). Under perturb-observe it is
best to do nothing (98.87 %, as alone), since what the detector calls slip there is noise: at 20 1/s it signals no slip.
"""
RULES.register("greedy-tuned", GREEDY_TUNED)


# The rule of JP5484215 as its claim 1 words it: a running sum that stops at the candidate.


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
