"""Laws of the adhesion curves: the tangential force coefficient over the slip velocity, and its maximum.

Every law is odd in the slip velocity and takes the local `peak` from the adhesion field. For Polach's curve the peak is the
friction coefficient, and the maximum over the slip velocity is below it. For the others it is the adhesion coefficient,
which is that maximum.
"""

import math

from alloc.compilation import equation
from alloc.plant.operations import (
    absolute,
    atan,
    exp,
    interpolate,
    maximum,
    minimum,
    sqrt,
    where,
)

PIECEWISE, POLACH, SLIP_RATIO, TABULATED, POLACH_BY_FRICTION, RATIONAL = 0, 1, 2, 3, 4, 5

CREEPAGE_SPEED_FLOOR = 1.0
"""Smallest speed [m/s] that creepage is divided by: it applies at standstill and is reached smoothly from twice this speed.

Creepage is singular at standstill; the floor bounds the stiffness, and with it the number of substeps. It is a numerical
device, not a property of the rail.
"""

GROWTH_END = 3.0
"""Slip velocity times Polach's decay B at which the creepage of `polach_coefficient` stops growing."""


@equation
def parabola_curvature(peak, micro_slope, top_curvature, macro_slope, residual_ratio):
    """Curvature C of the parabola, raised where the source's value would not give a curve.

    The source needs C >= g1^2 / (4 peak), else its first break point is negative and the curve jumps at the origin. It also
    needs B > 0, that is C > g2^2 / (4 (peak - mu_inf)), else its tail grows without bound. The law takes the smallest C that
    satisfies the first condition and leaves half of the fall from the peak to the tail. The initial slope is kept, and the
    curve keeps its first derivative.
    """
    return maximum(
        top_curvature, narrowest_parabola(micro_slope, macro_slope, residual_ratio) / peak
    )


@equation
def narrowest_parabola(micro_slope, macro_slope, residual_ratio):
    """Smallest curvature of the parabola, times the peak."""
    for_line = 0.25 * micro_slope * micro_slope
    for_tail = 0.5 * macro_slope * macro_slope / (1.0 - residual_ratio)
    return maximum(for_line, for_tail)


@equation
def piecewise_coefficient(slip, peak, micro_slope, top_curvature, macro_slope, residual_ratio):
    """Line, parabola, exponential: readhesion paper (1)-(6).

    On a rail too slippery for the source's `top_curvature` the parabola is narrowed, see `parabola_curvature`.
    """
    narrowest = narrowest_parabola(micro_slope, macro_slope, residual_ratio)
    # divisions are what this law costs: but for one, below, they are by constants
    breadth = minimum(1.0 / top_curvature, peak * (1.0 / narrowest))
    magnitude = absolute(slip)
    middle, half_width = peak * (1.0 / micro_slope), 0.25 * micro_slope * breadth
    line_end = maximum(0.0, middle - half_width)  # (3)
    top = middle + half_width  # (4)
    tail_start = top + 0.5 * macro_slope * breadth  # (5)
    residual = residual_ratio * peak
    drop = peak - 0.25 * macro_slope * macro_slope * breadth - residual  # (6), B of the source
    inverse = 1.0 / (peak * drop)
    curvature = maximum(top_curvature, narrowest * drop * inverse)  # as `parabola_curvature`
    # the parabola with its top at (top, peak), seen from the line that it leaves: at the origin nothing is to cancel
    off_line = maximum(0.0, magnitude - line_end)  # in this order a nan passes through
    rise = micro_slope * magnitude - curvature * off_line * off_line
    beyond = maximum(0.0, magnitude - tail_start)
    tail = residual + drop * exp(-beyond * macro_slope * peak * inverse)
    value = where(magnitude < tail_start, rise, tail)
    return where(slip < 0.0, -value, value)


@equation
def reference_speed(speed, rim_speed):
    """Speed that slip is divided by: the larger of car and rim speed, kept away from zero.

    Above twice the floor it is that speed itself; below, a parabola leads to the floor without a kink.
    """
    larger = maximum(absolute(speed), absolute(rim_speed))
    slow = maximum(0.0, 1.0 - larger * (0.5 / CREEPAGE_SPEED_FLOOR))
    return larger + CREEPAGE_SPEED_FLOOR * slow * slow


@equation
def polach_set(kind, q, peak):
    """B [s/m], kA and kS of Polach's law, and the slip velocity [m/s] at which its creepage stops growing.

    They are given, or follow from Open Rails' interpolation over the friction coefficient at rest (`Axle.cs`,
    `PolachCalculator`). The interpolation meets Polach's dry set at 0.55 and his wet one at 0.30, and keeps the wet set
    below that.
    """
    if kind == POLACH:
        none = 0.0 * peak
        return q[1] + none, q[2] + none, q[3] + none, q[5] + none
    else:
        decay = maximum(1.6 * peak - 0.28, 0.2)
        adhesion_factor = maximum(2.8 * peak - 0.54, 0.3)
        return decay, adhesion_factor, maximum(1.2 * peak - 0.26, 0.1), GROWTH_END / decay


@equation
def growing_slip(slip, decay, end):
    """Slip velocity [m/s] from which creepage is computed: `slip` at first, constant from `end` = `GROWTH_END` / `decay` on.

    There friction has fallen to nearly its final value. If creepage continued to grow, the coefficient would rise again, by
    up to 4 % of the peak at high speed and load. The transition is of fifth order, so the maximum is unchanged.
    """
    bounded = minimum(end, maximum(-end, slip))  # in this order a nan passes through
    share = bounded * decay * (1.0 / GROWTH_END)
    square = share * share
    return bounded * (1.0 - 0.2 * square * square)


@equation
def polach_coefficient(slip, speed, rim_speed, peak, ratio_at_infinity, shape, creep_stiffness):
    """Polach's creep force law in pure longitudinal creep (Wear 258 (2005) 992-1000, eqs. 1-9).

    Friction falls with the slip velocity as ((1 - A) exp(-B w) + A) from its value `peak` at rest. Creepage stops growing
    once friction has fallen, see `growing_slip`. `shape`: the result of `polach_set`.
    """
    decay, adhesion_factor, slip_factor, end = shape
    friction = peak * ((1.0 - ratio_at_infinity) * exp(-decay * absolute(slip)) + ratio_at_infinity)
    grown = growing_slip(slip, decay, end)
    reference = reference_speed(speed, rim_speed + (grown - slip))
    gradient = creep_stiffness * absolute(grown) / (reference * friction)
    adhesion = adhesion_factor * gradient
    value = (
        (2.0 / math.pi)
        * friction
        * (adhesion / (1.0 + adhesion * adhesion) + atan(slip_factor * gradient))
    )
    return where(slip < 0.0, -value, value)


@equation
def slip_ratio_coefficient(slip, reference, peak, peak_slip_ratio, residual_ratio):
    """Rise 2x/(1 + x^2) to the peak at x = slip ratio / `peak_slip_ratio` = 1, then towards a residual.

    With `residual_ratio` = 1 it is flat beyond the peak, as in publications on wheel slide protection.
    """
    x = absolute(slip) / (reference * peak_slip_ratio)
    rise = 2.0 * x / (1.0 + x * x)
    beyond = residual_ratio + (1.0 - residual_ratio) * rise
    value = peak * where(x <= 1.0, rise, beyond)
    return where(slip < 0.0, -value, value)


@equation
def rational_coefficient(slip, peak, peak_slip, steepness):
    """Peak times n x / (1 + (n - 2) x + x^2) with x = slip / `peak_slip` and n = `steepness`, after Kiencke and Daiss.

    Its slope at the origin is n peak / `peak_slip`; the top is at x = 1 for every n > 0.
    """
    x = absolute(slip) / peak_slip
    value = peak * (steepness * x / (1.0 + x * (x + (steepness - 2.0))))
    return where(slip < 0.0, -value, value)


@equation
def tabulated_coefficient(slip, peak, table):
    """Shape of the curve from `table`: slip velocity of the peak, then values over slip / (slip + that of the peak)."""
    magnitude = absolute(slip)
    value = peak * interpolate(table, magnitude / (magnitude + table[0]))
    return where(slip < 0.0, -value, value)


@equation
def tangential_coefficient(kind, q, slip, speed, rim_speed, peak, contact=1.0):
    """Coefficient of the curve `kind` with its parameters `q`; elementwise in the other arguments.

    `contact`: creep stiffness of the axle over that in `q`.
    """
    if kind == PIECEWISE:
        return piecewise_coefficient(slip, peak, q[0], q[1], q[2], q[3])
    elif kind in (POLACH, POLACH_BY_FRICTION):
        shape = polach_set(kind, q, peak)
        return polach_coefficient(slip, speed, rim_speed, peak, q[0], shape, q[4] * contact)
    elif kind == SLIP_RATIO:
        reference = reference_speed(speed, rim_speed)
        return slip_ratio_coefficient(slip, reference, peak, q[0], q[1])
    elif kind == RATIONAL:
        return rational_coefficient(slip, peak, q[0], q[1])
    else:
        return tabulated_coefficient(slip, peak, q)


@equation
def polach_peak(kind, q, peak, speed, contact):
    """Largest Polach coefficient of a driving axle over the slip velocity, and its place (golden section search).

    The curve rises from zero to its maximum and does not rise again. The bracket (0, one tenth of the speed plus 2 m/s)
    contains the maximum of every published set.
    """
    shape = polach_set(kind, q, peak)
    ratio, stiffness = q[0], q[4] * contact
    golden = 0.6180339887498949
    low = 0.0 * (peak + speed)
    high = low + 0.1 * absolute(speed) + 2.0
    inner_low, inner_high = high - golden * (high - low), low + golden * (high - low)
    for _ in range(60):
        left = polach_coefficient(
            inner_low, speed, speed + inner_low, peak, ratio, shape, stiffness
        ) > polach_coefficient(inner_high, speed, speed + inner_high, peak, ratio, shape, stiffness)
        low = where(left, low, inner_low)
        high = where(left, inner_high, high)
        inner_low = high - golden * (high - low)
        inner_high = low + golden * (high - low)
    top = 0.5 * (low + high)
    return polach_coefficient(top, speed, speed + top, peak, ratio, shape, stiffness), top


@equation
def slip_ratio_peak(speed, ratio):
    """Slip velocity [m/s] of a driving axle at which slip / `reference_speed` is `ratio`."""
    v = absolute(speed) * (0.5 / CREEPAGE_SPEED_FLOOR)
    # slip = ratio * (1 + (v + slip)^2 / 4) on the parabola, in floors
    linear = 1.0 - ratio * v
    root = sqrt(maximum(0.0, linear * linear - ratio * ratio * (1.0 + v * v)))
    below = maximum(linear + root, 1.0 - ratio)  # as it is wherever the parabola counts
    slow = CREEPAGE_SPEED_FLOOR * 2.0 * ratio * (1.0 + v * v) / below
    return where(v < 1.0 - ratio, slow, absolute(speed) * ratio / (1.0 - ratio))


@equation
def adhesion_limit(kind, q, peak, speed, contact=1.0):
    """Adhesion coefficient of a driving axle (maximum over the slip velocity), and the slip velocity [m/s] there.

    `contact`: creep stiffness of the axle over that in `q`.
    """
    if kind == PIECEWISE:
        curvature = parabola_curvature(peak, q[0], q[1], q[2], q[3])
        return peak * 1.0, peak / q[0] + q[0] / (4.0 * curvature)
    elif kind in (POLACH, POLACH_BY_FRICTION):
        return polach_peak(kind, q, peak, speed, contact)
    elif kind in (TABULATED, RATIONAL):
        return peak * 1.0, q[0] + 0.0 * peak
    else:
        return peak * 1.0, slip_ratio_peak(speed, q[0]) + 0.0 * peak
