"""From the units' limits to their torque targets and the brakes' cylinder pressures.

Driving and without blended brakes: limits (6) and (6') of JP5484215, load compensation, the motor's limit. Blended braking,
embodiment 3: the electric brake comes first, and the air brake supplies what the line does not take. The air brake of a unit
that receives limits fills up to the limit in the same way. Its motors do not follow the pattern then (par. 0078): they brake
with the limit less the air brake's force, and so make up at once for the lag of the cylinders. The air brake makes up for
what the line or failed motors lack. What readhesion control takes away it does not fill, and in the end it gives way too.
"""

import numpy as np

from alloc.compilation import inlined_jit
from alloc.onboard.observer import empty_torque_limit, load_compensated
from alloc.onboard.shoe_force import believed_shoe_force
from alloc.onboard.slide_protection.protect import LOWEST_SPEED, protect
from alloc.plant.equations import GRAVITY

MIDDLE = 0.5
"""Share of their torque that readhesion control leaves the motors, below which the air brake gives way."""

LEAST_GAIN = 1e-9
"""Shoe force over pressure [N/Pa] below which a brake is asked for all its pressure: it gives nothing."""

EASE_TIME = 1.0
"""Integral time [s] of that."""


@inlined_jit
def set_targets(eq, st, m, commanded):
    """Torque target of each unit: (6) and (6') plus its wheelsets' inertia, within the motor's limit, with bounded rise."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    for j in range(eq.axles.size):
        limit = m.unit.limit[j] if commanded != 0.0 else 0.0
        empty = empty_torque_limit(limit, eq.empty_axle_mass[j], eq.radius[j], eq.gear[j])
        share = 1.0 + eq.own_inertia[j]
        wanted = share * load_compensated(empty, eq.empty_axle_mass[j], eq.load_per_axle[j])
        planned = m.train.expected[0] * (eq.empty_axle_mass[j] + eq.load_per_axle[j])
        step = share * planned * GRAVITY * eq.radius[j] / eq.gear[j] * st.period / st.rise_time
        bound = m.drive_limit[j] if sign > 0.0 else m.brake_limit[j]
        m.rise[j] = min(min(wanted, bound), m.rise[j] + step) if commanded != 0.0 else 0.0
        m.unit.torque_target[j] = sign * m.rise[j]
        m.unit.air_brake_force[j] = 0.0
        m.taken[j] = np.inf
        m.kept[j] = 1.0
    m.lead.brake_rise[0] = 0.0


@inlined_jit
def _share_of_motors(st, m, j, pattern, full):
    """Torque that unit `j` asks of its motors: what the line takes of the `pattern`; `full` is that of the whole plan."""
    if not m.in_service[j]:
        m.taken[j] = 0.0
        return 0.0
    electric = max(-m.torque[j], 0.0)
    # what the line turns out to take the motors take over slowly, for cylinders empty slowly
    slow = full * st.period / st.brakes.blend_time
    # less than foreseen: the line does not take it, or motors have failed. Their lag, what the unit's own readhesion control
    # takes away and a sounding are foreseen
    if min(-m.foreseen[j], pattern, m.brake_limit[j]) > electric + 2.0 * slow:
        m.taken[j] = electric
    m.taken[j] = max(m.taken[j], electric + slow)
    return min(pattern, m.brake_limit[j], m.taken[j])


@inlined_jit
def _share_of_air(st, m, j, motors):
    """Share of its part that the air brake of unit `j` keeps: it gives way while readhesion control has little torque left.

    Mid-ranging control: the slow air brake leaves the fast motors room on both sides. Else it could hold wheels in a slide
    that no cut of torque ends.
    """
    left = -m.unit.torque_command[j] / motors if motors > 0.0 else 1.0
    m.kept[j] = min(max(m.kept[j] + (left - MIDDLE) * st.period / EASE_TIME, 0.0), 1.0)
    return m.kept[j]


@inlined_jit
def set_brake_targets(eq, st, m):
    """Torque targets and air brake forces of the units while the train brakes."""
    expected = m.train.expected[0]
    air = m.unit.air_brake_force
    for j in range(eq.axles.size):
        to_torque = (1.0 + eq.brake_inertia[j]) * eq.axle_load[j] * eq.radius[j] / eq.gear[j]
        at_rim = eq.gear[j] / eq.radius[j]
        step = expected * to_torque * st.period / st.rise_time
        m.rise[j] = min(m.unit.limit[j] * to_torque, m.rise[j] + step)
        pattern = m.rise[j]
        motors = _share_of_motors(st, m, j, pattern, expected * to_torque)
        air[j] = _share_of_air(st, m, j, motors) * (pattern - motors) * at_rim
        if np.isfinite(m.received[j]) and m.in_service[j]:
            motors = max(pattern - m.air_force[j] / at_rim, 0.0)
        m.unit.torque_target[j] = -min(motors, m.brake_limit[j])
    m.lead.brake_rise[0] = min(m.lead.brake_rise[0] + st.period / st.rise_time, 1.0)


@inlined_jit
def foresee_torque(eq, m, j, applied):
    """Torque that the motors of unit `j` would have in the next period under the command `applied` [N m] to the inverter."""
    m.foreseen[j] += eq.response[j] * (applied - m.foreseen[j])


@inlined_jit
def restrain_blind_units(st, m):
    """A unit that knows the speed of none of its axles could not notice slip: it gets a part of its target."""
    for j in range(m.unit.torque_target.size):
        if m.unit.axles_seen[j] == 0.0:
            m.unit.torque_target[j] *= st.sensors.blind_share


@inlined_jit
def brake_receiver(eq, st, m, tick, braking, pressure, valve):
    """Cylinder pressures [Pa] and valves of every brake group: force wanted of it, and its slide protection.

    `pressure`, `valve` (groups,) are filled. A trailer follows the plan by air alone.
    """
    protect(eq, st, m, tick, braking, valve)
    for g in range(eq.group.unit.size):
        if not braking:
            pressure[g] = m.estimate.full[g] = 0.0
            continue
        reference = max(m.reference[eq.group.body[g]], LOWEST_SPEED)
        unit = eq.group.unit[g]
        if unit >= 0:
            force = m.unit.air_brake_force[unit]
        else:
            planned = eq.group.share[g] * m.train.expected[0] * m.lead.brake_rise[0]
            force = planned * eq.group.weight[g] * (1.0 + eq.group.inertia[g])
            force = min(force, m.air_most[g] * (1.0 + eq.group.inertia[g]))
        # of wheels that roll: one that slides must not lower the pressure of the others
        per_pascal = max(believed_shoe_force(eq.group, g, 1.0, reference), LEAST_GAIN)
        pressure[g] = min(force / per_pascal, eq.group.pressure[g])
        m.estimate.full[g] = pressure[g]
