"""How the search for the best slip moves: the size of its swing, its step, and what it makes of slip that runs away.

*Swing.* Where e is told better than `GOAL`, the swing shrinks, down to `least_swing`, for it costs torque; else it grows
up to `swing`, or to `OVER_NOISE` times the noise of the slip.

*Step.* d ln s / dt = `gain` c A^2 / (A^2 + D) (e - p s), within `fastest_rise` and `fastest_fall`. This is extremum seeking
(Krstic and Wang, Automatica 36 (2000) 595-601) with the elasticity in place of the gradient, so that neither level nor slip
needs a scale. Yet e changes by -2 / n per ln s at a peak of steepness n: a step that is right on a wide peak overshoots, and
the slip goes to and fro, on one that falls at once. So c, a share of the whole step, shrinks where the error changes its
sign, and recovers where it does not (as steps of Rprop do: Riedmiller and Braun, ICNN 1993, 586-591). Where noise hides the
answer, slip rises on trial, for a larger one stands out of it.

*Running away.* On a curve that falls steeply, slip beyond the peak runs away from its limit, is caught, and runs away again.
No swing is answered there. But a second time within `AWAY_TIME` is no change of the rail: the elasticity then counts as
`FALLING`.
"""

import math

from mpc.arrays import inlined

GOAL = 0.8
"""How far an elasticity should be told."""
SWING_RATE = 3.0
"""Logarithmic speed of the swing [1/s], per `told` above or below the goal."""
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
"""Product of two errors that stands for none: where nothing is told, an error is rounding."""
FAR_BELOW = 0.25
"""Elasticity from which on the peak is far, and slip may rise faster."""
EAGER = 10.0
"""Growth of the fastest rise per elasticity above that."""
EXPLORE = 0.7
"""Speed [1/s] at which the slip rises where noise hides what elasticity there is: a larger slip stands out of it."""
HARDLY = 0.3
"""How far an elasticity is told for slip not to rise on trial."""
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
def doubt_peaks(search, axles, follows):
    """Raise peaks that limit the torque and that no slip shows; `follows`: whether slip is near the one sought."""
    pace, state = search.pace, search.state[0]
    weakest = 0
    for i in range(axles.peak.size):
        if axles.peak[i] < axles.peak[weakest]:
            weakest = i
    used = axles.coefficient[weakest] > FULL * axles.peak[weakest]
    # noise of so small a force makes single readings doubtful
    below = state.below + (pace.period if used else -pace.period)
    state.below = 0.0 if follows else max(below, 0.0)
    if state.below > UNTESTED:
        for i in range(axles.peak.size):
            axles.peak[i] *= math.exp(DOUBTED_RISE * pace.period)


@inlined
def size_swing(search, rough):
    """Let the swing grow or shrink; `rough`: deviation of a reading of the slip, over the slip."""
    pace, state = search.pace, search.state[0]
    most = max(pace.swing, min(OVER_NOISE * rough, LARGEST_SWING))
    swing = state.swing * math.exp(pace.swing_rate * (GOAL - state.told))
    state.swing = min(max(swing, pace.least_swing), most)


@inlined
def step_slip(search, error, rough, lowest, steep):
    """Move the slip sought along the `error`, elasticity less the one wanted, on a curve of steepness `steep`."""
    pace, state = search.pace, search.state[0]
    if error * state.error < -ROUNDING:
        state.step_share *= 1.0 - LOST * state.told
    state.error = error
    grown = state.step_share * (1.0 + RECOVERY * pace.period * state.told)
    least = max(LEAST_STEP_SHARE, steep / WIDE * steep / WIDE)
    state.step_share = min(max(grown, least), 1.0)
    rise = pace.rise * (1.0 + EAGER * max(state.elasticity - FAR_BELOW, 0.0))
    rate = min(max(state.step_share * state.told * pace.gain * error, -pace.fall), rise)
    if OVER_NOISE * rough > pace.swing and state.away < SELDOM:
        rate += EXPLORE * max(1.0 - state.told / HARDLY, 0.0)
    state.slip = min(max(state.slip * math.exp(pace.period * rate), lowest), pace.highest)
