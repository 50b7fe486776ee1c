"""Which car did not deliver the brake force that it was allocated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from alloc.errors import EstimationError
from alloc.estimation.brake_force_mean import BATCHES, batch_mean
from alloc.estimation.finite_series import finite_series, positive_series

Floats = NDArray[np.float64]

CONFIDENCE = 0.99
"""Probability with which a train without fault accuses no car, if the stated deviations are right."""


@dataclass(frozen=True)
class CalibrationErrors:
    """Standard deviations of what stays constant over a stop, so that no averaging removes it."""

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
        """Standard deviation [N] of each car's estimated force, (cars,), by linearisation of (2).

        `mass` [kg] (cars,); `acceleration` [m/s2] and `coupler_force` [N], (cars,) and (cars - 1,): means over the stop.
        """
        m = positive_series("mass", mass, (None,))
        a = finite_series("acceleration", acceleration, (m.size,))
        couplers = np.asarray(coupler_force, dtype=float)
        each = self.coupler_offset**2 + (self.coupler_gain * couplers) ** 2
        ends = np.pad(each, 1)
        own = (m * self.acceleration_offset) ** 2 + (self.mass * m * a) ** 2
        return np.asarray(np.sqrt(own + ends[:-1] + ends[1:]))


@dataclass(frozen=True, eq=False)
class Shortfalls:
    """By how much each car's brake force fell short of what it was allocated, mean over a stop."""

    shortfall: Floats
    """[N], (cars,); negative: the car gave more."""
    deviation: Floats
    """Its standard deviation [N], (cars,)."""
    threshold: Floats
    """Shortfall [N] beyond which a car is accused, (cars,)."""

    @property
    def accused(self) -> NDArray[np.int64]:
        """Cars (0 = foremost) beyond their threshold, the surest first."""
        order = np.argsort(-self.shortfall / np.maximum(self.deviation, 1e-9))
        return order[self.shortfall[order] > self.threshold[order]]


def find_shortfalls(
    allocated: ArrayLike,
    estimated: ArrayLike,
    constant_deviation: ArrayLike = 0.0,
    confidence: float = CONFIDENCE,
    batches: int = BATCHES,
) -> Shortfalls:
    """Compare allocated and estimated brake forces [N], both (time, cars) within the window of a stop.

    A car is accused where its mean shortfall exceeds the uncertainty at `confidence`, shared among the cars (Bonferroni):
    batch means of the difference, and `constant_deviation` [N], scalar or (cars,), of what averaging does not remove. The
    former is estimated and the latter known, so Student's t has the degrees of freedom of Welch and Satterthwaite.
    """
    if not 0.5 < confidence < 1.0:
        raise EstimationError(f"shortfall: confidence = {confidence!r} must lie in (0.5, 1)")
    given = finite_series("allocated", allocated, (None, None))
    found = finite_series("estimated", estimated, given.shape)
    constant = finite_series("constant_deviation", constant_deviation, (), (given.shape[1],))
    mean = batch_mean(given - found, batches)
    deviation = np.sqrt(mean.deviation**2 + constant**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = mean.freedom * np.nan_to_num(
            (deviation / mean.deviation) ** 4, nan=1.0, posinf=1e9
        )
    quantile = student.ppf(1.0 - (1.0 - confidence) / given.shape[1], freedom)
    return Shortfalls(mean.mean, deviation, quantile * deviation)
