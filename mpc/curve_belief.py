"""Belief about the slope of the adhesion curve in micro slip, by least squares with forgetting.

What is estimated is one number per unit, the stretch c of the rising branch along the slip axis: an axle that feels a
coefficient below the peak slips c times what the curve it was given says. It stands for the slope of every kind of curve:
the piecewise curve's micro slope over c and its top's curvature over c^2, Polach's creep stiffness over c, c times the slip
ratio of the peak. Not estimated is the branch beyond the peak (macro slope, residual, decay of friction): readhesion
holds the slip at the peak, where its share in what an axle feels cannot be told from that of the peak coefficient.

Regressor is the slip x that the given curve has at the felt coefficient, and the measured slip is the output: it carries
more of the noise, and errors of the output leave the estimate unbiased. From the sums over the accepted pairs

    c = (P + sum(x s) - k sum(x) sum(s) / n) / (P + sum(x x) - k sum(x)^2 / n),

the given curve counts as P, and k in [0, 1) is the share of a constant error of the reference speed that is taken out: the
reference is the slowest of many axles, so noise of the sensors shifts it. Forgetting goes by excitation: a pair forgets in
proportion to its own x^2, so nothing is forgotten, and nothing moves, while nothing is felt.
"""

import math
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.plant.adhesion import (
    PIECEWISE,
    POLACH,
    AdhesionCurve,
    adhesion_limit,
    tangential_coefficient,
)
from mpc.settings import CurveBelief

Floats = NDArray[np.float64]

PAIRS, X, XX, SLIP, X_SLIP = range(5)
"""Sums over the accepted pairs."""
PRIOR, FADING, SMALLEST, LARGEST, TESTED, UNTESTED, RESOLUTION = range(7)
"""Entries of the vector of constants, see `curve_constants`."""

GREATEST_RATIO = 0.9
"""Bound of a stretched curve's slip ratio at the peak, which is below 1 by definition."""

PLAUSIBLE = 2.0
"""A pair farther outside the bounds of the stretch than this factor is no micro slip: no axle of the train runs free, and
the reference slips along, or the force is not the motor's alone. Far outside, so that noise does not choose the pairs."""

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
def micro_slip(kind, q, coefficient, peak, speed):
    """Slip velocity [m/s] at which the rising branch has `coefficient`, odd in it; that of the peak where it is beyond."""
    low, high = 0.0, adhesion_limit(kind, q, peak, speed)[1]
    wanted = abs(coefficient)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if tangential_coefficient(kind, q, middle, speed, speed + middle, peak) < wanted:
            low = middle
        else:
            high = middle
    return math.copysign(0.5 * (low + high), coefficient)


@jit
def take_in(sums, c, expected, slip):
    """Take a pair of `expected` and measured `slip` [m/s] into the `sums` (5,), if it can be one of micro slip."""
    least, most = c[SMALLEST] / PLAUSIBLE * expected, c[LARGEST] * PLAUSIBLE * expected
    # about zero the slip is all noise, and tells of the reference's error alone
    if abs(expected) > c[RESOLUTION] and not least <= slip <= most:
        return False
    excitation = expected * expected
    keep = math.exp(-c[FADING] * excitation)
    for k in range(sums.size):
        sums[k] *= keep
    sums[PAIRS] += 1.0
    sums[X] += expected
    sums[XX] += excitation
    sums[SLIP] += slip
    sums[X_SLIP] += expected * slip
    return True


@jit
def stretch_estimate(sums, c, offset, resolution):
    """Stretch from the `sums` (5,), within its bounds; `offset` [m/s] is how far the reference may be off.

    `resolution` [m/s]: misfit of the curve that is put up with before it is laid to the reference.
    """
    both = offset * offset + resolution * resolution
    removed = offset * offset / both if both > 0.0 else 0.0
    share = removed / max(sums[PAIRS], 1.0)
    above = c[PRIOR] + sums[X_SLIP] - share * sums[X] * sums[SLIP]
    below = c[PRIOR] + sums[XX] - share * sums[X] * sums[X]
    return min(max(above / below, c[SMALLEST]), c[LARGEST])


def curve_constants(belief: CurveBelief, period: float) -> Floats:
    """Constants of the estimation at control `period` [s], as the compiled functions take them."""
    unit = belief.slip_scale**2 / period  # excitation by one axle in a second
    return np.array(
        [
            belief.prior * unit,
            1.0 / (belief.memory * unit),
            belief.smallest,
            belief.largest,
            belief.tested_share,
            belief.untested_share,
            belief.slip_scale / 3.0,
        ]
    )


def stretched(curve: AdhesionCurve, stretch: float) -> AdhesionCurve:
    """The `curve` with its rising branch stretched along the slip axis, see the module."""
    q = np.empty(6)
    stretch_parameters(curve.kind, curve.q, stretch, q)
    return type(curve)(*(float(value) for value in q[: len(fields(curve))]))
