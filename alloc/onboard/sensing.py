"""Sensing, once per control period: speeds, accelerations, slip signals, coefficient estimates."""

import numpy as np

from alloc.compilation import inlined_jit
from alloc.onboard import memory as om
from alloc.onboard.detector import differentiate, slip_signal
from alloc.onboard.observer import observe, tangential_coefficient_estimate
from alloc.onboard.reference_speed import acceleration_from_command, follow_reference


@inlined_jit
def _limit_at(table, speed):
    x = min(max(abs(speed) * 3.6, 0.0), table.size - 1.000001)
    k = int(x)
    return table[k] + (table[k + 1] - table[k]) * (x - k)


@inlined_jit
def _lose_signals(eq, st, m, time):
    """Which axles' speeds are known now, and of how many axles each unit knows them.

    A unit that sees more or fewer axles than before starts its filters anew: its mean speed jumps, which is no acceleration.
    """
    for i in range(m.axle_seen.size):
        m.axle_seen[i] = True
    for k in range(st.dropout.shape[0]):
        if st.dropout[k, 1] <= time < st.dropout[k, 2]:
            m.axle_seen[int(st.dropout[k, 0])] = False
    for j in range(eq.axles.size):
        before, m.seen[j] = m.seen[j], 0.0
        for i in range(m.axle_seen.size):
            if eq.axle_unit[i] == j and m.axle_seen[i]:
                m.seen[j] += 1.0
        if before != m.seen[j]:
            m.differentiator[j] = m.observer[j] = np.nan
        if before > 0.0 and m.seen[j] == 0.0:
            m.counter[om.BLINDED] += 1


@inlined_jit
def _read_speeds(eq, st, m, omega, noise):
    """Rim speeds as sensors tell them, (axles,) and mean per unit.

    An axle without signal is taken to turn as the others of its unit do; where none has one, as the reference speed.
    """
    units = eq.axles.size
    for j in range(units):
        m.mean_speed[j] = 0.0 if m.seen[j] > 0.0 else m.reference[eq.unit_body[j]]
    for i in range(omega.size):
        rim = eq.axle_radius[i] * omega[i] + noise[i]
        if st.speed_quantum > 0.0:
            rim = np.floor(rim / st.speed_quantum + 0.5) * st.speed_quantum
        m.axle_omega[i] = rim / eq.axle_radius[i]
        j = eq.axle_unit[i]
        if j >= 0 and m.axle_seen[i]:
            m.mean_speed[j] += rim / m.seen[j]
    share = 1.0 if st.speed_pole == 0.0 else -np.expm1(-st.speed_pole * st.period)
    for j in range(units):
        m.speed[j] += share * (m.mean_speed[j] - m.speed[j])
    for i in range(omega.size):
        j = eq.axle_unit[i]
        if j >= 0 and (st.speed_pole > 0.0 or not m.axle_seen[i]):
            # without sensors the inverter knows no single axle
            m.axle_omega[i] = m.speed[j] / eq.axle_radius[i]
        elif not m.axle_seen[i]:
            m.axle_omega[i] = m.reference[eq.axle_body[i]] / eq.axle_radius[i]


@inlined_jit
def _compare_with_reference(eq, st, m, sign, commanded):
    """Reference speeds, and how far the worst axle of each unit is from them."""
    for body in range(m.candidate.size):
        m.candidate[body] = np.inf
    for i in range(m.axle_omega.size):
        rim = eq.axle_radius[i] * m.axle_omega[i]
        body = eq.axle_body[i]
        if m.axle_seen[i]:
            m.candidate[body] = min(m.candidate[body], sign * rim)
    for body in range(m.reference.size):
        if np.isinf(
            m.candidate[body]
        ):  # no axle left to tell: the driver's command is all there is
            m.candidate[body] = sign * (m.reference[body] + commanded * st.period)
        if st.reference[0] > 0.0:
            least, greatest = m.motion[0] - st.reference[1], m.motion[0] + st.reference[1]
        else:
            least, greatest = acceleration_from_command(commanded, st.reference[1])
        m.reference[body] = follow_reference(
            m.reference[body], sign * m.candidate[body], least, greatest, st.period
        )
    for j in range(m.worst_slip.size):
        m.worst_slip[j] = -np.inf
    for i in range(m.axle_omega.size):
        slip = eq.axle_radius[i] * m.axle_omega[i] - m.reference[eq.axle_body[i]]
        j = eq.axle_unit[i]
        if j >= 0:
            m.worst_slip[j] = max(m.worst_slip[j], sign * slip)


@inlined_jit
def _move_by_forces(eq, m, sign, blended):
    """Acceleration [m/s2] that the train must have under the rail forces that its units estimate.

    Of axles without motor only the plan is known. Resistance and gradient are not.
    """
    force = 0.0
    for j in range(eq.axles.size):
        force += sign * m.estimate[j] * eq.axle_load[j] * eq.axles[j]
    if blended:
        for g in range(eq.group_unit.size):
            if eq.group_unit[g] < 0:
                planned = m.held[om.HELD_EXPECTED] * m.brake_rise[0] * eq.group_weight[g]
                force += sign * planned * eq.group_axles[g]
    m.motion[0] = force / eq.moved_mass


@inlined_jit
def sense(eq, st, m, time, commanded, omega, torque, noise):
    """Read the sensors: speeds, accelerations, slip signals, coefficient estimates; note B1's detection.

    `omega` (axles,) true angular speeds as the sensors see them, `noise` (axles,) [m/s at the rim], `torque` (units,)
    motor torque known to the inverters. Under blended brakes the estimate is (18): electric force as known, air brake
    force as commanded, and what the wheelsets' own deceleration takes of them.
    """
    units = eq.axles.size
    sign = 1.0 if commanded >= 0.0 else -1.0
    blended = eq.blended and commanded < 0.0
    if st.dropout.size:
        _lose_signals(eq, st, m, time)
    _read_speeds(eq, st, m, omega, noise)
    _compare_with_reference(eq, st, m, sign, commanded)
    first = 0
    while first < units - 1 and not m.in_service[first]:
        first += 1
    m.held[om.HELD_FIRST] = first
    m.held[om.HELD_ALLOCATE] = 0.0
    on, off, pole, gain, speed_on = st.detector
    a, keep, old, new = st.observer
    for j in range(units):
        if np.isnan(m.differentiator[j]):
            m.differentiator[j] = m.speed[j]
        m.differentiator[j], m.acceleration[j] = differentiate(
            m.differentiator[j], m.speed[j], pole, gain
        )
        angular = m.speed[j] / eq.radius[j]
        wheel_torque = torque[j] * eq.gear[j]
        if np.isnan(m.observer[j]):  # first sample: start in equilibrium
            m.observer_input[j] = wheel_torque + a * eq.inertia[j] * angular
            m.observer[j] = m.observer_input[j]
        m.observer[j], m.observer_input[j], load_torque = observe(
            m.observer[j],
            m.observer_input[j],
            wheel_torque,
            angular,
            eq.inertia[j],
            a,
            keep,
            old,
            new,
        )
        axle_load = eq.axle_load[j]
        m.estimate[j] = sign * tangential_coefficient_estimate(load_torque, axle_load, eq.radius[j])
        m.torque[j] = torque[j]
        if blended:
            electric = -torque[j] * eq.gear[j] / eq.radius[j]
            turning = st.brake_inertia * eq.inertia[j] / eq.radius[j] ** 2 * m.acceleration[j]
            m.estimate[j] = (electric + m.air[j] + turning) / axle_load
        was = m.slipping[j]
        m.slipping[j] = slip_signal(
            was, sign * m.acceleration[j], m.worst_slip[j], on, off, speed_on
        )
        if m.slipping[j] and commanded != 0.0:
            m.held[om.HELD_ANY_TIME] = time
        if m.slipping[j] and not was:
            m.counter[om.UNIT_DETECTIONS] += 1
            if j == first and commanded != 0.0:
                m.counter[om.DETECTIONS] += 1
                m.held[om.HELD_ESTIMATE] = min(max(m.estimate[j], 0.0), 1.0)
                m.held[om.HELD_TIME] = time
                m.held[om.HELD_ALLOCATE] = 1.0
        m.drive_limit[j] = _limit_at(eq.drive_table[j], m.speed[j])
        m.brake_limit[j] = _limit_at(eq.brake_table[j], m.speed[j])
        bound = m.drive_limit[j] if sign > 0.0 else m.brake_limit[j]
        at_rail = bound * eq.gear[j] / (axle_load * eq.radius[j] * (1.0 + eq.own_inertia[j]))
        if blended:
            m.limit_max[j] = np.inf  # what the motors cannot, the air brake can
        else:
            m.limit_max[j] = at_rail if m.in_service[j] else 0.0
    if st.reference[0] > 0.0:
        _move_by_forces(eq, m, sign, blended)
