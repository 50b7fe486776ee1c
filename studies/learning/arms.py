"""The arms of the sweep `learning`: who learns from what, by which learner, and allocates by which rule."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.increment_data import Reference
from alloc.estimation.learning import GaussianPosterior, Learning, RunningMean
from alloc.estimation.slide_counts import SIGMA

STORED_COUNT = 10.0
"""N_z of the wrong values: as many data as N_min, so that the first update meets them half-way (assumed)."""
FIRST, FURTHER = 10, 5
"""N_min and N_arg of (16), (17); JP5484215 names no numbers."""
PRIOR_DEVIATION = 0.010
"""Deviation of the Gaussian prior about the stored values (assumed): half of what the increments reach."""


class Arm(NamedTuple):
    """How a train learns and allocates."""

    learner: Literal["none", "truth", "running-mean", "gaussian"]
    rule: str = "exact"
    reference: Reference = "received"


ARMS: dict[str, Arm] = {
    "no learning": Arm("none"),
    "truth": Arm("truth"),
    "running mean": Arm("running-mean"),
    "running mean, held": Arm("running-mean", reference="held"),
    "Gaussian": Arm("gaussian", reference="held"),
    "Gaussian, robust": Arm("gaussian", rule="qp-robust", reference="held"),
}
"""Arms by name: "no learning" keeps the stored values, "truth" has the true ones. "running mean" is the patent's learning
with the patent's data; "held" takes the foremost unit's estimate at its last slip for reference, as
the Gaussian learners do, whose model has no room for biased data."""


def first_learning(arm: Arm, stored: NDArray[np.float64]) -> Learning:
    """The learner of an arm before its first station. Arms that do not learn collect data all the same."""
    if arm.learner == "gaussian":
        variance = np.full(stored.size, PRIOR_DEVIATION**2)
        variance[0] = 0.0  # the foremost unit is the reference
        return GaussianPosterior(stored, variance, noise=SIGMA)
    return RunningMean(stored, np.full(stored.size, STORED_COUNT), FIRST, FURTHER)


def believed_increments(
    arm: Arm, learner: Learning, stored: NDArray[np.float64], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Increments that a train of this arm allocates with, (units,)."""
    return {"none": stored, "truth": truth}.get(arm.learner, learner.increment).copy()
