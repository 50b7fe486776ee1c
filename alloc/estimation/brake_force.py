"""Brake force of each car from coupler forces and accelerations: RTRI report (2) to (9); means, smoother, shortfall.

In: series of coupler forces and accelerations, (instants, cars). Out: forces [N] with their uncertainty, and which car did
not deliver what was allocated to it.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar
from scipy.special import stdtrit

from alloc.display import displayed
from alloc.errors import EstimationError
from alloc.estimation.series import finite_series, positive_series
from alloc.estimation.slip_events import SlipCriterion
from alloc.plant.laws import gradient_force

# Brake force of each car from coupler forces and accelerations: Hijikata and Nishimura, RTRI report, (2) to (9).
#
# Couplers serve as force sensors. Cars count from the front; coupler k joins cars k and k + 1; its force is positive in
# tension, accelerations are positive forwards (negative while braking), brake forces positive against the motion.
# Series run along the first axis.
#
# The meaning of the force depends on `mass`. With the rolling mass (`rolling_mass`, which includes the wheelsets'
# inertia) it is the force at the brakes, of shoes and motors together, as a force at the rim. With the bare mass it is
# the force that the rail receives, which is smaller by the force that decelerates the wheelsets. The report does not
# say which one it means; a locomotive's wheelsets and motors add about 6 %.


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


# Averaging of estimated brake forces over a stop, with the uncertainty of the mean (RTRI report, 3.2.3).
#
# The mean of (2) over a window of N samples has errors of three origins:
#
# - Noise of the sensors is independent from sample to sample: s^2 / N. s^2 is computed from second differences, which a
#   slowly
#   changing force does not enter. The mean of (x_(k-1) - 2 x_k + x_(k+1))^2 is 6 s^2 (Gasser, Sroka and Jennen-
#   Steinmetz 1986,
#   Biometrika 73; its variance is 35 s^4 / 9 N, so 18 N / 35 degrees of freedom). A change of the force itself within
#   the
#   window does not make its mean uncertain. The scatter of batch means would count it, however they are detrended.
# - Relative motion matters where another car's acceleration stands for that of a stretch, as in (5). The error at an
#   instant
#   is dP/dt with the relative momentum P = sum m_k (v_k - v_1), so that of the mean is (P_end - P_start) / T. It falls
#   with
#   1/T, not with its root. Errors of neighbouring batches have opposite signs, since what one gains the next one loses
#   (with B
#   batches the scatter overestimates by sqrt(B)). P is the difference between the integral of the estimate and the
#   integral of
#   a smooth force. With its mean square about a polynomial, and independent ends, the variance is 2 P^2 / T^2.
# - An error that stays constant over the stop is not in the series:
#   `alloc.estimation.brake_force.CalibrationErrors`.


BUILT_UP = 0.632
"""Share of the steady cylinder pressure from which the report averages: dead time and one time constant have passed."""
TREND = 4
"""Degree of the polynomial in time that a force follows while it builds up and friction rises with falling speed."""


def braking_window(
    pressure: ArrayLike, speed: ArrayLike, steady: float | None = None, standstill: float = 0.5
) -> slice:
    """Samples from 63.2 % of the steady cylinder pressure to standstill, the report's window.

    `pressure` (time,) [Pa] of one cylinder, `speed` (time,) [m/s]. `steady` [Pa]: its final value; None: the median of the
    last quarter before standstill. `standstill` [m/s]: speed below which the train counts as stopped; a train that is never
    that slow gives no window. Raises `EstimationError` where there is none.
    """
    p = finite_series("pressure", pressure, (None,))
    v = finite_series("speed", speed, p.shape)
    slow = np.flatnonzero(v <= standstill)
    if not slow.size:
        raise EstimationError(
            f"averaging: the speed stays above {standstill:g} m/s (least {v.min():.3g}); there is no "
            "standstill to average to, so pass a higher `standstill`"
        )
    end = int(slow[0])
    if end == 0:
        raise EstimationError("averaging: the train stands at the first sample already")
    final = float(np.median(p[(3 * end) // 4 : end])) if steady is None else steady
    if not (math.isfinite(final) and final > 0.0):
        raise EstimationError(f"averaging: steady pressure {final!r} must exceed 0; is it braked?")
    built = np.flatnonzero(p[:end] >= BUILT_UP * final)
    if not built.size:
        raise EstimationError(
            f"averaging: the pressure does not reach {BUILT_UP:.1%} of {final:g} Pa before standstill"
        )
    return slice(int(built[0]), end)


@displayed
@dataclass(frozen=True, eq=False)
class SeriesMean:
    """Mean of one or several series with its uncertainty; fields are (series,), or scalars in arrays for one."""

    mean: Floats
    noise: Floats
    """Standard deviation of the mean due to errors that are independent from sample to sample."""
    motion: Floats
    """The same due to relative motion; 0 where every car has its own acceleration."""
    freedom: float
    """Degrees of freedom from which `noise` was estimated."""

    @property
    def deviation(self) -> Floats:
        """Standard deviation of the mean, without errors that are constant over the stop."""
        return np.hypot(self.noise, self.motion)

    def interval(
        self, confidence: float = 0.95, constant: ArrayLike = 0.0
    ) -> tuple[Floats, Floats]:
        """Lower and upper end of the confidence interval; `constant`: deviation of errors that averaging does not remove."""
        deviation = np.hypot(self.deviation, constant)
        freedom = effective_freedom(self.freedom, self.noise, deviation)
        half = stdtrit(freedom, 0.5 + 0.5 * confidence) * deviation
        return self.mean - half, self.mean + half


def effective_freedom(freedom: ArrayLike, estimated: Floats, whole: Floats) -> Floats:
    """Degrees of freedom of a deviation `whole` whose part `estimated` has `freedom`, while the rest is known.

    Welch (1947, Biometrika 34) and Satterthwaite (1946, Biometrics 2).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(freedom) * np.nan_to_num((whole / estimated) ** 4, nan=1.0, posinf=1e9)


def stop_mean(
    values: ArrayLike, moving: bool = False, batch: int = 1, trend: int = TREND
) -> SeriesMean:
    """Mean of a series (time,) of equally spaced samples, or of several (time, series), with its uncertainty.

    `moving`: another car's acceleration stands for that of the stretch, so the error contains relative motion; `trend`:
    degree of the polynomial from which the integral of the series deviates by it. `batch`: samples after which noise is
    independent, 1 for white noise; the mean's deviation is that of the means of such batches. Raises `EstimationError` where
    the series is too short.
    """
    x = finite_series("values", values, (None,), (None, None))
    if batch < 1 or trend < 0:
        raise EstimationError(
            f"averaging: batch = {batch} must be 1 or more, trend = {trend} 0 or more"
        )
    count, least = x.shape[0] // batch, trend + 3 if moving else 3
    if count < least:
        raise EstimationError(
            f"averaging: {x.shape[0]} samples are not {least} batches of {batch}; take a longer window"
        )
    # what does not fill a batch is left out of the noise at the start, where the force changes most
    parts = x[x.shape[0] - count * batch :].reshape(count, batch, *x.shape[1:]).mean(axis=1)
    bends = np.square(np.diff(parts, 2, axis=0)).mean(axis=0) / 6.0
    motion = _relative_motion(x, trend) if moving else np.zeros(x.shape[1:])
    return SeriesMean(
        np.asarray(x.mean(axis=0)),
        np.asarray(np.sqrt(bends / count)),
        motion,
        max((count - 2) * 18.0 / 35.0, 1.0),
    )


def _relative_motion(values: Floats, trend: int) -> Floats:
    """Deviation of the mean by a momentum that the ends of the window cut off, (series,)."""
    momentum = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    samples = momentum.shape[0]
    # the integral of a force that is a polynomial is one of a degree more
    powers = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, samples), trend + 2))[0]
    beside = momentum - powers @ (powers.T @ momentum)
    variance = np.square(beside).sum(axis=0) / (samples - trend - 2)
    return np.asarray(np.sqrt(2.0 * variance) / values.shape[0])


# Brake forces of all cars from their own accelerations, smoothed over the whole stop.
#
# The measurement is (2) with each car's own acceleration, y_k = -m_k a_k + R_(k-1) - R_k - W_k, which is exact at every
# instant whatever the couplers do. The report warns of models of the couplers: their law and its parameters would have
# to be known, and the inverse problem may be ill posed. Since the coupler forces are measured, no model is needed, and
# relative motion is not a state here. Neighbours share the noise of the coupler between them, so the cars are smoothed
# together. In coordinates in which that noise and the walk are both diagonal this is one scalar series per coordinate.
#
# The rate of each force is a random walk, and the force is its integral, not a walk itself. That decides the stated
# deviation. For a force that is a random walk, noise and walk make up half of the posterior variance each. With noise
# of variance s2 per sample and a walk of q per step the smoother weighs by h = 1 / (1 + w^2 s2/q) over frequency w.
# Noise leaves s2 h^2, the walk leaves (1 - h)^2 q / w^2, and the sum is s2 h. The integral of h^2 is half that of h.
# But a brake force is smooth: a cylinder builds it up, then friction changes with the speed. Its own part of the error
# was almost zero, so the stated variance was twice that of the errors. With the integral of a walk h = 1 / (1 + w^4
# s2/q), of whose integral the noise has 3/4; the rest is the smoother's bias where the force bends, averaged over the
# stop (Wahba 1983, J. R. Statist. Soc. B 45; Nychka 1988, JASA 83). Measured likelihoods prefer it too.
#
# All samples together are a Gaussian with a banded precision, (noise)^-1 + D' D / q with second differences D. Its
# Cholesky factor gives the forces and the likelihood, and the recursion of Takahashi (Erisman and Tinney 1975, Comm.
# ACM 18) the variances.


WALKS = (1e-3, 1e3)
"""Range [m/s3 per root second] of the walk: from rates that hardly change to a full brake within a sample."""
SLOWEST = 1e-11
"""Smallest variance of a second difference over that of the noise; below it, rounding hides the difference."""
BAND = 2
"""Samples on either side to which a second difference ties a sample."""


@displayed
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
    """Change of the rate of force over mass in a second, as deviation [m/s3 per root second], as given or as estimated."""
    log_likelihood: float
    """Log likelihood of the second differences of the measurements: a straight line has no prior."""

    @property
    def deviation(self) -> Floats:
        """Posterior standard deviation of each force [N], (time, cars); add constant errors of the sensors."""
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
    sample. `walk` [m/s3 per root second]: how fast the rate of force over mass may change; None: the most likely one in
    `WALKS`. Constant errors of sensors and masses are not noise and not in the deviation: `CalibrationErrors` has theirs,
    and the interval of a force contains both. Raises `EstimationError`, also for fewer than 3 samples.
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
    if own.shape[0] <= BAND:
        raise EstimationError(
            f"smoother: {own.shape[0]} samples have no second difference; give 3 or more"
        )
    # the walk's covariance is diag(m^2) times a number: in force over mass it is the identity
    variance, vectors = np.linalg.eigh(noise / np.outer(m, m))
    basis = m[:, None] * vectors
    y = (measured / m) @ vectors
    least = math.sqrt(SLOWEST * float(variance.min()) / period**3)
    if walk is None:
        found = minimize_scalar(
            lambda logarithm: -_solved(y, variance, math.exp(2.0 * logarithm) * period**3)[1],
            bounds=(math.log(max(WALKS[0], least)), math.log(max(WALKS[1], 10.0 * least))),
            method="bounded",
            options={"xatol": 0.02},
        )
        walk = math.exp(float(found.x))
    elif walk < least:
        raise EstimationError(
            f"smoother: walk = {walk:g} is too slow to be told from none at this period; give {least:.1g} or more"
        )
    mean, likelihood, factor = _solved(y, variance, walk**2 * period**3)
    return SmoothedForces(mean @ basis.T, basis, _inverse_diagonal(factor), walk, likelihood)


def _solved(y: Floats, noise: Floats, bend: float) -> tuple[Floats, float, Floats]:
    """Most likely series (time, cars), log-likelihood, and Cholesky factors (bands, time, cars), lower.

    `noise` (cars,): variance of a sample; `bend`: variance of a second difference.
    """
    samples = y.shape[0]
    precision = np.zeros((BAND + 1, samples))
    for k, one in enumerate((1.0, -2.0, 1.0)):
        for j, other in enumerate((1.0, -2.0, 1.0)[k:]):
            precision[j, k : samples - BAND + k] += one * other / bend
    x, factors, likelihood = np.empty_like(y), np.empty((BAND + 1, *y.shape)), 0.0
    for k, own in enumerate(noise):
        precision[0] += 1.0 / own
        factor = cholesky_banded(precision, lower=True, check_finite=False)
        precision[0] -= 1.0 / own
        x[:, k] = cho_solve_banded((factor, True), y[:, k] / own, check_finite=False)
        misfit = float(y[:, k] @ (y[:, k] - x[:, k])) / own
        determinant = 2.0 * float(np.log(factor[0]).sum()) + samples * math.log(own)
        likelihood -= 0.5 * (misfit + determinant + (samples - BAND) * math.log(2.0 * np.pi * bend))
        factors[:, :, k] = factor
    return x, likelihood, factors


def _inverse_diagonal(factors: Floats) -> Floats:
    """Diagonal (time, cars) of the inverses of L L' from banded L (bands, time, cars), from the last sample back."""
    samples = factors.shape[1]
    size = 1.0 / factors[0] ** 2
    one, two = factors[1] / factors[0], factors[2] / factors[0]
    diagonal, beside = np.zeros((2, samples + BAND, factors.shape[2]))
    for k in range(samples - 1, -1, -1):
        far = -one[k] * beside[k + 1] - two[k] * diagonal[k + 2]
        beside[k] = -one[k] * diagonal[k + 1] - two[k] * beside[k + 1]
        diagonal[k] = size[k] - one[k] * beside[k] - two[k] * far
    return diagonal[:samples]


# Which car did not deliver the brake force that was allocated to it.
#
# A car whose wheels slide delivers what the rail carries, and its slide protection releases the pressure. That says
# nothing about its brake. `sliding_cars` finds where wheels slide, and `find_shortfalls` judges a car by the rest of
# the stop.


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
