"""Learning the weights of running resistance from a train's motion: JP H07-322414 (4), (5), (8), and two yardsticks.

Every learner moves W1 in the open only and W2 in tunnels only. Errors are forces [N], delta / K_i of the source, whose gain
K_d on the current is 1 / K_i times the gain here.

Persistence of excitation: a weight is learnt only as far as the run varies its regressor independently of the others. At
constant speed on level track V^2 is constant and a + g sin(theta) is zero: W1 can be learnt, W3 not at all. At constant
speed on one gradient both are constant, and only W1 V^2 + W3 g sin(theta) can be determined: an error of one hides behind
the other. A gradient or an acceleration that comes and goes at one speed excites W3. A change of speed on level track
distinguishes W1 from A and B. W2 needs a tunnel, and a run outside of it to distinguish it from W3.
`alloc.estimation.excitation` states which weights a run has determined.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError

Floats = NDArray[np.float64]

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
        """Learn from one sample; see `alloc.onboard.speed_control.speed_controller.Learner`."""
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
