"""When a train sands: on slip or slide after a delay, and by the driver's command; and how much each sander lays."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import inlined_jit
from alloc.errors import OnboardError
from alloc.onboard.quantity import quantity
from alloc.onboard.slide_protection.fuzzy import SUPPLY
from alloc.plant.model import Floats


@dataclass(frozen=True)
class Sanding:
    """When the train's sanders work, all alike.

    Source: assumed.
    """

    on_slide: bool = True
    """They begin on a sign of sliding: a valve of the slide protection leaves supply, or a unit's slip signal comes on,
    anywhere in the train."""
    delay: float = quantity(1.0, "s")
    """Time from the sign, or from the driver's command, to the sand [s]."""
    hold: float = quantity(5.0, "s")
    """Time from the last such sign to the end of sanding [s]."""
    begin: float = quantity(math.inf, "s")
    """Instant from which the driver commands sand [s]. Left out: the driver commands none."""
    until: float = quantity(math.inf, "s")
    """Instant at which the driver's command ends [s]. Left out: it does not end."""
    least_speed: float = quantity(16.0 / 3.6, "km/h")
    """Below this speed no sand is laid [m/s]. Source: GM/RT2461, 7.5 g/m per rail where a train comes to rest, which 2
    kg/min would exceed."""

    def __post_init__(self) -> None:
        OnboardError.check("sanding", self, nonnegative=("delay", "hold", "begin", "least_speed"))
        OnboardError.check_order("sanding", self, "begin", "until", equal=True)


class SandingSettings(NamedTuple):
    """As `Sanding`."""

    on_slide: bool
    delay: float
    hold: float
    begin: float
    until: float
    least_speed: float


class SandingMemory(NamedTuple):
    """When the present slide, or the last one, was first and last seen [s], (1,) each."""

    first: Floats
    last: Floats


class Sanders(NamedTuple):
    """The train's sanders, (sanders,) each."""

    body: NDArray[np.int64]  # whose speed a sander knows
    rate: Floats  # [kg/s], the greatest
    amount: Floats  # [kg/m]; inf: of fixed rate


@inlined_jit
def _slides(m):
    """Whether any wheel is seen to slide or slip."""
    found = False
    for g in range(m.slide.action.size):
        found = found or m.slide.action[g] != SUPPLY
    for j in range(m.unit.slipping.size):
        found = found or m.unit.slipping[j] > 0.0
    return found


@inlined_jit
def command_sand(eq, st, m, time, rate):
    """Fill `rate` (sanders,) [kg/s]: fixed, or what lays the sander's amount at the reference speed."""
    s, k = st.sanding, m.sanding
    if s.on_slide and _slides(m):
        if time - k.last[0] > s.hold:
            k.first[0] = time
        k.last[0] = time
    asked = time - k.last[0] <= s.hold and time - k.first[0] >= s.delay
    asked = asked or s.begin <= time - s.delay < s.until
    for i in range(rate.size):
        speed = abs(m.reference[eq.sander.body[i]])
        wanted = min(eq.sander.rate[i], eq.sander.amount[i] * speed)
        rate[i] = wanted if asked and speed >= s.least_speed else 0.0
