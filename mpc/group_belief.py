"""What a group believes of its rail: the peak of each axle, and the load that rests on it while the car pulls."""

import numpy as np
from numpy.typing import NDArray

from mpc.belief import CurveObserver
from mpc.settings import CurveBelief, PeakBelief
from mpc.unit_model import Units, group_of, torque_per_coefficient, unit_of_axle, unloading

Floats = NDArray[np.float64]


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
        return carried_torque(self.peak * self.load / self._static, self._first, self._carried)


def carried_torque(peak: Floats, first: NDArray[np.int64], per_coefficient: Floats) -> Floats:
    """Torque [N m] at which the weakest axle of each unit is at its peak, (units,).

    `peak` (axles,) relative to the static load, `first` axle of each unit, `per_coefficient` (units,) [N m].
    """
    return np.asarray(np.minimum.reduceat(peak, first) * per_coefficient)
