"""Belief about the adhesion curve: the peak coefficient of each axle, from disturbance observers of single axles.

An axle that slips to the peak and beyond feels what the rail can carry: the believed curve at its slip says which share of
the peak that is. An axle that does not slip proves only that the peak is not less than what it feels; belief then rises
slowly until the rail contradicts it. The same pairs of slip and coefficient tell, below the peak, the slope of the curve:
`mpc.curve_belief`.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import float64, void
from numpy.typing import NDArray

from alloc.by_reference import ByReference
from alloc.compilation import jit
from alloc.onboard.host import UnitContext
from alloc.onboard.observer import observe, observer_gains, tangential_coefficient_estimate
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.adhesion_laws import adhesion_limit, tangential_coefficient
from alloc.plant.equations import slip_velocity
from alloc.plant.structure import Floats
from mpc.arrays import VECTOR, sweep
from mpc.curve_belief import Slope, slope_belief, update_slope
from mpc.settings import CurveBelief, PeakBelief
from mpc.unit_model import Units, group_of, torque_per_coefficient, unit_of_axle, unloading

NOISE_TIME = 1.0
"""Time [s] over which the mean deviation of measured slip is taken: long against a slip's growth."""

STEADY = 0.2
"""Change of slip within the observer's delay, as a share of it, up to which slip and coefficient are of one point."""

FOREIGN_FORCE = 0.02
"""Coefficient by which the unit's own estimate, which knows of the air brake, may differ from what the motors explain."""


class Constants(NamedTuple):
    """What the compiled update takes of the unit and of `PeakBelief`; rates per control period."""

    inertia: float
    radius: float
    pole: float
    keep: float
    """Of the observer's filter, as are `old` and `new`."""
    old: float
    new: float
    take_over: float
    probe: float
    informative: float
    slip_error: float
    noise_margin: float
    noise_share: float
    floor: float
    ceiling: float


class Axles(NamedTuple):
    """What is remembered of each axle, (axles,) each."""

    filtered: Floats
    """Of the observer, as is `last`."""
    last: Floats
    slip: Floats
    """Measured slip, as late as the observer's coefficient [m/s]."""
    last_slip: Floats
    noise: Floats
    """Mean deviation of measured slip [m/s]."""
    coefficient: Floats
    peak: Floats
    peak_slip: Floats
    told: Floats
    """Peak at which it last slipped; 0: never."""
    micro: NDArray[np.bool_]
    """Whether slip and coefficient are of one point of the rising branch."""


class Belief(NamedTuple):
    """All that a unit believes of its rail, as compiled code takes it."""

    gear: float
    constants: Constants
    axles: Axles
    load: Floats
    """Load of each axle [N], (axles,)."""
    fresh: NDArray[np.bool_]
    """Whether the observers start anew at the next update, (1,)."""
    unknown: Floats
    """Share of the deviation of measured slip that is still what was supposed of it at the start, (1,)."""
    estimates: bool
    """Whether the slope is learnt."""
    slope: Slope


def belief_of(context: UnitContext, belief: PeakBelief, curve: CurveBelief | None = None) -> Belief:
    """Belief of a unit at the start of a run."""
    curve, n = curve or CurveBelief(), context.axles
    values = (
        context.inertia, context.radius, belief.pole, *observer_gains(belief.pole, context.period),
        -math.expm1(-belief.gain * context.period), math.exp(belief.probe * context.period),
        belief.informative, belief.slip_error, belief.noise_margin, -math.expm1(-context.period / NOISE_TIME),
        belief.floor, belief.ceiling,
    )  # fmt: skip
    axles = Axles._make([*(np.zeros(n) for _ in range(9)), np.zeros(n, dtype=np.bool_)])
    axles.noise[:] = belief.slip_error  # until it is known
    axles.peak[:] = belief.initial
    return Belief(
        float(context.gear_ratio),
        Constants(*map(float, values)),
        axles,
        np.full(n, float(context.axle_load)),
        np.ones(1, dtype=np.bool_),
        np.ones(1),
        # slip against a reference that slips along tells nothing of the curve's slope
        bool(curve.estimate and context.free_axle),
        slope_belief(context.curve, n, context.period, curve, belief.initial),
    )


def _kind() -> Any:
    """Numba's type of a `Belief`."""
    curve = PiecewiseCurve()
    context = UnitContext(0, 1, 0.4, 100.0, 5.0, 1e5, 4e4, 0.01, curve, 0.01)
    return ByReference(belief_of(context, PeakBelief())).kind


BELIEF = _kind()


@jit
def _observe(b, speed, omega, torque):
    """Peaks and slips of one control period, all in the direction of the demand, `torque` at the wheel."""
    kind, q, c, load, fresh = b.slope.kind, b.slope.q, b.constants, b.load, b.fresh[0]
    filtered, last, slips, last_slip = (
        b.axles.filtered,
        b.axles.last,
        b.axles.slip,
        b.axles.last_slip,
    )
    noise, coefficient, peak, top = (
        b.axles.noise,
        b.axles.coefficient,
        b.axles.peak,
        b.axles.peak_slip,
    )
    told, micro = b.axles.told, b.axles.micro
    for i in range(omega.size):
        measured = slip_velocity(omega[i], c.radius, speed)
        if fresh:  # start in equilibrium
            slips[i] = last_slip[i] = measured
            last[i] = filtered[i] = torque + c.pole * c.inertia * omega[i]
        filtered[i], last[i], load_torque = observe(
            filtered[i], last[i], torque, omega[i], c.inertia, c.pole, c.keep, c.old, c.new
        )
        felt = tangential_coefficient_estimate(load_torque, load[i], c.radius)
        coefficient[i] = felt
        limit, top_slip = adhesion_limit(kind, q, peak[i], speed)
        # as late as the observer's coefficient, so that both belong to one point of the curve
        slips[i] = slip = c.keep * slips[i] + c.old * last_slip[i] + c.new * measured
        last_slip[i] = measured
        change = abs(measured - slip) - c.noise_margin * noise[i] - c.slip_error
        micro[i] = change <= STEADY * abs(slip)
        noise[i] += c.noise_share * (abs(measured - slip) - noise[i])
        tells = c.informative * top_slip + c.slip_error + c.noise_margin * noise[i]
        if slip >= tells:
            here = tangential_coefficient(kind, q, slip, speed, speed + slip, peak[i])
            peak[i] += c.take_over * (peak[i] * felt / here - peak[i])
            told[i] = peak[i]
            # on the way down the belief would pass for that of an axle in micro slip
            micro[i] = False
        elif felt > limit:
            peak[i] += c.take_over * (peak[i] * felt / limit - peak[i])
        else:
            peak[i] *= c.probe
        peak[i] = min(max(peak[i], c.floor), c.ceiling)
        limit, top[i] = adhesion_limit(kind, q, peak[i], speed)
    b.fresh[0] = False


@jit
def measured_noise(b):
    """Mean deviation of measured slip [m/s], without what was supposed of it at the start."""
    mean = 0.0
    for i in range(b.axles.noise.size):
        mean += b.axles.noise[i] / b.axles.noise.size
    return max(mean - b.constants.slip_error * b.unknown[0], 0.0) / (1.0 - b.unknown[0])


@sweep(void(BELIEF, float64, VECTOR, float64, float64))
def believe(b, speed, omega, torque, estimate):
    """Take in car speed [m/s], angular speeds [rad/s] (axles,) and motor torque [N m] in the direction of demand.

    What the MPC takes of it are peaks, peak slips and the parameters q of the curve. `estimate`: the unit's own of its
    tangential coefficient, nan if it has none. Where it differs, other brakes work, and nothing is learnt of the slope.
    """
    c, axles = b.constants, b.axles
    _observe(b, speed, omega, torque * b.gear)
    b.unknown[0] *= 1.0 - c.noise_share
    mean = 0.0
    for i in range(omega.size):
        mean += axles.coefficient[i] / omega.size
    foreign = abs(estimate - mean) > FOREIGN_FORCE  # False for nan
    if b.estimates and not foreign:
        update_slope(
            b.slope, speed, axles.slip, axles.coefficient, axles.peak, axles.told, axles.micro,
            c.noise_margin * measured_noise(b), c.slip_error,
        )  # fmt: skip


class CurveObserver:
    """Belief of one unit about the peak coefficient of its axles, and about the slope of the curve, for use from Python."""

    def __init__(
        self, context: UnitContext, belief: PeakBelief, curve: CurveBelief | None = None
    ) -> None:
        self.record = belief_of(context, belief, curve)
        self._record = ByReference(self.record)
        self.axles = self.record.axles
        self.axle_load = self.record.load
        """Load of each axle [N], (axles,); who knows of load transfer keeps it up to date."""
        self.coefficient = self.axles.coefficient
        """Coefficient that each axle feels, in the direction of the demand, (axles,)."""
        self.peak = self.axles.peak
        """Believed peak coefficient, (axles,)."""
        self.peak_slip = self.axles.peak_slip
        """Slip velocity of the believed curve's maximum [m/s], (axles,)."""
        self.q = self.record.slope.q
        """Parameters of the believed curve, (6,)."""

    @property
    def stretch(self) -> float:
        """Slip below the peak, over that of the curve the unit was given at the same coefficient."""
        return float(self.record.slope.stretch[0])

    def forget_forces(self) -> None:
        """Start the observers anew at the next update; the belief about the peak stays."""
        self.record.fresh[0] = True

    def update(
        self, speed: float, omega: Floats, torque: float, estimate: float = math.nan
    ) -> None:
        """As `believe`."""
        believe(self._record, speed, omega, torque, estimate)


class GroupBelief:
    """Belief of a group about the peak coefficients and the loads of its axles; axles unit by unit, foremost first.

    The slope of the curve is not estimated: units of a group share one model with one curve.

    The observers of the axles need the loads, which follow from the forces that they observe: those of the period before
    are taken, so the loads are 10 ms late, little against the observers' own lag.
    """

    def __init__(self, units: Units, belief: PeakBelief) -> None:
        group = group_of(units)
        self.observers = tuple(
            CurveObserver(context, belief, CurveBelief(estimate=False)) for context in group
        )
        self.unit = unit_of_axle(group)
        """Number of each axle's unit, (axles,)."""
        self.parts = [np.flatnonzero(self.unit == j) for j in range(len(group))]
        """Axles of each unit."""
        self._first = np.array([part[0] for part in self.parts])
        self._unloading = unloading(group)
        self._car = np.array([context.car for context in group])[self.unit]
        self._same_car = (self._car[:, None] == self._car[None, :]).astype(float)
        self._static = np.array([context.axle_load for context in group])[self.unit]
        self._carried = np.array([torque_per_coefficient(context) for context in group])
        self.load = self._static.copy()
        """Load of each axle [N], (axles,)."""
        self.peak = np.full(self.unit.size, belief.initial)
        """Believed peak coefficient of each axle, (axles,)."""
        self.peak_slip = np.zeros(self.unit.size)
        """Slip velocity of the believed curve's maximum [m/s], (axles,)."""

    def forget_forces(self) -> None:
        """Start the observers anew at the next update; the belief about the peaks stays."""
        for observer in self.observers:
            observer.forget_forces()

    def update(self, speed: Floats, omega: Floats, torque: Floats) -> None:
        """Take in car speed (units,) [m/s], angular speeds (axles,) [rad/s] and motor torques (units,) [N m]."""
        felt = np.empty_like(self.peak)
        for j, (observer, part) in enumerate(zip(self.observers, self.parts, strict=True)):
            observer.axle_load[:] = self.load[part]
            observer.update(float(speed[j]), omega[part], float(torque[j]))
            self.peak[part], self.peak_slip[part] = observer.peak, observer.peak_slip
            felt[part] = observer.coefficient
        force = self._same_car @ (felt * self.load)
        # an observer's transient must not take away a whole load
        self.load = np.maximum(self._static - self._unloading * force, 0.5 * self._static)

    def carried_torque(self) -> Floats:
        """Motor torque of each unit that its weakest axle just carries [N m], (units,)."""
        weakest = np.minimum.reduceat(self.peak * self.load / self._static, self._first)
        return np.asarray(weakest * self._carried)
