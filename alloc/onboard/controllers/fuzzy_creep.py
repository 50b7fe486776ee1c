"""Fuzzy creep control after Tian, Daniel, Meehan (2014): the torque follows from fuzzy inference of creep.

From the source (Computers in Railways XIV, 885, abstract): a fuzzy logic creep controller of a Co-Co locomotive under
Polach's contact law reaches more tractive force than a PI controller where the friction changes.

Assumed, as the abstract prints no rules: the inputs, slip velocity and its rate; the sets; the output, a rate of the
coefficient that is allowed. The nine rules are those of the slide protection: supply, hold and release of a valve become
more, the same and less torque.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from alloc.compilation import called
from alloc.errors import OnboardError
from alloc.onboard.controllers.built_in import (
    BuiltInController,
    direction,
    share_of_target,
    torque_per_coefficient,
)
from alloc.onboard.detector import differentiate, differentiator_gain
from alloc.onboard.quantity import filled, quantity
from alloc.onboard.reference_speed.sounding import is_relieved
from alloc.onboard.slide_protection.fuzzy import HOLD, infer

if TYPE_CHECKING:
    from alloc.onboard.parameters import Onboard


class FuzzyCreepSettings(NamedTuple):
    """Numbers of the law; `gain`: share of the new slip that the differentiator takes per control period."""

    reference: float
    large: float
    rate: float
    change: float
    pole: float
    gain: float


@called
def allowed_rate(slip, slip_rate, p):
    """Rate [1/s] at which the allowed coefficient changes at this slip [m/s] and slip rate [m/s2], under settings `p`.

    It never rises with slip or slip rate, lies within +-`change`, and is 0 at a steady slip of `reference`.
    """
    slips, rates = (0.0, p.reference, p.large), (-p.rate, 0.0, p.rate)
    return p.change * (HOLD - infer(slip, slip_rate, 1.0, slips, rates))


@called
def fuzzy_creep_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    sign = direction(commanded)
    to_torque = torque_per_coefficient(eq, j)
    ceiling = sign * m.unit.torque_target[j] / to_torque
    if math.isnan(k.allowed[j]):
        k.allowed[j], k.slip[j] = ceiling, m.worst_slip[j]
    k.slip[j], slip_rate = differentiate(k.slip[j], m.worst_slip[j], p.pole, p.gain)
    if is_relieved(m, j):  # little slip now says nothing of how much is allowed
        return share_of_target(m, j)
    wanted = k.allowed[j] + st.period * allowed_rate(m.worst_slip[j], slip_rate, p)
    k.allowed[j] = min(max(wanted, 0.0), ceiling)
    m.unit.torque_command[j] = sign * k.allowed[j] * to_torque
    return share_of_target(m, j)


# coefficient that is allowed, slip behind the differentiator's filter [m/s]; nan: nothing yet
@dataclass(frozen=True)
class FuzzyCreep(BuiltInController, remembered={"allowed": math.nan, "slip": math.nan}):
    """Fuzzy creep control after Tian, Daniel, Meehan (2014).

    Near the reference the law is that of `CreepControl`, with the integral gain change / reference and the proportional gain
    change / rate; the values are chosen so that the gains agree. Over 24 events of `studies.ladder.events` (seed 1000) the
    multiple units use 94.2 % where short, as under `CreepControl`. A reference of 0.12 m/s used 95.3 %, but slipped twice as
    long; doubled rates changed nothing.

    Source: Tian, Daniel, Meehan (2014); values chosen to match pi-creep near the reference.
    """

    name = "fuzzy-creep"
    meaning = "torque by fuzzy inference of slip and slip rate (Tian, Daniel, Meehan 2014)"
    colour = "#55718e"
    marker = "p"
    law = fuzzy_creep_unit

    reference: float = quantity(0.085, "km/h")
    """Slip at which the middle set of the slip peaks, and which the law holds; the lowest set peaks at 0 [m/s]."""
    large: float = quantity(0.3, "km/h")
    """Slip at which the highest set peaks, larger than `reference` [m/s]."""
    rate: float = quantity(1.7, "km/h/s")
    """Slip rates at which the outer sets of the rate peak, either way; the middle one peaks at 0 [m/s2]."""
    change: float = quantity(0.7, "1/s")
    """Greatest rate at which the allowed coefficient changes [1/s]."""
    pole: float = quantity(40.0, "1/s")
    """Pole of the pseudo-differentiator [1/s]."""

    def __post_init__(self) -> None:
        names = ("reference", "large", "rate", "change", "pole")
        OnboardError.check("fuzzy-creep", self, names)
        OnboardError.check_order("fuzzy-creep", self, "reference", "large")

    def settings(self, onboard: "Onboard") -> FuzzyCreepSettings:
        """Numbers of the law."""
        return filled(FuzzyCreepSettings, self, gain=differentiator_gain(self.pole, onboard.period))
