"""Learning the weights of running resistance from a train's motion: JP H07-322414 (4) to (8), and two yardsticks.

In: force and regressors per instant, or a recorded run. Out: weights, and which of them the run can teach.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from alloc.display import displayed
from alloc.errors import EstimationError
from alloc.estimation.series import finite_series
from alloc.onboard.line_memory import (
    EXTENDED_WEIGHTS,
    LineMemory,
    Motion,
    Regression,
    RegressionFilter,
    regressor,
)

# Which weights of the running resistance a run can teach: persistence of excitation, weight by weight.


Floats = NDArray[np.float64]

LEARNED, NOT_LEARNABLE = "learned", "not learnable from this run"
LEAST_PART = 1e-3
"""Independent part of a regressor's square below which the regressor cannot be distinguished from the others."""
LARGEST_DEVIATION = 0.05
"""Standard deviation of a learnt weight, relative to the weight, above which it is not called learnt."""
LEAST_SAMPLES = 20
"""Samples in which a regressor is not zero, below which nothing is said."""


@dataclass(frozen=True)
class WeightStatus:
    """Information of a run on one weight."""

    name: str
    status: str
    """`LEARNED` or `NOT_LEARNABLE`."""
    reason: str
    """Why it is not learnable; empty if it is."""
    value: float
    """Least-squares weight, of the least norm where it is not determined."""
    part: float
    """Part of the regressor's square that is apart from the other regressors, 0 to 1; nan without samples."""
    deviation: float
    """Standard deviation of the weight, by the residuals and their correlation from sample to sample."""


@dataclass(frozen=True)
class Excitation:
    """Excitation of all weights by one run."""

    weights: tuple[WeightStatus, ...]
    condition: float
    """Condition number of the normalised information matrix of the weights that occur at all; 1 is best."""
    smallest_eigenvalue: float
    """Of that matrix, whose diagonal is 1."""
    residual: float
    """Root mean square [N] of what the weights leave."""

    def learned(self, name: str) -> bool:
        """Whether the weight called `name` was learnt."""
        return next(one for one in self.weights if one.name == name).status == LEARNED


def judge_excitation(regressors: ArrayLike, force: ArrayLike, names: tuple[str, ...]) -> Excitation:
    """Judge samples F = W Z: `regressors` (samples, weights), `force` (samples,) [N].

    A weight is learned under three conditions: it is excited (`LEAST_SAMPLES`), distinguished from the others
    (`LEAST_PART`), and accurate compared with the residuals of the force (`LARGEST_DEVIATION`). Residuals are correlated: if
    neighbouring ones of n samples correlate by r, n (1 - r)/(1 + r) samples count. Raises `EstimationError` for impossible
    data.
    """
    z = finite_series("excitation: regressors", regressors, (None, len(names)))
    f = finite_series("excitation: force", force, z.shape[:1])
    count = (z != 0.0).sum(axis=0)
    present = count > 0
    size = np.where(present, np.sqrt((z * z).sum(axis=0)), 1.0)
    unit = z / size
    solved, *_ = np.linalg.lstsq(unit, f, rcond=1e-9)
    value = np.where(present, solved / size, np.nan)
    left = f - unit @ solved
    freedom = max(f.size - int(present.sum()), 1)
    variance = float(left @ left) / freedom
    if f.size > 2 and float(left @ left) > 0.0:
        r = float(np.clip(left[1:] @ left[:-1] / (left @ left), 0.0, 0.999))
        variance *= (1.0 + r) / (1.0 - r)
    information = unit[:, present].T @ unit[:, present]
    eigenvalues = np.linalg.eigvalsh(information) if present.any() else np.array([np.nan])
    statuses = []
    for k, name in enumerate(names):
        part, partner = _part_apart(unit, k, present)
        deviation = float(np.sqrt(variance / part) / size[k]) if part > 0.0 else np.inf
        reason = _reason(int(count[k]), part, names[partner], deviation, float(value[k]))
        status = NOT_LEARNABLE if reason else LEARNED
        statuses.append(WeightStatus(name, status, reason, float(value[k]), part, deviation))
    least = float(eigenvalues[0])
    condition = float(eigenvalues[-1] / least) if least > 1e-15 else np.inf
    return Excitation(tuple(statuses), condition, least, float(np.sqrt((left**2).mean())))


def _part_apart(unit: Floats, k: int, present: NDArray[np.bool_]) -> tuple[float, int]:
    """Part of column `k`'s square apart from the other columns, and the column that it resembles most."""
    if not present[k]:
        return float("nan"), k
    others = np.flatnonzero(present & (np.arange(present.size) != k))
    if others.size == 0:
        return 1.0, k
    solved, *_ = np.linalg.lstsq(unit[:, others], unit[:, k], rcond=1e-9)
    apart = unit[:, k] - unit[:, others] @ solved
    return float(np.clip(apart @ apart, 0.0, 1.0)), int(others[np.argmax(np.abs(solved))])


def _reason(count: int, part: float, partner: str, deviation: float, value: float) -> str:
    if count == 0:
        return "its regressor is zero throughout"
    if count < LEAST_SAMPLES:
        return f"{count} samples only"
    if part < LEAST_PART:
        return f"cannot be told apart from {partner}"
    if not deviation <= LARGEST_DEVIATION * abs(value):
        share = deviation / abs(value) if value else np.inf
        return (
            f"excited too little against what the weights leave: uncertain by {100 * share:.3g} %"
        )
    return ""


# Learning the weights of running resistance from a train's motion: JP H07-322414 (4), (5), (8), and two yardsticks.
#
# Every learner moves W1 in the open only and W2 in tunnels only. Errors are forces [N], delta / K_i of the source,
# whose gain K_d on the current is 1 / K_i times the gain here.
#
# Persistence of excitation: a weight is learnt only as far as the run varies its regressor independently of the others.
# At constant speed on level track V^2 is constant and a + g sin(theta) is zero: W1 can be learnt, W3 not at all. At
# constant speed on one gradient both are constant, and only W1 V^2 + W3 g sin(theta) can be determined: an error of one
# hides behind the other. A gradient or an acceleration that comes and goes at one speed excites W3. A change of speed
# on level track distinguishes W1 from A and B. W2 needs a tunnel, and a run outside of it to distinguish it from W3.
# `alloc.estimation.running_resistance` states which weights a run has determined.


MASS = 2
TYPICAL = (400.0, 400.0, 0.5, 1.0, 20.0)
"""Typical regressors, by which the normalised gradient scales: (20 m/s)^2, twice; 0.5 m/s2; 1; 20 m/s."""


def gradient_step(weights: Floats, direction: Floats, error: float, gain: float) -> Floats:
    """(5): W + K_d delta Z, the gradient of half the squared error with one gain for all weights.

    If `direction` is the regressor, it reduces the error of that sample where 0 < gain |Z|^2 < 2, and increases it beyond.
    """
    return weights + gain * error * direction


@dataclass(eq=False)
class Learner:
    """Common part of all learners: 3 or 5 `weights`, and `update` with the check of a sample."""

    weights: Floats

    def __post_init__(self) -> None:
        array = np.array(self.weights, dtype=float)
        if array.shape not in ((3,), (5,)) or not np.all(np.isfinite(array)):
            raise EstimationError(
                f"resistance learner: weights = {self.weights!r} must be 3 or 5 numbers"
            )
        self.weights = array

    def update(self, regressor: Floats, error: float, acceleration: float | None = None) -> None:
        """Learn from one sample; see `alloc.onboard.speed_controller.ResistanceLearner`."""
        if regressor.shape != self.weights.shape or not np.all(np.isfinite(regressor)):
            raise EstimationError(
                f"resistance learner: regressor = {regressor} must be {self.weights.size} finite numbers"
            )
        EstimationError.check("resistance learner", {"error": error}, finite=("error",))
        self._learn(regressor, error, acceleration)

    def _learn(self, regressor: Floats, error: float, acceleration: float | None) -> None:
        raise NotImplementedError


@dataclass(eq=False)
class GradientLearner(Learner):
    """(5) with one gain K_d for all weights; `as_printed` takes Z3 = a as the source prints it, not a + g sin(theta).

    With the misprint W3 learns nothing from a gradient at constant speed, and moves away from the truth where a and
    a + g sin(theta) have opposite signs, as when a train slows down uphill.
    """

    gain: float
    as_printed: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        EstimationError.check("resistance learner", self, positive=("gain",))

    def _learn(self, regressor: Floats, error: float, acceleration: float | None) -> None:
        direction = regressor
        if self.as_printed:
            if acceleration is None:
                raise EstimationError("resistance learner: as printed it needs the acceleration")
            direction = regressor.copy()
            direction[MASS] = acceleration
        self.weights = gradient_step(self.weights, direction, error, self.gain)


@dataclass(eq=False)
class NormalisedGradientLearner(Learner):
    """Normalised least mean squares: removes `rate` in (0, 2) of a sample's error, in scaled regressors Z / `typical`.

    Neither the unit of the force nor those of the regressors matter, if `typical` (weights,) has the same. Regressors of
    zero teach nothing.
    """

    rate: float
    typical: Floats = field(default_factory=lambda: np.array(TYPICAL))

    def __post_init__(self) -> None:
        super().__post_init__()
        self.typical = np.array(self.typical, dtype=float)[: self.weights.size]
        EstimationError.check("resistance learner", self, positive=("rate", "typical[]"))

    def _learn(self, regressor: Floats, error: float, acceleration: float | None) -> None:
        scaled = regressor / self.typical
        size = float(scaled @ scaled)
        if size > 0.0:
            self.weights = self.weights + self.rate * error * scaled / (self.typical * size)


@dataclass(eq=False)
class LeastSquaresLearner(Learner):
    """Recursive least squares: `deviation` (weights,) of the prior, `noise` [N] of a sample, `forgetting` in (0, 1].

    Only weights whose regressor is not zero forget, and none beyond the prior: a weight that a run does not excite must not
    drift. `joint`: full least squares, in which a sample from a tunnel moves W1 too, because both are correlated with W3.
    The source, and so the default, moves W1 in the open only. A weight that may not move keeps its value as a considered
    parameter in Schmidt's filter (1966). Joseph's form keeps the covariance positive.
    """

    deviation: Floats
    noise: float = 500.0
    forgetting: float = 1.0
    joint: bool = False
    covariance: Floats = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.deviation = np.array(self.deviation, dtype=float)
        if self.deviation.shape != self.weights.shape:
            raise EstimationError(
                f"resistance learner: deviation {self.deviation.shape} must be {self.weights.shape}"
            )
        EstimationError.check("resistance learner", self, positive=("noise", "deviation[]"))
        if not 0.0 < self.forgetting <= 1.0:
            raise EstimationError(
                f"resistance learner: forgetting = {self.forgetting!r} must lie in (0, 1]"
            )
        self.covariance = np.diag(self.deviation**2)

    def _learn(self, regressor: Floats, error: float, acceleration: float | None) -> None:
        excited = regressor != 0.0
        if self.forgetting < 1.0:
            prior = self.deviation / np.sqrt(np.maximum(np.diag(self.covariance), 1e-300))
            grown = np.minimum(1.0 / math.sqrt(self.forgetting), np.maximum(prior, 1.0))
            grow = np.where(excited, grown, 1.0)
            self.covariance = grow[:, None] * self.covariance * grow
        free = np.ones(self.weights.size, dtype=bool)
        if not self.joint:  # W1 and W2 belong to a section each
            free[:2] = excited[:2]
        noise = self.noise * self.noise
        along = self.covariance @ regressor
        gain = np.where(free, along, 0.0) / (noise + float(regressor @ along))
        rest = np.eye(free.size) - np.outer(gain, regressor)
        moved = rest @ self.covariance @ rest.T + noise * np.outer(gain, gain)
        self.weights = self.weights + gain * error
        self.covariance = 0.5 * (moved + moved.T)

    def posterior(self) -> Floats:
        """Standard deviation of each weight, (weights,)."""
        return np.sqrt(np.diag(self.covariance))


# Stand-alone learner of running resistance on a recorded run: JP H07-322414, claim 7, Fig. 7; par. 0049 calls it claim 6.


Source = Literal["measured", "commanded"]


@displayed
@dataclass(frozen=True)
class RunLog:
    """Log of a run, all (samples,), evenly spaced: the only input of the learner.

    `force` [N]: of the motors at the rims, the current over K_i, over the interval that begins at its sample.
    `commanded_speed`, `commanded_acceleration`: V_c and a_c, for learning from these (the source's paragraph 0054).
    """

    time: Floats
    """[s]"""
    position: Floats
    """[m]"""
    speed: Floats
    """[m/s]"""
    force: Floats
    """[N]"""
    commanded_speed: Floats | None = None
    """[m/s]"""
    commanded_acceleration: Floats | None = None
    """[m/s2]"""

    def __post_init__(self) -> None:
        for name, values in vars(self).items():
            if values is not None:
                array = finite_series(f"resistance log: {name}", values, (np.size(self.time),))
                object.__setattr__(self, name, array)
        if self.time.size < 3:
            raise EstimationError("resistance log: time needs 3 samples at least")
        steps = np.diff(self.time)
        if steps.min() <= 0.0 or np.ptp(steps) > 1e-6 * max(float(steps.max()), 1.0):
            raise EstimationError("resistance log: time must grow in even steps; resample the log")

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return float(self.time[1] - self.time[0])

    @classmethod
    def of_run(cls, run: xr.Dataset, speed_noise: float = 0.0, seed: int = 0) -> "RunLog":
        """The log of a run recorded by `alloc.driving.drive` or `alloc.simulation.simulate`, without air brakes.

        The force is that of the motor torques as recorded, the mean over each interval; `speed_noise` [m/s] is added to the
        speed, drawn from `seed`.
        """
        unit = run["axle_unit"].values
        axles = np.bincount(unit[unit >= 0], minlength=run.sizes["unit"])
        per_torque = axles * run["unit_gear"].values / run["unit_radius"].values
        if "cylinder_pressure" in run and run["cylinder_pressure"].values.max(initial=0.0) > 1e3:
            raise EstimationError(
                "resistance log: air brakes acted in this run; leave braking out, their force is not known"
            )
        # the torque follows its command within milliseconds: what was asked of an interval acts at its end
        force = run["motor_torque"].values @ per_torque
        force = np.append(force[1:], force[-1])
        noise = np.random.default_rng(seed).standard_normal(force.size) * speed_noise
        return cls(
            run["time"].values, run["position"].values, run["car_speed"].values[:, 0] + noise, force
        )  # fmt: skip


@displayed
class Learnt(NamedTuple):
    """What was learnt from a run."""

    time: Floats
    """[s], (samples,)."""
    weights: Floats
    """After each sample, (samples, weights)."""
    error: Floats
    """Error of the force with the weights of that instant [N], (samples,)."""
    excitation: Excitation
    """Status of every weight, from all samples together."""


def learn_from_log(
    log: RunLog,
    memory: LineMemory,
    learner: Learner,
    rotating_mass: float = 0.0,
    filter_time: float = 0.0,
    train_length: float = 0.0,
    source: Source = "measured",
    keep: Callable[[Floats], NDArray[np.bool_]] | None = None,
) -> Learnt:
    """Let `learner` learn from `log`, as on board in Fig. 7: the error is force less W Z, with measured V and a.

    `rotating_mass` [kg] as in `alloc.onboard.line_memory`; `filter_time` [s]; `train_length` [m]: samples with
    a change of section or gradient under the train are left out. `source` "commanded": V_c and a_c in place of V and a.
    `keep` picks samples by time. Raises `EstimationError` for a log from which nothing can be learnt.
    """
    if source not in get_args(Source):
        raise EstimationError(f"resistance log: source = {source!r} must be measured or commanded")
    count = learner.weights.size
    middle = 0.5 * (log.position[1:] + log.position[:-1])
    speed = log.speed
    if source == "commanded":
        if log.commanded_speed is None or log.commanded_acceleration is None:
            raise EstimationError("resistance log: it holds no commanded speed and acceleration")
        speed, acceleration = log.commanded_speed, log.commanded_acceleration[:-1]
    else:
        acceleration = np.diff(speed) / log.period
    tunnel, slope = memory.read(middle)
    z = regressor(Motion(0.5 * (speed[1:] + speed[:-1]), acceleration, slope, tunnel), count)
    target = log.force[:-1] - rotating_mass * acceleration
    used = np.ones(middle.size, dtype=bool)
    if train_length > 0.0:
        used &= ~memory.straddled(middle, train_length)
    if keep is not None:
        used &= keep(log.time[:-1])
    if not used.any():
        raise EstimationError("resistance log: no sample is left to learn from")
    smooth = RegressionFilter(filter_time, log.period)
    history, filtered = np.full_like(z, np.nan), np.full_like(z, np.nan)
    errors, forces = np.full(middle.size, np.nan), np.full(middle.size, np.nan)
    for k in range(middle.size):
        if used[k]:
            raw = Regression(z[k], float(target[k]), 0.0, float(acceleration[k]))
            sample = smooth.add(raw, tunnel[k] > 0.5)
            if sample is not None:
                errors[k] = sample.target - float(learner.weights @ sample.regressor)
                learner.update(sample.regressor, errors[k], sample.acceleration)
                filtered[k], forces[k] = sample.regressor, sample.target
        else:
            smooth.restart()
        history[k] = learner.weights
    taken = np.isfinite(forces)
    if not taken.any():
        raise EstimationError("resistance log: no section is long enough for the filter to settle")
    excitation = judge_excitation(filtered[taken], forces[taken], EXTENDED_WEIGHTS[:count])
    return Learnt(log.time[:-1], history, errors, excitation)
