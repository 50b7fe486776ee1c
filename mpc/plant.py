"""The plant on CasADi's symbols: rigid trains that pull on rail without memory; the laws are the compiled plant's own.

What is looked up in a table has a few knots about the place where the train will be: that is smooth, and short.
"""

import warnings
from types import FunctionType
from typing import Any

import casadi as cs
import numpy as np

from alloc.backends import symbolic as law
from alloc.plant import curves
from alloc.plant.dynamics import FLOOR
from alloc.run.event import Event
from alloc.run.world import World
from alloc.schema.errors import InputError, blamed_on

KNOTS = 4
"""Points of a table about a place."""
_coefficient = FunctionType(curves.coefficient.py_func.__code__, vars(curves) | {"law": law})


def refuse(event: Event, world: World) -> None:
    """Raise `InputError` for an event that this plant does not have."""
    p = world.plant[0]
    reasons = {
        "couplers": p.body_mass == 0.0,
        "rail that slip cleans": p.conditioning > 0.0,
        "adhesion that recovers": p.recovered_coefficient > 0.0,
        "motors that fail": (world.drives.failure < event.duration).any(),
        "braking": (world.command < 0.0).any(),
        "no traction": not (world.drives.size and (world.command > 0.0).any()),
        "a train that rolls backwards": event.initial_speed < 0.0,
        "a curve without a formula": type(event.rail.curve) is curves.TabulatedCurve,
    }
    if reason := next((reason for reason, holds in reasons.items() if holds), ""):
        need = "give a rigid train that pulls on rail without memory"
        raise InputError(f"event {event.name!r} has {reason}, where no optimum is sought: {need}")


def coefficient(world: World, curve: Any, slip: Any, speed: Any, peak: Any, contact: float) -> Any:
    """`alloc.plant.curves.coefficient`; of a curve that the compiled plant has as a table by its `shape`."""
    number, q = world.plant[0].curve_number, np.minimum(world.curve[:8], 1e9).tolist()
    if number != curves.TABULATED:
        return _coefficient(number, q, slip, speed, speed + slip, peak, contact)
    with warnings.catch_warnings(), blamed_on(f"adhesion curve {curve!r}", curve.shape):
        warnings.simplefilter("ignore", FutureWarning)  # CasADi's, of NumPy's functions on symbols
        share = curve.shape(cs.fabs(slip)) / float(curve.shape(np.array(q[:1]))[0])
    return law.copysign(peak * share, slip)


def between_knots(place: Any, knots: Any, step: Any) -> Any:
    """Value at a `place` counted in knots; `knots`: number of the first, then values; `step` leads from each to the next."""
    value = knots[1]
    for k in range(KNOTS - 1):
        value += step(place - knots[0] - k) * (knots[k + 2] - knots[k + 1])
    return value


def through_knots(place: Any, knots: Any) -> Any:
    """The same on the cubic through all values: of a table without jumps, and smooth."""
    s, by, value = place - knots[0], 1.0, 0.0
    differences = [knots[1], knots[2] - knots[1], knots[3] - 2.0 * knots[2] + knots[1]]
    differences.append(knots[4] - 3.0 * (knots[3] - knots[2]) - knots[1])
    for k, difference in enumerate(differences):
        value += by * difference
        by *= (s - k) / (k + 1.0)
    return value


def ramp(x: Any) -> Any:
    """0 below 0, 1 above 1, a line between them."""
    return law.minimum(law.maximum(x, 0.0), 1.0)


def build_plant(world: World, curve: Any) -> Any:
    """CasADi's function (y, u, t, knots) -> rates, rail forces of the driven axles, adhesion that the rail offers them.

    y: position, speed, slips of the driven axles, torques of the units, wheel damage; u: torques commanded. Rates are those
    of y, but of the rims' speeds in place of the slips: each depends on its own wheel alone. `knots`, (KNOTS + 1, axles +
    2): of the scatter under each axle; of the downhill force [N] and of the resistance that grows with the square of the
    speed [N s2/m2], by the train's place on the line. Wheelsets without motors roll with the train.
    """
    p, units, cars, driven = world.plant[0], world.drives, world.cars, world.wheelsets.unit >= 0
    a, turned = world.wheelsets[driven], world.wheelsets[~driven]
    n, m = a.size, units.size
    y, u, t = cs.SX.sym("y", n + m + 3), cs.SX.sym("u", m), cs.SX.sym("t")
    knots = cs.SX.sym("knots", KNOTS + 1, n + 2)
    x, v, slip, torque = y[0], y[1], y[2 : 2 + n], y[2 + n : 2 + n + m]

    # the rail
    decline = law.speed_law(v, 1.0, float(p.law_offset), 0.0)
    offered, mu = [], []
    for i in range(n):
        place, grown = x + float(a.offset[i]), float(a.increment[i])
        peak = float(a.law_numerator[i]) * decline + float(a.law_constant[i]) + grown
        peak = law.maximum(peak, FLOOR)
        for k in world.patches:
            inside = law.window(t, float(k.begin), float(k.until), float(k.fade))
            inside *= law.window(place, float(k.start), float(k.end), float(k.edge))
            peak += (float(k.factor) - 1.0) * inside * (peak - grown)
        if p.scatter_length > 0.0:
            peak += between_knots(place / float(p.scatter_length), knots[:, i], law.smooth_step)
        offered.append(law.maximum(peak, FLOOR))
        mu.append(coefficient(world, curve, slip[i], v, offered[i], float(a.contact[i])))

    # the train
    load, unloading = a.static_load.tolist(), a.unloading.tolist()
    for car in np.unique(a.car) if p.pitches else ():
        members = np.flatnonzero(a.car == car).tolist()
        carried = sum(mu[i] * load[i] for i in members)
        pull = law.car_force(carried, sum(mu[i] * unloading[i] for i in members))
        for i in members:
            load[i] = law.axle_load(load[i], unloading[i], pull)
    force = cs.vertcat(*[mu[i] * load[i] for i in range(n)])
    point = (x - float(p.line_origin)) / float(p.line_spacing)
    downhill, quadratic = (between_knots(point, knots[:, k], ramp) for k in (n, n + 1))
    constant, linear = float(cars.resistance.sum()), float(cars.resistance_linear.sum())
    drag = law.resistance(v, constant, linear, quadratic) + downhill
    mass = float(p.body_mass + (turned.inertia / turned.radius**2).sum())

    # wheelsets and motors
    shaft, rims = [float(a.gear[i] / a.radius[i]) * (v + slip[i]) for i in range(n)], []
    for i, j in enumerate(a.unit.tolist()):
        gear, radius, peers = float(a.gear[i]), float(a.radius[i]), np.flatnonzero(a.unit == j)
        mean = sum(shaft[k] for k in peers) / peers.size
        motor = law.parallel_torque(torque[j], float(units.slip_torque[j]), mean, shaft[i])
        rims.append(radius / float(a.inertia[i]) * (gear * motor - radius * force[i]))
    lags = [(u[j] - torque[j]) / float(units.lag[j]) for j in range(m)]
    rates = cs.vertcat(v, (cs.sum1(force) - drag) / mass, *rims, *lags, cs.dot(force, slip))
    return cs.Function("plant", [y, u, t, knots], cs.cse([rates, force, cs.vertcat(*offered)]))
