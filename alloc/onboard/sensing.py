"""Sensing, once per control period: speeds, accelerations, slip signals, coefficient estimates."""

import numpy as np

from alloc.compilation import jit
from alloc.onboard import memory as om
from alloc.onboard.detector import differentiate, slip_signal
from alloc.onboard.observer import observe, tangential_coefficient_estimate
from alloc.onboard.reference_speed import follow_reference
from alloc.plant.equations import GRAVITY


@jit
def _limit_at(table, speed):
    x = min(max(abs(speed) * 3.6, 0.0), table.size - 1.000001)
    k = int(x)
    return table[k] + (table[k + 1] - table[k]) * (x - k)


@jit
def sense(eq, st, m, time, commanded, omega, torque, noise):
    """Read the sensors: speeds, accelerations, slip signals, coefficient estimates; note B1's detection.

    `omega` (axles,) true angular speeds as the sensors see them, `noise` (axles,) [m/s at the rim], `torque` (units,) motor
    torque known to the inverters.
    """
    units = eq.axles.size
    sign = 1.0 if commanded >= 0.0 else -1.0
    for j in range(units):
        m.speed[j] = 0.0
    for body in range(m.candidate.size):
        m.candidate[body] = np.inf
    for i in range(omega.size):
        rim = eq.axle_radius[i] * omega[i] + noise[i]
        if st.speed_quantum > 0.0:
            rim = np.floor(rim / st.speed_quantum + 0.5) * st.speed_quantum
        m.axle_omega[i] = rim / eq.axle_radius[i]
        body = eq.axle_body[i]
        m.candidate[body] = min(m.candidate[body], sign * rim)
        j = eq.axle_unit[i]
        if j >= 0:
            m.speed[j] += rim / eq.axles[j]
    for body in range(m.reference.size):
        m.reference[body] = follow_reference(
            m.reference[body], sign * m.candidate[body], commanded, st.period
        )
    for j in range(units):
        m.worst_slip[j] = -np.inf
    for i in range(omega.size):
        j = eq.axle_unit[i]
        if j >= 0:
            reference = m.reference[eq.axle_body[i]]
            slip = sign * (eq.axle_radius[i] * m.axle_omega[i] - reference)
            m.worst_slip[j] = max(m.worst_slip[j], slip)
    first = 0
    while first < units - 1 and not m.in_service[first]:
        first += 1
    m.held[om.HELD_FIRST] = first
    m.held[om.HELD_ALLOCATE] = 0.0
    on, off, pole, gain, speed_on = st.detector
    a, keep, old, new = st.observer
    for j in range(units):
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
        axle_load = (eq.empty_axle_mass[j] + eq.load_per_axle[j]) * GRAVITY
        m.estimate[j] = sign * tangential_coefficient_estimate(load_torque, axle_load, eq.radius[j])
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
        m.limit_max[j] = at_rail if m.in_service[j] else 0.0
