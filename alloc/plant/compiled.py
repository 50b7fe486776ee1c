"""The plant compiled: assembly of the laws over axles and lanes, and a fixed-step integrator.

Inner loops run over lanes and hold no branch on states, so LLVM turns them into vector code. No
function here allocates; `Workspace` is made once per run.
"""

from typing import NamedTuple

import numpy as np

from alloc.compilation import jit
from alloc.plant.adhesion import PIECEWISE, POLACH, tangential_coefficient
from alloc.plant.equations import (
    axle_load,
    car_rail_force,
    conditioning_deposit,
    coupler_damper_force,
    coupler_spring_force,
    coupler_stretch,
    cylinder_pressure_rate,
    gradient_force,
    hyperbolic_speed_law,
    motor_torque_rate,
    running_resistance,
    shoe_torque,
    slip_velocity,
    wheel_acceleration,
)
from alloc.plant.field import interpolate_noise, patch_factor, peak_coefficient, window
from alloc.plant.model import Floats, Layout, Model
from alloc.plant.operations import maximum, minimum, sine
from alloc.plant.train import EFFORT_SPEED_STEP


class Workspace(NamedTuple):
    """Scratch of the compiled plant, and what it remembers between steps."""

    peak: Floats  # (axles, lanes)
    mu: Floats
    car: Floats  # (4, cars, lanes): static force, unloading, rail force, drag
    body: Floats  # (bodies, lanes) force
    unit: Floats  # (4, units, lanes): rim speed sum, drive limit, brake limit, wheel speed
    row: Floats  # (8, lanes)
    patch_time: Floats  # (patches, lanes)
    stage: Floats  # (rows, lanes)
    slope: Floats  # (rows, lanes)
    total: Floats  # (rows, lanes)
    cleaned: Floats  # (cells, lanes) degree of cleaning of each rail cell, a ring by position
    cell: np.ndarray  # (axles, lanes) cell of each axle at the end of the last step
    delay_target: Floats  # (groups, slots, lanes)
    delay_valve: Floats
    delay_steps: np.ndarray  # (groups,)
    clock: np.ndarray  # (1,) steps taken
    target: Floats  # (groups, lanes) delayed
    valve: Floats


def workspace(model: Model, step: float) -> Workspace:
    """Scratch for `model` advanced with `step` [s]."""
    n, lanes = model.layout, model.lanes
    length = sum(car.length for car in model.train.cars)
    cells = int(length / model.environment.cleaning_spacing) + 256
    dead_times = [
        car.air_brake.dead_time
        for car in model.train.cars
        if car.air_brake is not None
        for _ in range(max(car.bogie_of_axle) + 1)
    ]
    steps = np.array([round(t / step) for t in dead_times], dtype=np.int64)
    slots = int(steps.max(initial=0)) + 1
    return Workspace(
        peak=np.zeros((n.axles, lanes)),
        mu=np.zeros((n.axles, lanes)),
        car=np.zeros((4, n.cars, lanes)),
        body=np.zeros((n.bodies, lanes)),
        unit=np.zeros((4, n.units, lanes)),
        row=np.zeros((8, lanes)),
        patch_time=np.zeros((model.environment.patch.shape[0], lanes)),
        stage=np.zeros((n.rows, lanes)),
        slope=np.zeros((n.rows, lanes)),
        total=np.zeros((n.rows, lanes)),
        cleaned=np.zeros((cells if model.environment.conditioned else 1, lanes)),
        cell=np.full((n.axles, lanes), np.iinfo(np.int64).min, dtype=np.int64),
        delay_target=np.zeros((n.groups, slots, lanes)),
        delay_valve=np.zeros((n.groups, slots, lanes)),
        delay_steps=steps,
        clock=np.zeros(1, dtype=np.int64),
        target=np.zeros((n.groups, lanes)),
        valve=np.zeros((n.groups, lanes)),
    )


@jit
def _table_value(table, x):
    """Linear interpolation at `x` >= 0 in units of the table's spacing; the last value beyond its end."""
    bounded = minimum(maximum(x, 0.0), table.size - 1.000001)
    k = int(bounded)
    return table[k] + (table[k + 1] - table[k]) * (bounded - k)


@jit
def peak_field(s, e, layout, time, state, cleaning, w, peak):
    """Fill `peak` (axles, lanes) with the adhesion field at the state's positions and speeds."""
    lanes = state.shape[1]
    patches = e.patch.shape[0]
    for p in range(patches):
        for b in range(lanes):
            w.patch_time[p, b] = window(time, e.patch[p, 4, b], e.patch[p, 5, b], e.patch[p, 6, b])
    product = w.row[0]
    scatter = w.row[1]
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
            knots = e.noise.shape[1]
            for b in range(lanes):
                x = (state[body, b] + offset) / e.noise_length[b]
                base = np.floor(x)
                k = int(base)
                before = e.noise[b, k % knots]
                after = e.noise[b, (k + 1) % knots]
                scatter[b] = interpolate_noise(before, after, x - base)
        for b in range(lanes):
            peak[i, b] = peak_coefficient(
                state[layout.bodies + body, b],
                e.law[0, i, b],
                e.law[1, i, b],
                e.law[2, i, b],
                product[b],
                e.increment[i, b],
                scatter[b],
                e.conditioning[0, b] * cleaning[i, b],
            )


@jit
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
        else:
            for b in range(lanes):
                rim, v = r * state[first + i, b], state[body, b]
                mu[i, b] = tangential_coefficient(2, q, rim - v, v, rim, peak[i, b])


@jit
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


@jit
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


@jit
def _wheels(s, layout, state, force, w, slope):
    """Angular accelerations, and the works of motors, shoes and wheel-rail friction."""
    lanes = state.shape[1]
    omega = 2 * layout.bodies
    torque = omega + layout.axles
    pressure = torque + layout.units
    friction = pressure + layout.groups
    works = friction + layout.axles
    zero, motor, shoe_limit = w.row[2], w.row[3], w.row[4]
    for b in range(lanes):
        zero[b] = 0.0
        slope[works, b] = 0.0
        slope[works + 1, b] = 0.0
    for i in range(layout.axles):
        r, inertia, gear = s.radius[i], s.inertia[i], s.gear[i]
        body = layout.bodies + s.axle_body[i]
        j, group = s.axle_unit[i], s.axle_group[i]
        if j >= 0:
            for b in range(lanes):
                motor[b] = gear * state[torque + j, b]
        else:
            for b in range(lanes):
                motor[b] = 0.0
        if group >= 0:
            gain = s.shoe_gain[i] * r
            a, o, c = s.shoe_friction[i, 0], s.shoe_friction[i, 1], s.shoe_friction[i, 2]
            for b in range(lanes):
                grip = hyperbolic_speed_law(state[body, b], a, o, c)
                shoe_limit[b] = gain * state[pressure + group, b] * grip
            for b in range(lanes):
                shoe_limit[b] = shoe_torque(
                    motor[b] - r * force[i, b], state[omega + i, b], shoe_limit[b], inertia
                )
            for b in range(lanes):
                slope[works + 1, b] += shoe_limit[b] * state[omega + i, b]
        else:
            for b in range(lanes):
                shoe_limit[b] = 0.0
        for b in range(lanes):
            slope[omega + i, b] = wheel_acceleration(
                motor[b], force[i, b], r, shoe_limit[b], inertia
            )
        for b in range(lanes):
            slip = slip_velocity(state[omega + i, b], r, state[body, b])
            slope[friction + i, b] = force[i, b] * slip
        if j >= 0:
            for b in range(lanes):
                slope[works, b] += motor[b] * state[omega + i, b]


@jit
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
    for c in range(layout.cars):
        k = s.car_body[c]
        offset, mass = s.car_offset[c], s.car_mass[c]
        r0, r1, r2 = s.car_resistance[c, 0], s.car_resistance[c, 1], s.car_resistance[c, 2]
        for b in range(lanes):
            x = (state[k, b] + offset - e.line_origin) / e.line_spacing
            grade = _table_value(e.line[0], x)
            air = _table_value(e.line[1], x)
            v = state[layout.bodies + k, b]
            drag = running_resistance(v, r0, r1, r2, air) + gradient_force(mass, grade)
            w.car[3, c, b] = drag
            w.body[k, b] += w.car[2, c, b] - drag
            slope[works + 2, b] += drag * v
    for k in range(layout.bodies - 1):
        stiffness, stiffening = s.coupler[k, 0], s.coupler[k, 1]
        damping, slack = s.coupler[k, 2], s.coupler[k, 3]
        for b in range(lanes):
            stretch = coupler_stretch(state[k, b] - state[k + 1, b], slack)
            rate = state[layout.bodies + k, b] - state[layout.bodies + k + 1, b]
            damper = coupler_damper_force(stretch, rate, damping)
            tension = coupler_spring_force(stretch, stiffness, stiffening) + damper
            w.body[k, b] -= tension
            w.body[k + 1, b] += tension
            slope[works + 3, b] += damper * rate
    for k in range(layout.bodies):
        for b in range(lanes):
            slope[k, b] = state[layout.bodies + k, b]
            slope[layout.bodies + k, b] = w.body[k, b] / s.body_mass[k]


@jit
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


@jit
def _combine(total, factor, slope, out):
    """out = total + factor * slope."""
    for i in range(total.shape[0]):
        for b in range(total.shape[1]):
            out[i, b] = total[i, b] + factor * slope[i, b]


@jit
def runge_kutta_step(s, e, layout, time, step, state, command, target, valve, cleaning, w):
    """Advance `state` in place by one step of the classical fourth-order method."""
    k, stage, total = w.slope, w.stage, w.total
    derivative(s, e, layout, time, state, command, target, valve, cleaning, w, k)
    _combine(state, step / 6.0, k, total)
    _combine(state, step / 2.0, k, stage)
    derivative(s, e, layout, time + step / 2.0, stage, command, target, valve, cleaning, w, k)
    _combine(total, step / 3.0, k, total)
    _combine(state, step / 2.0, k, stage)
    derivative(s, e, layout, time + step / 2.0, stage, command, target, valve, cleaning, w, k)
    _combine(total, step / 3.0, k, total)
    _combine(state, step, k, stage)
    derivative(s, e, layout, time + step, stage, command, target, valve, cleaning, w, k)
    _combine(total, step / 6.0, k, state)


@jit
def _read_cleaning(s, e, layout, state, cleaning, w):
    """Cleaning of the rail under each axle, left by the wheels ahead."""
    cells = w.cleaned.shape[0]
    for i in range(layout.axles):
        body = s.axle_body[i]
        for b in range(state.shape[1]):
            x = (state[body, b] + s.axle_offset[i]) / e.cleaning_spacing
            base = int(np.floor(x))
            # the axle's own cell and those ahead hold what the wheels ahead left
            here, ahead = w.cleaned[base % cells, b], w.cleaned[(base + 1) % cells, b]
            cleaning[i, b] = here + (ahead - here) * (x - base)


@jit
def _leave_cleaning(s, e, layout, state, w):
    """Each axle marks the cells it has left behind; the foremost one starts them anew."""
    cells = w.cleaned.shape[0]
    for i in range(layout.axles):
        body = s.axle_body[i]
        for b in range(state.shape[1]):
            x = (state[body, b] + s.axle_offset[i]) / e.cleaning_spacing
            now = int(np.floor(x))
            if w.cell[i, b] < now - cells or w.cell[i, b] > now:
                w.cell[i, b] = now
            v = state[layout.bodies + body, b]
            rim = s.radius[i] * state[2 * layout.bodies + i, b]
            ratio = (rim - v) / max(max(abs(v), abs(rim)), 1e-3)
            deposit = conditioning_deposit(ratio, e.conditioning[1, b])
            if i == 0:
                w.cleaned[(now + 2) % cells, b] = 0.0
            for k in range(w.cell[i, b], now):
                if i == 0:
                    w.cleaned[(k + 2) % cells, b] = 0.0
                w.cleaned[k % cells, b] = max(w.cleaned[k % cells, b], deposit)
            w.cell[i, b] = now


@jit
def _delay_pneumatics(layout, target, valve, w):
    """Pass the brake commands through the dead time of each cylinder."""
    slots = w.delay_target.shape[1]
    now = w.clock[0] % slots
    for g in range(layout.groups):
        then = (w.clock[0] - w.delay_steps[g]) % slots
        started = w.clock[0] >= w.delay_steps[g]
        for b in range(target.shape[1]):
            w.delay_target[g, now, b] = target[g, b]
            w.delay_valve[g, now, b] = valve[g, b]
            w.target[g, b] = w.delay_target[g, then, b] if started else 0.0
            w.valve[g, b] = w.delay_valve[g, then, b] if started else 0.0
    w.clock[0] += 1


@jit
def advance(s, e, layout, time, step, steps, state, inputs, w):
    """Advance `state` in place by `steps` steps with constant inputs; return the new time."""
    for k in range(steps):
        _delay_pneumatics(layout, inputs.pressure_target, inputs.valve, w)
        if e.conditioned:
            _read_cleaning(s, e, layout, state, inputs.cleaning, w)
        runge_kutta_step(
            s, e, layout, time + k * step, step, state,
            inputs.torque_command, w.target, w.valve, inputs.cleaning, w,
        )  # fmt: skip
        if e.conditioned:
            _leave_cleaning(s, e, layout, state, w)
    return time + steps * step


class Rows(NamedTuple):
    """Sizes for compiled code; `Layout` is a Python object that Numba does not see through."""

    bodies: int
    axles: int
    cars: int
    units: int
    groups: int


def rows(layout: Layout) -> Rows:
    """Sizes of `layout` for compiled code."""
    return Rows(layout.bodies, layout.axles, layout.cars, layout.units, layout.groups)
