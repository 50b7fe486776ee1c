"""What each axle of a unit feels and how much it could carry at most, from torque and speeds alone.

Coefficient and slip come as a pair: a disturbance observer tells the coefficient, and the measured slip passes the same
filter, so both are of one instant. The peak is a random walk, seen through the shape f of the rational curve
(`alloc.plant.adhesion_laws`) that the unit believes in, whose slip at the peak and steepness `mpc.slip_search` tells:

    coefficient = f(slip) peak + error,

so a scalar Kalman filter estimates it. Both values of a pair are in error. That of the slip counts with the curve's slope
there (effective variance: Orear, Am. J. Phys. 50 (1982) 912-916). An axle on the steep part of its curve tells little of its
peak, and the estimate hardly moves. A pair that is too far from what was expected says that the rail has changed: the
filter then doubts its peak, and takes over the next pairs at once.
"""

import math
from typing import NamedTuple

import numpy as np

from alloc.compilation import jit
from alloc.onboard.host import UnitContext
from alloc.onboard.observer import observe, observer_gains, tangential_coefficient_estimate
from alloc.plant.equations import slip_velocity
from alloc.plant.structure import Floats
from mpc.settings import PeakBelief

NOISE_TIME = 1.0
"""Time [s] over which the noise of measured slip is taken."""

SMALLEST_NOISE = 2e-4
"""Noise [m/s] that is supposed at least: from there on a larger one is learnt."""

FIRST_NOISE = 0.01
"""Noise [m/s] supposed before any was felt: who supposes too little believes too firmly in what noise says."""

DOUBT = 0.5
"""Deviation of a peak that nothing is known of, over the peak."""

ROUGHEST = 4.0
"""A reading counts as no noisier than this many times the noise known: slip itself jumps too."""


class Constants(NamedTuple):
    """What the compiled update takes of the unit and of `PeakBelief`."""

    inertia: float
    radius: float
    pole: float
    keep: float
    """Of the observer's filter, as are `old` and `new`."""
    old: float
    new: float
    noise_share: float
    """Share of a new value in the mean noise."""
    repeat: float
    """Periods over which the filter's values are of one reading: so many count as one."""
    kept_noise: float
    """Variance of filtered noise over that of noise."""
    felt_noise: float
    """Deviation of the coefficient per m/s of noise in the slip."""
    walk: float
    """Growth of a peak's relative variance per period."""
    slip_error: float
    coefficient_error: float
    relative_error: float
    gate: float
    floor: float
    ceiling: float


class Axles(NamedTuple):
    """What is remembered of each axle, (axles,) each."""

    filtered: Floats
    """Of the observer, as is `last`."""
    last: Floats
    slip: Floats
    """Measured slip, as late as the coefficient [m/s]."""
    measured: Floats
    """Slip of the last reading [m/s]."""
    before: Floats
    """Of the reading before."""
    noise: Floats
    """Deviation of measured slip [m/s]."""
    coefficient: Floats
    peak: Floats
    variance: Floats
    """Of the peak."""


def constants_of(context: UnitContext, belief: PeakBelief) -> Constants:
    """Constants of a unit."""
    period, pole = context.period, belief.pole
    keep, old, new = observer_gains(pole, period)
    values = (
        context.inertia, context.radius, pole, keep, old, new, -math.expm1(-period / NOISE_TIME),
        max(1.0, 2.0 / (pole * period)), (1.0 - keep) / (1.0 + keep),
        pole * context.inertia / (context.radius**2 * context.axle_load), belief.walk**2 * period,
        belief.slip_error, belief.coefficient_error, belief.relative_error, belief.gate**2, belief.floor, belief.ceiling,
    )  # fmt: skip
    return Constants(*map(float, values))


def axles_of(context: UnitContext, belief: PeakBelief) -> Axles:
    """Axles of which nothing is known."""
    axles = Axles(*(np.zeros(context.axles) for _ in Axles._fields))
    axles.noise[:] = FIRST_NOISE
    axles.peak[:] = belief.initial
    axles.variance[:] = (DOUBT * belief.initial) ** 2
    return axles


@jit
def observe_axles(c, axles, load, speed, omega, torque, fresh):
    """Take in the readings of a period, in the direction of the demand; `torque` at the wheel, `load` [N] (axles,)."""
    for i in range(omega.size):
        measured = slip_velocity(omega[i], c.radius, speed)
        if fresh:  # start in equilibrium
            axles.slip[i] = axles.measured[i] = axles.before[i] = measured
            axles.last[i] = axles.filtered[i] = torque + c.pole * c.inertia * omega[i]
        axles.filtered[i], axles.last[i], load_torque = observe(
            axles.filtered[i],
            axles.last[i],
            torque,
            omega[i],
            c.inertia,
            c.pole,
            c.keep,
            c.old,
            c.new,
        )
        axles.coefficient[i] = tangential_coefficient_estimate(load_torque, load[i], c.radius)
        # E|x| of a normal second difference is 0.8 sqrt(6) of a reading's deviation
        rough = abs(measured - 2.0 * axles.measured[i] + axles.before[i]) / 1.95
        rough = min(rough, ROUGHEST * max(axles.noise[i], SMALLEST_NOISE))
        axles.noise[i] += c.noise_share * (rough - axles.noise[i])
        axles.slip[i] = c.keep * axles.slip[i] + c.old * axles.measured[i] + c.new * measured
        axles.before[i], axles.measured[i] = axles.measured[i], measured


@jit
def mean_noise(axles):
    """Deviation of measured slip [m/s], of the unit's axles on the mean."""
    total = 0.0
    for i in range(axles.noise.size):
        total += axles.noise[i] / axles.noise.size
    return total


@jit
def estimate_peaks(c, axles, peak_slip, steepness):
    """A step of the peaks' Kalman filters; the believed curve has its peak at `peak_slip` [m/s]."""
    noise = mean_noise(axles)
    felt = c.felt_noise * noise
    for i in range(axles.peak.size):
        slip, coefficient, peak = max(axles.slip[i], 0.0), axles.coefficient[i], axles.peak[i]
        x = slip / peak_slip
        below = 1.0 + x * (x + steepness - 2.0)
        share = steepness * x / below
        slope = peak * steepness * (1.0 - x * x) / (below * below * peak_slip)
        own = c.coefficient_error + c.relative_error * abs(coefficient)
        of_slip = c.slip_error * c.slip_error + c.kept_noise * noise * noise
        error = (own * own + felt * felt + slope * slope * of_slip) * c.repeat
        # while slip changes fast, the filtered pair lies beside the curve
        moving = 0.5 * slope * (axles.measured[i] - axles.slip[i])
        error += moving * moving
        unexpected = coefficient - share * peak
        expected = share * share * axles.variance[i] + error
        if unexpected * unexpected > c.gate * expected:
            axles.variance[i] += (DOUBT * peak) ** 2
            expected = share * share * axles.variance[i] + error
        # read at the slip that was measured, noise alone would pass for slip on a rail without adhesion
        likely = max(slip + slope * of_slip * c.repeat * unexpected / expected, 0.0) / peak_slip
        tells = steepness * likely / (1.0 + likely * (likely + steepness - 2.0))
        gain = tells * axles.variance[i] / (tells * share * axles.variance[i] + error)
        axles.peak[i] = min(max(peak + gain * unexpected, c.floor), c.ceiling)
        grown = (1.0 - gain * share) * axles.variance[i] + c.walk * peak * peak
        axles.variance[i] = min(grown, (DOUBT * peak) ** 2)
