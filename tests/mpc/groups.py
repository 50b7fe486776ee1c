"""Groups of units for the tests of the joint problem, and random problems for them."""

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.sets import find_set
from mpc.model import parameters, unit_of_axle
from mpc.period import HorizonProblem

UNLOADING = tuple(find_set("commuter-8car").cars[1].unloading_factors().tolist())
"""Load lost per newton by the axles of a motor car, front axle first: the front ones lose."""


def unit(number, car, axles, unloading, curve=None, **values):
    """One unit of a motor car."""
    defaults = {
        "unit": number, "car": car, "axles": axles, "radius": 0.43, "inertia": 155.0,
        "gear_ratio": 7.07, "axle_load": 78e3, "mass": 13.75e3 * axles, "torque_lag": 5e-3,
        "curve": curve or PiecewiseCurve(), "period": 0.01, "unloading": unloading,
    }  # fmt: skip
    return UnitContext(**(defaults | values))


def car_of_four(transfer=1.0):
    """A car with a motor and an inverter per axle; `transfer` scales the load transfer."""
    return [unit(k, 0, 1, (transfer * UNLOADING[k],)) for k in range(4)]


def small_cars(cars, curve=None):
    """Cars of two axles with an inverter each: the least group of its kind, quickly compiled."""
    return [unit(2 * c + k, c, 1, (0.1 - 0.2 * k,), curve) for c in range(cars) for k in range(2)]


def train_of(cars, **values):
    """Cars with one inverter for four motors each."""
    return [unit(c, c, 4, UNLOADING, **values) for c in range(cars)]


def problem(group, seed):
    """Slip from none to three times the peak's, peaks of each unit its own, any torques."""
    rng = np.random.default_rng(seed)
    units, of_axle = len(group), unit_of_axle(group)
    peak = rng.uniform(0.06, 0.2, units)[of_axle]
    speed, torque = rng.uniform(2.0, 30.0), rng.uniform(0.0, 800.0, units)
    top = group[0].curve.limit(peak, speed)[1]
    omega = (speed + rng.uniform(0.0, 3.0, of_axle.size) * top) / 0.43
    return HorizonProblem(
        state=np.concatenate([[speed], omega, torque]),
        parameters=parameters(group, peak, rng.uniform(-0.02, 0.02)),
        slip_limit=top,
        target=rng.uniform(300.0, 800.0, units),
        before=torque,
        upper=rng.uniform(600.0, 1000.0, units),
        reference=rng.uniform(200.0, 800.0, units),
    )


def rolling(group, peak, torque, target, upper=1150.0):
    """Problem of a group that rolls without slip; `peak`, `torque`, `target`, `upper` one for all or per unit."""
    of_axle = unit_of_axle(group)
    peak = np.broadcast_to(np.asarray(peak, dtype=float), (len(group),))[of_axle]
    torque, target, upper = (np.full(len(group), value, float) for value in (torque, target, upper))
    return HorizonProblem(
        state=np.concatenate([[10.0], np.full(of_axle.size, 10.005 / 0.43), torque]),
        parameters=parameters(group, peak),
        slip_limit=group[0].curve.limit(peak, 10.0)[1],
        target=target,
        before=torque,
        upper=upper,
        reference=np.full(len(group), target.mean()),
    )
