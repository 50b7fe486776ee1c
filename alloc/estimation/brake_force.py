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
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from alloc.errors import EstimationError
from alloc.estimation.series import finite_series, positive_series

Floats = NDArray[np.float64]


def rolling_mass(mass: ArrayLike, inertia: ArrayLike, radius: ArrayLike) -> Floats:
    """Effective mass [kg] of a rolling car, (cars,): m + J / r^2.

    `inertia` [kg m2]: of all wheelsets of each car with everything geared to them; `radius` [m] of its wheels.
    """
    bare = positive_series("mass", mass, (None,))
    turning = finite_series("inertia", inertia, (bare.size,))
    return np.asarray(bare + turning / positive_series("radius", radius, bare.shape) ** 2)


def group_brake_force(
    acceleration: ArrayLike, mass: float, front: ArrayLike | None = None,
    rear: ArrayLike | None = None, resistance: ArrayLike = 0.0,
) -> Floats:  # fmt: skip
    """Brake force [N] of a stretch of cars between two couplers, (time,): -m a + R_front - R_rear - W.

    A single car: (2), (4), (9); the locomotive: (3), with `rear` alone; all wagons behind it: (5), with `front` alone.
    `acceleration` (time,) [m/s2] on level track stands for all of the stretch, whose mass is `mass` [kg];
    `front`, `rear` (time,) [N]: coupler forces at its ends, None where the train ends; `resistance` [N]: scalar or (time,).
    """
    a = finite_series("acceleration", acceleration, (None,))
    force = -positive_series("mass", mass, ()) * a
    for sign, name, given in ((1.0, "front", front), (-1.0, "rear", rear)):
        if given is not None:
            force = force + sign * finite_series(name, given, a.shape)
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
    own = a if a.ndim == 2 else a[:, None]
    return np.asarray(-m * own + between[:, :-1] - between[:, 1:] - drag)


def coupler_force_between(
    front_force: ArrayLike, front_mass: float, rear_force: ArrayLike, rear_mass: float
) -> Floats:
    """Coupler force [N] between two parts of a train without relative motion: report (6).

    Zero where the brake forces [N] are in proportion to the masses [kg].
    """
    m, n = positive_series("front_mass, rear_mass", [front_mass, rear_mass], (2,))
    return np.asarray((m * np.asarray(rear_force) - n * np.asarray(front_force)) / (m + n))


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
        return np.asarray(cars * math.prod(self) * np.asarray(pressure) * np.asarray(friction))


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
        told = f"{BUILT_UP:.1%} of {final:g} Pa; is the train braked?"
        raise EstimationError(f"averaging: the pressure does not reach {told}")
    return slice(int(built[0]), end)


# Brake forces of all cars, smoothed over the whole stop. The measurement is (2) with each car's own acceleration, exact at
# every instant whatever the couplers do: their forces are measured, so no model of them is needed. Neighbours share the
# noise of the coupler between them; in coordinates in which that noise and the walk are both diagonal this is one scalar
# series per coordinate. The rate of each force is a random walk: a cylinder builds the force up, then friction changes with
# the speed. All samples together are a Gaussian with a banded precision, (noise)^-1 + D' D / q with second differences D.
# Its Cholesky factor gives forces and likelihood.

WALKS = (1e-3, 1e3)
"""Range [m/s3 per root second] of the walk: from rates that hardly change to a full brake within a sample."""
SLOWEST = 1e-11
"""Smallest variance of a second difference over that of the noise; below it, rounding hides the difference."""
BAND = 2
"""Samples on either side to which a second difference ties a sample."""


class SmoothedForces(NamedTuple):
    """Brake forces after all measurements."""

    force: Floats
    """[N], (time, cars)."""
    walk: float
    """Change of the rate of force over mass in a second, as deviation [m/s3 per root second], as given or as estimated."""
    log_likelihood: float
    """Log likelihood of the second differences of the measurements: a straight line has no prior."""


def smooth_brake_forces(
    acceleration: ArrayLike, coupler_force: ArrayLike, mass: ArrayLike, period: float,
    acceleration_noise: float, coupler_noise: float, walk: float | None = None,
    resistance: ArrayLike = 0.0,
) -> SmoothedForces:  # fmt: skip
    """Smooth the brake forces of all cars; arguments as `car_brake_forces`, with own accelerations (time, cars).

    `period` [s]: of the samples. `acceleration_noise` [m/s2], `coupler_noise` [N]: standard deviations of white noise per
    sample. `walk` [m/s3 per root second]: how fast the rate of force over mass may change; None: the most likely one in
    `WALKS`. Constant errors of sensors and masses are not in the deviation, see `CalibrationErrors`.
    """
    m = positive_series("mass", mass, (None,))
    for name, value in (
        ("period", period), ("acceleration_noise", acceleration_noise),
        ("coupler_noise", coupler_noise), ("walk", 1.0 if walk is None else walk),
    ):  # fmt: skip
        if not (math.isfinite(value) and value > 0.0):
            raise EstimationError(f"smoother: {name} = {value!r} must be a finite number above 0")
    own = finite_series("acceleration", acceleration, (None, m.size))
    measured = car_brake_forces(own, coupler_force, m, resistance)
    difference = np.eye(m.size, m.size - 1, -1) - np.eye(m.size, m.size - 1)
    noise = acceleration_noise**2 * np.diag(m**2) + coupler_noise**2 * difference @ difference.T
    if len(own) <= BAND:
        told = f"{len(own)} samples have no second difference; give 3 or more"
        raise EstimationError(f"smoother: {told}")
    # the walk's covariance is diag(m^2) times a number: in force over mass it is the identity
    variance, vectors = np.linalg.eigh(noise / np.outer(m, m))
    y = (measured / m) @ vectors
    least = math.sqrt(SLOWEST * float(variance.min()) / period**3)
    if walk is None:
        between = math.log(max(WALKS[0], least)), math.log(max(WALKS[1], 10.0 * least))

        def unlikely(logarithm: float) -> float:
            return -_solved(y, variance, math.exp(2.0 * logarithm) * period**3)[1]

        found = minimize_scalar(unlikely, bounds=between, options={"xatol": 0.02})
        walk = math.exp(float(found.x))
    elif walk < least:
        told = f"walk = {walk:g} is too slow for rounding; give {least:.1g} or more"
        raise EstimationError(f"smoother: {told}")
    mean, likelihood = _solved(y, variance, walk**2 * period**3)
    return SmoothedForces(mean @ (m[:, None] * vectors).T, walk, likelihood)


def _solved(y: Floats, noise: Floats, bend: float) -> tuple[Floats, float]:
    """Most likely series (time, cars), and log-likelihood.

    `noise` (cars,): variance of a sample; `bend`: variance of a second difference.
    """
    samples = y.shape[0]
    precision = np.zeros((BAND + 1, samples))
    for k, one in enumerate((1.0, -2.0, 1.0)):
        for j, other in enumerate((1.0, -2.0, 1.0)[k:]):
            precision[j, k : samples - BAND + k] += one * other / bend
    x, likelihood = np.empty_like(y), 0.0
    for k, own in enumerate(noise):
        precision[0] += 1.0 / own
        factor = cholesky_banded(precision, lower=True, check_finite=False)
        precision[0] -= 1.0 / own
        x[:, k] = cho_solve_banded((factor, True), y[:, k] / own, check_finite=False)
        misfit = float(y[:, k] @ (y[:, k] - x[:, k])) / own
        determinant = 2.0 * float(np.log(factor[0]).sum()) + samples * math.log(own)
        likelihood -= 0.5 * (misfit + determinant + (samples - BAND) * math.log(2.0 * np.pi * bend))
    return x, likelihood


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
        couplers = np.asarray(coupler_force, dtype=float)
        each = self.coupler_offset**2 + (self.coupler_gain * couplers) ** 2
        ends = np.pad(each, [(0, 0)] * (each.ndim - 1) + [(1, 1)])
        own = (m * self.acceleration_offset) ** 2 + (self.mass * m * a) ** 2
        return np.asarray(np.sqrt(own + ends[..., :-1] + ends[..., 1:]))
