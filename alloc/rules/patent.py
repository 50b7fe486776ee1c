"""The rule of JP5484215: the slip of the foremost unit bounds all units, and the rear takes over what the front lost.

`greedy` is `alloc.rules.reference` compiled as it stands, `greedy-claim` its other reading. Like the patent they
count units, not masses, and leave torque limits to the units, which fall short of what they cannot reach. The further
rules share in the same way on other beliefs and other equipment.
"""

from dataclasses import replace

from alloc.compilation import jit
from alloc.onboard.signatures import share
from alloc.rules.problem import ROUNDING
from alloc.rules.rule import RULES, Rule


@jit
def redistribute(units, run, running_sum):
    """Steps S206 to S214; returns the level. `running_sum`: (9) as claim 1 words it."""
    n, plan, mean, highest = units.size, run.needed, 0.0, 0.0
    for u in units:
        mean += u.cap / n  # S206, (7)
        highest = max(highest, u.cap)
    run.case = 1 if mean <= plan * (1.0 + ROUNDING) else 2  # S207
    level = highest  # S208: case A, every unit at its cap
    if run.case == 2:
        front, small = 0, 0.0
        while units[front].cap < plan:
            small += plan - units[front].cap  # S209, (8)
            front += 1
        for j in range(front, n):  # S210
            level, large = units[j].cap, 0.0
            for k in range(front, j + 1 if running_sum else n):
                large += (units[k].cap if running_sum else min(units[k].cap, level)) - plan  # (9)
            if large >= small - n * plan * ROUNDING:  # S211
                break
    for u in units:
        u.wanted = min(min(u.cap, level), u.most)  # S212 to S214, (10), (11)
    return level


@share
def share_greedy(units, run):
    """Limits by the description, par. 0041 and 0049."""
    return redistribute(units, run, False)


@share
def share_greedy_claim(units, run):
    """Limits by claim 1."""
    return redistribute(units, run, True)


GREEDY = Rule(
    "greedy",
    "the reference: rear caps bound at the next unit's cap (JP5484215 par. 0041, 0049)",
    share_greedy,
    promise="reference",
    colour="#d55e00",
    marker="s",
)

GREEDY_LITERAL = replace(
    GREEDY,
    name="greedy-literal",
    belief="front detected",
    colour="#551c8e",
    marker="d",
    description="greedy by the steps of JP5484215: at the foremost unit's slip, held, lifted at once; corrected equations",
)
"""The steps of Fig. 7 to 9 as the patent has them, on equipment that deviates from the text in `PRINTED`."""

PRINTED = {
    "detector.speed_on": 600.0 / 3.6,
    "inertia_in_limit": False,
    "braking.inertia_in_estimate": False,
    "braking.air_force": "command",
}
"""The four deviations of the equipment taken back: Fig. 5 tests the acceleration alone, so no slip velocity counts as slip;
(6) is without the wheelsets' inertia, and so is (18); (18) and par. 0071 have the command of the air brake for its force."""

GREEDY_PRINTED = replace(
    GREEDY_LITERAL,
    name="greedy-printed",
    settings=PRINTED,
    colour="#000040",
    marker="8",
    description="greedy with every equation and test of JP5484215 as printed: Fig. 5, (6) and (18) too",
)

TUNED = {"hold_time": 5.0, "detector.pole": 20.0, "detector.speed_on": 0.3}
"""Time for which a detection counts [s], "a certain time" in par. 0036; pole of the detector's differentiator [1/s];
slip from which a unit counts as slipping [m/s]. Tuned on 80 events (seeds 1000 and 1001) for the used share of the
bound."""

GREEDY_TUNED = replace(
    GREEDY_LITERAL,
    name="greedy-tuned",
    belief="any detected",
    settings=TUNED,
    colour="#aa71ff",
    marker="h",
    description="greedy at its best within the words of JP5484215: all units' slips heard, tuned hold and detector",
)
GREEDY_CLAIM = replace(
    GREEDY,
    name="greedy-claim",
    share=share_greedy_claim,
    promise="baseline",
    colour="#8ec6c6",
    marker="D",
    description="the reference as claim 1 of JP5484215 words it: a running sum",
)

for _rule in (GREEDY, GREEDY_PRINTED, GREEDY_LITERAL, GREEDY_TUNED, GREEDY_CLAIM):
    RULES.register(_rule)
