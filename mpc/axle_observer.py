"""Pairs of coefficient and slip of each axle of a unit, from torque and speeds alone.

A disturbance observer estimates the coefficient (JP5484215 (1)-(4), `alloc.onboard.observer`). The measured slip passes the
same filter, so both belong to one instant. Between readings speeds are assumed to be linear. Torque is not linear: it
follows the command, which changes once a period, with the motor's lag, so most of its change comes early. If it were treated
as linear, it would seem late, and the torque that accelerates the wheelset would be mistaken for adhesion that grows with
slip.
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
"""Averaging time [s] for the noise of measured slip."""

SMALLEST_NOISE = 2e-4
"""Smallest noise [m/s] assumed; larger noise is learnt."""

FIRST_NOISE = 0.01
"""Noise [m/s] assumed before any reading: with too small a value the filter trusts noisy readings too much."""

DOUBT = 0.5
"""Deviation of an unknown peak, over the peak."""

ROUGHEST = 4.0
"""A reading counts as no noisier than this multiple of the known noise, because slip itself also jumps."""


class Constants(NamedTuple):
    """Constants of the compiled update, from the unit and `PeakBelief`."""

    inertia: float
    radius: float
    pole: float
    keep: float
    """Weight in the observer's filter, as are `old` and `new`."""
    old: float
    new: float
    old_torque: float
    """Weights of the torque, as `old` and `new` of the speed."""
    new_torque: float
    noise_share: float
    """Weight of a new value in the mean noise."""
    repeat: float
    """Periods over which the filter's values come from one reading: together they count as one."""
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
    """Axles before any reading."""
    axles = Axles(*(np.zeros(context.axles) for _ in Axles._fields))
    axles.noise[:] = FIRST_NOISE
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
    """Mean deviation of measured slip [m/s] over the unit's axles."""
    total = 0.0
    for i in range(axles.noise.size):
        total += axles.noise[i] / axles.noise.size
    return total
