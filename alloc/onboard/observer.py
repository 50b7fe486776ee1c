"""Minimal-order disturbance observer of the tangential force, JP5484215 (1)-(4), sampled.

tau_c = a/(s + a) (tau_m - J s w) is computed without differentiating the speed: with z = filter(tau_m + a J w), tau_c = z -
a J w. Between samples torque and speed are assumed to be linear; the recursion is exact for that.
"""

import math

from alloc.compilation import equation
from alloc.plant.equations import GRAVITY


def observer_gains(pole: float, period: float) -> tuple[float, float, float]:
    """Weights of the old filter state, the old input and the new input (first-order hold)."""
    decay = math.exp(-pole * period)
    mean = -math.expm1(-pole * period) / (pole * period)
    return decay, mean - decay, 1.0 - mean


@equation
def observe(filtered, last_input, torque, angular_speed, inertia, pole, keep, old, new):
    """One sample of (3), all at the wheel: returns filter state, input, and the estimated load torque [N m].

    `torque` is the motor torque times the gear ratio, `inertia` that of the wheelset with everything geared to it.
    """
    value = torque + pole * inertia * angular_speed
    filtered = keep * filtered + old * last_input + new * value
    return filtered, value, filtered - pole * inertia * angular_speed


@equation
def tangential_coefficient_estimate(load_torque, axle_load, radius):
    """Coefficient of (4) from the load torque at the wheel [N m] and the axle load with pay load [N]."""
    return load_torque / (axle_load * radius)


@equation
def empty_torque_limit(limit, empty_axle_mass, radius, gear_ratio):
    """Torque limit of an empty car [N m per motor], JP5484215 (6)."""
    return limit * empty_axle_mass * GRAVITY * radius / gear_ratio


@equation
def load_compensated(empty_limit, empty_axle_mass, load_per_axle):
    """Torque limit with load, JP5484215 (6')."""
    return empty_limit * (1.0 + load_per_axle / empty_axle_mass)
