"""Right side of the compiled plant: assembly of the laws over axles and lanes.

Inner loops run over lanes and hold neither a branch on states nor a call, so LLVM turns them into vector code;
table look-ups, which it cannot, stand in loops of their own. No function here allocates.
"""

import numpy as np

from alloc.compilation import inlined_jit
from alloc.plant.adhesion_laws import (
    PIECEWISE,
    POLACH,
    SLIP_RATIO,
    TABULATED,
    tangential_coefficient,
)
from alloc.plant.car import EFFORT_SPEED_STEP
from alloc.plant.equations import (
    axle_load,
    car_drag,
    car_rail_force,
    coupler_forces,
    cylinder_pressure_rate,
    hyperbolic_speed_law,
    motor_torque_rate,
    slip_velocity,
    wheelset,
)
from alloc.plant.field import interpolate_noise, patch_factor, peak_coefficient, window
from alloc.plant.operations import maximum, minimum, sine
from alloc.plant.rail import NOISE_KNOTS


@inlined_jit
def _table_value(table, x):
    """Linear interpolation at `x` >= 0 in units of the table's spacing; the last value beyond its end."""
    bounded = minimum(maximum(x, 0.0), table.size - 1.000001)
    k = int(bounded)
    return table[k] + (table[k + 1] - table[k]) * (bounded - k)


@inlined_jit
def peak_field(s, e, layout, time, state, cleaning, w, peak):
    """Fill `peak` (axles, lanes) with the adhesion field at the state's positions and speeds."""
    lanes = state.shape[1]
    patches = e.patch.shape[0]
    for p in range(patches):
        for b in range(lanes):
            w.patch_time[p, b] = window(time, e.patch[p, 4, b], e.patch[p, 5, b], e.patch[p, 6, b])
    product, scatter, knot, before, after = w.row[0], w.row[1], w.row[2], w.row[3], w.row[4]
    for i in range(layout.axles):
        body = s.axle_body[i]
        offset = s.axle_offset[i]
        for b in range(lanes):
            product[b] = 1.0
            scatter[b] = 0.0
        for p in range(patches):
            for b in range(lanes):
                x = state[body, b] + offset
                space = window(x, e.patch[p, 1, b], e.patch[p, 2, b], e.patch[p, 3, b])
                product[b] *= patch_factor(space, w.patch_time[p, b], e.patch[p, 0, b])
        if e.noisy:
            for b in range(lanes):
                knot[b] = (state[body, b] + offset) / e.noise_length[b]
            for b in range(
                lanes
            ):  # apart: LLVM does not vectorise look-ups, but what surrounds them
                k = int(np.floor(knot[b]))
                before[b] = e.noise[b, k % NOISE_KNOTS]
                after[b] = e.noise[b, (k + 1) % NOISE_KNOTS]
            for b in range(lanes):
                fraction = knot[b] - np.floor(knot[b])
                scatter[b] = interpolate_noise(before[b], after[b], fraction)
        for b in range(lanes):
            peak[i, b] = peak_coefficient(
                state[layout.bodies + body, b], e.law[0, i, b], e.law[1, i, b], e.law[2, i, b],
                product[b], e.increment[i, b], scatter[b], e.conditioning[0, b] * cleaning[i, b],
            )  # fmt: skip


@inlined_jit
def _coefficients(s, e, layout, state, peak, mu):
    """Tangential force coefficient of every axle; the curve is chosen outside the loop over lanes."""
    lanes = state.shape[1]
    q = e.curve
    first = 2 * layout.bodies
    for i in range(layout.axles):
        r = s.radius[i]
        body = layout.bodies + s.axle_body[i]
        if e.curve_kind == PIECEWISE:
            for b in range(lanes):
                rim, v = r * state[first + i, b], state[body, b]
                mu[i, b] = tangential_coefficient(PIECEWISE, q, rim - v, v, rim, peak[i, b])
        elif e.curve_kind == POLACH:
            for b in range(lanes):
                rim, v = r * state[first + i, b], state[body, b]
                mu[i, b] = tangential_coefficient(POLACH, q, rim - v, v, rim, peak[i, b])
        elif e.curve_kind == SLIP_RATIO:
            for b in range(lanes):
                rim, v = r * state[first + i, b], state[body, b]
                mu[i, b] = tangential_coefficient(SLIP_RATIO, q, rim - v, v, rim, peak[i, b])
        else:
            for b in range(lanes):
                rim, v = r * state[first + i, b], state[body, b]
                mu[i, b] = tangential_coefficient(TABULATED, q, rim - v, v, rim, peak[i, b])


@inlined_jit
def _motors(s, e, layout, time, state, command, w, slope):
    """Torque limits from the units' rim speeds, and the rate of the motor torques."""
    lanes = state.shape[1]
    omega = 2 * layout.bodies
    torque = omega + layout.axles
    for j in range(layout.units):
        for b in range(lanes):
            w.unit[0, j, b] = 0.0
    for i in range(layout.axles):
        j = s.axle_unit[i]
        if j >= 0:
            scale = s.radius[i] / s.unit_axles[j]
            for b in range(lanes):
                w.unit[0, j, b] += scale * state[omega + i, b]
    for b in range(lanes):
        wave = sine(6.283185307179586 * time / e.receptivity[2, b] + e.receptivity[3, b])
        w.row[0, b] = minimum(maximum(e.receptivity[0, b] + e.receptivity[1, b] * wave, 0.0), 1.0)
    for j in range(layout.units):
        lag = s.unit_lag[j]
        for b in range(lanes):
            x = abs(w.unit[0, j, b]) / EFFORT_SPEED_STEP
            w.unit[1, j, b] = _table_value(s.drive_table[j], x)
            w.unit[2, j, b] = _table_value(s.brake_table[j], x) * w.row[0, b]
        for b in range(lanes):
            health = 1.0 if time < e.failure_time[j, b] else 0.0
            slope[torque + j, b] = motor_torque_rate(
                state[torque + j, b], command[j, b], w.unit[1, j, b], w.unit[2, j, b], health, lag
            )


@inlined_jit
def _loads_and_forces(s, layout, peak_mu, w):
    """Rail force of every axle into w.mu, rail force of every car into w.car[2]."""
    lanes = peak_mu.shape[1]
    for c in range(layout.cars):
        for b in range(lanes):
            w.car[0, c, b] = 0.0
            w.car[1, c, b] = 0.0
    for i in range(layout.axles):
        c = s.axle_car[i]
        load, unloading = s.static_load[i], s.unloading[i]
        for b in range(lanes):
            w.car[0, c, b] += peak_mu[i, b] * load
            w.car[1, c, b] += peak_mu[i, b] * unloading
    for c in range(layout.cars):
        for b in range(lanes):
            w.car[2, c, b] = car_rail_force(w.car[0, c, b], w.car[1, c, b])
    for i in range(layout.axles):
        c = s.axle_car[i]
        load, unloading = s.static_load[i], s.unloading[i]
        for b in range(lanes):
            peak_mu[i, b] *= axle_load(load, unloading, w.car[2, c, b])


@inlined_jit
def _wheels(s, layout, state, force, w, slope):
    """Angular accelerations, and the works of motors, shoes and wheel-rail friction."""
    lanes = state.shape[1]
    omega = 2 * layout.bodies
    torque = omega + layout.axles
    pressure = torque + layout.units
    friction = pressure + layout.groups
    works = friction + layout.axles
    motor, shoe_limit = w.row[0], w.row[1]
    for b in range(lanes):
        slope[works, b] = 0.0
        slope[works + 1, b] = 0.0
    for i in range(layout.axles):
        r, inertia, gear = s.radius[i], s.inertia[i], s.gear[i]
        body = layout.bodies + s.axle_body[i]
        j, group = s.axle_unit[i], s.axle_group[i]
        for b in range(lanes):
            motor[b] = gear * state[torque + j, b] if j >= 0 else 0.0
        if group >= 0:
            gain = s.shoe_gain[i] * r
            a, o, c = s.shoe_friction[i, 0], s.shoe_friction[i, 1], s.shoe_friction[i, 2]
            for b in range(lanes):
                grip = hyperbolic_speed_law(state[body, b], a, o, c)
                shoe_limit[b] = gain * state[pressure + group, b] * grip
        else:
            for b in range(lanes):
                shoe_limit[b] = 0.0
        for b in range(lanes):
            rotation = state[omega + i, b]
            shoe, acceleration = wheelset(
                motor[b], force[i, b], r, rotation, shoe_limit[b], inertia
            )
            slope[omega + i, b] = acceleration
            slope[friction + i, b] = force[i, b] * slip_velocity(rotation, r, state[body, b])
            slope[works, b] += motor[b] * rotation
            slope[works + 1, b] += shoe * rotation


@inlined_jit
def _cars(s, e, layout, state, w, slope):
    """Accelerations of the bodies under rail forces, resistance, gradient and couplers."""
    lanes = state.shape[1]
    works = 2 * layout.bodies + 2 * layout.axles + layout.units + layout.groups
    for k in range(layout.bodies):
        for b in range(lanes):
            w.body[k, b] = 0.0
    for b in range(lanes):
        slope[works + 2, b] = 0.0
        slope[works + 3, b] = 0.0
    grade, air = w.row[0], w.row[1]
    for c in range(layout.cars):
        k = s.car_body[c]
        offset, mass = s.car_offset[c], s.car_mass[c]
        r0, r1, r2 = s.car_resistance[c, 0], s.car_resistance[c, 1], s.car_resistance[c, 2]
        for b in range(lanes):
            x = (state[k, b] + offset - e.line_origin) / e.line_spacing
            grade[b] = _table_value(e.line[0], x)
            air[b] = _table_value(e.line[1], x)
        for b in range(lanes):
            v = state[layout.bodies + k, b]
            drag = car_drag(v, r0, r1, r2, air[b], mass, grade[b])
            w.car[3, c, b] = drag
            w.body[k, b] += w.car[2, c, b] - drag
            slope[works + 2, b] += drag * v
    for k in range(layout.bodies - 1):
        stiffness, stiffening = s.coupler[k, 0], s.coupler[k, 1]
        damping, slack = s.coupler[k, 2], s.coupler[k, 3]
        for b in range(lanes):
            elongation = state[k, b] - state[k + 1, b]
            rate = state[layout.bodies + k, b] - state[layout.bodies + k + 1, b]
            tension, damper = coupler_forces(
                elongation, rate, stiffness, stiffening, damping, slack
            )
            w.body[k, b] -= tension
            w.body[k + 1, b] += tension
            slope[works + 3, b] += damper * rate
    for k in range(layout.bodies):
        for b in range(lanes):
            slope[k, b] = state[layout.bodies + k, b]
            slope[layout.bodies + k, b] = w.body[k, b] / s.body_mass[k]


@inlined_jit
def derivative(s, e, layout, time, state, command, target, valve, cleaning, w, slope):
    """Fill `slope` (rows, lanes) with the state's derivative at `time` [s]."""
    peak_field(s, e, layout, time, state, cleaning, w, w.peak)
    _coefficients(s, e, layout, state, w.peak, w.mu)
    _loads_and_forces(s, layout, w.mu, w)
    _motors(s, e, layout, time, state, command, w, slope)
    _wheels(s, layout, state, w.mu, w, slope)
    _cars(s, e, layout, state, w, slope)
    first = 2 * layout.bodies + layout.axles + layout.units
    for g in range(layout.groups):
        fill, release = s.group_fill[g], s.group_release[g]
        for b in range(state.shape[1]):
            slope[first + g, b] = cylinder_pressure_rate(
                state[first + g, b], target[g, b], valve[g, b], fill, release
            )
