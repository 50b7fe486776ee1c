"""What the leader believes that each unit can carry, and when it asks its rule.

In: what the units have reported, `reports` and `report_tick` as of `alloc.onboard.signatures.belief`. Out: `unit.cap` and
`unit.most`, between which a rule shares. While nothing limits the train no rule is asked and limits are lifted: every unit
keeps the plan.

The patent waits for slip ("front detected", "any detected"). The others go by reports: good controllers cut torque without
slip. A limited unit carries what it delivers, any other its `mark`, what it has shown, which rises with time.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from alloc.compilation import jit
from alloc.onboard.columns import NEVER
from alloc.onboard.sensing import ROUNDING, limit_by_sight
from alloc.onboard.signatures import belief
from alloc.schema.registry import Registry


class Belief(NamedTuple):
    """A belief of the leader, a part of a rule."""

    name: str
    function: Callable[..., Any]
    description: str
    """What the rule is told, and when, in a few words."""
    knows: bool = False
    """Whether that is the truth, which no computer on board can know; speed and orders are true then too."""


RISE = 0.1
"""Rise of a mark, plan/s: a peak of a few hundredths is tried again after a second, and a rail that wheels clean is
followed. At 0.01 `cooperative` gains 0.2 to 0.3 points of the bound less; at 0.3 or 3 one start of 140 loses 13 to 27 (240
events of seeds 6505 and 6506)."""
ROOM = 1.06
"""Limit over what a limited unit delivers [1]: a search that is held at what it delivers would never reach the peak."""
SLEW = 0.6
"""Rise of limits beyond the plan, over that of torque to the plan [1]."""
FORGET = 5.0
"""Time constant of a limited unit's mark that it no longer reaches, in belief "front" [s]: longer than a cycle of cut and
ramp."""
HELD = 1.0
"""Time for which a unit that was limited still counts as such [s]: a search takes as long."""
LEAST = 0.01
"""Smallest cap of a limited unit [1]."""


@belief
def believe_front_detected(tick, units, reports, report_tick, run):
    """JP5484215 (5), S203 to S216: what the leader held at its detection, for `run.hold`, and increments along the train."""
    if units.size == 0:
        return False
    run.needed = run.plan  # the patent's trailers brake themselves
    front = units[run.leader]
    for u in units:
        u.most = largest_limit(u, run)
        u.cap = max(front.held + u.increment - front.increment, 0.0)
    if run.plan == 0.0 or not is_within(front.detected, run.hold, run):
        return lift_limits(units, run)
    return ask_rule(front.detected == run.time, run)


@belief
def believe_any_detected(tick, units, reports, report_tick, run):
    """JP5484215 (5) from the foremost unit whose slip counts; any other that slipped has what it found itself (par. 0063).

    The cap of units ahead of all that slipped is the plan.
    """
    run.needed = run.plan
    front, changed = -1, False
    for j in range(units.size):
        u = units[j]
        sent, detected = (
            report_tick[tick, j],
            newest_report(j, tick, units, reports, report_tick)[2],
        )
        held = u.held if sent == tick else reports[sent, j].held
        if not is_within(detected, run.hold, run):
            detected = NEVER
        changed = changed or detected != u.counted
        u.counted, u.most, u.cap = detected, largest_limit(u, run), run.plan
        if detected > NEVER:
            u.cap, front = held, j if front < 0 else front
        elif front >= 0:
            u.cap = max(units[front].cap + u.increment - units[front].increment, 0.0)
    if run.plan == 0.0 or front < 0:
        return lift_limits(units, run)
    return ask_rule(changed, run)


@belief
def believe_front(tick, units, reports, report_tick, run):
    """JP5484215 (5) from what the foremost limited unit that works has shown; a limited unit's mark fades within `FORGET`.

    No cap is below what a unit shows without slip: else each dip of the foremost would keep the whole train below the plan.
    Where motors or failures alone limit the train the caps are what the others must carry.
    """
    run.needed = run.plan
    if not hear_reports(tick, units, reports, report_tick, run, False):
        return False
    first, lacking, able_mass = -1, 0.0, 0.0
    for u in units:
        lacking += u.mass_share * max(run.plan - u.most, 0.0)
        able_mass += u.mass_share if u.most > run.plan else 0.0
    made_up = run.plan + (lacking / able_mass if able_mass > 0.0 else 0.0)
    for j in range(units.size):
        u = units[j]
        limited, _, _, works = newest_report(j, tick, units, reports, report_tick)
        if u.searching:
            before = u.reported if u.mark == math.inf else u.mark
            u.mark = max(u.reported, before + (u.reported - before) * run.telegram / FORGET)
        else:
            u.mark = raise_mark(u, run)
        if first < 0 and works and counts_as_limited(limited, run) and u.mark < math.inf:
            first = j
    for j in range(units.size):
        u = units[j]
        limited, slipped, _, works = newest_report(j, tick, units, reports, report_tick)
        u.cap = made_up
        if first >= 0:
            u.cap = max(units[first].mark + u.increment - units[first].increment, 0.0)
        if counts_as_limited(limited, run) and u.mark < math.inf:
            # without slip there is room: trying costs nothing
            u.cap = u.mark if is_within(slipped, run.hold, run) else max(u.mark, ROOM * u.reported)
        elif report_tick[tick, j] * run.period - slipped >= run.telegram - ROUNDING:
            u.cap = max(u.cap, min(u.mark, max(run.plan, u.reported)))
        if not works:
            u.cap = min(u.cap, u.most)
    return True


@belief
def believe_delivered(tick, units, reports, report_tick, run):
    """Marks of all units, while one is limited, and always in blended braking: trailers' brakes may lack their part."""
    return believe_marks(tick, units, reports, report_tick, run, run.braking == 1)


@belief
def believe_delivered_always(tick, units, reports, report_tick, run):
    """Marks of all units, with every telegram."""
    return believe_marks(tick, units, reports, report_tick, run, True)


@jit
def believe_marks(tick, units, reports, report_tick, run, always):
    """A limited unit's cap and mark are what it delivers; any other's mark rises, and is its cap."""
    if not hear_reports(tick, units, reports, report_tick, run, always):
        return False
    for u in units:
        u.mark = u.cap = max(u.reported, LEAST) if u.searching else raise_mark(u, run)
    return True


@jit
def hear_reports(tick, units, reports, report_tick, run, always):
    """Read the newest reports: `report_tick`, `searching`, `most` of each unit; whether the rule is asked, with a
    telegram."""
    active = always
    for j in range(units.size):
        u, sent = units[j], report_tick[tick, j]
        limited = newest_report(j, tick, units, reports, report_tick)[0]
        u.reported = max(u.delivered if sent == tick else reports[sent, j].delivered, 0.0)
        u.searching = 1 if limited > (sent - 0.5) * run.period else 0
        before = run.plan if u.wanted == math.inf else max(u.wanted, run.plan)
        u.most = min(largest_limit(u, run), before + SLEW * run.plan * run.telegram / run.rise)
        active = active or counts_as_limited(limited, run) or u.most < run.plan
    if run.plan == 0.0 or not active:
        return lift_limits(units, run)
    return units.size > 0 and tick % round(run.telegram / run.period) == 0


@jit
def raise_mark(u, run):
    """A unit's mark [1] a telegram on, no less than it delivers; that of a unit never limited is infinite."""
    return max(u.mark + RISE * run.plan * run.telegram, u.reported)


@belief
def believe_truth(tick, units, reports, report_tick, run):
    """The true coefficients, every period: what no computer on board can know."""
    for u in units:
        u.most, u.cap = largest_limit(u, run), u.truth
    if run.plan == 0.0:
        return lift_limits(units, run)
    return units.size > 0


@jit
def largest_limit(u, run):
    """Largest limit [1] of a unit by its motors and by what it sees; blended brakes have air for the rest."""
    if run.braking:
        return math.inf
    bound = u.drive_limit if run.sign > 0.0 else u.brake_limit
    at_rail = bound * u.gear / ((1.0 + u.turning) * u.load * u.radius)
    return min(at_rail, limit_by_sight(u, run)) if u.works else 0.0


@jit
def is_within(instant, span, run):
    """Whether an instant lies no more than `span` [s] back."""
    return run.time - instant <= span + ROUNDING


@jit
def counts_as_limited(instant, run):
    """Whether a unit that was limited then still counts as such."""
    return run.time - instant < HELD - ROUNDING


@jit
def ask_rule(asks, run):
    """Whether the rule is asked: where the belief asks it, or the driver has changed the plan that it answered to."""
    asks = asks or run.plan != run.answered
    if asks:
        run.answered = run.plan
    return asks


@jit
def lift_limits(units, run):
    """Limits are lifted, marks forgotten, the rule is not asked."""
    for u in units:
        u.wanted = u.mark = math.inf
        u.counted, u.searching = NEVER, 0
    run.level, run.case, run.answered = math.nan, 0, math.nan
    return False


@jit
def newest_report(j, tick, units, reports, report_tick):
    """Unit `j` by its newest report: last instants at which it was limited, slipped, detected slip; whether it works."""
    sent = report_tick[tick, j]
    if sent == tick:
        u = units[j]
        return u.limited, u.slipped, u.detected, u.works
    report = reports[sent, j]
    return report.limited, report.slipped, report.detected, report.works


BELIEFS: Registry[Belief] = Registry("belief")
"""Beliefs of the leader by name."""
for _belief in (
    Belief("front detected", believe_front_detected, "the leader's adhesion, at its slip"),
    Belief(
        "any detected",
        believe_any_detected,
        "every unit's adhesion at its slip, at any unit's slip",
    ),
    Belief("front", believe_front, "the foremost limited unit's adhesion, while a unit is limited"),
    Belief("delivered", believe_delivered, "what every unit delivers, while a unit is limited"),
    Belief("delivered always", believe_delivered_always, "what every unit delivers, always"),
    Belief("known", believe_truth, "the true rail, always", knows=True),
):
    BELIEFS.register(_belief)
