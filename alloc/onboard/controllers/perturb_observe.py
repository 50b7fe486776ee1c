"""Maximum adhesion tracking by perturbation: creep control whose reference climbs by fixed steps."""

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
