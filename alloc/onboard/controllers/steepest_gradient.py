"""Maximum adhesion tracking by steepest gradient: creep control whose reference climbs along the estimated slope."""

import math
from dataclasses import dataclass

from alloc.compilation import equation
from alloc.errors import OnboardError
from alloc.onboard.controllers.built_in import BuiltInController
from alloc.onboard.controllers.peak_search import (
    REMEMBERED,
    interval_is_over,
    interval_means,
    move_reference,
)
from alloc.onboard.controllers.pi_creep import hold_slip_of_unit
from alloc.onboard.quantity import quantity


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
