"""The thresholds of the sweep `blended`: what each claim must pass."""

from collections.abc import Mapping

from studies.core.threshold import Threshold

PAGE, OWN = "docs/reference-speed.md", "set by this project"

TABLE = (
    Threshold("estimate", "bound_use, true speed less estimate", "at most", 0.01,
              "a hundredth of the bound is what the choice of a controller or a rule is about", OWN),
    Threshold("damage", "damage, estimate over true speed, less 1", "at most", 0.2,
              "slip that is measured wrongly costs no more than a fifth of the wheel damage", PAGE),
    Threshold("error", "reference_error", "at most", 0.2,
              "largest error of an event [m/s], on the mean: half the slip of a wide peak", PAGE),
    Threshold("deviation", "reference_within", "at least", 0.95,
              "two deviations contain 95 % of normal errors", OWN),
    Threshold("sharing", "bound_use, a rule less alone", "at least", 0.0, "sharing is there to use more", OWN),
    Threshold("controller", "bound_use, a controller less another", "at least", 0.0, "better is more of the bound", OWN),
)  # fmt: skip
"""Every threshold that decides a verdict about a mean."""
THRESHOLDS: Mapping[str, Threshold] = {row.name: row for row in TABLE}
