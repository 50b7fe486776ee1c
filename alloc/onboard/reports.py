"""Reports of the traction units to the foremost one: whether they are limited or slip, what they deliver and find.

A good readhesion controller reduces torque without any slip signal. So "limited" means that a unit's torque stays below its
target for lack of adhesion, or that it has failed or has no speed signal. The last two say nothing about the rail.
"""

from typing import NamedTuple

import numpy as np

from alloc.compilation import inlined_jit
from alloc.onboard.mail import Mail, exchange, mail, tell
from alloc.onboard.reference_speed.sounding import is_relieved
from alloc.onboard.slide_protection.fuzzy import SUPPLY
from alloc.plant.model import Floats

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
    line: Mail  # to the foremost unit
    acceleration: Floats  # (1,) of the train behind the same filter [m/s2]
    speed: Floats  # (1,) reference speed a period ago [m/s]
    slipped_at: Floats  # (units,) when a unit slipped for the last time, as heard [s]
    limited_at: Floats  # (units,) when a unit was limited for the last time, as heard [s]
    counted: Floats  # (units,) detection that counts for a rule asked on slip [s]; -inf: none


def report_memory(units: int, speed: float, expected: float, added: int = 0) -> ReportMemory:
    """Memory at the start of a run: every unit delivers the plan. `added`: numbers that a controller adds, nan at first."""
    own = np.tile([expected, np.nan, -np.inf, 0.0, -np.inf, *[np.nan] * added], (units, 1))
    line = mail(units, own.shape[1], 0.0)
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
    """Fill the present report of each unit; a sounded unit repeats its last report.

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
def hear_reports(eq, st, m, time, tick, delay, fate):
    """Send and receive reports with the periodic telegrams; `delay`, `fate` (units,): draws of their jitter and loss."""
    own, line, first = m.report.own, m.report.line, m.lead.unit[0]
    sending = tick % st.telegrams.ticks == 0
    for j in range(eq.axles.size):
        if j == first:
            tell(line, j, time, own)
        else:
            exchange(line, j, time, own, sending, st.telegrams, m.counter, delay[j], fate[j])
        limited_by = line.read[j, LIMITED]
        m.limited[j] = limited_by != BY_NOTHING
        m.report.slipped_at[j] = line.read[j, SLIPPED]
        before = line.newest[j] - st.telegrams.ticks * st.period  # the telegram before this one
        m.slipping[j] = line.read[j, SLIPPED] > before
        if m.limited[j]:
            m.report.limited_at[j], m.by_rail[j] = line.newest[j], limited_by == BY_RAIL
        m.delivered[j] = max(line.read[j, DELIVERED], 0.0)
