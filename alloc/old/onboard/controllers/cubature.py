"""Extremum seeking on a cubature Kalman filter's estimate of the coefficient, after Applied Sciences 15(19), 10524.

In: torque and speed of a unit. Out: the slip that is held.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from alloc.old.compilation import called
from alloc.old.errors import OnboardError
from alloc.old.onboard.controllers.base import (
    BuiltInController,
    Remembered,
    direction,
    torque_per_coefficient,
)
from alloc.old.onboard.controllers.creep import LIMITING, hold_slip_of_unit
from alloc.old.onboard.controllers.swarm import between
from alloc.old.onboard.reference_speed import is_relieved
from alloc.old.records import quantity

# Cubature Kalman filter (Arasaratnam and Haykin, 2009) in memory that is there already.
#
# 2 n points at +-sqrt(n) times the columns of a square root of the covariance carry mean and covariance through a model
# that need not be linear. What is measured here are elements of the state, so their correction is the linear filter's,
# one by one. Square roots are Cholesky's.


LEAST_VARIANCE = 1e-14
"""Below it a direction of the state counts as known: rounding must not make a square root of a negative number."""


@called
def lower_root(covariance, root):
    """Fill `root` (n, n) with the lower Cholesky factor of `covariance` (n, n)."""
    n = covariance.shape[0]
    for c in range(n):
        for r in range(n):
            total = covariance[r, c]
            for i in range(c):
                total -= root[r, i] * root[c, i]
            if r < c:
                root[r, c] = 0.0
            elif r == c:
                root[r, c] = math.sqrt(max(total, LEAST_VARIANCE))
            else:
                root[r, c] = total / root[c, c]


def prediction(model: Any) -> Any:
    """Compiled prediction under `model(points, i, inputs)`, which moves row `i` of `points` by one period."""

    @called
    def predict(state, covariance, root, points, walk, inputs):
        """Carry `state` (n,) and `covariance` (n, n) one period on; `walk` (n,): variances that the model's errors add.

        `root` (n, n) and `points` (2 n, n) are room to work in.
        """
        n = state.size
        lower_root(covariance, root)
        for i in range(2 * n):
            side = math.sqrt(n) if i < n else -math.sqrt(n)
            for a in range(n):
                points[i, a] = state[a] + side * root[a, i % n]
            model(points, i, inputs)
        for a in range(n):
            state[a] = 0.0
            for i in range(2 * n):
                state[a] += points[i, a] / (2 * n)
        for a in range(n):
            for b in range(n):
                total = walk[a] if a == b else 0.0
                for i in range(2 * n):
                    total += (points[i, a] - state[a]) * (points[i, b] - state[b]) / (2 * n)
                covariance[a, b] = total

    return predict


@called
def correct(state, covariance, root, a, measured, variance):
    """Correct by a measurement of element `a` with the error variance `variance`; returns the innovation."""
    n = state.size
    innovation = measured - state[a]
    total = covariance[a, a] + variance
    for b in range(n):
        root[0, b] = covariance[b, a]
    for b in range(n):
        state[b] += root[0, b] / total * innovation
        for c in range(n):
            covariance[b, c] -= root[0, b] * root[0, c] / total
    return innovation


# Extremum seeking on the estimate of a cubature Kalman filter, after Applied Sciences 15(19), 10524 (2025).
#
# From the source (abstract): an adaptive cubature Kalman filter, whose square roots are by singular value
# decomposition, estimates the train's speed. With it an extremum-seeking algorithm keeps the wheels near the largest
# adhesion. Above 90 % of it is used while the rail changes and under noise.
#
# Assumed are
#
# - the state, which is rim speed, train speed and the height of an adhesion curve;
# - the curve, 2 x / (1 + x^2) of slip over a fixed slip;
# - a noise of the measurement that adapts to the innovations;
# - Cholesky's square roots;
# - seeking by a sine added to the creep reference, the classical method.
#
# The curve only has to be right where the wheels are, because its height adapts.


RIM, TRAIN, HEIGHT = 0, 1, 2
"""Elements of the state: rim speed and train speed [m/s], positive ahead, and height of the adhesion curve.

Their sign does not change with the demand, or the filter would start again when brakes follow traction.
"""
STATES = 3
FIRST_HEIGHT = 0.1
HIGHEST = 1.0

_ROWS = ((0.0,) * STATES,) * STATES


@called
def curve_at(slip, scale):
    """Coefficient of a curve of height 1 at this slip over its `scale` [m/s], and its slope [s/m]."""
    x = slip / scale
    bottom = 1.0 + x * x
    return 2.0 * x / bottom, 2.0 * (1.0 - x * x) / (bottom * bottom * scale)


@called
def wheel_on_curve(points, i, inputs):
    """One period of the wheelset: `inputs` = (torque as a coefficient, m/s2 per coefficient, period [s], scale [m/s]).

    The step is implicit where the curve rises: there a wheel settles within a control period.
    """
    torque, response, period, scale = inputs
    value, slope = curve_at(points[i, RIM] - points[i, TRAIN], scale)
    height = points[i, HEIGHT]
    pull = response * period
    points[i, RIM] += pull * (torque - height * value) / (1.0 + pull * max(height * slope, 0.0))


predict = prediction(wheel_on_curve)


@called
def adapted(variance, innovation, expected, share, least):
    """Next variance of a measurement: the part of the innovations that the variance of the state does not explain."""
    return max(variance + share * (innovation * innovation - expected - variance), least)


@called
def estimate_slip(eq, st, m, p, k, j, commanded):
    """One period of unit `j`'s filter: writes its estimates of slip [m/s] and coefficient into memory."""
    state, covariance, root = k.state[j], k.covariance[j], k.root[j]
    sign, speed = direction(commanded), m.reference[eq.unit_body[j]]
    rim = speed + sign * m.worst_slip[j]
    if math.isnan(state[RIM]):
        state[RIM], state[TRAIN], state[HEIGHT] = rim, speed, FIRST_HEIGHT
        k.rim_variance[j] = p.noise**2
    torque = m.torque[j] / torque_per_coefficient(eq, j)
    torque += sign * m.air_force[j] / eq.axle_load[j]
    response = eq.axle_load[j] * eq.radius[j] ** 2 / eq.inertia[j]
    walk = (
        (p.rim_walk * st.period) ** 2,
        (p.train_walk * st.period) ** 2,
        p.height_walk**2 * st.period,
    )
    predict(state, covariance, root, k.points[j], walk, (torque, response, st.period, p.scale))
    own = covariance[RIM, RIM]
    innovation = correct(state, covariance, root, RIM, rim, k.rim_variance[j])
    k.rim_variance[j] = adapted(k.rim_variance[j], innovation, own, p.adapt, p.noise**2)
    correct(state, covariance, root, TRAIN, speed, p.train_noise**2)
    state[HEIGHT] = between(state[HEIGHT], 0.0, HIGHEST)
    k.slip[j] = sign * (state[RIM] - state[TRAIN])
    k.coefficient[j] = state[HEIGHT] * curve_at(k.slip[j], p.scale)[0]


@called
def seek(k, j, p, coefficient, period):
    """One period of extremum seeking: returns the slip reference [m/s], a sine about `centre`, moved after a whole cycle.

    Over a cycle the mean of the coefficient times the sine is half the slope times the amplitude.
    """
    k.phase[j] += 2.0 * math.pi * period / p.cycle
    k.product[j] += coefficient * math.sin(k.phase[j] - p.lag) * period / p.cycle
    if k.phase[j] >= 2.0 * math.pi:
        slope = 2.0 * k.product[j] / p.amplitude
        k.centre[j] = between(
            k.centre[j] + between(p.gain * slope, -p.largest, p.largest), p.lowest, p.highest
        )
        k.phase[j], k.product[j] = 0.0, 0.0
    return k.centre[j] + p.amplitude * math.sin(k.phase[j])


@called
def cubature_seeking_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    if math.isnan(k.allowed[j]):
        k.centre[j] = st.law.creep.reference
    estimate_slip(eq, st, m, p, k, j, commanded)
    reference = k.centre[j]
    if is_relieved(m, j) or m.unit.torque_factor[j] >= LIMITING:
        k.phase[j] = k.product[j] = 0.0  # nothing to be learnt of the peak
    else:
        reference = seek(k, j, p, k.coefficient[j], st.period)
    return hold_slip_of_unit(eq, st, m, st.law.creep, k.allowed, reference, k.slip[j], j, commanded)


_SEEKING: Remembered = {
    "allowed": math.nan,  # integral of creep control; nan: nothing yet
    "state": (math.nan,) * STATES,
    "covariance": ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-2)),
    "root": _ROWS,
    "points": (*_ROWS, *_ROWS),
    "rim_variance": 0.0,
    "slip": 0.0,  # as estimated [m/s]
    "coefficient": 0.0,  # as estimated
    "centre": 0.0,  # slip velocity about which is sought [m/s]
    "phase": 0.0,
    "product": 0.0,  # mean so far of coefficient times sine
}


@dataclass(frozen=True)
class CubatureSeeking(BuiltInController, remembered=_SEEKING):
    """Creep control on the slip that a cubature Kalman filter estimates, with extremum seeking of its reference.

    The reference is a sine about a centre, which moves after every cycle with the slope that the cycle showed. Fourteen sets
    of these parameters were tried, mostly of cycle (0.2, 0.3, 0.5 s), gain and lag. This one used most over 24 events of
    `studies.ladder.events` (seed 1000): 97.1 % where short on the multiple units, and 95.2 % at 0.5 s and a gain of 0.05.

    Source: Applied Sciences 15, 10524; values tuned on 24 events of `studies.ladder.events` (seed 1000).
    """

    name = "cubature-seeking"
    meaning = (
        "extremum seeking on a cubature Kalman filter's estimates (Applied Sciences 15, 10524)"
    )
    colour = "#550000"
    marker = "H"
    law = cubature_seeking_unit

    cycle: float = quantity(0.3, "s")
    """Period of the sine [s]."""
    amplitude: float = quantity(0.015, "km/h")
    """Amplitude of the sine [m/s]."""
    gain: float = quantity(0.2, "m2/s2")
    """Move of the centre over the slope that the cycle showed [m2/s2]."""
    largest: float = quantity(0.03, "km/h")
    """Largest move of the centre [m/s]."""
    lag: float = quantity(0.3, "1")
    """Phase lag of the coefficient behind the reference [rad]."""
    lowest: float = quantity(0.02, "km/h")
    """Least centre [m/s]."""
    highest: float = quantity(0.5, "km/h")
    """Greatest centre [m/s]."""
    noise: float = quantity(0.005, "km/h")
    """Filter: least deviation of the measured rim speed [m/s]."""
    train_noise: ClassVar[float] = 0.01
    """Filter: deviation of the train's measured speed [m/s]."""
    rim_walk: ClassVar[float] = 1.0
    """Filter: walk of the rim speed [m/s2]."""
    train_walk: ClassVar[float] = 0.3
    """Filter: walk of the train's speed [m/s2]."""
    height_walk: ClassVar[float] = 0.2
    """Filter: walk of the curve's height [1/sqrt(s)]."""
    adapt: ClassVar[float] = 0.02
    """Filter: share of an innovation that enters the rim speed's variance."""
    scale: ClassVar[float] = 0.2
    """Filter: slip at the peak of its curve [m/s]."""

    def __post_init__(self) -> None:
        names = ("cycle", "amplitude", "gain", "largest", "lowest", "highest", "noise")
        OnboardError.check("cubature-seeking", self, names, ("lag",))
        OnboardError.check_order("cubature-seeking", self, "lowest", "highest")
