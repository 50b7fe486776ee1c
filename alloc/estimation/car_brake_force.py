"""Brake force of each car from coupler forces and accelerations: Hijikata and Nishimura, RTRI report, (2) to (9).

Couplers serve as force sensors. Cars count from the front; coupler k joins cars k and k + 1; its force is positive in
tension, accelerations are positive forwards (negative while braking), brake forces positive against the motion. Series run
along the first axis.

The meaning of the force depends on `mass`. With the rolling mass (`rolling_mass`, which includes the wheelsets' inertia) it
is the force at the brakes, of shoes and motors together, as a force at the rim. With the bare mass it is the force that the
rail receives, which is smaller by the force that decelerates the wheelsets. The report does not say which one it means; a
locomotive's wheelsets and motors add about 6 %.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.estimation.finite_series import finite_series, positive_series
from alloc.plant.equations import gradient_force

Floats = NDArray[np.float64]


def rolling_mass(mass: ArrayLike, inertia: ArrayLike, radius: ArrayLike) -> Floats:
    """Effective mass [kg] of a rolling car, (cars,): m + J / r^2.

    `inertia` [kg m2]: of all wheelsets of each car with everything geared to them; `radius` [m] of its wheels.
    """
    bare = positive_series("mass", mass, (None,))
    turning = finite_series("inertia", inertia, (bare.size,))
    return np.asarray(bare + turning / positive_series("radius", radius, bare.shape) ** 2)


def level_acceleration(
    acceleration: ArrayLike, grade: ArrayLike, rotating_share: ArrayLike = 0.0
) -> Floats:
    """Acceleration [m/s2] that the same forces would give on level track (report, below (2)).

    `grade`: rise per run at the car; `rotating_share`: mass that the wheelsets add over the bare mass, where the forces use
    `rolling_mass` (gravity acts on the bare mass alone). All broadcast together. An accelerometer fixed to the car body
    measures the result for the bare mass directly: use its readings unchanged.
    """
    slope = gradient_force(1.0, np.asarray(grade, dtype=float))
    return np.asarray(acceleration) + slope / (1.0 + np.asarray(rotating_share))


def group_brake_force(
    acceleration: ArrayLike,
    mass: float,
    front: ArrayLike | None = None,
    rear: ArrayLike | None = None,
    resistance: ArrayLike = 0.0,
) -> Floats:
    """Brake force [N] of a stretch of cars between two couplers, (time,): -m a + R_front - R_rear - W.

    A single car: (2), (4), (9); the locomotive: (3), with `rear` alone; all wagons behind it: (5), with `front` alone.
    `acceleration` (time,) [m/s2] on level track stands for all of the stretch, whose mass is `mass` [kg];
    `front`, `rear` (time,) [N]: coupler forces at its ends, None where the train ends; `resistance` [N]: running resistance
    of the stretch, scalar or (time,).
    """
    a = finite_series("acceleration", acceleration, (None,))
    m = positive_series("mass", mass, ())
    force = -m * a
    if front is not None:
        force = force + finite_series("front", front, a.shape)
    if rear is not None:
        force = force - finite_series("rear", rear, a.shape)
    return np.asarray(force - finite_series("resistance", resistance, (), a.shape))


def car_brake_forces(
    acceleration: ArrayLike, coupler_force: ArrayLike, mass: ArrayLike, resistance: ArrayLike = 0.0
) -> Floats:
    """Brake force [N] of each car, (time, cars): report (2).

    `acceleration` [m/s2] on level track: (time,), that of the train, as the report has it, exact once relative motion has
    died out; or (time, cars), each car's own, exact always. `coupler_force` (time, cars - 1) [N]; `mass` (cars,) [kg];
    `resistance` [N]: scalar, (cars,) or (time, cars).
    """
    m = positive_series("mass", mass, (None,))
    a = finite_series("acceleration", acceleration, (None,), (None, m.size))
    couplers = np.zeros((a.shape[0], 0))
    if m.size > 1:
        couplers = finite_series("coupler_force", coupler_force, (a.shape[0], m.size - 1))
    drag = finite_series("resistance", resistance, (), (m.size,), (a.shape[0], m.size))
    own = a if a.ndim == 2 else a[:, None]
    between = np.pad(couplers, ((0, 0), (1, 1)))
    return np.asarray(-m * own + between[:, :-1] - between[:, 1:] - drag)


def coupler_force_between(
    front_force: ArrayLike, front_mass: float, rear_force: ArrayLike, rear_mass: float
) -> Floats:
    """Coupler force [N] between two parts of a train without relative motion: report (6).

    Zero where the brake forces [N] are in proportion to the masses [kg].
    """
    m, n = positive_series("front_mass, rear_mass", [front_mass, rear_mass], (2,))
    front, rear = np.asarray(front_force, dtype=float), np.asarray(rear_force, dtype=float)
    return np.asarray((m * rear - n * front) / (m + n))


class BrakeRigging(NamedTuple):
    """Parameters of a car's brake in (7)."""

    cylinders: float
    """tau: brake cylinders per car."""
    lever_ratio: float
    """kappa"""
    efficiency: float
    """eta"""
    piston_area: float
    """S [m2]"""

    def force(self, pressure: ArrayLike, friction: ArrayLike, cars: int = 1) -> Floats:
        """Theoretical brake force [N] of `cars` equal cars: (7), (8).

        `pressure` [Pa] of the cylinders; `friction`: coefficient between wheel and shoe, usually a function of speed.
        """
        p, mu = np.asarray(pressure, dtype=float), np.asarray(friction, dtype=float)
        constant = self.cylinders * self.lever_ratio * self.efficiency * self.piston_area
        return np.asarray(cars * constant * p * mu)
