"""Brake forces of all cars from their own accelerations, smoothed: Kalman filter and Rauch-Tung-Striebel smoother.

The state is the brake force of each car as a random walk; the measurement is (2) with each car's own acceleration,
y_k = -m_k a_k + R_(k-1) - R_k - W_k, exact at every instant whatever the couplers do. The report warns of models of the
couplers (their law and its parameters would have to be known, the inverse problem may be ill posed), and since their
forces are measured none is needed: relative motion is no state here. Neighbours share the noise of the coupler between
them, so the cars are filtered together; in coordinates in which that noise and the walk are both diagonal
this is one scalar filter per coordinate.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from alloc.errors import EstimationError
from alloc.estimation.car_brake_force import car_brake_forces
from alloc.estimation.finite_series import finite_series, positive_series

Floats = NDArray[np.float64]

WALKS = (1e-3, 10.0)
"""Range [m/s2 per root second] in which the walk is sought: from forces that hardly change to a full brake in 10 ms."""


@dataclass(frozen=True, eq=False)
class SmoothedForces:
    """Brake forces after all measurements."""

    force: Floats
    """[N], (time, cars)."""
    basis: Floats
    """(cars, cars): force = basis @ coordinates; the coordinates' errors are independent."""
    variance: Floats
    """Posterior variance of the coordinates, (time, cars)."""
    walk: float
    """Deviation by which force over mass changes in a second [m/s2 per root second], as given or as found."""
    log_likelihood: float
    """Of the measurements after the first, which starts the filter."""

    @property
    def deviation(self) -> Floats:
        """Posterior standard deviation of each force [N], (time, cars)."""
        return np.asarray(np.sqrt(self.variance @ (self.basis**2).T))

    def total(self, cars: slice | None = None) -> tuple[Floats, Floats]:
        """Sum of these cars' forces [N] and its posterior deviation, two (time,); None: all cars."""
        chosen = slice(None) if cars is None else cars
        share = self.basis[chosen].sum(axis=0)
        return self.force[:, chosen].sum(axis=1), np.sqrt(self.variance @ share**2)


def smooth_brake_forces(
    acceleration: ArrayLike,
    coupler_force: ArrayLike,
    mass: ArrayLike,
    period: float,
    acceleration_noise: float,
    coupler_noise: float,
    walk: float | None = None,
    resistance: ArrayLike = 0.0,
) -> SmoothedForces:
    """Smooth the brake forces of all cars; arguments as `car_brake_forces`, with own accelerations (time, cars).

    `period` [s]: of the samples. `acceleration_noise` [m/s2], `coupler_noise` [N]: standard deviations of white noise per
    sample. `walk` [m/s2 per root second]: how fast force over mass may change; None: the most likely one in `WALKS`.
    Constant errors of sensors and masses are not noise and not in the deviation. Raises `EstimationError`.
    """
    m = positive_series("mass", mass, (None,))
    given = {
        "period": period, "acceleration_noise": acceleration_noise, "coupler_noise": coupler_noise,
        "walk": 1.0 if walk is None else walk,
    }  # fmt: skip
    EstimationError.check("smoother", given, positive=given)
    own = finite_series("acceleration", acceleration, (None, m.size))
    measured = car_brake_forces(own, coupler_force, m, resistance)
    difference = np.eye(m.size, m.size - 1, -1) - np.eye(m.size, m.size - 1)
    noise = acceleration_noise**2 * np.diag(m**2) + coupler_noise**2 * difference @ difference.T
    # the walk's covariance is diag(m^2) times a number: in force over mass it is the identity
    variance, vectors = np.linalg.eigh(noise / np.outer(m, m))
    basis = m[:, None] * vectors
    y = (measured / m) @ vectors
    if walk is None:
        found = minimize_scalar(
            lambda logarithm: -_filter(y, variance, math.exp(2.0 * logarithm) * period)[2],
            bounds=(math.log(WALKS[0]), math.log(WALKS[1])),
            method="bounded",
            options={"xatol": 0.02},
        )
        walk = math.exp(float(found.x))
    mean, p, likelihood = _filter(y, variance, walk**2 * period)
    mean, p = _smooth(mean, p, walk**2 * period)
    return SmoothedForces(mean @ basis.T, basis, p, walk, likelihood)


def _filter(y: Floats, noise: Floats, step: float) -> tuple[Floats, Floats, float]:
    """Means and variances (time, cars) of random walks after each measurement, and the log-likelihood."""
    mean, p = np.empty_like(y), np.empty_like(y)
    mean[0], p[0] = y[0], noise  # nothing is known before the first measurement
    for k in range(1, y.shape[0]):  # variances first: they do not depend on what is measured
        before = p[k - 1] + step
        p[k] = before * noise / (before + noise)
    gain = p / noise
    for k in range(1, y.shape[0]):
        mean[k] = mean[k - 1] + gain[k] * (y[k] - mean[k - 1])
    innovation = y[1:] - mean[:-1]
    spread = p[:-1] + step + noise
    likelihood = -0.5 * float(np.sum(np.log(2.0 * np.pi * spread) + innovation**2 / spread))
    return mean, p, likelihood


def _smooth(mean: Floats, p: Floats, step: float) -> tuple[Floats, Floats]:
    """Rauch, Tung and Striebel's backward pass over what `_filter` found."""
    smooth, variance = mean.copy(), p.copy()
    gain = p / (p + step)
    for k in range(mean.shape[0] - 2, -1, -1):
        smooth[k] = mean[k] + gain[k] * (smooth[k + 1] - mean[k])
        variance[k] = p[k] + gain[k] ** 2 * (variance[k + 1] - p[k] - step)
    return smooth, variance
