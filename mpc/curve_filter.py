"""Joint filter of a unit: the peak coefficient of each axle, and the curve of all by its slope at the origin and peak slip.

What an axle feels is mu = mu_p f(s), with the rational curve of Kiencke and Daiss (1994) in the form

    f = r s / ((1 - x)^2 + r s),    x = s / s_p,

where r [s/m] is its slope at the origin over the peak; its steepness is n = r s_p. Each of the three is found from what
tells it, and from nothing else, for rails follow the family only nearly:

*Peaks and slope*, random walks both, from pairs of coefficient and slip, one of each axle and period, by an extended Kalman
filter. The derivatives are d mu / d mu_p = f and d mu / d ln r = mu (1 - f): pairs far below the peak tell r mu_p, those
near it tell the peak. Which of the two gives way is a matter of their variances; at the start r is the less known. Pairs
beyond `RISING` of the peak say nothing of r. Until an elasticity was heard, it is k = r mu_p that pairs have told: a peak
lower than it was believed to be at the start is then found at a smaller slip. So k is kept where the peaks move, and
d mu / d mu_p = f^2. Later r is kept, for rails change their peak more than their shape. Both values of a pair are in error.
That of the slip counts with the curve's slope there (effective variance: Orear, Am. J. Phys. 50 (1982) 912-916). A pair too
far from what was expected says that the rail has changed: the filter then doubts the axle's peak, and takes over the next
pairs at once. Covariances are left out: peaks change from place to place, the curve does not.

*Slip of the peak* from the elasticity e at a slip s, which `mpc.slip_search` hears: from e = (1 - x^2) / ((1 - x)^2 + r s)
follows

    x = (e + sqrt(1 - e (1 + e) r s)) / (1 + e),    s_p = s / x.

As long as no elasticity was heard, the curve is taken for one of `USUAL_STEEPNESS`, whose s_p = n / r. That is `top`. The
MPC predicts, and reads its pairs, with a peak that lies `REACH` times beyond the slip sought at least (`peak_slip`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import equation
from alloc.named_record import named_record
from mpc.arrays import inlined
from mpc.axle_observer import DOUBT
from mpc.settings import PeakBelief
from mpc.stiffness import no_steeper

PEAK_SLIPS = (0.012, 3.0)
"""Bounds of s_p [m/s]."""
STEEPNESS = (1.0, 60.0)
"""Bounds of n."""
USUAL_STEEPNESS = 3.0
"""Assumed before the first elasticity: slip starts near the peak of a curve that falls steeply, and climbs on others."""
FIRST_DEVIATION = 1.0
"""Deviation of ln r before the first pair."""
RISING = 0.8
"""Share of the peak up to which a pair gives information on the slope at the origin."""
SHAPE_TIME = 0.3
"""Time [s] in which s_p follows the elasticities."""
LEAST_X = 0.5
"""Smallest share of s_p that a slip is assumed to be: a peak further off cannot be seen from there."""
REACH = 1.25
"""Smallest s_p for the prediction, over the slip sought: a prediction whose peak is passed would not look beyond it."""

STATE = named_record("peak_slip", "top", "slope", "variance", "heard_for")
"""s_p [m/s] for the prediction, and as observed; r [s/m] and the variance of its logarithm; time of observation [s]."""


class Pace(NamedTuple):
    """Numbers per control period."""

    walk: float
    """Growth of the variance of ln r."""
    shape: float
    """Weight of a new s_p."""
    period: float


class Curve(NamedTuple):
    """The curve that a unit believes in."""

    pace: Pace
    state: NDArray[np.void]
    """`STATE`, (1,)."""


def curve_of(belief: PeakBelief, period: float, peak_slip: float) -> Curve:
    """The curve before any reading, with a likely `peak_slip` [m/s]."""
    state = np.zeros(1, STATE)
    one = state[0]
    one.peak_slip = one.top = peak_slip
    one.slope = USUAL_STEEPNESS / peak_slip
    one.variance = FIRST_DEVIATION**2
    pace = Pace(belief.slope_walk**2 * period, -math.expm1(-period / SHAPE_TIME), period)
    return Curve(pace, state)


@inlined
def steepness(curve):
    """n of the curve."""
    state = curve.state[0]
    return min(max(state.slope * state.peak_slip, STEEPNESS[0]), STEEPNESS[1])


@equation
def bend(x, n):
    """n x / f: deviation of the curve from its slope at the origin."""
    return 1.0 + x * (x + n - 2.0)


@inlined
def total_peak(axles):
    """Sum of the believed peaks."""
    total = 0.0
    for i in range(axles.peak.size):
        total += axles.peak[i]
    return total


@equation
def by_peak(share, first):
    """Derivative of a pair's coefficient by the peak, for that of the curve, `share`: at equal r, at `first` at equal k."""
    return share * share if first else share


@inlined
def take_in_pairs(c, axles, curve, noise):
    """A step of the filter with the pairs of a period; `noise`: deviation of measured slip [m/s]."""
    state = curve.state[0]
    state.variance = min(state.variance + curve.pace.walk, FIRST_DEVIATION * FIRST_DEVIATION)
    felt = c.felt_noise * noise
    first = state.heard_for == 0.0
    before = total_peak(axles)
    for i in range(axles.peak.size):
        slip, coefficient, peak = max(axles.slip[i], 0.0), axles.coefficient[i], axles.peak[i]
        x, n = slip / state.peak_slip, steepness(curve)
        below = bend(x, n)
        share = n * x / below
        slope = peak * n * (1.0 - x * x) / (below * below * state.peak_slip)
        own = c.coefficient_error + c.relative_error * abs(coefficient)
        of_slip = c.slip_error * c.slip_error + c.kept_noise * noise * noise
        error = own * own + felt * felt + slope * slope * of_slip
        # while slip changes fast, the filtered pair lies beside the curve
        moving = 0.5 * slope * (axles.measured[i] - axles.slip[i])
        by_slope = peak * share * (1.0 - share) if x < 1.0 and share < RISING else 0.0
        unsure = error * c.repeat + moving * moving + by_slope * by_slope * state.variance
        unexpected = coefficient - share * peak
        by_own = by_peak(share, first)
        expected = by_own * by_own * axles.variance[i] + unsure
        # a single pair is no less sure for being one of many alike
        if unexpected * unexpected > c.gate * (expected - error * (c.repeat - 1.0)):
            axles.variance[i] += (DOUBT * peak) ** 2
            expected = by_own * by_own * axles.variance[i] + unsure
        # read at the slip that was measured, noise alone would pass for slip on a rail without adhesion
        likely = (
            max(slip + slope * of_slip * c.repeat * unexpected / expected, 0.0) / state.peak_slip
        )
        tells = by_peak(n * likely / bend(likely, n), first)
        gain = tells * axles.variance[i] / (tells * by_own * axles.variance[i] + unsure)
        axles.peak[i] = min(max(peak + gain * unexpected, c.floor), c.ceiling)
        grown = (1.0 - gain * by_own) * axles.variance[i] + c.walk * peak * peak
        axles.variance[i] = min(grown, (DOUBT * peak) ** 2)
        by_slope *= state.variance / expected
        state.slope *= math.exp(by_slope * unexpected)
        state.variance -= by_slope * by_slope * expected
    if first:
        state.slope *= before / total_peak(axles)
        state.top = min(max(USUAL_STEEPNESS / state.slope, PEAK_SLIPS[0]), PEAK_SLIPS[1])


@inlined
def take_in_elasticity(curve, slip, elasticity, told):
    """Move s_p towards the value that the `elasticity` at `slip` [m/s] gives, by its share of information `told`, 0 to 1."""
    state, e = curve.state[0], max(elasticity, -0.5)
    state.heard_for += curve.pace.period * told
    left = 1.0 - e * (1.0 + e) * state.slope * slip
    x = max((e + math.sqrt(max(left, 0.0))) / (1.0 + e), LEAST_X)
    top = min(max(slip / x, PEAK_SLIPS[0]), PEAK_SLIPS[1])
    state.top *= math.exp(curve.pace.shape * told * math.log(top / state.top))
    if left < 0.0:  # so steep a curve would have bent more
        state.slope *= math.exp(curve.pace.shape * told * math.log(1.0 / (1.0 - left)))


@inlined
def look_beyond(curve, sought):
    """Predict with a peak beyond the slip `sought` [m/s]."""
    state = curve.state[0]
    state.peak_slip = max(state.top, REACH * sought)


@inlined
def predicted_curve(curve, axles):
    """Peak slip [m/s] and steepness for the prediction: as believed, but no steeper than `mpc.stiffness` allows."""
    most = 0.0
    for i in range(axles.peak.size):
        most = max(most, axles.peak[i])
    return no_steeper(curve.state[0].peak_slip, steepness(curve), most)
