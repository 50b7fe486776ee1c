"""What each axle of a unit feels, from torque and speeds alone: pairs of coefficient and slip.

A disturbance observer tells the coefficient (JP5484215 (1)-(4), `alloc.onboard.observer`), and the measured slip passes the
same filter, so both are of one instant. Between readings speeds are taken as linear. Torque is not: it follows the command,
which changes once a period, with the motor's lag, so most of its change comes early. Taken as linear it would seem late, and
what turns the wheelset faster and slower would pass for adhesion that grows with slip.
"""

import math
from typing import NamedTuple

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.onboard.observer import observer_gains, tangential_coefficient_estimate
from alloc.plant.equations import slip_velocity
from alloc.plant.structure import Floats
from mpc.arrays import inlined
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
    old_torque: float
    """Weights of the torque, as `old` and `new` of the speed."""
    new_torque: float
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
    """Of the observer, as are `turned` and `drove` [N m]."""
    turned: Floats
    """Last input that the speed made."""
    drove: Floats
    """Last torque."""
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


def torque_share(pole: float, period: float, lag: float) -> float:
    """Weight that the torque of the reading before has in the filtered one: between readings it follows a held command.

    T = command + (T_0 - command) exp(-t / lag), so the reading T_1 at the end of the period tells the command.
    """
    left, keep, gap = math.exp(-period / lag), math.exp(-pole * period), pole - 1.0 / lag
    transient = pole * keep * (math.expm1(gap * period) / gap if gap else period)
    return (transient - left * (1.0 - keep)) / (1.0 - left)


def constants_of(context: UnitContext, belief: PeakBelief) -> Constants:
    """Constants of a unit."""
    period, pole = context.period, belief.pole
    keep, old, new = observer_gains(pole, period)
    old_torque = torque_share(pole, period, context.torque_lag)
    values = (
        context.inertia, context.radius, pole, keep, old, new, old_torque,
        1.0 - keep - old_torque, -math.expm1(-period / NOISE_TIME),
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


@inlined
def observe_axles(c, axles, load, speed, omega, torque, fresh):
    """Take in the readings of a period, in the direction of the demand; `torque` at the wheel, `load` [N] (axles,)."""
    for i in range(omega.size):
        measured = slip_velocity(omega[i], c.radius, speed)
        turned = c.pole * c.inertia * omega[i]
        if fresh:  # start in equilibrium
            axles.slip[i] = axles.measured[i] = axles.before[i] = measured
            axles.turned[i], axles.drove[i] = turned, torque
            axles.filtered[i] = torque + turned
        axles.filtered[i] *= c.keep
        axles.filtered[i] += c.old * axles.turned[i] + c.new * turned
        axles.filtered[i] += c.old_torque * axles.drove[i] + c.new_torque * torque
        axles.turned[i], axles.drove[i] = turned, torque
        load_torque = axles.filtered[i] - turned
        axles.coefficient[i] = tangential_coefficient_estimate(load_torque, load[i], c.radius)
        # E|x| of a normal second difference is 0.8 sqrt(6) of a reading's deviation
        rough = abs(measured - 2.0 * axles.measured[i] + axles.before[i]) / 1.95
        rough = min(rough, ROUGHEST * max(axles.noise[i], SMALLEST_NOISE))
        axles.noise[i] += c.noise_share * (rough - axles.noise[i])
        axles.slip[i] = c.keep * axles.slip[i] + c.old * axles.measured[i] + c.new * measured
        axles.before[i], axles.measured[i] = axles.measured[i], measured


@inlined
def mean_noise(axles):
    """Deviation of measured slip [m/s], of the unit's axles on the mean."""
    total = 0.0
    for i in range(axles.noise.size):
        total += axles.noise[i] / axles.noise.size
    return total
