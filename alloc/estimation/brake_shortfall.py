"""Which car did not deliver the brake force that was allocated to it.

A car whose wheels slide delivers what the rail carries, and its slide protection releases the pressure. That says nothing
about its brake. `sliding_cars` finds where wheels slide, and `find_shortfalls` judges a car by the rest of the stop.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from alloc.display import displayed
from alloc.errors import EstimationError
from alloc.estimation.brake_force_mean import effective_freedom, stop_mean
from alloc.estimation.finite_series import finite_series, positive_series
from alloc.estimation.slip_events import SlipCriterion

Floats = NDArray[np.float64]

CONFIDENCE = 0.99
"""Probability that no car of a train without fault is accused, if the stated deviations are right."""
REFILLED = 3.0
"""Time [s] after a slide in which a car is not judged yet, since its cylinders fill; assumed, times are 0.4 to 3."""
LEAST_JUDGED = 0.1
"""Share of the window that must be free of slides for a car to be judged."""


@dataclass(frozen=True)
class CalibrationErrors:
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
        (time, cars) and (time, cars - 1): the deviation at each instant, one draw of errors for all of them.
        """
        m = positive_series("mass", mass, (None,))
        a = finite_series("acceleration", acceleration, (m.size,), (None, m.size))
        couplers = np.asarray(coupler_force, dtype=float)
        each = self.coupler_offset**2 + (self.coupler_gain * couplers) ** 2
        ends = np.pad(each, [(0, 0)] * (each.ndim - 1) + [(1, 1)])
        own = (m * self.acceleration_offset) ** 2 + (self.mass * m * a) ** 2
        return np.asarray(np.sqrt(own + ends[..., :-1] + ends[..., 1:]))


@displayed
@dataclass(frozen=True, eq=False)
class Shortfalls:
    """Difference between the allocated and the delivered brake force of each car, mean over a stop."""

    shortfall: Floats
    """[N], (cars,); negative: the car gave more; nan: its wheels slid nearly all the time, so it is not judged."""
    deviation: Floats
    """Its standard deviation [N], (cars,)."""
    threshold: Floats
    """Shortfall [N] beyond which a car is accused, (cars,)."""

    @property
    def accused(self) -> NDArray[np.int64]:
        """Cars (0 = foremost) beyond their threshold, the most certain first."""
        order = np.argsort(-self.shortfall / np.maximum(self.deviation, 1e-9))
        return order[self.shortfall[order] > self.threshold[order]]


def sliding_cars(
    axle_speed: ArrayLike,
    axle_car: ArrayLike,
    period: float,
    criterion: SlipCriterion | None = None,
    refilled: float = REFILLED,
) -> NDArray[np.bool_]:
    """Whether a car's wheels slide or have just done so, (time, cars).

    `axle_speed` (time, axles) [m/s] at the rims; `axle_car` (axles,): car of each, 0 = foremost; `period` [s] of the
    samples. A wheel slides where it is slower than the fastest of the train by more than the criterion. Its car is left out
    until `refilled` [s] after the slide. If all wheels slide at once, no slide is detected: in that case give the speed over
    ground as one more axle.
    """
    car = np.asarray(axle_car, dtype=int)
    v = finite_series("axle_speed", axle_speed, (None, car.size))
    fastest = v.max(axis=1, keepdims=True)
    slides = fastest - v > (criterion or SlipCriterion()).bound(fastest, v)
    cars = np.stack([slides[:, car == k].any(axis=1) for k in range(int(car.max()) + 1)], axis=1)
    count = np.cumsum(np.pad(cars, ((1, 0), (0, 0))), axis=0)
    since = np.maximum(np.arange(v.shape[0]) - round(refilled / period), 0)
    return np.asarray(count[1:] > count[since])


def find_shortfalls(
    allocated: ArrayLike,
    estimated: ArrayLike,
    constant_deviation: ArrayLike = 0.0,
    confidence: float = CONFIDENCE,
    sliding: NDArray[np.bool_] | None = None,
    batch: int = 1,
) -> Shortfalls:
    """Compare allocated and estimated brake forces [N], both (time, cars) within the window of a stop.

    A car is accused where its mean shortfall exceeds the uncertainty at `confidence`, shared among the cars (Bonferroni).
    The uncertainty has two parts: noise of the mean (`stop_mean`, with `batch`), and `constant_deviation` [N], scalar or
    (cars,), of errors that averaging does not remove. The first is estimated and the second known, so Student's t has the
    degrees of freedom of Welch and Satterthwaite. `sliding` (time, cars), of `sliding_cars`: samples without information on
    the car's brake. A car with less than `LEAST_JUDGED` of the window left is not judged.
    """
    if not 0.5 < confidence < 1.0:
        raise EstimationError(f"shortfall: confidence = {confidence!r} must lie in (0.5, 1)")
    given = finite_series("allocated", allocated, (None, None))
    found = finite_series("estimated", estimated, given.shape)
    cars = given.shape[1]
    constant = finite_series("constant_deviation", constant_deviation, (), (cars,))
    left_out = np.zeros(given.shape, dtype=bool) if sliding is None else np.asarray(sliding)
    if left_out.shape != given.shape:
        raise EstimationError(
            f"shortfall: sliding has shape {left_out.shape}, allocated {given.shape}"
        )
    mean, noise, freedom = np.full(cars, np.nan), np.full(cars, np.inf), np.ones(cars)
    judged = (~left_out).mean(axis=0) >= LEAST_JUDGED
    for k in np.flatnonzero(judged):
        one = stop_mean((given - found)[~left_out[:, k], k], batch=batch)
        mean[k], noise[k], freedom[k] = float(one.mean), float(one.noise), one.freedom
    deviation = np.hypot(noise, constant)
    whole = np.where(judged, effective_freedom(freedom, noise, deviation), 1.0)
    quantile = stdtrit(whole, 1.0 - (1.0 - confidence) / cars)
    return Shortfalls(mean, deviation, quantile * deviation)
