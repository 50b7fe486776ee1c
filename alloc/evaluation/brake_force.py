"""Brake force of each car from coupler forces and accelerations: RTRI report (2) to (9), and smoothed over the stop.

In: series of coupler forces and accelerations, (instants, cars). Out: forces [N], and what constant errors make of them.

Couplers serve as force sensors. Cars count from the front; coupler k joins cars k and k + 1. Its force is positive in
tension, accelerations are positive forwards (negative while braking), brake forces positive against the motion.

The meaning of the force depends on `mass`. With the rolling mass it is the force at the brakes, of shoes and motors, at the
rim. With the bare mass it is the force that the rail receives, smaller by what decelerates the wheelsets, about 6 % of a
locomotive's. The report does not say which one it means.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import dct, idct

from alloc.evaluation.measured_series import finite_series, positive_series
from alloc.schema.errors import EstimationError

Floats = NDArray[np.float64]


def rolling_mass(mass: ArrayLike, inertia: ArrayLike, radius: ArrayLike) -> Floats:
    """Effective mass [kg] of a rolling car, (cars,): m + J / r^2.

    `inertia` [kg m2]: of all wheelsets of each car with everything geared to them; `radius` [m] of its wheels.
    """
    bare = positive_series("mass", mass, (None,))
    turning = finite_series("inertia", inertia, (bare.size,))
    return np.asarray(bare + turning / positive_series("radius", radius, bare.shape) ** 2)


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
    `front`, `rear` (time,) [N]: coupler forces at its ends, None where the train ends; `resistance` [N]: scalar or (time,).
    """
    a = finite_series("acceleration", acceleration, (None,))
    force = -positive_series("mass", mass, ()) * a
    for sign, name, coupler_force in ((1.0, "front", front), (-1.0, "rear", rear)):
        if coupler_force is not None:
            force = force + sign * finite_series(name, coupler_force, a.shape)
    return np.asarray(force - finite_series("resistance", resistance, (), a.shape))


def car_brake_forces(
    acceleration: ArrayLike, coupler_force: ArrayLike, mass: ArrayLike, resistance: ArrayLike = 0.0
) -> Floats:
    """Brake force [N] of each car, (time, cars): report (2).

    `acceleration` [m/s2] on level track: (time,), the train's, exact once relative motion has died out; or (time, cars),
    each car's own, exact always. `coupler_force` (time, cars - 1) [N]; `mass` (cars,) [kg]; `resistance` [N].
    """
    m = positive_series("mass", mass, (None,))
    a = finite_series("acceleration", acceleration, (None,), (None, m.size))
    couplers = np.zeros((len(a), 0))
    if m.size > 1:
        couplers = finite_series("coupler_force", coupler_force, (len(a), m.size - 1))
    drag = finite_series("resistance", resistance, (), (m.size,), (a.shape[0], m.size))
    between = np.pad(couplers, ((0, 0), (1, 1)))
    a = a if a.ndim == 2 else a[:, None]
    return np.asarray(-m * a + between[:, :-1] - between[:, 1:] - drag)


def coupler_force_between(
    front_force: ArrayLike, front_mass: float, rear_force: ArrayLike, rear_mass: float
) -> Floats:
    """Coupler force [N] between two parts of a train without relative motion: report (6).

    Zero where the brake forces [N] are in proportion to the masses [kg].
    """
    m, n = positive_series("front_mass, rear_mass", [front_mass, rear_mass], (2,))
    front, rear = finite_series("front_force", front_force), finite_series("rear_force", rear_force)
    return np.asarray((m * rear - n * front) / (m + n))


class BrakeRigging(NamedTuple):
    """Parameters of a car's brake in (7)."""

    cylinders: float
    """tau: brake cylinders per car; then kappa, eta, and S [m2]."""
    lever_ratio: float
    efficiency: float
    piston_area: float

    def force(self, pressure: ArrayLike, friction: ArrayLike, cars: int = 1) -> Floats:
        """Theoretical brake force [N] of `cars` equal cars: (7), (8).

        `pressure` [Pa] of the cylinders; `friction`: coefficient between wheel and shoe, usually a function of speed.
        """
        p, mu = finite_series("pressure", pressure), finite_series("friction", friction)
        return np.asarray(cars * math.prod(self) * p * mu)


BUILT_UP = 0.632
"""Share of the steady cylinder pressure from which the report averages: dead time and one time constant have passed."""
STANDSTILL = 0.5
"""Speed [m/s] from which on the train counts as stopped."""


def braking_window(pressure: ArrayLike, speed: ArrayLike) -> slice:
    """Samples from 63.2 % of the steady cylinder pressure to standstill, the report's window.

    `pressure` (time,) [Pa] of one cylinder, steady at the median of the last quarter before standstill; `speed` (time,)
    [m/s]. Raises `EstimationError` where there is no window.
    """
    p = finite_series("pressure", pressure, (None,))
    v = finite_series("speed", speed, p.shape)
    slow = np.flatnonzero(v <= STANDSTILL)
    if not slow.size:
        raise EstimationError(f"averaging: the speed stays above {STANDSTILL:g} m/s")
    end = int(slow[0])
    if end == 0:
        raise EstimationError("averaging: the train stands at the first sample already")
    final = float(np.median(p[(3 * end) // 4 : end]))
    built = np.flatnonzero(p[:end] >= BUILT_UP * final)
    if not (math.isfinite(final) and final > 0.0 and built.size):
        level = f"{BUILT_UP:.1%} of {final:g} Pa"
        raise EstimationError(
            f"averaging: the pressure does not reach {level}; is the train braked?"
        )
    return slice(int(built[0]), end)


STIFFNESS = np.geomspace(1e-3, 1e10, 80)
"""What is tried as weight of the squared second differences of a smoothed series over its squared misfit [1]."""


def smooth_brake_forces(
    acceleration: ArrayLike,
    coupler_force: ArrayLike,
    mass: ArrayLike,
    acceleration_noise: float,
    coupler_noise: float,
    resistance: ArrayLike = 0.0,
) -> Floats:
    """Brake forces of all cars, smoothed over the stop, (time, cars); arguments as `car_brake_forces`, accelerations by car.

    `acceleration_noise` [m/s2], `coupler_noise` [N]: standard deviations of white noise per sample. A car's measurement is
    (2), exact at every instant whatever the couplers do, since their forces are measured. Its penalised least squares are
    diagonal in the cosine transform (Garcia, Computational Statistics and Data Analysis 54, 2010), and of all `STIFFNESS`
    that counts which has the least expected error (Mallows 1973): a brake may build up or pulse as fast as it likes.
    """
    m = positive_series("mass", mass, (None,))
    a_noise = float(positive_series("acceleration_noise", acceleration_noise, ()))
    r_noise = float(positive_series("coupler_noise", coupler_noise, ()))
    a = finite_series("acceleration", acceleration, (None, m.size))
    samples, car = len(a), np.arange(m.size)
    if samples < 3:
        advice = "have no second difference; give 3 or more"
        raise EstimationError(f"smoother: {samples} samples {advice}")
    couplers = 2 - (car == 0) - (car == m.size - 1)
    variance = (a_noise * m) ** 2 + couplers * r_noise**2
    parts = dct(car_brake_forces(a, coupler_force, m, resistance), axis=0, norm="ortho")
    bending = (2.0 - 2.0 * np.cos(np.pi * np.arange(samples) / samples)) ** 2
    gain = 1.0 / (1.0 + STIFFNESS[:, None] * bending)
    error = (1.0 - gain) ** 2 @ (parts**2 / variance) + 2.0 * gain.sum(axis=1)[:, None]
    return np.asarray(idct(gain[error.argmin(axis=0)].T * parts, axis=0, norm="ortho"))


class CalibrationErrors(NamedTuple):
    """Standard deviations of errors that stay constant over a stop, so that no averaging removes them."""

    acceleration_offset: float = 0.0
    """[m/s2]"""
    coupler_offset: float = 0.0
    """[N]"""
    coupler_gain: float = 0.0
    """Relative error of a coupler's calibration."""
    mass: float = 0.0
    """Relative error of a car's mass."""

    def deviation(
        self, mass: ArrayLike, acceleration: ArrayLike, coupler_force: ArrayLike
    ) -> Floats:
        """Standard deviation [N] of each car's estimated force, by linearisation of (2), (cars,) or (time, cars).

        `mass` [kg] (cars,); `acceleration` [m/s2] and `coupler_force` [N], (cars,) and (cars - 1,): means over the stop; or
        (time, cars) and (time, cars - 1): at each instant, one draw of errors for all of them.
        """
        m = positive_series("mass", mass, (None,))
        a = finite_series("acceleration", acceleration, (m.size,), (None, m.size))
        couplers = finite_series("coupler_force", coupler_force)
        variance = self.coupler_offset**2 + (self.coupler_gain * couplers) ** 2
        ends = np.pad(variance, [(0, 0)] * (variance.ndim - 1) + [(1, 1)])
        car = (m * self.acceleration_offset) ** 2 + (self.mass * m * a) ** 2
        return np.asarray(np.sqrt(car + ends[..., :-1] + ends[..., 1:]))
