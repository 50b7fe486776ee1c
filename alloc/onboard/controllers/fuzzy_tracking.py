"""Fuzzy adhesion tracking after Abouzeid et al. (arXiv 2406.13650): a search whose step is inferred.

From the source (only the abstract could be read): it has two strategies that overcome the limitations of perturb-observe and
steepest gradient. One of them finds the slip of the largest adhesion by a fuzzy logic controller.

Assumed, as the abstract prints no rules: the inputs, the changes of the coefficient and of the slip from interval to
interval; three sets each; nine rules.
"""

import math
from dataclasses import dataclass

from alloc.compilation import called
from alloc.errors import OnboardError
from alloc.onboard.controllers.built_in import BuiltInController
from alloc.onboard.controllers.peak_search import (
    interval_is_over,
    interval_means,
    move_reference,
)
from alloc.onboard.controllers.pi_creep import hold_slip_of_unit
from alloc.onboard.fuzzy_inference import weighted_action
from alloc.onboard.quantity import quantity

# Share of the largest step, by the change of the coefficient (rows) and of the slip (columns)
RULES = (
    # back still onward
    (1.0, 0.0, -1.0),  # less adhesion: turn back
    (0.0, 0.0, 0.0),  # as much: the peak is here
    (-1.0, 0.0, 1.0),  # more: go on
)


@called
def inferred_step(last_step, coefficient_change, slip_change, p):
    """Next step of the reference [m/s] under settings `p`, between `least` and `largest`.

    Without a smallest step nothing would be learnt. Where no rule applies, the reference moves back and forth by that step.
    """
    changes = (-p.coefficient, 0.0, p.coefficient)
    ways = (-p.way, 0.0, p.way)
    wanted = p.largest * weighted_action(RULES, coefficient_change, slip_change, changes, ways)
    if wanted == 0.0:
        return math.copysign(p.least, -last_step)
    return math.copysign(max(abs(wanted), p.least), wanted)


@called
def fuzzy_tracking_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    bounds, search = st.law.perturb_observe, m.law.perturb_observe
    if interval_is_over(st, m, bounds, search, j):
        coefficient, slip = interval_means(search, j)
        if math.isnan(search.last_coefficient[j]):
            step = math.copysign(p.least, search.step[j])
        else:
            rise, way = coefficient - search.last_coefficient[j], slip - search.last_slip[j]
            step = inferred_step(search.step[j], rise, way, p)
        move_reference(bounds, search, j, step, coefficient, slip)
    return hold_slip_of_unit(
        eq, st, m, st.law.creep, search.allowed, search.reference[j], m.worst_slip[j], j, commanded
    )


@dataclass(frozen=True)
class FuzzyTracking(BuiltInController):
    """Fuzzy adhesion tracking: as `PerturbObserve`, but the step is inferred from the changes of coefficient and slip.

    Interval, bounds and memory are those of `PerturbObserve`. Of five sets of scales and steps this one used most over 24
    events of `studies.ladder.events` (seed 1000): 97.2 % where short on the multiple units, against 96.0 % with a least step
    of half the size.

    Source: arXiv 2406.13650; values tuned on 24 events of `studies.ladder.events` (seed 1000).
    """

    name = "fuzzy-tracking"
    meaning = "creep control whose reference climbs by inferred steps (arXiv 2406.13650)"
    colour = "#8e5500"
    marker = "h"
    law = fuzzy_tracking_unit

    coefficient: float = quantity(0.005, "1")
    """Changes of the coefficient at which its outer sets peak, either way."""
    way: float = quantity(0.01, "km/h")
    """Changes of the slip at which its outer sets peak, either way [m/s]."""
    least: float = quantity(0.01, "km/h")
    """Least step of the reference [m/s]."""
    largest: float = quantity(0.04, "km/h")
    """Largest step of the reference [m/s]."""

    def __post_init__(self) -> None:
        names = ("coefficient", "way", "least", "largest")
        OnboardError.check("fuzzy-tracking", self, names)
        OnboardError.check_order("fuzzy-tracking", self, "least", "largest", equal=True)
