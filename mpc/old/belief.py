"""Belief of a unit, or a group of units, about its rail and its drag: peaks, curve, best slip, gradient, air brake.

In: a `UnitSense` per control period. Out: the parameters of the prediction model.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numba import float64, void
from numpy.typing import NDArray

from alloc.old.onboard.host import UnitContext
from alloc.old.plant.adhesion import PiecewiseCurve, RationalCurve
from alloc.old.plant.laws import GRAVITY, adhesion_limit
from alloc.old.plant.model import Floats
from alloc.old.records import ByReference
from mpc.old.arrays import VECTOR, inlined, sweep
from mpc.old.condensing import STEEPEST_SLOPE
from mpc.old.estimator import (
    AxleEstimates,
    Curve,
    axles_of,
    constants_of,
    curve_of,
    look_beyond,
    mean_noise,
    observe_axles,
    predicted_curve,
    take_in_pairs,
)
from mpc.old.model import (
    Units,
    group_of,
    torque_per_coefficient,
    unit_of_axle,
    unloading,
)
from mpc.old.settings import MpcSettings
from mpc.old.slip_search import (
    LIMITING,
    USUAL_SHARE,
    UnitSearch,
    search_of,
    search_slip,
    slip_limit,
)

# Estimate of the force of a unit's air brake, from what the unit can observe.
#
# The unit's own estimate of its tangential coefficient includes the shoes (`alloc.old.onboard.sensing`); the estimate from
# the motors alone does not. The difference is the coefficient of the air brake. The two estimates respond to the
# oscillation of the slip a little differently, and both are noisy, so the difference is smoothed. The brake's force
# changes slowly and is assumed to be constant over the horizon.


AIR_TIME = 0.2
"""Averaging time [s] of the difference: one period of the swing, short compared with the filling of a brake cylinder."""
LEAST_AIR = 0.01
"""Coefficient above which it is believed."""


class AirBrakeEstimate(NamedTuple):
    """Estimate of the air brake of one unit."""

    share: float
    """Weight of a new value in the mean, per period."""
    mean: Floats
    """Mean difference, (1,)."""
    coefficient: Floats
    """Coefficient of the air brake, in the direction of the demand, (1,)."""


def air_brake_of(period: float) -> AirBrakeEstimate:
    """A brake that is released."""
    return AirBrakeEstimate(-math.expm1(-period / AIR_TIME), np.zeros(1), np.zeros(1))


@inlined
def hear_air_brake(air, axles, estimate):
    """Use the unit's `estimate` of its coefficient, nan if it has none, and add the air brake to the axles' coefficients."""
    mean = 0.0
    for i in range(axles.coefficient.size):
        mean += axles.coefficient[i] / axles.coefficient.size
    if math.isnan(estimate):
        air.mean[0] = 0.0
    else:
        air.mean[0] += air.share * (estimate - mean - air.mean[0])
    air.coefficient[0] = air.mean[0] if air.mean[0] > LEAST_AIR else 0.0
    for i in range(axles.coefficient.size):
        axles.coefficient[i] += air.coefficient[0]


# Forces that hold a unit back beside those of its own rails: gradient, resistance, and deviations of the other cars.
#
# The prediction moves the unit with its share of the train's mass. Drag is its believed rail forces over that mass,
# less the acceleration of the reference speed. It changes slowly and is assumed to be constant over the horizon, as an
# equivalent gradient.


DRAG_TIME = 0.5
"""Averaging time [s] of drag: long against the noise of a differentiated speed, short against a gradient's length."""


class Drag(NamedTuple):
    """Estimate of the drag of one unit."""

    share: float
    """Weight of a new value in the mean, per period."""
    weight: float
    """Weight of the unit's share of the train [N]."""
    rate: float
    """Control periods per second over gravity."""
    speed: Floats
    """Speed of the period before [m/s], (1,)."""
    grade: Floats
    """Gradient equivalent to all drag, rise per run in the direction of the demand, (1,)."""


def drag_of(context: UnitContext) -> Drag:
    """Drag before any reading."""
    share = float(-np.expm1(-context.period / DRAG_TIME))
    weight, rate = context.mass * GRAVITY, 1.0 / (context.period * GRAVITY)
    return Drag(share, float(weight), float(rate), np.zeros(1), np.zeros(1))


@inlined
def estimate_drag(drag, axles, load, speed, fresh):
    """Use the car's speed [m/s] and the coefficients of its axles; `load` [N], (axles,)."""
    if not fresh:
        force = 0.0
        for i in range(load.size):
            force += axles.coefficient[i] * load[i]
        found = force / drag.weight - (speed - drag.speed[0]) * drag.rate
        drag.grade[0] += drag.share * (found - drag.grade[0])
    drag.speed[0] = speed


# Belief of a unit, or a group of units, about its rail: peaks of its axles, the curve, and the best slip.
#
# `mpc.old.estimator` estimates what axles transmit and could carry. `mpc.old.slip_search` finds the slip with the largest
# force, and the curve for the prediction.


PREDICTED = RationalCurve(peak_slip=2.0 / STEEPEST_SLOPE, steepness=2.0)
"""Curve that the steps of the prediction are made for: of the steepest slope."""


def with_predicted_curve(context: UnitContext) -> UnitContext:
    """The unit as the prediction models it: its model has the rational curve, whatever curve the unit was given."""
    return replace(context, curve=PREDICTED)


def mean_curve(curves: Sequence[tuple[float, float]]) -> Floats:
    """Geometric mean of peak slips [m/s] and of steepnesses, (2,): units of a group share one model."""
    return np.asarray(np.exp(np.mean(np.log(curves), axis=0)))


class GivenCurve(NamedTuple):
    """The adhesion curve that the unit was given; it is used only where no slip is sought."""

    kind: int
    q: Floats
    share: float
    """Slip held, over that of its peak."""


class BeliefRecord(NamedTuple):
    """Everything that a unit believes about its rail, as compiled code takes it."""

    gear: float
    constants: Any
    """See `mpc.old.estimator.constants_of`."""
    axles: AxleEstimates
    load: Floats
    """Load of each axle [N], (axles,)."""
    fresh: NDArray[np.bool_]
    """Whether the observers start again at the next update, (1,)."""
    air: AirBrakeEstimate
    drag: Drag
    search: UnitSearch
    curve: Curve
    given: GivenCurve


def belief_of(context: UnitContext, settings: MpcSettings) -> BeliefRecord:
    """Belief of a unit at the start of a run."""
    curve = context.curve
    return BeliefRecord(
        float(context.gear_ratio),
        constants_of(context, settings.belief),
        axles_of(context, settings.belief),
        np.full(context.axles, float(context.axle_load)),
        np.ones(1, dtype=np.bool_),
        air_brake_of(context.period),
        drag_of(context),
        search_of(context, settings.search, settings.belief.pole),
        curve_of(settings.belief, context.period, settings.search.first / USUAL_SHARE),
        GivenCurve(curve.kind, np.array(curve.q, dtype=float), float(settings.search.given_share)),
    )


def _kind() -> Any:
    """Numba's type of a `BeliefRecord`."""
    context = UnitContext(0, 1, 0.4, 100.0, 5.0, 1e5, 4e4, 0.01, PiecewiseCurve(), 0.01)
    return ByReference(belief_of(context, MpcSettings())).kind


BELIEF = _kind()


@sweep(void(BELIEF, float64, VECTOR, float64, float64, float64))
def believe(b, speed, omega, torque, wanted, estimate):
    """Use car speed [m/s], angular speeds [rad/s] (axles,), motor torque and the torque wanted [N m].

    All in the direction of the demand. `estimate`: the unit's own of its tangential coefficient, nan if it has none.
    """
    axles, state, least = b.axles, b.search.state[0], np.inf
    observe_axles(b.constants, axles, b.load, speed, omega, torque * b.gear, b.fresh[0])
    hear_air_brake(b.air, axles, estimate)
    estimate_drag(b.drag, axles, b.load, speed, b.fresh[0])
    b.fresh[0] = False
    noise = mean_noise(axles)
    take_in_pairs(b.constants, axles, b.curve, noise)
    felt = b.constants.felt_noise * noise
    limited = torque < LIMITING * wanted
    search_slip(b.search, axles, b.curve, felt, noise, limited, b.constants.ceiling)
    if not b.search.pace.seek:
        for i in range(omega.size):
            least = min(least, axles.peak[i])
        _, top = adhesion_limit(b.given.kind, b.given.q, least, speed)
        state.slip = b.given.share * top
    look_beyond(b.curve, state.slip)


class UnitBelief:
    """Belief of one unit, for use from Python."""

    def __init__(self, context: UnitContext, settings: MpcSettings) -> None:
        self.record = belief_of(context, settings)
        self._record = ByReference(self.record)
        self._search = ByReference(self.record.search)
        self._curve = ByReference(self.record.curve)
        self._axles = ByReference(self.record.axles)
        self.axle_load = self.record.load
        """Load of each axle [N], (axles,); who knows of load transfer keeps it up to date."""
        self.coefficient = self.record.axles.coefficient
        """Coefficient that each axle feels, in the direction of the demand, (axles,)."""
        self.peak = self.record.axles.peak
        """Believed peak coefficient, (axles,)."""

    @property
    def grade(self) -> float:
        """Gradient equivalent to all drag, in the direction of the demand."""
        return float(self.record.drag.grade[0])

    @property
    def air_coefficient(self) -> float:
        """Coefficient of the air brake, in the direction of the demand."""
        return float(self.record.air.coefficient[0])

    @property
    def slip_limit(self) -> float:
        """Slip [m/s] that no axle should exceed at present."""
        return float(slip_limit(self._search))

    @property
    def curve(self) -> tuple[float, float]:
        """Peak slip [m/s] and steepness for the prediction."""
        top, steepness = predicted_curve(self._curve, self._axles)
        return float(top), float(steepness)

    def forget_forces(self) -> None:
        """Start the observers again at the next update; the belief about the rail is kept."""
        self.record.fresh[0] = True

    def update(
        self,
        speed: float,
        omega: Floats,
        torque: float,
        wanted: float = math.inf,
        estimate: float = math.nan,
    ) -> None:
        """As `believe`."""
        believe(self._record, speed, omega, torque, wanted, estimate)


class GroupBelief:
    """Belief of a group about the rail and the loads of its axles; axles unit by unit, foremost first.

    Every unit searches for its own slip. The group's one model has the geometric mean of their curves. The observers of the
    axles need the loads, which follow from the observed forces. The forces of the period before are used, so the loads are
    10 ms late, which is short compared with the observers' own lag.
    """

    def __init__(self, units: Units, settings: MpcSettings) -> None:
        group = group_of(units)
        self.observers = tuple(UnitBelief(context, settings) for context in group)
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
        self.peak = np.full(self.unit.size, settings.belief.initial)
        """Believed peak coefficient of each axle, (axles,)."""
        self.slip_limit = np.full(self.unit.size, settings.search.first)
        """Slip [m/s] that each axle should not exceed, (axles,)."""
        self._radius = np.array([context.radius for context in group])
        self.air_torque = np.zeros(len(group))
        """Torque of the air brake at each wheelset of a unit [N m], (units,)."""
        self._air = np.zeros(len(group))

    def forget_forces(self) -> None:
        """Start the observers again at the next update; the belief about the rail is kept."""
        for observer in self.observers:
            observer.forget_forces()

    def update(
        self, speed: Floats, omega: Floats, torque: Floats, wanted: Floats, estimate: Floats
    ) -> None:
        """Use car speed (units,) [m/s], angular speeds (axles,) [rad/s], motor torques and those wanted [N m].

        `estimate`: each unit's own of its tangential coefficient, nan if it has none, (units,).
        """
        felt = np.empty_like(self.peak)
        for j, (observer, part) in enumerate(zip(self.observers, self.parts, strict=True)):
            observer.axle_load[:] = self.load[part]
            observer.update(
                float(speed[j]), omega[part], float(torque[j]), float(wanted[j]), float(estimate[j])
            )
            self._air[j] = observer.air_coefficient
            self.air_torque[j] = self._air[j] * self._radius[j] * observer.axle_load.mean()
            self.peak[part], self.slip_limit[part] = observer.peak, observer.slip_limit
            felt[part] = observer.coefficient
        force = self._same_car @ (felt * self.load)
        # an observer's transient must not take away a whole load
        self.load = np.maximum(self._static - self._unloading * force, 0.5 * self._static)

    @property
    def drag(self) -> Floats:
        """Gradient equivalent to all drag of each unit, in the direction of the demand, (units,)."""
        return np.array([observer.grade for observer in self.observers])

    @property
    def curve(self) -> Floats:
        """Peak slip [m/s] and steepness for the prediction, (2,)."""
        return mean_curve([observer.curve for observer in self.observers])

    def carried_torque(self) -> Floats:
        """Motor torque of each unit that its weakest axle just carries beside the air brake [N m], (units,)."""
        weakest = np.minimum.reduceat(self.peak * self.load / self._static, self._first)
        return np.maximum(weakest - self._air, 0.0) * self._carried
