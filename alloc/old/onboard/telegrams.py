"""Telegrams along the train: limits from the foremost unit, reports to it; they arrive late, or never.

In: what a unit knows of itself, what the leader wants, numbers that a controller adds. Out: the same as the receiver has it,
with latency, jitter and loss; and the slips of all units for a rule that is called on slip.
"""

from typing import NamedTuple

import numpy as np

from alloc.old.compilation import inlined_jit
from alloc.old.onboard.laws import SUPPLY
from alloc.old.onboard.reference_speed import is_relieved
from alloc.old.plant.model import Floats

SLOTS = 16
"""Largest number of telegrams in transit on one line."""

ROUNDING = 1e-9
"""Tolerance [s] for comparing instants, which are multiples of a period."""


class Channel(NamedTuple):
    """Lines of telegrams, one per unit, with `fields` numbers in each."""

    arrival: Floats  # (units, SLOTS) [s]; inf: empty
    sent: Floats  # (units, SLOTS) [s]
    content: Floats  # (units, SLOTS, fields)
    newest: Floats  # (units,) when the newest that has arrived was sent [s]
    heard: Floats  # (units,) when the last one arrived [s]
    read: Floats  # (units, fields) what the newest said


def channel(units: int, fields: int, nothing: float) -> Channel:
    """Lines without any telegram yet; a receiver reads `nothing`."""
    return Channel(
        arrival=np.full((units, SLOTS), np.inf),
        sent=np.zeros((units, SLOTS)),
        content=np.zeros((units, SLOTS, fields)),
        newest=np.full(units, -np.inf),
        heard=np.zeros(units),
        read=np.full((units, fields), nothing),
    )


@inlined_jit
def send(line, j, time, delay, message):
    """Send `message[j]` (units, fields) on line `j` at `time`; it arrives after `delay` [s]."""
    for k in range(SLOTS):
        if np.isinf(line.arrival[j, k]):
            line.arrival[j, k] = time + delay
            line.sent[j, k] = time
            for f in range(message.shape[1]):
                line.content[j, k, f] = message[j, f]
            break


@inlined_jit
def deliver(line, j, time, message):
    """Deliver at once on line `j`, whose sender and receiver are one computer."""
    line.newest[j] = line.heard[j] = time
    for f in range(message.shape[1]):
        line.read[j, f] = message[j, f]


@inlined_jit
def collect(line, j, time):
    """Read the newest telegram that has arrived on line `j` by `time`; returns whether any has."""
    found = False
    for k in range(SLOTS):
        if line.arrival[j, k] <= time + ROUNDING:
            found = True
            if line.sent[j, k] > line.newest[j]:
                line.newest[j] = line.sent[j, k]
                for f in range(line.read.shape[1]):
                    line.read[j, f] = line.content[j, k, f]
            line.arrival[j, k] = np.inf
    if found:
        line.heard[j] = time
    return found


@inlined_jit
def exchange(line, j, time, message, sending, telegrams, counter, delay, lost):
    """Send on line `j` when it is due, unless the telegram is lost, and read what has arrived; returns whether any has.

    `delay`, `lost`: draws from 0 to 1 of the telegram's jitter and loss.
    """
    if sending:
        counter.telegrams_sent[0] += 1
        if lost < telegrams.loss:
            counter.telegrams_lost[0] += 1
        else:
            send(line, j, time, telegrams.latency + telegrams.jitter * delay, message)
    return collect(line, j, time)


# Numbers that a controller in Python adds to the train's periodic telegrams, so that its units can exchange them.
#
# Reports and limits are sent in any case (`alloc.old.onboard.telegrams`, `alloc.old.onboard.distribution`). The added numbers are
# part of the same telegram. So they are counted once and are late or lost together with it, and a seed loses the same
# telegrams whatever controls the train.


class Attachment(NamedTuple):
    """Numbers added to the telegrams of one direction, a row per unit. The leader reaches itself without a telegram."""

    message: Floats
    """Numbers of the next telegram, (units, numbers); they are sent until they are changed."""
    read: Floats
    """What the newest telegram that has arrived said, (units, numbers); nan before the first."""
    heard: Floats
    """When a telegram arrived last, lost contents or not, (units,) [s]."""


class AddedNumbers(NamedTuple):
    """How many numbers a controller adds to each report, and to each limit that is sent."""

    report: int = 0
    order: int = 0


NOTHING_ADDED = AddedNumbers()


# Reports of the traction units to the foremost one: whether they are limited or slip, what they deliver and find.
#
# A good readhesion controller reduces torque without any slip signal. So "limited" means that a unit's torque stays
# below its target for lack of adhesion, or that it has failed or has no speed signal. The last two say nothing about
# the rail.


DELIVERED, ESTIMATE, DETECTED, LIMITED, SLIPPED = range(5)
"""Fields of a report: the filtered limit at which the unit would deliver what it delivers now; the coefficient at the last
detection, nan before the first; the instant of that detection [s], which distinguishes it from the one before; what
limits the unit; the instant of its last slip [s], since a flag would miss slips between two telegrams."""

NUMBERS = SLIPPED + 1

BY_NOTHING, BY_RAIL, BY_ITSELF = 0.0, 1.0, 2.0
"""What limits a unit: nothing, since its target is within reach; the rail; its own failure or blindness."""

WHOLE = 0.985
"""Share of its target above which a unit counts as not limited: creep control on the rising branch of the curve keeps within
a hundredth of its target."""

ACTING = 0.5
"""Share of the plan that a unit's target must reach: a smaller target says nothing about the rail."""

FILTER_TIME = 0.2
"""Time constant [s] of the delivered coefficient: two telegrams, and one step of a searching controller."""


class ReportMemory(NamedTuple):
    """What the units send, and what the foremost one has received."""

    own: Floats  # (units, 5 and what a controller adds) what each would say now
    line: Channel  # to the foremost unit
    acceleration: Floats  # (1,) of the train behind the same filter [m/s2]
    speed: Floats  # (1,) reference speed a period ago [m/s]
    slipped_at: Floats  # (units,) when a unit slipped for the last time, as heard [s]
    limited_at: Floats  # (units,) when a unit was limited for the last time, as heard [s]
    counted: Floats  # (units,) detection that counts for a rule asked on slip [s]; -inf: none


def report_memory(units: int, speed: float, expected: float, added: int = 0) -> ReportMemory:
    """Memory at the start of a run: every unit delivers the plan. `added`: numbers that a controller adds, nan at first."""
    own = np.tile([expected, np.nan, -np.inf, 0.0, -np.inf, *[np.nan] * added], (units, 1))
    line = channel(units, own.shape[1], 0.0)
    line.read[:] = own
    return ReportMemory(own, line, np.zeros(1), np.full(1, speed), *np.full((3, units), -np.inf))


@inlined_jit
def _limited_by(eq, m, j, expected, braking):
    """What keeps unit `j` from its target."""
    if m.unit.axles_seen[j] == 0.0 or not (m.in_service[j] or braking):
        return BY_ITSELF
    to_coefficient = eq.gear[j] / (eq.axle_load[j] * eq.radius[j])
    target = abs(m.unit.torque_target[j]) * to_coefficient
    if m.unit.torque_factor[j] < WHOLE and target > ACTING * expected:
        return BY_RAIL
    if braking:
        for g in range(eq.group.unit.size):
            if eq.group.unit[g] == j and m.slide.action[g] != SUPPLY:
                return BY_RAIL
    return BY_NOTHING


@inlined_jit
def write_reports(eq, st, m, time, commanded):
    """Fill the present report of each unit; a relieved unit repeats its last report.

    A limit includes the torque that accelerates the wheelsets, in proportion to the limit, although the train accelerates
    them all alike. So a limit at the delivered torque would deliver less, and marks would fall without end. The report
    states the limit at which the unit delivers as much as now.
    """
    gain = st.period / (FILTER_TIME + st.period)
    r = m.report
    speed = m.reference[0]
    r.acceleration[0] += gain * ((speed - r.speed[0]) / st.period - r.acceleration[0])
    r.speed[0] = speed
    # share of the planned acceleration that the train reaches
    reached = min(max(r.acceleration[0] / commanded, 0.0), 1.0) if commanded != 0.0 else 0.0
    own = m.report.own
    braking = eq.blended and commanded < 0.0
    for j in range(eq.axles.size):
        if is_relieved(m, j) and m.in_service[j]:
            continue
        turning = eq.brake_inertia[j] if braking else eq.own_inertia[j]
        at_rail = max(m.unit.coefficient_estimate[j], 0.0)
        delivered = (at_rail + turning * reached * m.train.expected[0]) / (1.0 + turning)
        limited_by = _limited_by(eq, m, j, m.train.expected[0], braking)
        own[j, DELIVERED] += gain * (delivered - own[j, DELIVERED])
        own[j, LIMITED] = limited_by if commanded != 0.0 else BY_NOTHING
        if m.unit.slipping[j] > 0.0:
            own[j, SLIPPED] = time


@inlined_jit
def hear_reports(eq, st, m, time, tick, delay, lost):
    """Send and receive reports with the periodic telegrams; `delay`, `lost` (units,): draws of their jitter and loss."""
    own, line, first = m.report.own, m.report.line, m.lead.unit[0]
    sending = tick % st.telegrams.ticks == 0
    for j in range(eq.axles.size):
        if j == first:
            deliver(line, j, time, own)
        else:
            exchange(line, j, time, own, sending, st.telegrams, m.counter, delay[j], lost[j])
        limited_by = line.read[j, LIMITED]
        m.limited[j] = limited_by != BY_NOTHING
        m.report.slipped_at[j] = line.read[j, SLIPPED]
        before = line.newest[j] - st.telegrams.ticks * st.period  # the telegram before this one
        m.slipping[j] = line.read[j, SLIPPED] > before
        if m.limited[j]:
            m.report.limited_at[j], m.by_rail[j] = line.newest[j], limited_by == BY_RAIL
        m.delivered[j] = max(line.read[j, DELIVERED], 0.0)


# Slips of all units, for a rule that is called on slip: JP5484215 with embodiment 2's reports at their best.
#
# There every unit estimates its coefficient at its own detection and sends it to the foremost one (par. 0063), which
# learns increments from it after some stations. If it is used at once, as if one datum were enough, it is the unit's
# cap (5) itself.


@inlined_jit
def count_slips(st, m, time):
    """Note which detections are within the hold time; returns whether there are any, and whether they changed."""
    some, changed = False, False
    for j in range(m.cap.size):
        detected = m.report.line.read[j, DETECTED]
        counted = detected if time - detected <= st.hold_time else -np.inf
        changed = changed or counted != m.report.counted[j]
        some = some or counted > -np.inf
        m.report.counted[j] = counted
    return some, changed


@inlined_jit
def caps_by_own_slips(st, m, time):
    """Set the cap of each unit that slipped within the hold time to its own slip's coefficient, without an increment."""
    message = m.report.line.read
    for j in range(m.cap.size):
        if time - message[j, DETECTED] <= st.hold_time:
            m.cap[j] = message[j, ESTIMATE]


@inlined_jit
def caps_by_slips(st, m, time):
    """(5) from the foremost unit whose slip counts, of which there must be one; others that slipped have what they found.

    Units ahead have not slipped: the plan is their cap, as it is without slip (step S216).
    """
    caps_by_own_slips(st, m, time)
    increment, front = m.learnt.increment, 0
    while m.report.counted[front] == -np.inf:
        front += 1
    found = m.report.line.read[front, ESTIMATE]
    for j in range(m.cap.size):
        if j < front:
            m.cap[j] = m.train.expected[0]
        elif (
            j == front or m.report.counted[j] == -np.inf
        ):  # (5) rounds as it does in the rule as printed
            m.cap[j] = max(found + increment[j] - increment[front], 0.0)
