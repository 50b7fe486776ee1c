"""The plant compiled: a fixed-step integrator, with what acts between steps.

Between steps the rail is read and changed (`rail_memory`), and brake commands pass through the cylinders' dead time; the
right side is in `right_side`.
"""

from alloc.compilation import inlined_jit, jit
from alloc.plant.rail_memory import leave_rail, read_rail
from alloc.plant.right_side import derivative, near_rest
from alloc.plant.simd import WIDTH, load, spread, store
from alloc.plant.workspace import workspace


@inlined_jit
def _copy_part(source, first, target, start, count):
    for i in range(count):
        target[start + i] = source[first + i]


@inlined_jit
def pack(w, state, y):
    """Write `state` (rows,) to the padded `y`."""
    for i in range(state.size):
        y[w.place[i]] = state[i]


@inlined_jit
def unpack(w, y, state):
    """The inverse of `pack`."""
    for i in range(state.size):
        state[i] = y[w.place[i]]


@inlined_jit
def _note(w):
    """Keep the adhesion field and the accelerations of the bodies of the right side just computed."""
    _copy_part(w.scratch.peak, 0, w.noted.peak, 0, w.size.axles)
    _copy_part(w.scratch.slope, w.row.speed, w.noted.acceleration, 0, w.size.bodies)


@inlined_jit
def _delay_pneumatics(w, target, valve):
    """Pass the brake commands through the dead time of each cylinder."""
    c = w.scratch
    slots = c.delay_target.shape[1]
    now = c.clock[0] % slots
    for g in range(w.size.groups):
        then = now - c.delay_steps[g]
        if then < 0:
            then += slots  # a remainder would cost more than the rest of this
        started = c.clock[0] >= c.delay_steps[g]
        c.delay_target[g, now] = target[g]
        c.delay_valve[g, now] = valve[g]
        c.target[g] = c.delay_target[g, then] if started else 0.0
        c.valve[g] = c.delay_valve[g, then] if started else 0.0
    c.clock[0] += 1


@inlined_jit
def _find_sticking(w):
    """Whether a contact may stick in the coming step, and the number of rows that change in it.

    A train that moves leaves no contact deflected: there nothing bears on it, and what it stored counts as lost already.
    """
    c, first = w.scratch, w.row.deflection
    was, now = c.sticking[0], near_rest(w, c.state)
    if was and not now:
        for i in range(first, w.row.end, WIDTH):
            store(c.state, i, spread(0.0))
    c.sticking[0] = now
    return w.row.end if now else first


@inlined_jit
def _copy(values, result, rows):
    for i in range(0, rows, WIDTH):
        store(result, i, load(values, i))


@inlined_jit
def _follow(c, weight, reach, rows):
    """Add the slope with this weight [s] to the step's end, and go `reach` [s] along it to the next stage; so many rows."""
    for i in range(0, rows, WIDTH):
        slope = load(c.slope, i)
        store(c.total, i, load(c.total, i) + weight * slope)
        store(c.stage, i, load(c.state, i) + reach * slope)


@inlined_jit
def inlined_advance(w, time, step, steps, state, inputs):
    """As `advance`, compiled into the loop that calls it: the classical fourth-order Runge-Kutta method."""
    c = w.scratch
    pack(w, state, c.state)
    _copy_part(inputs.torque_command, 0, c.command, 0, w.size.units)
    for k in range(steps):
        _delay_pneumatics(w, inputs.pressure_target, inputs.valve)
        if w.rail.conditioned or w.rail.sandy:
            read_rail(w)
        rows = _find_sticking(w)
        _copy(c.state, c.stage, rows)
        _copy(c.state, c.total, rows)
        for stage in range(w.stages.shape[0]):
            reach, ahead, share = w.stages[stage, 0], w.stages[stage, 1], w.stages[stage, 2]
            derivative(w, time + (k + reach) * step, c.stage, c.slope)
            if k == 0 and stage == 0:
                _note(w)
            _follow(c, share * step, ahead * step, rows)
        _copy(c.total, c.state, rows)
        if w.rail.conditioned or w.rail.sandy:
            leave_rail(w, inputs.sand_rate)
    unpack(w, c.state, state)
    return time + steps * step


@jit
def advance(w, time, step, steps, state, inputs):
    """Advance `state` (rows,) in place by `steps` steps with constant `inputs`; return the new time [s].

    The workspace `w` stores the memory of the rail and of the brakes' dead time; `w.noted` has the adhesion field and the
    accelerations at the first instant.
    """
    return inlined_advance(w, time, step, steps, state, inputs)


__all__ = ["advance", "inlined_advance", "pack", "unpack", "workspace"]
