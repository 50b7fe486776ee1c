"""Belief about the adhesion curve: the peak coefficient of each axle, from disturbance observers of single axles.

An axle that slips to the peak and beyond feels what the rail can carry: the believed curve at its slip says which share of
the peak that is. An axle that does not slip proves only that the peak is not less than what it feels; belief then rises
slowly until the rail contradicts it. The same pairs of slip and coefficient tell, below the peak, the slope of the curve:
`mpc.curve_belief`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.onboard.host import UnitContext
from alloc.onboard.observer import observe, observer_gains, tangential_coefficient_estimate
from alloc.plant.adhesion import adhesion_limit, tangential_coefficient
from alloc.plant.equations import slip_velocity
from mpc.curve_belief import StretchEstimator
from mpc.settings import CurveBelief, PeakBelief

Floats = NDArray[np.float64]

INERTIA, RADIUS, POLE, KEEP, OLD, NEW = range(6)
TAKE_OVER, PROBE, INFORMATIVE, SLIP_ERROR, NOISE_MARGIN, NOISE_SHARE, FLOOR, CEILING = range(6, 14)
CONSTANTS = 14

NOISE_TIME = 1.0
"""Time [s] over which the mean deviation of measured slip is taken: long against a slip's growth."""


STEADY = 0.2
"""Change of slip within the observer's delay, as a share of it, up to which slip and coefficient are of one point."""


FOREIGN_FORCE = 0.02
"""Coefficient by which the unit's own estimate, which knows of the air brake, may differ from what the motors explain."""


@jit
def _update(
    kind, q, c, load, speed, omega, torque, fresh,
    filtered, last, slips, last_slip, noise, coefficient, peak, top, told, micro,
):  # fmt: skip
    """One control period, all in the direction of the demand, `torque` at the wheel; fills the arrays of the second line."""
    for i in range(omega.size):
        measured = slip_velocity(omega[i], c[RADIUS], speed)
        if fresh:  # start in equilibrium
            slips[i] = last_slip[i] = measured
            last[i] = filtered[i] = torque + c[POLE] * c[INERTIA] * omega[i]
        filtered[i], last[i], load_torque = observe(
            filtered[i], last[i], torque, omega[i], c[INERTIA], c[POLE], c[KEEP], c[OLD], c[NEW]
        )
        felt = tangential_coefficient_estimate(load_torque, load[i], c[RADIUS])
        coefficient[i] = felt
        limit, top_slip = adhesion_limit(kind, q, peak[i], speed)
        # as late as the observer's coefficient, so that both belong to one point of the curve
        slips[i] = slip = c[KEEP] * slips[i] + c[OLD] * last_slip[i] + c[NEW] * measured
        last_slip[i] = measured
        change = abs(measured - slip) - c[NOISE_MARGIN] * noise[i] - c[SLIP_ERROR]
        micro[i] = change <= STEADY * abs(slip)
        noise[i] += c[NOISE_SHARE] * (abs(measured - slip) - noise[i])
        tells = c[INFORMATIVE] * top_slip + c[SLIP_ERROR] + c[NOISE_MARGIN] * noise[i]
        if slip >= tells:
            here = tangential_coefficient(kind, q, slip, speed, speed + slip, peak[i])
            peak[i] += c[TAKE_OVER] * (peak[i] * felt / here - peak[i])
            told[i] = peak[i]
            # on the way down the belief would pass for that of an axle in micro slip
            micro[i] = False
        elif felt > limit:
            peak[i] += c[TAKE_OVER] * (peak[i] * felt / limit - peak[i])
        else:
            peak[i] *= c[PROBE]
        peak[i] = min(max(peak[i], c[FLOOR]), c[CEILING])
        limit, top[i] = adhesion_limit(kind, q, peak[i], speed)


class CurveObserver:
    """Belief of one unit about the peak coefficient of its axles, and about the slope of the curve."""

    def __init__(
        self, context: UnitContext, belief: PeakBelief, curve: CurveBelief | None = None
    ) -> None:
        curve = curve or CurveBelief()
        self._kind = context.curve.kind
        self._gear = context.gear_ratio
        self._constants = np.empty(CONSTANTS)
        self._constants[:POLE] = context.inertia, context.radius
        self._constants[POLE] = belief.pole
        self._constants[KEEP : NEW + 1] = observer_gains(belief.pole, context.period)
        self._constants[TAKE_OVER:] = (
            -math.expm1(-belief.gain * context.period),
            math.exp(belief.probe * context.period),
            belief.informative,
            belief.slip_error,
            belief.noise_margin,
            -math.expm1(-context.period / NOISE_TIME),
            belief.floor,
            belief.ceiling,
        )
        n = context.axles
        self._filtered, self._last = np.zeros(n), np.zeros(n)
        self._slip, self._last_slip = np.zeros(n), np.zeros(n)
        self._noise = np.full(n, belief.slip_error)  # until it is known
        self._told, self._micro = np.zeros(n), np.zeros(n, dtype=np.bool_)
        self._unknown = 1.0
        # slip against a reference that slips along tells nothing of the curve's slope
        self._estimates = curve.estimate and context.free_axle
        self._estimator = StretchEstimator(context.curve, n, context.period, curve, belief.initial)
        self._belief = belief
        self._fresh = True
        self.axle_load = np.full(n, context.axle_load)
        """Load of each axle [N], (axles,); who knows of load transfer keeps it up to date."""
        self.coefficient = np.zeros(n)
        """Coefficient that each axle feels, in the direction of the demand, (axles,)."""
        self.peak = np.full(n, belief.initial)
        """Believed peak coefficient, (axles,)."""
        self.peak_slip = np.zeros(n)
        """Slip velocity of the believed curve's maximum [m/s], (axles,)."""

    @property
    def stretch(self) -> float:
        """Slip below the peak, over that of the curve the unit was given at the same coefficient."""
        return self._estimator.stretch

    @property
    def q(self) -> Floats:
        """Parameters of the believed curve, (6,)."""
        return self._estimator.q

    def forget_forces(self) -> None:
        """Start the observers anew at the next update; the belief about the peak stays."""
        self._fresh = True

    def update(
        self, speed: float, omega: Floats, torque: float, estimate: float = math.nan
    ) -> None:
        """Take in car speed [m/s], angular speeds [rad/s] (axles,) and motor torque [N m] in the direction of demand.

        `estimate`: the unit's own of its tangential coefficient, if it has one. Where it differs, other brakes work, and
        nothing is learnt of the slope.
        """
        _update(
            self._kind, self.q, self._constants, self.axle_load, speed, omega, torque * self._gear,
            self._fresh, self._filtered, self._last, self._slip, self._last_slip, self._noise,
            self.coefficient, self.peak, self.peak_slip, self._told, self._micro,
        )  # fmt: skip
        self._fresh = False
        self._unknown *= 1.0 - self._constants[NOISE_SHARE]
        foreign = abs(estimate - float(self.coefficient.mean())) > FOREIGN_FORCE  # False for nan
        if self._estimates and not foreign:
            self._estimator.update(
                speed, self._slip, self.coefficient, self.peak, self._told, self._micro,
                self._belief.noise_margin * self._measured_noise(), self._belief.slip_error,
            )  # fmt: skip

    def _measured_noise(self) -> float:
        """Mean deviation of measured slip [m/s], without what was supposed of it at the start."""
        supposed = self._belief.slip_error * self._unknown
        return max(float(self._noise.mean()) - supposed, 0.0) / (1.0 - self._unknown)
