"""What a method must beat: units alone, all asked for the same, the patent's prior art, control allocation's textbook rule.

The question to every other rule: does its gain come from knowing where the adhesion is?
"""

import numpy as np

from alloc.compilation import jit
from alloc.onboard.beliefs import ROOM
from alloc.onboard.signatures import share
from alloc.rules.rule import RULES, Rule


@jit
def limit_in_force(u, run):
    """The unit's limit in force; the plan where it has none."""
    return u.wanted if u.wanted < np.inf else run.needed


@jit
def find_case(units, run):
    """Case 2 (B) where caps and torque limits allow more than the plan, weighted with mass, else 1 (A)."""
    balance = 0.0
    for u in units:
        balance += u.mass_share * (min(u.cap, u.most) - run.needed)
    return 2 if balance > 0.0 else 1


@share
def share_alone(units, run):
    """Every unit keeps the plan, within its torque limit; only its own readhesion control acts."""
    run.case = find_case(units, run)
    for u in units:
        u.wanted = min(run.plan, u.most)
    return np.nan


ALONE = Rule(
    "alone",
    "every unit keeps the plan and looks after its own slip",
    share_alone,
    "front",
    colour="#7f7f7f",
    marker="o",
)

MOST = 1.3
"""Bound of `uniform` over the plan, and what `most` asks for; without it the sum of `uniform` winds up to eight times the
plan where the rail carries no more."""
GAIN = 0.1
"""Part of the train's shortfall that `uniform` adds per telegram. Tuned on 20 events with headroom (seed 1000): 0.03,
0.1 and 0.3 use 95.3, 95.6 and 95.5 % of the bound under cut-and-ramp, 98.6, 99.2 and 99.3 % under perturb-observe."""


@share
def share_uniform(units, run):
    """One step: for all the largest limit in force and `GAIN` times what the train lacks, within plan and `MOST` of it."""
    run.case = find_case(units, run)
    lacking, total, before = 0.0, 0.0, 0.0
    for u in units:
        lacking += u.mass_share * (run.needed - u.reported)
        total += u.mass_share
        before = max(before, limit_in_force(u, run))
    level = min(max(before + GAIN * lacking / total, run.needed), MOST * run.plan)
    for u in units:
        u.wanted = min(level, u.most)
    return np.nan


UNIFORM = Rule(
    "uniform",
    "all asked for the same, more while the train lacks effort: sharing without knowing who can",
    share_uniform,
    "delivered",
    colour="#9bacd0",
    marker="+",
)


@share
def share_most(units, run):
    """All are asked for `MOST` of the plan at any time, so that what some lack others have delivered already."""
    run.case = find_case(units, run)
    for u in units:
        u.wanted = min(MOST * run.plan, u.most)
    return np.nan


ASK_MOST = Rule(
    "most",
    "all asked for 1.3 times the plan, always: what a driver gets who asks for more than is wanted",
    share_most,
    "delivered always",
    colour="#684e75",
    marker="x",
)


@share
def share_spread(units, run):
    """What limited units lack, in equal parts over all others; nobody is asked for less than the plan, and no mark is read.

    A limited unit has room to search, as under `cooperative`. The obvious answer to a shortfall: a method with a memory of
    what the rail carried is worth what it adds to this one.
    """
    run.case = find_case(units, run)
    lacking, able = 0.0, 0.0
    for u in units:
        limited = u.searching != 0 or u.most < run.plan
        effort = min(u.reported, u.most) if limited else run.plan
        lacking += u.mass_share * (run.needed - effort)
        able += 0.0 if limited else u.mass_share
    more = max(lacking, 0.0) / able if able > 0.0 else 0.0
    for u in units:
        limit = max(ROOM * u.reported, run.plan) if u.searching != 0 else run.plan + more
        u.wanted = min(limit, u.most)
    return np.nan


SPREAD = Rule(
    "spread",
    "what limited units lack in equal parts over all others, without marks",
    share_spread,
    "delivered",
    colour="#389ea2",
    marker="2",
)

MOVED = 0.1
"""Part of the plan that the pattern moves between the train's ends; its source names none. The best of 0.03 to 0.25 for the
mean of 80 events (seeds 1000 and 1001); a tenth is also what the increments (15) add along 8 motor cars."""


@share
def share_preset(units, run):
    """A fixed part of the front's effort moved to the rear, JP H05-276606 as JP5484215 par. 0007 describes it.

    Limits are linear along the train, with the plan as their mean weighted with mass: of n equal units the foremost has
    (1 - `MOVED`) of the plan and the rearmost (1 + `MOVED`).
    """
    run.case = find_case(units, run)
    total, moment, spacing = 0.0, 0.0, 2.0 / max(units.size - 1, 1)
    for j in range(units.size):
        total += units[j].mass_share
        moment += units[j].mass_share * spacing * j
    for j in range(units.size):
        shift = MOVED * (spacing * j - moment / total)
        units[j].wanted = min(run.plan * (1.0 + shift), units[j].most)
    return np.nan


PRESET = Rule(
    "preset",
    "a fixed part of the front's effort moved to the rear (JP H05-276606)",
    share_preset,
    "delivered always",
    colour="#553900",
    marker="v",
)

HANDED = 0.15
"""Share of the shortfall that `sharing` hands on per telegram; its source names none. With `OVERLOOKED` the best of
25 pairs for the mean of 80 events (seeds 1000 and 1001): 0.05 to 0.5, and 0.5 to 8 %."""
OVERLOOKED = 0.04
"""Shortfall, as a share of the plan, that counts as none."""


@share
def share_sharing(units, run):
    """One step of dynamic sharing, JP 4225233 as JP5484215 par. 0007 and 0009 describe it.

    A unit is short if it delivers less than its limit by more than `OVERLOOKED` of the plan. The train's shortfall is
    divided in equal parts among the others, and a limit that is not reached is lowered towards what is delivered,
    both by the share `HANDED` per step.
    """
    run.case = find_case(units, run)
    lacking, able = 0.0, 0.0
    for u in units:
        effort = max(u.reported, 0.0)
        lacking += u.mass_share * (run.needed - effort)
        if limit_in_force(u, run) - effort <= OVERLOOKED * run.needed:
            able += u.mass_share
    step = HANDED * lacking / able if able > 0.0 else 0.0
    for u in units:
        before = limit_in_force(u, run)
        over = max(before - max(u.reported, 0.0), 0.0)
        limit = before - HANDED * over + (step if over <= OVERLOOKED * run.needed else 0.0)
        u.wanted = min(max(limit, 0.0), u.most)
    return np.nan


SHARING = Rule(
    "sharing",
    "each unit's shortfall handed to the others step by step (JP 4225233)",
    share_sharing,
    "front",
    colour="#e69f00",
    marker="^",
)

MOST_CAP = 1e3
"""Cap over the plan beyond which `erp` takes units for alike, so that a cap may be infinite."""


@share
def share_erp(units, run):
    """The redistributed pseudo-inverse of control allocation, as Johansen and Fossen survey it: minimise sum m (x / cap)^2.

    Without bounds x = s cap^2 with one scale s. Units beyond their bound are frozen there and the others solved for
    the rest, which raises s, so n passes suffice. With the norm sum m (x - plan)^2 the same is the exact level.
    """
    run.case = find_case(units, run)
    needed, scale = run.needed, 0.0
    for _ in range(units.size):
        wanted, free = 0.0, 0.0
        for u in units:
            cap, upper = min(u.cap, MOST_CAP * needed), min(u.cap, u.most)
            weight = cap * (cap / needed)
            frozen = scale * weight >= upper
            wanted += u.mass_share * (needed - upper if frozen else needed)
            free += 0.0 if frozen else u.mass_share * weight
        if free <= 0.0 or wanted <= scale * free:
            break
        scale = wanted / free
    for u in units:
        cap = min(u.cap, MOST_CAP * needed)
        u.wanted = min(scale * cap * (cap / needed), min(u.cap, u.most))
    return np.nan


ERP = Rule(
    "erp",
    "redistributed pseudo-inverse of control allocation: least used shares of the caps, the textbook's way",
    share_erp,
    promise="effort",
    colour="#95583f",
    marker="1",
)

for _rule in (ALONE, UNIFORM, ASK_MOST, SPREAD, PRESET, SHARING, ERP):
    RULES.register(_rule)
