"""The wire between plant and board: the one place that sees what is true and what is known.

`read` carries readings to the board, `apply` commands to the plant. `tell_speed` and `tell_limits` are a wire of their own:
they tell the oracle what no train can know, and no other rule.
"""

import math

from alloc.backends import compiled as law
from alloc.compilation import jit, last_use
from alloc.onboard.sensing import NOTICED, ROUNDING
from alloc.plant.curves import top
from alloc.plant.dynamics import derivative, state_places

USED, USED_BY_AIR, BACK = 0.999, 0.995, 0.8
"""Shares of the true adhesion that the oracle uses pulling, and braking with air: at the very peak no torque can be held.
Share of what a wheel beyond the peak carries that it leaves to it, so that the wheel comes back."""


@jit
def read(y, noise, wheelsets, cars, drives, cylinders, plant, axles, units, brakes, onboard, run):
    """Readings of an instant: pressures, torques, speeds with noise, quantum, wrong radius, and whether motors work.

    `y`: the plant's state; `noise` (axles,) of the speed sensors [m/s].
    """
    _, omega, torque, pressure, _ = state_places(wheelsets, cars, drives, cylinders, plant)
    quantum = onboard.speed_quantum
    for g in range(brakes.size):
        brakes[g].pressure = y[pressure + g]
    for j in range(units.size):
        u = units[j]
        u.works = 1 if run.time < drives[j].failure + NOTICED - ROUNDING else 0
        u.motor_torque, u.unseen = run.sign * y[torque + j], 0.0
    for i in range(axles.size):
        a, sensor, rim = axles[i], wheelsets[i], axles[i].radius * y[omega + i]
        a.was_seen, a.seen = has_signal(sensor, run.time - run.period), has_signal(sensor, run.time)
        if a.seen:
            a.signal = rim + noise[i]
            if quantum > 0.0:
                a.signal = math.floor(a.signal / quantum + 0.5) * quantum
        elif a.unit >= 0:  # its motors' inverter has the speed roughly
            units[a.unit].unseen += rim
    last_use(y, noise, wheelsets, cars, drives, cylinders, axles, units, brakes)


@jit
def has_signal(wheelset, time):
    """Whether the speed of an axle is known at an instant [s]: it has a sensor, whose signal is not lost."""
    lost = wheelset.lost - ROUNDING <= time < wheelset.back - ROUNDING
    return 1 if wheelset.sensed == 1 and not lost else 0


@jit
def apply(drives, cylinders, plant, units, brakes, run):
    """Commands of an instant: torques and pressures; and the plan by the true masses, which metrics judge by."""
    for j in range(drives.size):
        drives[j].applied = units[j].applied
    for g in range(cylinders.size):
        cylinders[g].pressure_target, cylinders[g].valve = (
            brakes[g].pressure_target,
            brakes[g].valve,
        )
    per_acceleration = plant.brake_planned if run.braking else plant.planned
    plant.planned_coefficient = abs(run.driver_command) * per_acceleration


# What the oracle is told


@jit
def tell_speed(y, wheelsets, cars, drives, cylinders, plant, axles, run):
    """True speeds of the train and of the cars of all axles."""
    bodies = state_places(wheelsets, cars, drives, cylinders, plant)[0]
    run.true_speed = y[bodies]
    for i in range(axles.size):
        axles[i].true_speed = y[bodies + wheelsets[i].body]


@jit
def tell_limits(
    t, y, stages, wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve, scatter, plant,
    units, brakes, run,
):  # fmt: skip
    """What each unit and each trailer's brake can carry, now and as far ahead as a torque cannot be changed.

    Writes `unit.truth` and `brake.most`.
    """
    bodies, omega, _, _, _ = state_places(wheelsets, cars, drives, cylinders, plant)
    ahead, moved = plant.period, stages[0]
    for j in range(units.size):
        units[j].truth = math.inf
        ahead = max(ahead, plant.period + 2.0 * drives[j].lag)
    for g in range(brakes.size):
        brakes[g].most = math.inf
    for reach in (ahead, 0.0):
        for r in range(y.size):
            moved[r] = y[r]
        for b in range(bodies):
            moved[b] += reach * y[bodies + b]
        derivative(
            t + reach, moved, stages[1], wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve,
            scatter, plant,
        )  # fmt: skip
        for i in range(wheelsets.size):
            a = wheelsets[i]
            speed = y[bodies + a.body]
            most, place = top(plant.curve_number, curve, speed, a.offered, a.contact)
            load = law.axle_load(a.static_load, a.unloading, cars[a.car].force)
            carried = (USED_BY_AIR if run.braking else USED) * most * load
            if run.sign * (a.radius * y[omega + i] - speed) > 1.05 * place:
                carried = min(carried, BACK * run.sign * a.rail_force)
            if a.unit >= 0:
                units[a.unit].truth = min(units[a.unit].truth, carried)
            elif a.brake >= 0:
                brakes[a.brake].most = min(brakes[a.brake].most, carried)
    for j in range(units.size):  # a part turns the wheelsets, as the train goes, not as planned
        u = units[j]
        turning = drives[j].inertia / u.radius**2 * run.sign * plant.acceleration
        share = 1.0 + (u.brake_turning if run.braking else u.turning)
        u.truth = max(u.truth + turning, 0.0) / (share * u.load)
