"""The arms of the sweep `learning`: who learns from what, by which learner, and allocates by which rule."""

from typing import Literal, NamedTuple

from alloc.onboard.increment_learning import IncrementLearning

Reference = Literal["received", "held"]

NEVER = 1_000_000_000
"""N_min of arms that keep their belief; they collect data all the same, and own slips cap units under them too."""


class LearningArm(NamedTuple):
    """How a train learns and allocates."""

    learner: Literal["none", "truth", "running-mean", "gaussian"]
    rule: str = "exact"
    reference: Reference = "received"

    @property
    def learning(self) -> IncrementLearning:
        """What runs on board."""
        if self.learner == "none" or self.learner == "truth":
            return IncrementLearning("running-mean", self.reference, first=NEVER)
        return IncrementLearning(self.learner, self.reference)


ARMS: dict[str, LearningArm] = {
    "no learning": LearningArm("none"),
    "truth": LearningArm("truth"),
    "truth, held": LearningArm("truth", reference="held"),
    "running mean": LearningArm("running-mean"),
    "running mean, held": LearningArm("running-mean", reference="held"),
    "Gaussian": LearningArm("gaussian", reference="held"),
    "Gaussian, robust": LearningArm("gaussian", rule="qp-robust", reference="held"),
}
"""Arms by name: "no learning" keeps the stored values, "truth" has the true ones; "truth, held" runs in the same way and
collects other data. "running mean" is the patent's learning with the patent's data. "held" uses the leader's estimate at
its last slip as reference, as the Gaussian learners do, whose model has no room for biased data."""
EXACT: dict[Reference, str] = {"received": "truth", "held": "truth, held"}
"""Arms whose data show what a reference gives where the stored increments are right."""
