"""Small laws that several computers on board share: slip detector, observer, believed shoe force, fuzzy inference.

In: readings and beliefs of one unit or axle. Out: flags, coefficients, forces. All are compiled; memory is the caller's.
"""

import math

from alloc.old.compilation import equation, inlined_jit
from alloc.old.plant.laws import GRAVITY, hyperbolic_speed_law
from alloc.old.plant.operations import maximum, minimum

# Slip detection: computed acceleration of a unit's axles against thresholds with hysteresis (JP5484215 Fig. 5).


def differentiator_gain(pole: float, period: float) -> float:
    """Share of the new value that the differentiator's filter takes per `period` [s]."""
    return -math.expm1(-pole * period)


@equation
def differentiate(filtered, value, pole, gain):
    """Pseudo-differentiator p s / (s + p): returns the new filter state and the computed derivative."""
    derivative = pole * (value - filtered)
    return filtered + gain * (value - filtered), derivative


@equation
def slip_signal(was_on, acceleration, slip, on, off, speed_on):
    """New state of the detector's signal; acceleration and slip count positive in the direction of the demand.

    The signal comes on above `on` [m/s2] or beyond `speed_on` [m/s] of slip. It goes off only at or below `off` and below
    half of `speed_on`.
    """
    if acceleration > on or slip > speed_on:
        return True
    elif acceleration <= off and slip < 0.5 * speed_on:
        return False
    else:
        return was_on


# Minimal-order disturbance observer of the tangential force, JP5484215 (1)-(4), sampled.
#
# tau_c = a/(s + a) (tau_m - J s w) is computed without differentiating the speed: with z = filter(tau_m + a J w), tau_c
# = z - a J w. Between samples torque and speed are assumed to be linear; the recursion is exact for that.


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


# What computers believe of brake shoes: force by cylinder pressure and rim speed.


@inlined_jit
def believed_shoe_force(group, g, pressure, rim_speed):
    """Force [N] of the shoes of an axle of brake group `g` at the rim, under `pressure` [Pa] of its cylinders.

    `group`: as in `Equipment`. Shoes rub on the tread, so `rim_speed` [m/s] is the wheel's own: a wheel that slides is
    gripped harder.
    """
    numerator, offset, constant = group.friction[g]
    friction = hyperbolic_speed_law(rim_speed, numerator, offset, constant)
    return group.gain[g] * pressure * friction


# Fuzzy inference from two inputs: three overlapping sets each, nine rules, zero-order Sugeno.


@equation
def memberships(x, low, middle, high):
    """Degrees to which `x` belongs to three sets that peak at `low`, `middle`, `high`; their sum is 1."""
    first = minimum(maximum((middle - x) / (middle - low), 0.0), 1.0)
    last = minimum(maximum((x - middle) / (high - middle), 0.0), 1.0)
    return first, 1.0 - first - last, last


@equation
def weighted_action(rules, x, y, x_knots, y_knots):
    """Weighted mean of the actions `rules` (3, 3), rows by `x`, columns by `y`; knots (3,): where the sets peak.

    Where the rules are ordered along a row or a column, the surface is: the sets overlap in pairs.
    """
    low, middle, high = memberships(x, x_knots[0], x_knots[1], x_knots[2])
    first, second, third = memberships(y, y_knots[0], y_knots[1], y_knots[2])
    at_low = first * rules[0][0] + second * rules[0][1] + third * rules[0][2]
    at_middle = first * rules[1][0] + second * rules[1][1] + third * rules[1][2]
    at_high = first * rules[2][0] + second * rules[2][1] + third * rules[2][2]
    return low * at_low + middle * at_middle + high * at_high


# Fuzzy inference of a valve's action from slip and slip rate: nine rules, zero-order Sugeno.
#
# JP4209318 controls its valves by fuzzy inference and does not disclose the rules; these are this project's own.


SUPPLY, HOLD, RELEASE = 0.0, 1.0, 2.0
"""Actions of a bogie's valves, as the plant takes them (`alloc.old.plant.model.Inputs.valve`)."""

# What the valves should do, by slip (rows) and by slip rate (columns)
RULES = (
    # falling  steady    growing
    (SUPPLY, SUPPLY, HOLD),  # small slip: brake, but do not feed a slide that begins
    (SUPPLY, HOLD, RELEASE),  # medium: the slip that is wanted; act on where it goes
    (HOLD, RELEASE, RELEASE),  # large: release until the wheel comes back by itself
)


@equation
def infer(slip, rate, sensitivity, slip_knots, rate_knots):
    """Weighted mean of the rules' actions, `SUPPLY` to `RELEASE`; `slip` a ratio, `rate` in m/s2, knots (3,) each.

    It never falls with slip or rate. For sliding wheels whose slip grows, it does not fall with the sensitivity either,
    since the sets overlap in pairs and the rules are ordered.
    """
    x, y = sensitivity * slip, sensitivity * rate
    return weighted_action(RULES, x, y, slip_knots, rate_knots)


@equation
def valve_action(inferred):
    """The action nearest to the inferred value."""
    return SUPPLY if inferred < 0.5 else (HOLD if inferred < 1.5 else RELEASE)
