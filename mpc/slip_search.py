"""Search for the slip of the best torque, which needs no known curve: excitation, elasticity, and a step along it.

What is sought is the slip s at which the rail force less the price of its friction work is greatest. With the price
`friction_price` p [s/m], the coefficient counts as mu(s) (1 - p s). So at the best slip the elasticity of the curve is

    e = d ln mu / d ln s = p s / (1 - p s), about p s.

Where adhesion hardly grows any more, slip costs more than it brings. On a wide peak the best slip lies well below that of
the peak.

*Excitation.* The slip limit that the MPC keeps swings about its mean by `swing`, a sine of `swing_time`.

*Elasticity.* ln mu and ln s of each axle, less their means, are demodulated at that frequency with a memory of `memory`:
complex numbers Z_mu and Z_s. Their quotient would be biased towards zero, for slip is measured with noise, and the
controller acts on that noise. So the swing itself is the instrument (instrumental variables; Soederstroem, Automatica 43
(2007) 939-958). With U, the mean of Z_s over `INSTRUMENT_TIME`, which is what the slip has of the swing,

    e = Re(Z_mu conj U) / Re(Z_s conj U).

A rail that changes is no answer to the swing, and adds noise but no bias. While slip does not follow the swing, a prior
holds e at what it should be, and nothing moves. The axle asked is the one with the largest slip: it is at its limit.

*Step.* d ln s / dt = `gain` (e - p s), within `fastest_rise` and `fastest_fall`. This is extremum seeking (Krstic and Wang,
Automatica 36 (2000) 595-601) with the elasticity in place of the gradient, so that neither level nor slip needs a scale.

*The curve.* The MPC predicts with the rational curve mu_p n x / (1 + (n - 2) x + x^2), x = s / s_p (Kiencke and Daiss,
1994). Its three numbers follow from three that are measured: the slope k = n mu_p / s_p at the origin, from pairs far below
the peak; the coefficient at the present slip; and e there. With D = s k / mu the curve's equations give e D = 1 - x^2,
hence x and s_p = s / x. Peak, peak slip and steepness are so independent of each other.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import equation, jit
from alloc.named_record import named_record
from alloc.onboard.host import UnitContext
from alloc.plant.structure import Floats
from mpc.axle_observer import mean_noise
from mpc.settings import SlipSearch

STEEPEST_SLOPE = 12.0
"""Slope [s/m] of the steepest curve that is predicted with; steeper ones would need shorter steps for next to no slip."""

LEAST_COEFFICIENT = 0.01
"""Of an axle that is listened to; so small a force has no logarithm worth its noise."""
LEAST_SLIP = 0.004
"""The same [m/s]."""

MEAN_TIME = 0.2
"""Time [s] over which the mean is taken that demodulation removes."""
INSTRUMENT_TIME = 1.0
"""Time [s] over which the slip's answer to the swing is taken."""
SETTLED = 0.2
"""Time [s] of limitation after which the search goes on."""
AT_LIMIT = 0.5
"""Share of the slip sought from which on the slip limit is what binds."""
JUMP = 0.12
"""Change of ln mu within the mean's time that is a change of the rail."""
WHOLE_SWING = 1.3
"""The same over the swing: filtered ln mu answers it by no more, from one extreme to the other."""
SURE = 4.0
"""The same over the deviation of ln mu that noise makes, where that is more."""
PRIOR = 0.1
"""Weight of the prior, over that of a slip that follows the swing."""
UNTOLD = 0.05
"""Excitation that tells half of what a full one tells."""
MICRO = 0.6
"""Share of the peak up to which a pair tells the slope at the origin."""
SLOPE_SHARE = 0.01
"""Share of a new pair in the sums for that slope."""
SHAPE_TIME = 0.3
"""Time [s] in which the predicted curve follows."""
USUAL_SHARE = 0.8
"""Slip sought over that of the peak, as long as no elasticity tells."""
LIMITING = 0.999
"""Share of its target below which a unit counts as limited."""
STEEPNESS = (1.0, 60.0)
"""Bounds of n."""
PEAK_SLIPS = (0.012, 1.5)
"""Bounds of the peak's slip [m/s]."""
GOLDEN = 2.399963
"""Golden angle: units swing out of step, so the train does not swing."""


class Pace(NamedTuple):
    """Settings of the search, per control period."""

    swing: float
    advance: float
    """Of the swing's phase."""
    kept: float
    """Of the demodulated values."""
    mean: float
    """Share of a new value, as are `instrument` and `shape`."""
    instrument: float
    shape: float
    period: float
    gain: float
    rise: float
    fall: float
    price: float
    lowest: float
    highest: float
    noise_margin: float
    full: float
    """Demodulated value of a slip that follows the swing."""
    seeks: bool


STATE = named_record(
    "slip", "phase", "cosine", "sine", "limited_for", "elasticity", "excitation",
    "slope_above", "slope_below", "peak_slip", "steepness",
)  # fmt: skip
"""`slip` sought [m/s]; `phase` of the swing; the instrument's two parts; time since the unit is limited [s]; `elasticity`;
`excitation`, 1: slip follows the swing; sums for the slope at the origin; peak slip [m/s] and steepness of the curve."""


class Search(NamedTuple):
    """The search of one unit."""

    pace: Pace
    state: NDArray[np.void]
    """`STATE`, (1,)."""
    mean_slip: Floats
    """Mean of ln s of each axle, nan: none yet, (axles,)."""
    mean_coefficient: Floats
    demodulated: Floats
    """Parts of Z_s and of Z_mu of each axle, (axles, 4)."""


def search_of(context: UnitContext, settings: SlipSearch, peak: float) -> Search:
    """The search of a unit at the start of a run; `peak`: believed before anything was felt."""
    dt = context.period

    def share(time: float) -> float:
        return -math.expm1(-dt / time)

    pace = Pace(
        float(settings.swing), 2.0 * math.pi * dt / settings.swing_time, math.exp(-dt / settings.memory),
        share(MEAN_TIME), share(INSTRUMENT_TIME), share(SHAPE_TIME), float(dt), float(settings.gain),
        float(settings.fastest_rise), float(settings.fastest_fall), float(settings.friction_price),
        float(settings.lowest), float(settings.highest), float(settings.noise_margin),
        0.5 * settings.memory * settings.swing, bool(settings.seek),
    )  # fmt: skip
    state = np.zeros(1, STATE)
    one = state[0]
    one.slip = settings.first
    one.phase = GOLDEN * context.unit % (2.0 * math.pi)
    one.peak_slip = settings.first / USUAL_SHARE
    one.steepness = 2.0
    one.slope_below = 1e-4
    one.slope_above = one.slope_below * one.steepness * peak / one.peak_slip
    n = context.axles
    return Search(pace, state, np.full(n, np.nan), np.zeros(n), np.zeros((n, 4)))


@jit
def slip_limit(search):
    """Slip [m/s] that no axle of the unit should exceed now."""
    state = search.state[0]
    return state.slip * (1.0 + search.pace.swing * math.sin(state.phase))


@jit
def _slope_at_origin(axles, state):
    """Take in what pairs far below the peak tell; the slip, which is in error, is divided by and never squared."""
    for i in range(axles.peak.size):
        share = axles.coefficient[i] / axles.peak[i]
        if axles.coefficient[i] > 2.0 * LEAST_COEFFICIENT and share < MICRO:
            n = state.steepness
            half = 0.5 * (n - share * (n - 2.0))
            # x at which the curve has this share
            x = (half - math.sqrt(max(half * half - share * share, 0.0))) / share
            bend = 1.0 + x * (x + n - 2.0)
            mu = axles.coefficient[i]
            state.slope_above += SLOPE_SHARE * (mu * mu * bend - state.slope_above)
            state.slope_below += SLOPE_SHARE * (mu * axles.slip[i] - state.slope_below)


@jit
def _demodulate(search, axles, felt):
    """Take the pairs of a period into the demodulated values; returns the axle with the largest mean slip, -1: none."""
    pace, state = search.pace, search.state[0]
    cosine, sine = math.cos(state.phase) * pace.period, math.sin(state.phase) * pace.period
    largest = -1
    for i in range(axles.peak.size):
        z = search.demodulated[i]
        if axles.slip[i] < LEAST_SLIP or axles.coefficient[i] < LEAST_COEFFICIENT:
            search.mean_slip[i] = np.nan
            continue
        slip, coefficient = math.log(axles.slip[i]), math.log(axles.coefficient[i])
        fresh = math.isnan(search.mean_slip[i])
        jump = max(JUMP, WHOLE_SWING * pace.swing, SURE * felt / axles.coefficient[i])
        if fresh or abs(coefficient - search.mean_coefficient[i]) > jump:
            search.mean_slip[i], search.mean_coefficient[i] = slip, coefficient
            for k in range(4):
                z[k] *= 0.0 if fresh else 0.3
        else:
            search.mean_slip[i] += pace.mean * (slip - search.mean_slip[i])
            search.mean_coefficient[i] += pace.mean * (coefficient - search.mean_coefficient[i])
            slip -= search.mean_slip[i]
            coefficient -= search.mean_coefficient[i]
            z[0] = pace.kept * z[0] + slip * cosine
            z[1] = pace.kept * z[1] + slip * sine
            z[2] = pace.kept * z[2] + coefficient * cosine
            z[3] = pace.kept * z[3] + coefficient * sine
        if largest < 0 or search.mean_slip[i] > search.mean_slip[largest]:
            largest = i
    return largest


@jit
def _elasticity(search, i, wanted):
    """Elasticity of axle `i`, `wanted` where nothing tells it, and how far slip follows the swing."""
    pace, state, z = search.pace, search.state[0], search.demodulated[i]
    # at first a plain mean: what slip answered before the unit was limited again may have been another phase
    share = max(pace.instrument, pace.period / state.limited_for)
    state.cosine += share * (z[0] - state.cosine)
    state.sine += share * (z[1] - state.sine)
    size = math.sqrt(state.cosine * state.cosine + state.sine * state.sine) + 1e-12
    of_slip = max((z[0] * state.cosine + z[1] * state.sine) / size, 0.0)
    of_coefficient = (z[2] * state.cosine + z[3] * state.sine) / size
    prior = PRIOR * pace.full
    state.elasticity = (of_coefficient + prior * wanted) / (of_slip + prior)
    state.excitation = (of_slip / pace.full) ** 2


@jit
def _fit_curve(search, axles, i):
    """Move the predicted curve towards the one through what is measured."""
    pace, state = search.pace, search.state[0]
    known = state.excitation / (state.excitation + 0.3) if state.limited_for > SETTLED else 0.0
    slope = min(max(state.slope_above / max(state.slope_below, 1e-7), 1.0), 80.0)
    ratio = max(math.exp(search.mean_slip[i] - search.mean_coefficient[i]) * slope, 1.05)
    x = math.sqrt(min(max(1.0 - state.elasticity * ratio, 0.3), 1.1))
    x = known * x + (1.0 - known) * USUAL_SHARE
    top = min(max(state.slip / x, PEAK_SLIPS[0]), PEAK_SLIPS[1])
    state.peak_slip *= math.exp(pace.shape * math.log(top / state.peak_slip))
    n = min(max(slope * state.peak_slip / axles.peak[i], STEEPNESS[0]), STEEPNESS[1])
    state.steepness *= math.exp(pace.shape * math.log(n / state.steepness))


@jit
def search_slip(search, axles, felt, limited):
    """A control period of the search.

    `felt`: deviation of a coefficient by noise; `limited`: whether the unit gives less than is wanted of it.
    """
    pace, state = search.pace, search.state[0]
    state.phase = (state.phase + pace.advance) % (2.0 * math.pi)
    _slope_at_origin(axles, state)
    if not limited:
        state.limited_for = 0.0
        for i in range(search.mean_slip.size):
            search.mean_slip[i] = np.nan
        return
    state.limited_for += pace.period
    i = _demodulate(search, axles, felt)
    if i < 0:
        return
    wanted = pace.price * state.slip
    _elasticity(search, i, wanted)
    at_limit = math.exp(search.mean_slip[i]) > AT_LIMIT * state.slip
    if pace.seeks and state.limited_for > SETTLED and at_limit:
        told = state.excitation / (state.excitation + UNTOLD)
        rate = min(max(told * pace.gain * (state.elasticity - wanted), -pace.fall), pace.rise)
        lowest = max(pace.lowest, pace.noise_margin * mean_noise(axles))
        state.slip = min(max(state.slip * math.exp(pace.period * rate), lowest), pace.highest)
    _fit_curve(search, axles, i)


@equation
def no_steeper(peak_slip, steepness, most):
    """Peak slip [m/s] and steepness of a curve near the given one, with no slope above `STEEPEST_SLOPE`.

    `most`: the greatest peak coefficient that the curve is scaled with. From steepness 2 on the steepest slope is that at
    the origin. Below, the curve turns on its way to the peak, and from steepness 1 on a straight line is a bound, see
    `alloc.plant.adhesion.RationalCurve.steepest_slope`.
    """
    top = max(peak_slip, 1.5 * most / STEEPEST_SLOPE)
    allowed = STEEPEST_SLOPE * top / most
    return top, min(steepness, allowed, 1.9 * allowed - 1.8)


@jit
def predicted_curve(search, axles):
    """Peak slip [m/s] and steepness to predict with: of the believed curve, but no steeper than `STEEPEST_SLOPE`."""
    state, most = search.state[0], 0.0
    for i in range(axles.peak.size):
        most = max(most, axles.peak[i])
    return no_steeper(state.peak_slip, state.steepness, most)
