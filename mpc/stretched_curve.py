"""An adhesion curve with its rising branch stretched along the slip axis, and that branch's inverse."""

import math
from dataclasses import fields

import numpy as np

from alloc.compilation import jit
from alloc.plant.adhesion import AdhesionCurve
from alloc.plant.adhesion_laws import PIECEWISE, POLACH, tangential_coefficient

GREATEST_RATIO = 0.9
"""Bound of a stretched curve's slip ratio at the peak, which is below 1 by definition."""

BISECTIONS = 24


@jit
def stretch_parameters(kind, q, stretch, out):
    """Fill `out` (6,) with the parameters `q` (6,) of a curve stretched along the slip axis."""
    for k in range(q.size):
        out[k] = q[k]
    if kind == PIECEWISE:
        out[0] = q[0] / stretch
        out[1] = q[1] / (stretch * stretch)
    elif kind == POLACH:
        out[4] = q[4] / stretch
    else:
        out[0] = min(q[0] * stretch, GREATEST_RATIO)


@jit
def micro_slip(kind, q, coefficient, peak, top, speed):
    """Slip velocity [m/s] where the branch that rises to `peak` at `top` has `coefficient`; odd in it, at most `top`."""
    low, high = 0.0, top
    wanted = abs(coefficient)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if tangential_coefficient(kind, q, middle, speed, speed + middle, peak) < wanted:
            low = middle
        else:
            high = middle
    return math.copysign(0.5 * (low + high), coefficient)


def stretched(curve: AdhesionCurve, stretch: float) -> AdhesionCurve:
    """The `curve` with its rising branch stretched along the slip axis."""
    q = np.empty(6)
    stretch_parameters(curve.kind, curve.q, stretch, q)
    return type(curve)(*(float(value) for value in q[: len(fields(curve))]))
