"""Belief about the slope of the adhesion curve in micro slip, by least squares with forgetting.

What is estimated is one number per unit, the stretch c of the rising branch along the slip axis: an axle that feels a
coefficient below the peak slips c times what the curve it was given says. It stands for the slope of every kind of curve:
the piecewise curve's micro slope over c and its top's curvature over c^2, Polach's creep stiffness over c, c times the slip
ratio of the peak. Not estimated is the branch beyond the peak (macro slope, residual, decay of friction): readhesion
holds the slip at the peak, where its share in what an axle feels cannot be told from that of the peak coefficient.

Regressor is the slip x that the given curve has at the felt coefficient, and the measured slip s is the output: it carries
more of the noise, and errors of the output leave the estimate unbiased. From the sums over the accepted pairs

    c = (P + sum(x s) - k sum(x) sum(s) / n) / (P + sum(x x) - k sum(x)^2 / n),

the given curve counts as P, and k in [0, 1) is the share of a constant error of the reference speed that is taken out: the
reference is the slowest of many axles, so noise of the sensors shifts it. Forgetting goes by excitation: a pair forgets in
proportion to its own x^2, so nothing is forgotten, and nothing moves, while nothing is felt.

What slip a coefficient means depends on the peak, and an axle that has not slipped knows none. Its pairs are therefore kept
as they are, by coefficient, judged by the peak supposed meanwhile, and judged anew once it has slipped.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.plant.adhesion import AdhesionCurve
from alloc.plant.adhesion_laws import (
    PIECEWISE,
    POLACH,
    POLACH_BY_FRICTION,
    adhesion_limit,
    tangential_coefficient,
)
from alloc.plant.structure import Floats
from mpc.settings import CurveBelief


def _named(*names: str) -> np.dtype[np.void]:
    """Type of records of numbers, whose fields are attributes in Python as in compiled code."""
    return np.dtype((np.record, [(name, float) for name in names]))


SUMS = _named("pairs", "x", "xx", "slip", "x_slip")
"""Sums over the accepted pairs of expected slip x and measured slip."""
CLASS = _named("pairs", "coefficient", "slip")
"""Kept pairs of one class of coefficients: their number, and sums."""


class Sums(NamedTuple):
    """`SUMS` by name (1,), and the same memory as numbers (5,)."""

    named: NDArray[np.void]
    flat: Floats

    @classmethod
    def zeros(cls) -> "Sums":
        """Sums over nothing."""
        named = np.zeros(1, SUMS)
        return cls(named, named.view(float))


class Constants(NamedTuple):
    """What the compiled functions take of `CurveBelief`."""

    prior: float
    """Sum of x^2 as which the given curve counts [m2/s2]."""
    fading: float
    """Forgetting per sum of x^2 [s2/m2]."""
    smallest: float
    largest: float
    tested: float
    untested: float
    resolution: float
    """Slip [m/s] below which x counts as zero."""


BIN, BINS = 0.0125, 40
"""Width of a class of coefficients in which an untested axle's pairs are kept, and their number."""
FULL = 200.0
"""Pairs in a class from which on its older ones count half."""

PLAUSIBLE = 2.0
"""A pair farther outside the bounds of the stretch than this factor is no micro slip: no axle of the train runs free, and
the reference slips along, or the force is not the motor's alone. Far outside, so that noise does not choose the pairs."""

BEND = 1.5
"""Stretch of a higher class over that of a lower one from which on the peak must be lower than supposed."""

RISEN = 1.2
"""Felt coefficient over that of the last slip from which on the rail has changed; noise alone reaches a little less."""

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
    elif kind in (POLACH, POLACH_BY_FRICTION):
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


@jit
def take_in(sums, c, expected, slip, number, offset):
    """Take `number` pairs of `expected` and measured `slip` [m/s] into the `sums`, if they can be of micro slip."""
    if abs(expected) < c.resolution:
        expected = 0.0  # all noise: it tells of the reference's error alone
    least, most = c.smallest / PLAUSIBLE * abs(expected), c.largest * PLAUSIBLE * abs(expected)
    along = math.copysign(slip, slip * expected)
    if not least - offset <= along <= most + offset:
        return
    excitation = expected * expected
    keep = math.exp(-c.fading * number * excitation)
    for k in range(sums.flat.size):
        sums.flat[k] *= keep
    taken = sums.named[0]
    taken.pairs += number
    taken.x += number * expected
    taken.xx += number * excitation
    taken.slip += number * slip
    taken.x_slip += number * expected * slip


@jit
def _keep(bins, coefficient, slip):
    """Note a pair in the class of its coefficient; `bins` (BINS,)."""
    row = bins[min(max(int(coefficient / BIN), 0), BINS - 1)]
    if row.pairs >= FULL:
        row.pairs *= 0.5
        row.coefficient *= 0.5
        row.slip *= 0.5
    row.pairs += 1.0
    row.coefficient += coefficient
    row.slip += slip


@jit
def _judge(kind, q, c, bins, peak, share, speed, offset, sums):
    """Take the kept pairs below `share` of `peak` into `sums`, from the lowest up to where the curve bends."""
    limit, top = adhesion_limit(kind, q, peak, speed)
    least = np.inf
    for row in bins:
        if row.pairs > 0.0 and row.coefficient <= share * limit * row.pairs:
            expected = micro_slip(kind, q, row.coefficient / row.pairs, peak, top, speed)
            slip = row.slip / row.pairs
            if expected > 3.0 * c.resolution:
                if slip > BEND * least * expected:
                    break
                least = min(least, max(slip, 0.0) / expected)
            take_in(sums, c, expected, slip, row.pairs, offset)


class Memory(NamedTuple):
    """What is remembered of the pairs."""

    sums: Sums
    """Of the pairs judged for good."""
    total: Sums
    """The same with those that are judged for the time being."""
    bins: NDArray[np.void]
    """Pairs kept of each untested axle, `CLASS` (axles, BINS)."""
    most: Floats
    """Largest coefficient among them, (axles,)."""


@jit
def _update(kind, q, c, initial, offset, speed, slips, coefficient, peak, told, micro, memory):
    """Take in the pairs of one period."""
    sums, total, bins, most = memory.sums, memory.total, memory.bins, memory.most
    news = False
    for i in range(slips.size):
        if not micro[i]:
            continue
        if 0.0 < RISEN * told[i] < coefficient[i]:
            told[i] = most[i] = 0.0  # the rail carries more by now
        if told[i] > 0.0:
            known = min(told[i], peak[i])
            if most[i] > 0.0:
                # what it carried before the slip it could carry, even if the rail has changed since
                _judge(kind, q, c, bins[i], max(known, most[i]), c.tested, speed, offset, sums)
                for row in bins[i]:
                    row.pairs = row.coefficient = row.slip = 0.0
                most[i] = 0.0
                news = True
            limit, top = adhesion_limit(kind, q, known, speed)
            if abs(coefficient[i]) <= c.tested * limit:
                expected = micro_slip(kind, q, coefficient[i], known, top, speed)
                take_in(sums, c, expected, slips[i], 1.0, offset)
                news = True
        else:
            _keep(bins[i], coefficient[i], slips[i])
            most[i] = max(most[i], coefficient[i])
            news = True
    if news:
        for k in range(sums.flat.size):
            total.flat[k] = sums.flat[k]
        highest = 0.0
        for i in range(told.size):
            highest = max(highest, told[i])
        for i in range(slips.size):
            if most[i] > 0.0:
                # a belief that has only been rising since is no better than the first, nor than its neighbours'
                supposed = min(peak[i], initial)
                if highest > 0.0:
                    supposed = min(supposed, highest)
                supposed = max(most[i], supposed)
                _judge(kind, q, c, bins[i], supposed, c.untested, speed, offset, total)
    return news


@jit
def stretch_estimate(sums, c, offset, resolution):
    """Stretch from the `sums`, within its bounds; `offset` [m/s] is how far the reference may be off.

    `resolution` [m/s]: misfit of the curve that is put up with before it is laid to the reference.
    """
    both = offset * offset + resolution * resolution
    removed = offset * offset / both if both > 0.0 else 0.0
    share = removed / max(sums.pairs, 1.0)
    above = c.prior + sums.x_slip - share * sums.x * sums.slip
    below = c.prior + sums.xx - share * sums.x * sums.x
    return min(max(above / below, c.smallest), c.largest)


class Slope(NamedTuple):
    """Belief about the slope of one unit's curve, as compiled code takes it."""

    kind: int
    """Of the curve."""
    given: Floats
    """Parameters of the curve that the unit was given."""
    initial: float
    """Peak believed before anything was felt."""
    constants: Constants
    memory: Memory
    stretch: Floats
    """Slip below the peak, over that of the curve the unit was given at the same coefficient, (1,)."""
    q: Floats
    """Parameters of the believed curve, (6,)."""


@jit
def update_slope(slope, speed, slips, coefficient, peak, told, micro, offset, resolution):
    """Take in the pairs of `slips` [m/s] and felt `coefficient` of the axles that are in `micro` slip, all (axles,).

    `peak`: believed; `told`: where the axle last slipped, 0: never; set to 0 where the axle has felt more since.
    `offset`, `resolution` [m/s]: see `stretch_estimate`.
    """
    c, memory = slope.constants, slope.memory
    if _update(
        slope.kind, slope.given, c, slope.initial, offset, speed, slips, coefficient, peak, told, micro, memory,
    ):  # fmt: skip
        slope.stretch[0] = stretch_estimate(memory.total.named[0], c, offset, resolution)
        stretch_parameters(slope.kind, slope.given, slope.stretch[0], slope.q)


def slope_belief(
    curve: AdhesionCurve, axles: int, period: float, belief: CurveBelief, initial: float
) -> Slope:
    """Belief of a unit of `axles` that was given `curve`, at control `period` [s].

    `initial` is the peak believed before anything was felt.
    """
    unit = belief.slip_scale**2 / period  # excitation by one axle in a second
    constants = Constants(
        prior=belief.prior * unit,
        fading=1.0 / (belief.memory * unit),
        smallest=float(belief.smallest),
        largest=float(belief.largest),
        tested=float(belief.tested_share),
        untested=float(belief.untested_share),
        resolution=0.1 * belief.slip_scale,
    )
    memory = Memory(Sums.zeros(), Sums.zeros(), np.zeros((axles, BINS), CLASS), np.zeros(axles))
    given = np.array(curve.q, dtype=float)
    return Slope(curve.kind, given, float(initial), constants, memory, np.ones(1), given.copy())
