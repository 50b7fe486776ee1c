"""The adhesion field: peak coefficient by position, time, speed and the effect of the wheels ahead.

peak = (speed law x patches + increment + scatter) x (1 + gain x cleaning), never below a floor; sand raises it towards the
coefficient of sanded rail. JP5484215 gives the speed law (12), the increments by axle (15) and the scatter; JP4209318 par.
0051 gives the conditioning.
"""

from alloc.compilation import equation
from alloc.plant.operations import exp, floor, maximum, minimum
from alloc.plant.rail import NOISE_KNOTS

PEAK_FLOOR = 1e-3
"""Smallest peak coefficient of the field; scatter must not make adhesion zero or negative."""


@equation
def smooth_step(x):
    """0 below 0, 1 above 1, twice continuously differentiable between: 6 x^5 - 15 x^4 + 10 x^3."""
    bounded = minimum(1.0, maximum(0.0, x))  # in this order a nan passes through
    return bounded * bounded * bounded * (10.0 + bounded * (6.0 * bounded - 15.0))


@equation
def window(x, start, end, edge):
    """1 between `start` and `end`, 0 outside, with smooth edges of width `edge` centred on the bounds."""
    per_edge = 1.0 / edge
    return smooth_step((x - start) * per_edge + 0.5) * smooth_step((end - x) * per_edge + 0.5)


@equation
def patch_factor(weight_in_space, weight_in_time, factor):
    """Multiplier of the coefficient under a patch: 1 outside, `factor` inside."""
    return 1.0 + (factor - 1.0) * weight_in_space * weight_in_time


@equation
def scatter_knot(x, length):
    """Place in the scatter's ring of `NOISE_KNOTS` knots, `length` [m] apart, between which it is interpolated linearly.

    The smooth step makes the result a curve with zero slope at the knots.
    """
    knot = x * (1.0 / length)
    base = floor(knot)
    ring = base - NOISE_KNOTS * floor(base * (1.0 / NOISE_KNOTS))
    return ring + smooth_step(knot - base)


@equation
def peak_coefficient(decline, numerator, constant, patches, increment, scatter, conditioning):
    """Peak coefficient of one axle; `decline` is that of its speed law, `patches` the product of the patch factors."""
    base = (numerator * decline + constant) * patches
    return maximum((base + increment + scatter) * (1.0 + conditioning), PEAK_FLOOR)


@equation
def sanded_peak(peak, amount, sanded, saturation):
    """Peak coefficient on a rail with `amount` [kg/m] of sand: from `peak` towards `sanded`, by 63 % at `saturation` [kg/m].

    The form is assumed: the gain is proportional to the remaining difference, so each grain adds less than the one before.
    Where the rail carries more than `sanded`, sand changes nothing.
    """
    return peak + maximum(sanded - peak, 0.0) * (1.0 - exp(-amount / saturation))
