"""Sensing, once per control period: speeds, accelerations, slip signals, coefficient estimates, relative wheel radii.

In: the plant's true speeds with the noise, quantisation and losses of the sensors. Out: what the units know, in `Memory`.
"""

import numpy as np

from alloc.old.compilation import inlined_jit, jit
from alloc.old.onboard.laws import (
    believed_shoe_force,
    differentiate,
    observe,
    slip_signal,
    tangential_coefficient_estimate,
)
from alloc.old.onboard.reference_speed import estimate_speed, is_relieved, relieve
from alloc.old.onboard.telegrams import DETECTED, ESTIMATE
from alloc.old.plant.laws import limit_place, slip_velocity
from alloc.old.plant.operations import look_up

# Relative wheel radii, found while the train rolls.
#
# Wheels that no force acts on turn with the speed of their body. What one runs ahead of the others is then the error of
# its believed radius, e_i:
#
#     y_i = v (1 + e_i) + n,    e_i constant,    n ~ 2 noise^2,    sum of all e_i = 0
#
# Each e_i has a scalar Kalman filter. The error that all wheels have in common is not seen, but it makes no slip
# either. A train has mostly done so before a run begins (`ReferenceSpeed.radii_compared`).


LEAST_SPEED = 3.0
"""Speed [m/s] below which noise hides the radii."""

LEAST_COEFFICIENT, LEAST_PRESSURE = 1e-3, 1e3
"""Coefficient asked of a wheel, and cylinder pressure [Pa], below which neither makes it slip."""

AFTER = 0.5
"""Time [s] for which nothing has acted on any wheel: before, some may still return from a slide."""

GATE = 5.0
"""Deviations of a radius beyond which a reading is another fault."""


@inlined_jit
def _nothing_acts(eq, torque, pressure):
    """Whether neither motors nor shoes act on any wheel; `torque` (units,) [N m], `pressure` (groups,) [Pa]."""
    acts = False
    for j in range(torque.size):
        asked = abs(torque[j]) * eq.gear[j]
        acts = acts or asked > LEAST_COEFFICIENT * eq.radius[j] * eq.axle_load[j]
    for g in range(pressure.size):
        acts = acts or pressure[g] > LEAST_PRESSURE
    return not acts


@inlined_jit
def compare_radii(eq, st, m, commanded, torque, pressure):
    """Learn from one period in which the train rolls: fills `m.estimate.radii`.

    `commanded` acceleration [m/s2]; others as of `kalman_filter.predict`.
    """
    o, k, n = st.reference, m.estimate.radii, m.axle_omega.size
    if o.radius_deviation == 0.0:
        return
    rolls = commanded == 0.0 and _nothing_acts(eq, torque, pressure)
    k.rolling[0] = k.rolling[0] + st.period if rolls else 0.0
    if k.rolling[0] < AFTER or m.reference[0] < LEAST_SPEED:
        return
    most = GATE * o.radius_deviation
    together, count = 0.0, 0.0
    for i in range(n):
        v = m.reference[eq.axle_body[i]]
        k.ahead[i] = eq.axle_radius[i] * m.axle_omega[i] / v - 1.0
        if m.axle_seen[i] and abs(k.ahead[i]) < most:
            together, count = together + k.ahead[i], count + 1.0
    for i in range(n):
        if m.axle_seen[i] and abs(k.ahead[i]) < most:
            v = m.reference[eq.axle_body[i]]
            information = 0.5 * v * v / o.noise**2
            k.known[i] += information
            gain = information / (k.known[i] + 1.0 / o.radius_prior**2)
            change = 1.0 - gain * (k.ahead[i] - together / count)
            k.factor[i] *= change
            m.estimate.rim[i] *= change
            m.estimate.smooth_rim[i] *= change
    for j in range(torque.size):
        # the unit's speed is another now, which is no acceleration
        m.differentiator[j] = m.observer[j] = np.nan


@inlined_jit
def _lose_signals(eq, dropout, m, time):
    """Which axles' speeds are known now, and of how many axles each unit knows them.

    A unit that sees more or fewer axles than before starts its filters anew: its mean speed jumps, which is no acceleration.
    """
    for i in range(m.axle_seen.size):
        m.axle_seen[i] = eq.axle_sensed[i]
    for k in range(dropout.axle.size):
        if dropout.begin[k] <= time < dropout.until[k]:
            m.axle_seen[dropout.axle[k]] = False
    seen = m.unit.axles_seen
    for j in range(eq.axles.size):
        before, seen[j] = seen[j], 0.0
        for i in range(m.axle_seen.size):
            if eq.axle_unit[i] == j and m.axle_seen[i]:
                seen[j] += 1.0
        if before != seen[j]:
            m.differentiator[j] = m.observer[j] = np.nan
        if before > 0.0 and seen[j] == 0.0:
            m.counter.blinded[0] += 1


@inlined_jit
def _read_speeds(eq, st, m, omega, noise):
    """Rim speeds as sensors tell them, (axles,) and mean per unit.

    An axle without signal is taken to turn as the others of its unit do; where none has one, as the reference speed.
    """
    units = eq.axles.size
    seen, quantum, pole = m.unit.axles_seen, st.sensors.speed_quantum, st.sensors.pole
    for j in range(units):
        m.mean_speed[j] = 0.0 if seen[j] > 0.0 else m.reference[eq.unit_body[j]]
    for i in range(omega.size):
        rim = eq.axle_radius[i] * omega[i] + noise[i]
        if quantum > 0.0:
            rim = np.floor(rim / quantum + 0.5) * quantum
        rim *= m.estimate.radii.factor[i]
        m.axle_omega[i] = rim / eq.axle_radius[i]
        j = eq.axle_unit[i]
        if j >= 0 and m.axle_seen[i]:
            m.mean_speed[j] += rim / seen[j]
    share = 1.0 if pole == 0.0 else -np.expm1(-pole * st.period)
    for j in range(units):
        m.speed[j] += share * (m.mean_speed[j] - m.speed[j])
    for i in range(omega.size):
        j = eq.axle_unit[i]
        if j >= 0 and (pole > 0.0 or not m.axle_seen[i]):
            # without sensors the inverter knows no single axle
            m.axle_omega[i] = m.speed[j] / eq.axle_radius[i]
        elif not m.axle_seen[i]:
            m.axle_omega[i] = m.reference[eq.axle_body[i]] / eq.axle_radius[i]


@inlined_jit
def _compare_with_reference(eq, m, sign):
    """How far the worst axle of each unit is from the reference speed."""
    for j in range(m.worst_slip.size):
        m.worst_slip[j] = -np.inf
    for i in range(m.axle_omega.size):
        slip = slip_velocity(m.axle_omega[i], eq.axle_radius[i], m.reference[eq.axle_body[i]])
        j = eq.axle_unit[i]
        if j >= 0:
            m.worst_slip[j] = max(m.worst_slip[j], sign * slip)


@inlined_jit
def _read_air_forces(eq, st, m, pressure, blended):
    """Air brake force of each unit per axle at its rim: of its cylinders' pressure, or as commanded."""
    for g in range(pressure.size):
        m.pressure[g] = pressure[g]
    by_pressure = blended and st.brakes.by_pressure
    for j in range(eq.axles.size):
        m.air_force[j] = 0.0 if by_pressure else m.unit.air_brake_force[j]
    if by_pressure:
        for i in range(eq.axle_unit.size):
            j, g = eq.axle_unit[i], eq.axle_group[i]
            if j >= 0 and g >= 0:
                rim = eq.axle_radius[i] * m.axle_omega[i]
                force = believed_shoe_force(eq.group, g, pressure[g], rim)
                m.air_force[j] += force / eq.axles[j]


@inlined_jit
def _estimate(eq, st, m, j, torque, sign, blended):
    """Coefficient of unit `j`: by (4) from motor torque and speed; under blended brakes (18).

    To what (4) finds of the electric brake (18) adds the air brake's force; as printed it takes the electric force as it is.
    """
    o = st.observer
    angular = m.speed[j] / eq.radius[j]
    wheel_torque = torque * eq.gear[j]
    if np.isnan(m.observer[j]):  # first sample: start in equilibrium
        m.observer_input[j] = wheel_torque + o.pole * eq.inertia[j] * angular
        m.observer[j] = m.observer_input[j]
    m.observer[j], m.observer_input[j], load_torque = observe(
        m.observer[j], m.observer_input[j], wheel_torque, angular, eq.inertia[j],
        o.pole, o.keep, o.old, o.new,
    )  # fmt: skip
    axle_load = eq.axle_load[j]
    m.unit.coefficient_estimate[j] = sign * tangential_coefficient_estimate(
        load_torque, axle_load, eq.radius[j]
    )
    m.torque[j] = torque
    if blended:
        if not st.brakes.inertia_in_estimate:
            m.unit.coefficient_estimate[j] = -wheel_torque / (axle_load * eq.radius[j])
        m.unit.coefficient_estimate[j] += m.air_force[j] / axle_load


@inlined_jit
def _detect(st, m, j, sign, time, commanded):
    """Slip signal of unit `j`; the foremost unit's detection calls for an allocation."""
    d = st.detector
    was = m.unit.slipping[j] > 0.0
    if is_relieved(m, j):
        return  # its wheels change their speed because they are told to
    slipping = slip_signal(
        was, sign * m.unit.computed_acceleration[j], m.worst_slip[j], d.on, d.off, d.speed_on
    )
    m.unit.slipping[j] = 1.0 if slipping else 0.0
    if slipping and commanded != 0.0:
        m.lead.slipped[0] = time
    if slipping and not was:
        m.counter.unit_detections[0] += 1
        if commanded == 0.0:
            return
        found = min(max(m.unit.coefficient_estimate[j], 0.0), 1.0)
        if m.in_service[j] and m.unit.axles_seen[j] > 0.0:
            m.report.own[j, ESTIMATE], m.report.own[j, DETECTED] = found, time
        if j == m.lead.unit[0]:
            m.counter.detections[0] += 1
            m.lead.estimate[0], m.lead.detected[0] = found, time
            m.lead.allocate[0] = True


@inlined_jit
def _limits(eq, m, j, sign, blended):
    """Torque limits of unit `j` at its speed, and the coefficient that they allow."""
    place = limit_place(m.speed[j], 3.6, eq.drive_table.shape[1])
    m.drive_limit[j] = look_up(eq.drive_table[j], place)
    m.brake_limit[j] = look_up(eq.brake_table[j], place)
    bound = m.drive_limit[j] if sign > 0.0 else m.brake_limit[j]
    at_rail = bound * eq.gear[j] / (eq.axle_load[j] * eq.radius[j] * (1.0 + eq.own_inertia[j]))
    if blended:
        m.limit_max[j] = np.inf  # what the motors cannot, the air brake can
    else:
        m.limit_max[j] = at_rail if m.in_service[j] else 0.0


@jit
def sense(eq, st, m, time, commanded, omega, torque, pressure, noise):
    """Read the sensors: speeds, accelerations, slip signals, coefficient estimates; note the foremost unit's detection.

    `omega` (axles,) true angular speeds as the sensors see them, `noise` (axles,) [m/s at the rim], `torque` (units,)
    motor torque known to the inverters, `pressure` (groups,) of the brake cylinders [Pa].
    """
    units = eq.axles.size
    sign = 1.0 if commanded >= 0.0 else -1.0
    blended = eq.blended and commanded < 0.0
    if st.sensors.dropout.axle.size:
        _lose_signals(eq, st.sensors.dropout, m, time)
    _read_speeds(eq, st, m, omega, noise)
    if not st.reference.given:
        relieve(eq, st, m, estimate_speed(eq, st, m, sign, torque, pressure))
    compare_radii(eq, st, m, commanded, torque, pressure)
    _compare_with_reference(eq, m, sign)
    _read_air_forces(eq, st, m, pressure, blended)
    m.lead.allocate[0] = False
    for j in range(units):
        if np.isnan(m.differentiator[j]):
            m.differentiator[j] = m.speed[j]
        m.differentiator[j], m.unit.computed_acceleration[j] = differentiate(
            m.differentiator[j], m.speed[j], st.detector.pole, st.detector.gain
        )
        _estimate(eq, st, m, j, torque[j], sign, blended)
        _detect(st, m, j, sign, time, commanded)
        _limits(eq, m, j, sign, blended)
