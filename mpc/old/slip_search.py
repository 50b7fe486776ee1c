"""Search for the slip of the best torque, which needs no known curve: excitation, elasticity, and a step along it.

In: coefficient and slip of a unit per control period. Out: the slip limit of the next one.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.old.onboard.host import UnitContext
from alloc.old.plant.model import Floats
from alloc.old.records import named_record, numbers_of
from mpc.old.arrays import inlined
from mpc.old.estimator import steepness, take_in_elasticity
from mpc.old.settings import SlipSearch

# How the search for the best slip moves: the size of its swing, its step, and what it makes of slip that runs away.
#
# *Swing.* Where e is known better than `GOAL`, the swing shrinks, down to `least_swing`, for it costs torque; else it
# grows
# up to `swing`, or to `OVER_NOISE` times the noise of the slip.
#
# *Step.* d ln s / dt = `gain` c A^2 / (A^2 + D) (e - p s), within `fastest_rise` and `fastest_fall`. This is extremum
# seeking
# (Krstic and Wang, Automatica 36 (2000) 595-601) with the elasticity in place of the gradient, so that neither level
# nor slip
# needs a scale. Yet e changes by -2 / n per ln s at a peak of steepness n: a step that is right on a wide peak
# overshoots, and
# the slip goes to and fro, on one that falls at once. So c, a share of the whole step, shrinks where the error changes
# its
# sign, and recovers where it does not (as steps of Rprop do: Riedmiller and Braun, ICNN 1993, 586-591). Where noise
# hides the
# answer, slip rises on trial, for a larger one stands out of it.
#
# *Running away.* On a curve that falls steeply, slip beyond the peak runs away from its limit, is caught, and runs away
# again.
# No swing is answered there. But a second time within `AWAY_TIME` is no change of the rail: the elasticity then counts
# as
# `FALLING`.


GOAL = 0.8
"""How far an elasticity should be known."""
SWING_RATE = 3.0
"""Logarithmic speed of the swing [1/s], per `certainty` above or below the goal."""
OVER_NOISE = 1.5
"""Greatest swing, over the noise of the slip, where that is more than the usual one."""
LARGEST_SWING = 0.3
"""The same at most."""
LOST = 0.5
"""What a step loses of its share where the error changes its sign."""
RECOVERY = 0.7
"""Relative growth of that share [1/s] where it does not."""
LEAST_STEP_SHARE = 0.1
WIDE = 14.0
"""Steepness from which on no step overshoots. The share is at least the square of the curve's over it: noise turns errors
too, and a share once lost came back so slowly that slip climbed by a tenth in five seconds on wide peaks."""
ROUNDING = 1e-12
"""Product of two errors that stands for none: where nothing is known, an error is rounding."""
FAR_BELOW = 0.25
"""Elasticity from which on the peak is far, and slip may rise faster."""
EAGER = 10.0
"""Growth of the fastest rise per elasticity above that."""
EXPLORE = 0.7
"""Speed [1/s] at which the slip rises where noise hides what elasticity there is: a larger slip stands out of it."""
HARDLY = 0.3
"""How far an elasticity is known for slip not to rise on trial."""
BEYOND = 1.2
"""Slip over its limit, noise apart, that the torque did not hold."""
AWAY_TIME = 1.0
"""Time [s] over which slips that ran away are counted."""
AGAIN = 1.4
"""Number of them that is no change of the rail: a second one within `AWAY_TIME`."""
SELDOM = 0.1
"""Number of them that is as good as none."""
UNTESTED = 0.2
"""Time [s] after which a peak is doubted that limits torque while slip stays far below the slip sought."""
FULL = 0.9
"""Share of that peak above which it does so."""
MORE = 5.0
"""How many times faster it is doubted while its axle feels more than it."""
WITHIN_NOISE = 2.0
"""The same in deviations of the coefficient by noise: how far below that share a peak is still used up."""
DOUBTED_RISE = 8.0
"""Logarithmic speed [1/s] at which it then rises."""
FALLING = -0.5
"""Elasticity where slip runs away again and again."""


@inlined
def runs_away(search, axles, noise):
    """Whether an axle's slip runs away from its limit, and has done so shortly before: the curve falls there."""
    pace, state = search.pace, search.state[0]
    largest = 0.0
    for i in range(axles.peak.size):
        largest = max(largest, axles.slip[i])
    beyond = largest > BEYOND * state.slip * (1.0 + state.swing) + 2.0 * noise
    state.away *= pace.kept_away
    if beyond and state.beyond == 0.0:
        state.away += 1.0
    state.beyond = 1.0 if beyond else 0.0
    return beyond and state.away > AGAIN


@inlined
def doubt_peaks(search, axles, follows, felt, ceiling):
    """Raise peaks that limit the torque and that no slip shows; `follows`: whether slip is near the one sought.

    `felt`: deviation of a coefficient by noise. A peak within it of nothing would never seem to be used up.
    """
    pace, state = search.pace, search.state[0]
    weakest = 0
    for i in range(axles.peak.size):
        if axles.peak[i] < axles.peak[weakest]:
            weakest = i
    coefficient, peak = axles.coefficient[weakest], axles.peak[weakest]
    # noise of so small a force makes single readings doubtful
    told = 1.0 if coefficient + WITHIN_NOISE * felt > FULL * peak else -1.0
    below = state.below + (MORE if coefficient > peak else told) * pace.period
    state.below = 0.0 if follows else max(below, 0.0)
    if state.below > UNTESTED:
        for i in range(axles.peak.size):
            axles.peak[i] = min(axles.peak[i] * math.exp(DOUBTED_RISE * pace.period), ceiling)


@inlined
def size_swing(search, rough):
    """Let the swing grow or shrink; `rough`: deviation of a reading of the slip, over the slip."""
    pace, state = search.pace, search.state[0]
    most = max(pace.swing, min(OVER_NOISE * rough, LARGEST_SWING))
    swing = state.swing * math.exp(pace.swing_rate * (GOAL - state.certainty))
    state.swing = min(max(swing, pace.least_swing), most)


@inlined
def step_slip(search, error, rough, lowest, steep):
    """Move the slip sought along the `error`, elasticity less the one wanted, on a curve of steepness `steep`."""
    pace, state = search.pace, search.state[0]
    if error * state.error < -ROUNDING:
        state.step_share *= 1.0 - LOST * state.certainty
    state.error = error
    grown = state.step_share * (1.0 + RECOVERY * pace.period * state.certainty)
    least = max(LEAST_STEP_SHARE, steep / WIDE * steep / WIDE)
    state.step_share = min(max(grown, least), 1.0)
    rise = pace.fastest_rise * (1.0 + EAGER * max(state.elasticity - FAR_BELOW, 0.0))
    rate = min(
        max(state.step_share * state.certainty * pace.gain * error, -pace.fastest_fall), rise
    )
    if OVER_NOISE * rough > pace.swing and state.away < SELDOM:
        rate += EXPLORE * max(1.0 - state.certainty / HARDLY, 0.0)
    state.slip = min(max(state.slip * math.exp(pace.period * rate), lowest), pace.highest)


# Search for the slip of the best torque, which needs no known curve: excitation, elasticity, and a step along it.
#
# What is sought is the slip s at which the rail force less the price of its friction work is greatest. With the price
# `friction_price` p [s/m], the coefficient counts as mu(s) (1 - p s). So at the best slip the elasticity of the curve
# is
#
#     e = d ln mu / d ln s = p s / (1 - p s), about p s.
#
# Where adhesion hardly grows any more, slip costs more than it brings. On a wide peak the best slip lies well below
# that of the peak.
#
# *Excitation.* The slip limit that the MPC keeps swings about its mean, a sine of `swing_time`.
#
# *Elasticity.* ln mu and ln s of each axle, less their means, are demodulated at that frequency with a memory of
# `memory`:
# complex numbers Z_mu and Z_s. Their quotient would be biased towards zero, for slip is measured with noise. So the
# swing
# itself is the instrument (instrumental variables; Soederstroem, Automatica 43 (2007) 939-958): slip answers it with a
# known
# lag, and u is the phase of that answer. A wrong lag costs signal, but makes no bias. With the parts along u and across
# it,
#
#     A = Re(Z_s conj u),    B = Re(Z_mu conj u),    e = (A B + D e_0) / (A^2 + D).
#
# The part of Z_mu across u that does not follow slip is no answer, so it tells the noise: D = FOLLOWS var(Z_s) +
# var(Z_mu - e Z_s) / PRIOR^2 holds e at e_0 = p s, where nothing moves, as long as slip does not follow or adhesion
# changes by itself; var(Z_s) is what the sensors' noise makes. A^2 / (A^2 + D) is how far e is known. A rail that
# changes is no answer to the swing either. The axle asked is the one with the largest slip: it is at its limit.
#
# *Step.* `mpc.old.slip_search` says how large the swing is, and how the slip sought moves along the elasticity.
#
# *Start.* Before any elasticity is known, the slip sought is `USUAL_SHARE` of what `mpc.old.estimator` takes for the
# peak's: the
# rise of the torque has shown the slope of the curve by then. Where the curve falls so steeply that slip runs away from
# its
# limit again and again, no swing is answered; but that it runs away tells that it is too large. Where slip stays
# below the one sought and no swing is answered, what limits the torque is the peak believed; if that goes on, the
# belief is
# too low and rises.


LEAST_COEFFICIENT = 0.01
"""Of an axle that is listened to; so small a force has no logarithm worth its noise."""
LEAST_SLIP = 0.004
"""The same [m/s]."""

MEAN_TIME = 0.2
"""Time [s] over which the mean is taken that demodulation removes."""
NOISE_TIME = 1.0
"""Time [s] over which the variance across the answer is taken."""
ANSWER_LAG = 0.015
"""Time [s] by which slip follows its limit, apart from the filter of the pairs and the lag of the motors."""
SETTLED = 0.2
"""Time [s] of limitation after which the search goes on."""
AT_LIMIT = 0.5
"""Share of the slip sought from which on the slip limit may be what binds."""
BINDS = 0.9
"""The same from which on it does; below, an answer to the swing tells."""
JUMP = 0.12
"""Change of ln mu within the mean's time that is a change of the rail."""
LEAP = 0.3
"""Share of the slip held by which slip falls where adhesion returns; torque is then what holds it, not the slip limit."""
FELL = 1.5
"""The same in deviations of a reading's noise: four of those of the filtered slip."""
WHOLE_SWING = 1.3
"""The same over the swing: filtered ln mu answers it by no more, from one extreme to the other."""
SURE = 4.0
"""The same over the deviation of ln mu that noise makes, where that is more."""
PRIOR = 0.3
"""Deviation of an elasticity from the one wanted, before it is heard."""
FOLLOWS = 2.0
"""Weight of the noise in the slip against its answer."""
KEPT_AFTER_JUMP = 0.3
"""Share of the demodulated values that is kept where the rail changes."""
FIRST_ERROR = 0.2
"""Error of an elasticity heard at first, from a slip that follows the swing."""
USUAL_SHARE = 0.8
"""Slip sought over that of the peak, as long as no elasticity tells."""
LIMITING = 0.999
"""Share of its target below which a unit counts as limited."""
GOLDEN = 2.399963
"""Golden angle: units swing out of step, so the train does not swing."""


STATE = named_record(
    "slip", "swing", "phase", "limited_for", "elasticity", "certainty", "noise", "error", "step_share",
    "beyond", "away", "below",
)  # fmt: skip
"""`slip` sought [m/s]; size and `phase` of the swing; time since the unit is limited [s]; `elasticity`; its `certainty`,
0 to 1; variance of ln mu across the answer; `error` of the elasticity at the last step, and its `step_share`, 1: a
whole one; whether slip is `beyond` its limit, how often it ran `away` of late, and for how long it was `below` the slip
sought though the peak believed was used up [s]."""


class UnitSearch(NamedTuple):
    """The search of one unit."""

    pace: Any
    """Numbers of `SlipSearch`, and more per control period, see `search_of`."""
    state: NDArray[np.void]
    """`STATE`, (1,)."""
    mean_slip: Floats
    """Mean of ln s of each axle, nan: none yet, (axles,)."""
    mean_coefficient: Floats
    demodulated: Floats
    """Parts of Z_s and of Z_mu of each axle, (axles, 4)."""


def search_of(context: UnitContext, settings: SlipSearch, pole: float) -> UnitSearch:
    """The search of a unit at the start of a run."""
    dt = context.period

    def share(time: float) -> float:
        return -math.expm1(-dt / time)

    turning = 2.0 * math.pi / settings.swing_time
    lag = math.atan(turning / pole) + math.atan(turning * context.torque_lag) + turning * ANSWER_LAG
    pace = numbers_of(
        settings,
        period=float(dt),
        advance=2.0 * math.pi * dt / settings.swing_time,  # of the swing's phase
        kept=math.exp(-dt / settings.memory),  # of the demodulated values
        mean=share(MEAN_TIME),  # share of a new value, as is `noise`
        noise=share(NOISE_TIME),
        cosine=-math.sin(lag),  # of the phase of an answer, as is `sine`
        sine=math.cos(lag),
        # variance that noise of a reading makes in a demodulated value, over its own
        heard=0.25 * dt * settings.memory / (1.0 + (turning / pole) ** 2),
        swing_rate=SWING_RATE * dt,  # logarithmic, per `certainty` above `GOAL`
        kept_away=math.exp(-dt / AWAY_TIME),  # of the count of slips that ran away
    )
    state = np.zeros(1, STATE)
    one = state[0]
    one.slip, one.swing = settings.first, settings.swing
    one.step_share = 1.0
    one.phase = GOLDEN * context.unit % (2.0 * math.pi)
    one.noise = (FIRST_ERROR * 0.5 * settings.memory * settings.swing) ** 2
    n = context.axles
    return UnitSearch(pace, state, np.full(n, np.nan), np.zeros(n), np.zeros((n, 4)))


@inlined
def slip_limit(search):
    """Slip [m/s] that no axle of the unit should exceed now."""
    state = search.state[0]
    return state.slip * (1.0 + state.swing * math.sin(state.phase))


@inlined
def _demodulate(search, axles, felt, noise):
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
        whole = WHOLE_SWING * max(state.swing, pace.swing)
        jump = max(JUMP, whole, SURE * felt / axles.coefficient[i])
        held = state.slip if fresh else min(math.exp(search.mean_slip[i]), state.slip)
        if not fresh and held - axles.slip[i] > max(max(LEAP, whole) * held, FELL * noise):
            # adhesion returns: that slip falls while it rises is no answer
            fresh, state.certainty = True, 0.0
        if fresh or abs(coefficient - search.mean_coefficient[i]) > jump:
            search.mean_slip[i], search.mean_coefficient[i] = slip, coefficient
            for k in range(4):
                z[k] *= 0.0 if fresh else KEPT_AFTER_JUMP
            state.swing = max(state.swing, pace.swing)
            state.step_share = 1.0
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


@inlined
def _elasticity(search, i, wanted, rough, follows):
    """Elasticity of axle `i`, `wanted` where nothing tells it; returns what the answer alone says.

    `rough`: deviation of a reading of its slip, over the slip; `follows`: whether the slip limit is what binds.
    """
    pace, state, z = search.pace, search.state[0], search.demodulated[i]
    cosine, sine = pace.cosine, pace.sine
    of_slip = max(z[0] * cosine + z[1] * sine, 0.0)
    of_coefficient = z[2] * cosine + z[3] * sine
    # what lies across the answer is no answer
    across = z[1] * cosine - z[0] * sine
    noise = z[3] * cosine - z[2] * sine - state.elasticity * across
    # below the limit torque rises, and what that changes would pass for noise
    if follows or noise * noise < state.noise:
        state.noise += pace.noise * (noise * noise - state.noise)
    answer = of_slip * of_slip
    doubt = FOLLOWS * pace.heard * rough * rough + state.noise / (PRIOR * PRIOR) + 1e-12
    state.elasticity = (of_slip * of_coefficient + doubt * wanted) / (answer + doubt)
    state.certainty = answer / (answer + doubt)
    return of_coefficient / max(of_slip, 1e-9)


@inlined
def search_slip(search, axles, curve, felt, noise, limited, ceiling):
    """A control period of the search, which tells the `curve` what it hears.

    `noise`: deviation of measured slip [m/s], `felt`: that of a coefficient by it; `limited`: whether the unit gives
    less than is wanted of it; `ceiling`: largest peak believed.
    """
    pace, state = search.pace, search.state[0]
    state.phase = (state.phase + pace.advance) % (2.0 * math.pi)
    lowest = max(pace.lowest, pace.noise_margin * noise)
    if curve.state[0].heard_for == 0.0:  # pairs below the peak are all that is known
        state.slip = min(max(USUAL_SHARE * curve.state[0].top, lowest), pace.highest)
    if not limited:
        state.limited_for = 0.0
        for i in range(search.mean_slip.size):
            search.mean_slip[i] = np.nan
        return
    state.limited_for += pace.period
    i = _demodulate(search, axles, felt, noise)
    slip = math.exp(search.mean_slip[i]) if i >= 0 else 0.0
    follows = slip > AT_LIMIT * state.slip
    # a peak believed can hold slip a little below its limit: then no swing is answered, and slip stays where it is
    binds = slip > BINDS * state.slip or state.certainty > HARDLY
    doubt_peaks(search, axles, follows and binds, felt, ceiling)
    if i < 0:
        return
    wanted, rough = pace.friction_price * state.slip, noise / slip
    heard = _elasticity(search, i, wanted, rough, follows)
    if runs_away(search, axles, noise):
        heard = state.elasticity = FALLING
        state.certainty = 1.0
    size_swing(search, rough)
    if state.limited_for > SETTLED and follows:
        if pace.seek:
            step_slip(search, state.elasticity - wanted, rough, lowest, steepness(curve))
        take_in_elasticity(curve, slip, heard, state.certainty)
