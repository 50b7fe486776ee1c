"""Controllers that search for the peak of the adhesion curve: perturb-observe, steepest gradient, fuzzy tracking.

In: coefficient and slip over an interval. Out: the slip that the creep control below them holds.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

from alloc.old.compilation import called, equation
from alloc.old.errors import OnboardError
from alloc.old.onboard.controllers.base import BuiltInController
from alloc.old.onboard.controllers.creep import (
    REMEMBERED,
    hold_slip_of_unit,
    interval_is_over,
    interval_means,
    move_reference,
)
from alloc.old.onboard.laws import weighted_action
from alloc.old.records import quantity

# Maximum adhesion tracking by perturbation: creep control whose reference climbs by fixed steps.


@equation
def perturbed_step(last_step, coefficient_change, step):
    """Next step of the reference [m/s]: in the same direction if the coefficient rose, in the other if it fell."""
    onward = last_step >= 0.0
    if coefficient_change < 0.0:
        onward = not onward
    return step if onward else -step


@equation
def perturb_observe_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    if interval_is_over(st, m, p, k, j):
        coefficient, slip = interval_means(k, j)
        if math.isnan(k.last_coefficient[j]):
            step = math.copysign(p.step, k.step[j])
        else:
            step = perturbed_step(k.step[j], coefficient - k.last_coefficient[j], p.step)
        move_reference(p, k, j, step, coefficient, slip)
    return hold_slip_of_unit(
        eq, st, m, st.law.creep, k.allowed, k.reference[j], m.worst_slip[j], j, commanded
    )


@dataclass(frozen=True)
class PerturbObserve(BuiltInController, remembered=REMEMBERED):
    """Perturb and observe: at every interval the creep reference moves by a step, and turns back if the coefficient fell.

    The coefficient is the observer's, averaged over the second half of the interval. Nine pairs of interval (0.2, 0.3, 0.5
    s) and step (0.01, 0.02, 0.04 m/s) were tried over eight probe events of `studies.ladder.events` (seed 1000, the multiple
    units). This one used most adhesion: 97.4 % where short, against 96.8 % at 0.3 s and 91.9 % at 0.3 s and 0.04 m/s. The
    source (arXiv 2406.13650) names the weaknesses: the step is a compromise between search time and fluctuation around the
    peak, and a change of the rail is mistaken for a response to the step.

    Source: arXiv 2406.13650; values tuned on eight events of `studies.ladder.events` (seed 1000).
    """

    name = "perturb-observe"
    meaning = "creep control whose reference climbs by fixed steps"
    colour = "#395539"
    marker = "D"
    law = perturb_observe_unit

    interval: float = quantity(0.2, "s")
    """Time from one move of the reference to the next [s]."""
    step: float = quantity(0.01, "km/h")
    """Size of a move [m/s]."""
    lowest: float = quantity(0.02, "km/h")
    """Least reference [m/s]. Source: assumed."""
    highest: float = quantity(0.5, "km/h")
    """Greatest reference [m/s]. Source: assumed."""

    def __post_init__(self) -> None:
        OnboardError.check("perturb-observe", self, ("interval", "step", "lowest", "highest"))
        OnboardError.check_order("perturb-observe", self, "lowest", "highest")


# Maximum adhesion tracking by steepest gradient: creep control whose reference climbs along the estimated slope.


@equation
def gradient_step(last_step, coefficient_change, slip_change, gain, least, largest):
    """Next step of the reference [m/s] along the slope of the curve between the last two intervals.

    If the slip has hardly changed, the quotient carries no information: the smallest step probes the last direction.
    """
    if abs(slip_change) < 0.3 * least:
        return math.copysign(least, last_step)
    wanted = gain * coefficient_change / slip_change
    return math.copysign(min(max(abs(wanted), least), largest), wanted)


@equation
def steepest_gradient_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    if interval_is_over(st, m, p, k, j):
        coefficient, slip = interval_means(k, j)
        if math.isnan(k.last_coefficient[j]):
            step = math.copysign(p.least, k.step[j])
        else:
            step = gradient_step(
                k.step[j], coefficient - k.last_coefficient[j], slip - k.last_slip[j],
                p.gain, p.least, p.largest,
            )  # fmt: skip
        move_reference(p, k, j, step, coefficient, slip)
    return hold_slip_of_unit(
        eq, st, m, st.law.creep, k.allowed, k.reference[j], m.worst_slip[j], j, commanded
    )


@dataclass(frozen=True)
class SteepestGradient(BuiltInController, remembered=REMEMBERED):
    """Steepest gradient: as `PerturbObserve`, but the step is a gain times the slope d mu / d slip.

    The slope is the quotient of both changes between intervals. Steps are bounded: without the smallest step nothing is
    learnt at the peak, and without the largest a small change of slip causes an excessive step. Of five triples of gain,
    least and largest this one used most adhesion over the probe events of `PerturbObserve`, with the shortest search of
    equals. It used 97.0 % where short in 0.04 s, against 95.9 % in 0.18 s with 0.04, 0.003 and 0.03. The source (arXiv
    2406.13650) names the weaknesses: the quotient is noisy, and small where the curve falls slowly.

    Source: arXiv 2406.13650; values tuned on eight events of `studies.ladder.events` (seed 1000).
    """

    name = "steepest-gradient"
    meaning = "creep control whose reference climbs along the estimated slope"
    colour = "#0000c6"
    marker = "X"
    law = steepest_gradient_unit

    interval: float = quantity(0.3, "s")
    """Time from one move of the reference to the next [s]. Source: assumed."""
    gain: float = quantity(0.15, "m2/s2")
    """Step over the slope d mu / d slip [m2/s2]."""
    least: float = quantity(0.01, "km/h")
    """Least step [m/s]."""
    largest: float = quantity(0.06, "km/h")
    """Largest step [m/s]."""
    lowest: float = quantity(0.02, "km/h")
    """Least reference [m/s]. Source: assumed."""
    highest: float = quantity(0.5, "km/h")
    """Greatest reference [m/s]. Source: assumed."""

    def __post_init__(self) -> None:
        names = ("interval", "gain", "least", "largest", "lowest", "highest")
        OnboardError.check("steepest-gradient", self, names)
        OnboardError.check_order("steepest-gradient", self, "lowest", "highest")
        OnboardError.check_order("steepest-gradient", self, "least", "largest", equal=True)


# Fuzzy adhesion tracking after Abouzeid et al. (arXiv 2406.13650): a search whose step is inferred.
#
# From the source (only the abstract could be read): it has two strategies that overcome the limitations of perturb-
# observe and steepest gradient. One of them finds the slip of the largest adhesion by a fuzzy logic controller.
#
# Assumed, as the abstract prints no rules: the inputs, the changes of the coefficient and of the slip from interval to
# interval; three sets each; nine rules.


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

    coefficient: ClassVar[float] = 0.005
    """Changes of the coefficient at which its outer sets peak, either way."""
    way: ClassVar[float] = 0.01
    """Changes of the slip at which its outer sets peak, either way [m/s]."""
    least: float = quantity(0.01, "km/h")
    """Least step of the reference [m/s]."""
    largest: float = quantity(0.04, "km/h")
    """Largest step of the reference [m/s]."""

    def __post_init__(self) -> None:
        OnboardError.check("fuzzy-tracking", self, ("least", "largest"))
        OnboardError.check_order("fuzzy-tracking", self, "least", "largest", equal=True)
