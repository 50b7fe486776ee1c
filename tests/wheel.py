"""A wheelset on a rail whose curve is known, and random rows, for tests of controllers."""

import math
from types import FunctionType

import numpy as np

from alloc.onboard.columns import AXLE, RUN, UNIT

LOAD, RADIUS, GEAR, INERTIA = 9e4, 0.41, 6.5, 130.0
SCALE = LOAD * RADIUS / GEAR
"""Torque of a coefficient of 1 [N m]."""


def rows(sign=1.0, period=0.01, lag=0.02, axles=1, number=0):
    """A unit, its axles and the run: the unit's motors can do anything."""
    values = {"load": LOAD, "radius": RADIUS, "gear": GEAR, "inertia": INERTIA}
    unit = UNIT.rows(1, lag=lag, drive_limit=1e9, brake_limit=1e9, **values)
    run = RUN.rows(1, period=period, sign=sign, plan=0.15, driver_command=0.8 * sign)
    return unit[0], AXLE.rows(axles, unit=number), run[0]


def course(seed, ticks, sign=1.0, period=0.01, backwards=False):
    """Random rows, tick by tick; nothing of them follows from the torque commanded. Plant signs turn if `backwards`."""
    rng = np.random.default_rng(seed)
    unit, axles, run = rows(sign, period, lag=rng.choice([0.005, 0.1]), axles=3, number=2)
    axles.unit[1], way = -1, -1.0 if backwards else 1.0
    run.sign *= way
    target, slip, coefficient, speed = 0.1, 0.0, 0.1, 3.0
    for _ in range(ticks):
        target = rng.uniform(0.0, 0.2) if rng.random() < 0.02 else target
        slip += 0.02 * rng.normal() - 0.05 * (slip - 0.1) + (0.3 if rng.random() < 0.01 else 0.0)
        coefficient = max(coefficient + 0.01 * rng.normal() - 0.01 * (coefficient - 0.1), 0.0)
        speed += sign * period * rng.uniform(0.0, 1.0)
        unit.torque_target, unit.motor_torque = target * SCALE, coefficient * SCALE
        unit.worst_slip, unit.slipping = slip, int(rng.random() < 0.2)
        unit.coefficient_estimate, unit.air = coefficient, 2e3 * (sign < 0.0)
        run.reference_speed, unit.rim = way * speed, way * (speed + sign * slip)
        for a in axles:
            a.reading = way * (speed + sign * slip * rng.uniform(0.8, 1.0))
        yield unit, axles, run


def drive(controller, peak, best, seconds=10.0, noise=0.0, power=0.0):
    """The wheelset in closed loop: (ticks,) slips [m/s], coefficients, commands over SCALE, and the memory at the end.

    The target rises to a coefficient of 0.15 in 1.5 s.
    The coefficient is `peak`(t) 2 x / (1 + x^2), x = slip / `best`, and falls half as far beyond the peak; with a `power`,
    it is peak x^power.
    """
    unit, axles, run = rows()
    memory, rng, told = controller.rows(1)[0], np.random.default_rng(1), []
    slip, torque, speed, rim, mu = 0.0, 0.0, 5.0, 5.0, 0.0
    lag, h = float(unit.lag), 0.1 * float(run.period)
    for k in range(round(seconds / run.period)):
        t = 10.0 * h * k
        reading = speed + slip + noise * float(rng.normal())
        unit.computed_acceleration = (reading - rim) / run.period
        on, off = unit.computed_acceleration > 1.8, unit.computed_acceleration <= 0.9
        unit.slipping = int(on or slip > 0.6 or (unit.slipping and not (off and slip < 0.3)))
        unit.coefficient_estimate += 0.22 * (mu - unit.coefficient_estimate)
        unit.torque_target, unit.motor_torque = min(0.1 * t, 0.15) * SCALE, torque
        unit.worst_slip, unit.rim, run.reference_speed = reading - speed, reading, speed
        axles.reading[0], rim = reading, reading
        controller.control(unit, axles, memory, run)
        command, high = float(unit.torque_command), peak(t)
        for _ in range(10):
            x = max(slip, 0.0) / best
            share = x**power if power else 2.0 * x / (1.0 + x * x)
            mu = high * (share if power or x < 1.0 else 0.5 + 0.5 * share)
            torque += h / lag * (command - torque)
            ahead = 0.8 * mu / 0.15
            pull = RADIUS / INERTIA * (GEAR * torque - RADIUS * LOAD * mu)
            slip, speed = slip + h * (pull - ahead), speed + h * ahead
        told.append((slip, mu, unit.torque_command / SCALE))
    return *np.array(told).T, memory


def plain(function):
    """A compiled function as Python has it, with all that it calls."""
    bare = function.py_func
    scope = {
        key: plain(one) if hasattr(one, "py_func") else one
        for key, one in bare.__globals__.items()
        if key in bare.__code__.co_names
    }
    return FunctionType(bare.__code__, scope | {"__builtins__": __builtins__, "math": math})
