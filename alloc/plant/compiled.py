"""The plant compiled: a fixed-step integrator, with what acts between steps.

Between steps the rail is cleaned and read, and brake commands pass through the cylinders' dead time; the
right side is in `right_side`.
"""

from typing import NamedTuple

import numpy as np

from alloc.compilation import inlined_jit, jit
from alloc.plant.equations import conditioning_deposit
from alloc.plant.model import Floats, Model
from alloc.plant.right_side import derivative


class Workspace(NamedTuple):
    """Scratch of the compiled plant, and what it remembers between steps."""

    peak: Floats  # (axles, lanes)
    mu: Floats
    car: Floats  # (4, cars, lanes): static force, unloading, rail force, drag
    body: Floats  # (bodies, lanes) force
    unit: Floats  # (4, units, lanes): rim speed sum, drive limit, brake limit, wheel speed
    row: Floats  # (5, lanes)
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
    steps = np.array(
        [round(brake.dead_time / step) for brake in model.train.brake_groups], dtype=np.int64
    )
    slots = int(steps.max(initial=0)) + 1
    return Workspace(
        peak=np.zeros((n.axles, lanes)),
        mu=np.zeros((n.axles, lanes)),
        car=np.zeros((4, n.cars, lanes)),
        body=np.zeros((n.bodies, lanes)),
        unit=np.zeros((4, n.units, lanes)),
        row=np.zeros((5, lanes)),
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


@inlined_jit
def runge_kutta_step(s, e, layout, time, step, state, command, target, valve, cleaning, w):
    """Advance `state` in place by one step of the classical fourth-order method."""
    rows, lanes = state.shape
    for i in range(rows):
        for b in range(lanes):
            w.total[i, b] = w.stage[i, b] = state[i, b]
    # one call for all stages: the right side is inlined, and compiled once
    for stage in range(4):
        share = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
        reach = 0.0 if stage == 0 else (step if stage == 3 else 0.5 * step)
        ahead = step if stage == 2 else 0.5 * step
        derivative(
            s, e, layout, time + reach, w.stage, command, target, valve, cleaning, w, w.slope
        )
        for i in range(rows):
            for b in range(lanes):
                w.total[i, b] += share * w.slope[i, b]
                w.stage[i, b] = state[i, b] + ahead * w.slope[i, b]
    for i in range(rows):
        for b in range(lanes):
            state[i, b] = w.total[i, b]


@inlined_jit
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


@inlined_jit
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


@inlined_jit
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


@jit
def note(s, e, layout, time, state, inputs, w, k, states, peaks, accelerations):
    """Write state, adhesion field and accelerations of the bodies at `time` [s] to row `k` of three records."""
    derivative(
        s, e, layout, time, state, inputs.torque_command, w.target, w.valve, inputs.cleaning, w, w.slope
    )  # fmt: skip
    # element by element: an assignment of arrays compiles its check of shapes too, for seconds
    for i in range(state.shape[0]):
        states[k, i] = state[i, 0]
    for i in range(layout.axles):
        peaks[k, i] = w.peak[i, 0]
    for i in range(layout.bodies):
        accelerations[k, i] = w.slope[layout.bodies + i, 0]
