"""How many Runge-Kutta steps a step of the horizon needs: as many as the believed curve is steep.

The bound is the plant's (`alloc.plant.model.Model.stiffness`), whose greatest rate is that of a wheelset on the steepest
part of its adhesion curve.
"""

from typing import NamedTuple

import numpy as np

from alloc.compilation import equation
from alloc.plant.model import STABLE_STEP
from mpc.arrays import inlined

STEEPEST_SLOPE = 12.0
"""Slope [s/m] of the steepest curve that is predicted with; steeper ones would need shorter steps for next to no slip."""


class Stiffness(NamedTuple):
    """What decides how short a Runge-Kutta step of a group must be."""

    slope: float
    """Rate of its wheelsets [1/s] per slope of the curve [s/m]."""
    rest: float
    """Fastest rate of all else [1/s]."""
    axles: int
    curve: int
    """Place of the rational curve among the parameters; -1: the model has another curve."""
    most: int
    """Most substeps; for another curve, always."""


@equation
def steepest(peak, peak_slip, steepness):
    """Bound of the slope [s/m] of the rational curve, for a steepness from 1 on: above 2, its slope at the origin.

    Below, the curve turns on its way to the peak, and a straight line is a bound, see
    `alloc.plant.adhesion.RationalCurve.steepest_slope`.
    """
    return peak / peak_slip * max(steepness, (steepness + 1.8) / 1.9)


@equation
def no_steeper(peak_slip, n, most):
    """Peak slip [m/s] and steepness of a curve near the given one, with no slope above `STEEPEST_SLOPE`.

    `most`: the greatest peak coefficient that the curve is scaled with. `steepest` solved for the steepness.
    """
    top = max(peak_slip, 1.5 * most / STEEPEST_SLOPE)
    allowed = STEEPEST_SLOPE * top / most
    return top, min(n, allowed, 1.9 * allowed - 1.8)


@inlined
def needed_substeps(stiffness, step, parameters):
    """Substeps of a step of `step` [s] with the model's `parameters`."""
    if stiffness.curve < 0:
        return stiffness.most
    peak = 0.0
    for i in range(stiffness.axles):
        peak = max(peak, parameters[i])
    slope = steepest(peak, parameters[stiffness.curve], parameters[stiffness.curve + 1])
    needed = step * max(stiffness.slope * slope, stiffness.rest) / STABLE_STEP
    # what is no number surfaces in the trajectory; a number of steps it must not become
    return max(1, int(np.ceil(needed))) if needed < stiffness.most else stiffness.most
