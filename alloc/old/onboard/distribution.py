"""What the foremost unit does for the train: caps, when to ask the rule, and telegrams to the others."""

import numpy as np

from alloc.old.compilation import inlined_jit, jit
from alloc.old.onboard.increment_learning import NO_LEARNING, learn_increments
from alloc.old.onboard.laws import believed_shoe_force
from alloc.old.onboard.telegrams import (
    caps_by_own_slips,
    caps_by_slips,
    count_slips,
    deliver,
    exchange,
    hear_reports,
    write_reports,
)
from alloc.old.rules.rule import Caps, Trigger

HELD = 1.0
"""Time [s] for which a unit that was limited still counts as such: a search for the peak takes about as long, and in ten
telegrams at least one arrives."""

RISE = 0.01
"""Speed [1/s] at which a mark rises, as a share of the plan: a peak of a few hundredths is tried again after some seconds,
and adhesion that grows with the cleaned rail is followed."""

FORGET = 5.0
"""Time constant [s] of a mark that is no longer reached: longer than a cycle of cut and ramp, whose best must count."""

KEPT = 0.995
"""Cap of a limited unit over its mark, for rules that hold it there: at the very mark its wheels creep at the peak."""

PROBE = 1.06
"""Limit over what a unit delivers that is, or was, limited without slip: controllers that search for the peak must limit the
torque themselves. One held at what it delivered on its way to the peak reaches its target, stops to search, and stays there:
marks alone left the MPC 2.9 % of the effort behind on wide peaks (20 events of the curves, seed 0, `exact`)."""

ROOM = 1.3
"""The same for rules that know every unit's own mark: a search is not to meet the limit. Under (5) a unit's limit moves
those behind it. `cooperative` asks a unit that slipped for `PROBE` all the same: cut-and-ramp would lose 0.7 points of the
bound and ride 4.5 % worse (48 events with headroom, seeds 9200 and 9300)."""

LEAST = 0.01
"""Least cap of a unit that works."""

RAISE = 0.6
"""Speed at which limits rise beyond the plan, relative to that at which torque rises to it."""


@inlined_jit
def _lead(eq, m):
    """The foremost unit that works leads; a new leader's estimate is that of the old one, at its own place."""
    units, before = eq.axles.size, m.lead.unit[0]
    first = 0
    while first < units - 1 and not m.in_service[first]:
        first += 1
    if first != before:
        m.lead.estimate[0] += m.learnt.increment[first] - m.learnt.increment[before]
        m.lead.unit[0] = first


@inlined_jit
def _caps_at_detection(st, m, time):
    """(5): the coefficient that the leader held at its detection, and the increments."""
    first, increment = m.lead.unit[0], m.learnt.increment
    for j in range(m.cap.size):
        m.cap[j] = max(m.lead.estimate[0] + increment[j] - increment[first], 0.0)
    if st.learning.learner != NO_LEARNING:
        caps_by_own_slips(st, m, time)


@inlined_jit
def _update_demonstrated(st, m):
    """What each unit has shown to carry: its best while limited, a little less with time; slowly more once it is not.

    Without any slip there is room above: trying costs nothing, and a search must not meet its limit.
    """
    period = st.telegrams.ticks * st.period
    for j in range(m.cap.size):
        got = m.delivered[j]
        slipped = m.report.slipped_at[j] >= m.report.limited_at[j] - st.hold_time
        if m.limited[j]:
            if np.isinf(m.demonstrated[j]):
                m.demonstrated[j] = got
            m.demonstrated[j] = max(
                got, m.demonstrated[j] + (got - m.demonstrated[j]) * period / FORGET
            )
            own = st.rule.caps == Caps.DELIVERED or st.rule.caps == Caps.PREVIEW
            room = ROOM if own and not slipped else PROBE
            m.upper_bound[j] = max(m.demonstrated[j], room * got)
        else:
            m.demonstrated[j] = max(m.demonstrated[j] + RISE * m.train.expected[0] * period, got)
            m.upper_bound[j] = m.demonstrated[j] if slipped else max(m.demonstrated[j], PROBE * got)


@inlined_jit
def _level_without_rail(eq, m):
    """What each other unit must carry where motors, failures or lost sensors alone keep some from the plan."""
    expected, lacking, able = m.train.expected[0], 0.0, 0.0
    for j in range(m.cap.size):
        bound = m.limit_max[j]
        if m.since_limited[j] < HELD and not m.by_rail[j]:
            bound = min(bound, m.delivered[j])
        lacking += eq.mass[j] * max(expected - bound, 0.0)
        able += eq.mass[j] if bound > expected else 0.0
    return expected + lacking / able if able > 0.0 else expected


@inlined_jit
def _caps_by_front(eq, st, m, time, blended):
    """(5) from the mark of the foremost unit that the rail limits; no unit's cap is below what it delivers without slip.

    A unit that slips is held below its mark. One that its controller limits without any slip has room to search.
    """
    front, known = -1, _level_without_rail(eq, m)
    for j in range(m.cap.size):
        rail = m.since_limited[j] < HELD and m.by_rail[j] and m.in_service[j]
        if front < 0 and rail:
            front = j
    for j in range(m.cap.size):
        m.cap[j] = known
        if front >= 0:
            m.cap[j] = max(
                m.demonstrated[front] + m.learnt.increment[j] - m.learnt.increment[front], 0.0
            )
        if m.since_limited[j] < HELD and np.isfinite(m.demonstrated[j]):
            slips = time - m.report.slipped_at[j] <= st.hold_time
            m.cap[j] = KEPT * m.demonstrated[j] if slips else m.upper_bound[j]
            works = m.in_service[j] or blended
            if not (m.by_rail[j] and works):
                # there is nothing to look for
                carried = m.delivered[j] if works else m.cap[j]
                m.cap[j] = min(carried, m.train.expected[0])
        elif not m.slipping[j]:
            # a cap at what it just delivers would keep every dip below the plan
            m.cap[j] = max(
                m.cap[j], min(m.demonstrated[j], max(m.train.expected[0], m.delivered[j]))
            )


@inlined_jit
def _trailers_shortfall(eq, m, expected):
    """What the trailers' shoes lack against their part of the plan, as a coefficient of the units."""
    lacking, carried = 0.0, 0.0
    for g in range(eq.group.unit.size):
        if eq.group.unit[g] < 0:
            shoes = believed_shoe_force(eq.group, g, m.pressure[g], m.reference[eq.group.body[g]])
            force = shoes / (1.0 + eq.group.inertia[g])
            wanted = eq.group.share[g] * expected * m.lead.brake_rise[0] * eq.group.weight[g]
            lacking += eq.group.axles[g] * (wanted - force)
    for j in range(eq.axles.size):
        carried += eq.axles[j] * eq.axle_load[j]
    return lacking / carried


@inlined_jit
def _keep_plan(m, expected):
    for j in range(m.cap.size):
        m.limit_wanted[j] = expected
        m.demonstrated[j] = m.upper_bound[j] = np.inf
    m.train.case[0] = 0.0
    m.train.level[0] = np.nan


@inlined_jit
def _asked_on_slip(st, m, time, tick, changed):
    """As the patent says: at the leader's detection, while its slip is not over for the hold time."""
    _caps_at_detection(st, m, time)
    expected = m.train.expected[0]
    slipping = st.rule.trigger == Trigger.SLIPPING
    since = m.lead.slipped[0] if slipping else m.lead.detected[0]
    if expected == 0.0 or time - since > st.hold_time:
        _keep_plan(m, expected)
        return False
    if slipping:
        return tick % st.telegrams.ticks == 0 or changed
    return m.lead.allocate[0] or changed


@inlined_jit
def _asked_on_any_slip(st, m, time, changed):
    """At every unit's detection, and where one is too old to count, while any counts."""
    some, others = count_slips(st, m, time)
    if m.train.expected[0] == 0.0 or not some:
        _keep_plan(m, m.train.expected[0])
        return False
    caps_by_slips(st, m, time)
    return others or changed


@inlined_jit
def _asked_on_limited(eq, st, m, time, tick, failed, blended):
    """With every telegram while a unit is limited by the rail, by its motors' power or by a failure."""
    expected = m.train.expected[0]
    of_units = st.rule.caps == Caps.DELIVERED or st.rule.caps == Caps.PREVIEW
    active = st.rule.trigger == Trigger.TELEGRAM or (blended and of_units)
    for j in range(m.cap.size):
        works = m.in_service[j] or blended  # air brakes stand in for motors
        m.since_limited[j] = time - m.report.limited_at[j] if works else 0.0
        active = active or m.since_limited[j] < HELD or m.limit_max[j] < expected
    if expected == 0.0 or not active:
        _keep_plan(m, expected)
        return False
    if not (tick % st.telegrams.ticks == 0 or failed):
        return False
    step = RAISE * expected * st.telegrams.ticks * st.period / st.rise_time
    for j in range(m.cap.size):
        m.most[j] = min(m.limit_max[j], max(m.limit_wanted[j], expected) + step)
    _update_demonstrated(st, m)
    if of_units:
        best = expected
        for j in range(m.cap.size):
            m.cap[j] = max(m.delivered[j], LEAST) if m.limited[j] else m.upper_bound[j]
            if np.isfinite(m.demonstrated[j]):
                best = max(best, m.demonstrated[j])
        for j in range(m.cap.size):
            m.mark[j] = min(m.demonstrated[j], best)
    else:
        _caps_by_front(eq, st, m, time, blended)
    return True


@inlined_jit
def prepare_allocation(eq, st, m, time, tick, commanded, failed):
    """Fill the caps; returns whether the rule must be asked now. `failed`: a unit has just failed or come back.

    Where nothing limits the train the limits are the plan and no rule is asked; nor is it where there are no units to limit.
    """
    blended = eq.blended and commanded < 0.0
    expected = abs(commanded) * (eq.brake_share if blended else eq.planned_share)
    changed = expected != m.train.expected[0]
    m.train.expected[0] = expected
    m.lead.needed[0] = expected
    if m.cap.size == 0:
        return False
    if blended and st.rule.caps >= Caps.DELIVERED:
        m.lead.needed[0] += _trailers_shortfall(eq, m, expected)
    _lead(eq, m)
    if st.learning.learner != NO_LEARNING:
        learn_increments(st, m, time)
    for j in range(m.cap.size):
        m.most[j] = m.limit_max[j]
    trigger = st.rule.trigger
    if trigger == Trigger.PERIOD:
        return True
    if trigger == Trigger.ANY_SLIP:
        return _asked_on_any_slip(st, m, time, changed)
    if trigger == Trigger.SLIP or trigger == Trigger.SLIPPING:
        return _asked_on_slip(st, m, time, tick, changed)
    return _asked_on_limited(eq, st, m, time, tick, failed or changed, blended)


@jit
def lead(eq, st, m, time, tick, commanded, failed, delay, lost):
    """Send the units' reports to the leader, which prepares what the rule needs; returns whether it must be asked now.

    `delay`, `lost` (units,): draws of the reports' jitter and loss; others as of `prepare_allocation`.
    """
    write_reports(eq, st, m, time, commanded)
    hear_reports(eq, st, m, time, tick, delay, lost)
    needed = prepare_allocation(eq, st, m, time, tick, commanded, failed)
    if needed:
        for j in range(m.cap.size):
            if np.isinf(m.cap[j]):  # nothing is known of it: its motors alone bound it
                m.cap[j] = m.most[j]
    return needed


@jit
def distribute(eq, st, m, time, tick, delay, lost):
    """Send limits with the periodic telegrams; each unit takes what has arrived, or falls back to the plan.

    `delay`, `lost` (units,): draws of the telegrams' jitter and loss. The oracle's limits arrive at once.
    """
    units = eq.axles.size
    if units == 0:
        return
    first = m.lead.unit[0]
    limited = m.train.case[0] != 0.0
    sending = tick % st.telegrams.ticks == 0
    for j in range(units):
        m.message[j, 0] = m.limit_wanted[j] if limited else np.inf
    for j in range(units):
        if j == first or st.rule.caps == Caps.TRUE:
            deliver(m.orders, j, time, m.message)
            continue
        if exchange(
            m.orders, j, time, m.message, sending, st.telegrams, m.counter, delay[j], lost[j]
        ):
            m.unit.fallen_back[j] = 0.0
        if time - m.orders.heard[j] > st.telegrams.silence:
            if m.unit.fallen_back[j] == 0.0:
                m.counter.fallbacks[0] += 1
            m.unit.fallen_back[j] = 1.0
            m.orders.read[j, 0] = np.inf
    for j in range(units):  # who is told nothing keeps to the driver's command
        m.received[j] = m.orders.read[j, 0]
        m.unit.limit[j] = m.received[j] if np.isfinite(m.received[j]) else m.train.expected[0]
        if m.unit.axles_seen[j] == 0.0 and st.rule.trigger < Trigger.SLIP:
            # a cap at what its share leaves of the plan, and that share of the cap again, would end at nothing
            m.unit.limit[j] = max(m.unit.limit[j], m.train.expected[0])
