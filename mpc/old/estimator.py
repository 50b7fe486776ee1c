"""Estimates of the rail under a unit: pairs of coefficient and slip per axle, and a filter of peaks and slope.

In: torque and wheel speeds. Out: peak coefficient per axle, peak slip and slope of the curve, with their variances.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.old.compilation import equation
from alloc.old.onboard.host import UnitContext
from alloc.old.onboard.laws import observer_gains, tangential_coefficient_estimate
from alloc.old.plant.laws import slip_velocity
from alloc.old.plant.model import Floats
from alloc.old.records import named_record, numbers_of
from mpc.old.arrays import inlined
from mpc.old.condensing import no_steeper
from mpc.old.settings import PeakBelief

# Pairs of coefficient and slip of each axle of a unit, from torque and speeds alone.
#
# A disturbance observer estimates the coefficient (JP5484215 (1)-(4), `alloc.old.onboard.laws`). The measured slip
# passes the same filter, so both belong to one instant. Between readings speeds are assumed to be linear. Torque is not
# linear: it follows the command, which changes once a period, with the motor's lag, so most of its change comes early.
# If it were treated as linear, it would seem late, and the torque that accelerates the wheelset would be mistaken for
# adhesion that grows with slip.


NOISE_TIME = 1.0
"""Averaging time [s] for the noise of measured slip."""

SMALLEST_NOISE = 2e-4
"""Smallest noise [m/s] assumed; larger noise is learnt."""

FIRST_NOISE = 0.03
"""Noise [m/s] assumed before any reading, a tenth of a km/h: with too small a value the filter trusts noisy readings too
much, and a first reading of some slip without force passes for a rail without adhesion."""

FIRST_READINGS = 10.0
"""Number of readings that it counts for."""

DOUBT = 0.5
"""Deviation of an unknown peak, over the peak."""

ROUGHEST = 4.0
"""A reading counts as no noisier than this multiple of the known noise, because slip itself also jumps."""


class AxleEstimates(NamedTuple):
    """Stored values of each axle, (axles,) each."""

    filtered: Floats
    """State of the observer, as are `turned` and `drove` [N m]."""
    turned: Floats
    """Last input due to the speed."""
    drove: Floats
    """Last torque."""
    slip: Floats
    """Measured slip, with the same delay as the coefficient [m/s]."""
    measured: Floats
    """Slip of the last reading [m/s]."""
    before: Floats
    """Slip of the reading before [m/s]."""
    noise: Floats
    """Deviation of measured slip [m/s]."""
    readings: Floats
    """Number of readings in it, those that the first guess counts for included."""
    repeated: Floats
    """Number of readings in the filtered values after the first."""
    coefficient: Floats
    peak: Floats
    variance: Floats
    """Variance of the peak."""


def torque_share(pole: float, period: float, lag: float) -> float:
    """Weight of the previous reading's torque in the filtered one: between readings it follows a held command.

    T = command + (T_0 - command) exp(-t / lag), so the command follows from the reading T_1 at the end of the period.
    """
    left, keep, gap = math.exp(-period / lag), math.exp(-pole * period), pole - 1.0 / lag
    transient = pole * keep * (math.expm1(gap * period) / gap if gap else period)
    return (transient - left * (1.0 - keep)) / (1.0 - left)


def constants_of(context: UnitContext, belief: PeakBelief) -> Any:
    """Numbers of the compiled update: those of `belief`, and what follows from them and the unit."""
    period, pole = context.period, belief.pole
    keep, old, new = observer_gains(pole, period)
    old_torque = torque_share(pole, period, context.torque_lag)
    inertia, radius = float(context.inertia), float(context.radius)
    return numbers_of(
        belief,
        inertia=inertia,
        radius=radius,
        keep=keep,  # weight in the observer's filter, as are `old` and `new`
        old=old,
        new=new,
        old_torque=old_torque,  # weights of the torque, as `old` and `new` of the speed
        new_torque=1.0 - keep - old_torque,
        noise_share=-math.expm1(-period / NOISE_TIME),  # weight of a new value in the mean noise
        # periods over which the filter's values come from one reading: together they count as one
        repeat=max(1.0, 2.0 / (pole * period)),
        kept_noise=(1.0 - keep) / (1.0 + keep),  # variance of filtered noise over that of noise
        # deviation of the coefficient per m/s of noise in the slip
        felt_noise=float(pole * context.inertia / (context.radius**2 * context.axle_load)),
        walk=belief.walk**2 * period,  # growth of a peak's relative variance per period
        gate=belief.gate**2,
    )


def axles_of(context: UnitContext, belief: PeakBelief) -> AxleEstimates:
    """Axles before any reading."""
    axles = AxleEstimates(*(np.zeros(context.axles) for _ in AxleEstimates._fields))
    axles.noise[:] = FIRST_NOISE
    axles.readings[:] = FIRST_READINGS
    axles.peak[:] = belief.initial
    axles.variance[:] = (DOUBT * belief.initial) ** 2
    return axles


@inlined
def observe_axles(c, axles, load, speed, omega, torque, fresh):
    """Use the readings of a period, in the direction of the demand; `torque` at the wheel, `load` [N] (axles,)."""
    for i in range(omega.size):
        measured = slip_velocity(omega[i], c.radius, speed)
        turned = c.pole * c.inertia * omega[i]
        if fresh:  # start in equilibrium
            axles.slip[i] = axles.measured[i] = axles.before[i] = measured
            axles.turned[i], axles.drove[i] = turned, torque
            axles.filtered[i] = torque + turned
            axles.repeated[i] = -1.0
        axles.filtered[i] *= c.keep
        axles.filtered[i] += c.old * axles.turned[i] + c.new * turned
        axles.filtered[i] += c.old_torque * axles.drove[i] + c.new_torque * torque
        axles.turned[i], axles.drove[i] = turned, torque
        load_torque = axles.filtered[i] - turned
        axles.coefficient[i] = tangential_coefficient_estimate(load_torque, load[i], c.radius)
        # E|x| of a normal second difference is 0.8 sqrt(6) of a reading's deviation
        rough = abs(measured - 2.0 * axles.measured[i] + axles.before[i]) / 1.95
        rough = min(rough, ROUGHEST * max(axles.noise[i], SMALLEST_NOISE))
        axles.readings[i] += 1.0
        axles.repeated[i] += 1.0
        axles.noise[i] += max(c.noise_share, 1.0 / axles.readings[i]) * (rough - axles.noise[i])
        axles.slip[i] = c.keep * axles.slip[i] + c.old * axles.measured[i] + c.new * measured
        axles.before[i], axles.measured[i] = axles.measured[i], measured


@inlined
def mean_noise(axles):
    """Mean deviation of measured slip [m/s] over the unit's axles."""
    total = 0.0
    for i in range(axles.noise.size):
        total += axles.noise[i] / axles.noise.size
    return total


# Joint filter of a unit: the peak coefficient of each axle, and the curve of all by its slope at the origin and peak
# slip.
#
# What an axle feels is mu = mu_p f(s), with the rational curve of Kiencke and Daiss (1994) in the form
#
#     f = r s / ((1 - x)^2 + r s),    x = s / s_p,
#
# where r [s/m] is its slope at the origin over the peak; its steepness is n = r s_p. Each of the three is found from
# what tells it, and from nothing else, for rails follow the family only nearly:
#
# *Peaks and slope*, random walks both, from pairs of coefficient and slip, one of each axle and period, by an extended
# Kalman
# filter. The derivatives are d mu / d mu_p = f and d mu / d ln r = mu (1 - f): pairs far below the peak tell r mu_p,
# those
# near it tell the peak. Which of the two gives way is a matter of their variances; at the start r is the less known.
# Pairs
# beyond `RISING` of the peak say nothing of r. Until an elasticity was heard, it is k = r mu_p that pairs have certainty: a
# peak
# lower than it was believed to be at the start is then found at a smaller slip. So k is kept where the peaks move, and
# d mu / d mu_p = f^2. Later r is kept, for rails change their peak more than their shape. Both values of a pair are in
# error.
# That of the slip counts with the curve's slope there (effective variance: Orear, Am. J. Phys. 50 (1982) 912-916). A
# pair too
# far from what was expected says that the rail has changed: the filter then doubts the axle's peak, and takes over the
# next
# pairs at once. Covariances are left out: peaks change from place to place, the curve does not.
#
# *Slip of the peak* from the elasticity e at a slip s, which `mpc.old.slip_search` hears: from e = (1 - x^2) / ((1 - x)^2 +
# r s)
# follows
#
#     x = (e + sqrt(1 - e (1 + e) r s)) / (1 + e),    s_p = s / x.
#
# As long as no elasticity was heard, the curve is taken for one of `USUAL_STEEPNESS`, whose s_p = n / r. That is `top`.
# Where it lies below the s_p assumed before any reading, a steep slope may as well be that of a steep curve, as Polach's
# are: `top` then is the geometric mean of both.
# The MPC predicts, and reads its pairs, with a peak that lies `REACH` times beyond the slip sought at least
# (`peak_slip`).


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
    first: float
    """s_p before any reading [m/s]."""


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
    pace = Pace(belief.slope_walk**2 * period, -math.expm1(-period / SHAPE_TIME), period, peak_slip)
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
        # the filter begins with one reading
        kept = max(c.kept_noise, math.exp(2.0 * axles.repeated[i] * math.log(c.keep)))
        of_slip = c.slip_error * c.slip_error + kept * noise * noise
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
        top = min(max(USUAL_STEEPNESS / state.slope, PEAK_SLIPS[0]), PEAK_SLIPS[1])
        state.top = max(top, math.sqrt(top * curve.pace.first))


@inlined
def take_in_elasticity(curve, slip, elasticity, certainty):
    """Move s_p towards the value that the `elasticity` at `slip` [m/s] gives, by its `certainty`, 0 to 1."""
    state, e = curve.state[0], max(elasticity, -0.5)
    state.heard_for += curve.pace.period * certainty
    left = 1.0 - e * (1.0 + e) * state.slope * slip
    x = max((e + math.sqrt(max(left, 0.0))) / (1.0 + e), LEAST_X)
    top = min(max(slip / x, PEAK_SLIPS[0]), PEAK_SLIPS[1])
    state.top *= math.exp(curve.pace.shape * certainty * math.log(top / state.top))
    if left < 0.0:  # so steep a curve would have bent more
        state.slope *= math.exp(curve.pace.shape * certainty * math.log(1.0 / (1.0 - left)))


@inlined
def look_beyond(curve, sought):
    """Predict with a peak beyond the slip `sought` [m/s]."""
    state = curve.state[0]
    state.peak_slip = max(state.top, REACH * sought)


@inlined
def predicted_curve(curve, axles):
    """Peak slip [m/s] and steepness for the prediction: as believed, but no steeper than `mpc.old.model` allows."""
    most = 0.0
    for i in range(axles.peak.size):
        most = max(most, axles.peak[i])
    return no_steeper(curve.state[0].peak_slip, steepness(curve), most)
