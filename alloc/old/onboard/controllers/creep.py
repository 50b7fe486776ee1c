"""Creep control: PI and fuzzy control of slip velocity, and what every search on top of it shares.

In: the unit's slip against the reference speed. Out: the coefficient from which the torque follows.
"""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from alloc.old.compilation import called, equation
from alloc.old.errors import OnboardError
from alloc.old.onboard.controllers.base import (
    BuiltInController,
    direction,
    share_of_target,
    torque_per_coefficient,
)
from alloc.old.onboard.laws import HOLD, differentiate, differentiator_gain, infer
from alloc.old.onboard.reference_speed import is_relieved
from alloc.old.records import numbers_of, quantity

# What searches for the peak of the adhesion curve share: means over intervals, and a reference that moves.


LIMITING = 0.999
"""Share of its target below which a unit counts as limited by its readhesion controller, and a search goes on."""


REMEMBERED = {
    "allowed": math.nan,  # integral of creep control; nan: nothing yet
    "reference": 0.0,  # slip velocity that is held [m/s]
    "step": 0.0,  # last one of the reference [m/s]
    "clock": 0.0,  # time in this interval [s]
    "coefficient_sum": 0.0,
    "slip_sum": 0.0,
    "samples": 0.0,
    "last_coefficient": math.nan,  # mean of the last interval; nan: none
    "last_slip": 0.0,
}
"""What a searching creep controller remembers of every unit."""


@equation
def _start_interval(k, j):
    k.clock[j] = k.coefficient_sum[j] = k.slip_sum[j] = k.samples[j] = 0.0


@equation
def interval_is_over(st, m, p, k, j):
    """Add what unit `j` senses to its means; whether an interval is over. Only while the controller limits the torque."""
    if math.isnan(k.allowed[j]):
        k.reference[j] = st.law.creep.reference
    if is_relieved(m, j):
        _start_interval(k, j)
        return False
    if m.unit.torque_factor[j] >= LIMITING:  # adhesion suffices: nothing to be learnt of the peak
        _start_interval(k, j)
        k.last_coefficient[j] = math.nan
        return False
    k.clock[j] += st.period
    if k.clock[j] > 0.5 * p.interval:  # the first half is for the slip to settle at its reference
        k.coefficient_sum[j] += m.unit.coefficient_estimate[j]
        k.slip_sum[j] += m.worst_slip[j]
        k.samples[j] += 1.0
    return k.clock[j] >= p.interval


@equation
def interval_means(k, j):
    """Means of coefficient and slip [m/s] over the interval of unit `j` that is over."""
    return k.coefficient_sum[j] / k.samples[j], k.slip_sum[j] / k.samples[j]


@equation
def move_reference(p, k, j, step, coefficient, slip):
    """Move the reference of unit `j` by `step` [m/s] within its bounds, and start an interval; both means are the last's."""
    wanted = k.reference[j] + step
    k.step[j] = -step if wanted < p.lowest or wanted > p.highest else step
    k.reference[j] = min(max(wanted, p.lowest), p.highest)
    k.last_coefficient[j], k.last_slip[j] = coefficient, slip
    _start_interval(k, j)


@equation
def hold_slip(allowed, slip, reference, ceiling, proportional, integral, period):
    """One period of the PI controller of slip: returns the integral's new value and the coefficient to pull with.

    `allowed` is the integral, `ceiling` the coefficient that the target asks for; slip and reference [m/s] count positive in
    the direction of the demand. The integral is bounded by what can be commanded, so it does not wind up while the wheels
    adhere.
    """
    error = reference - slip
    allowed = min(max(allowed + integral * error * period, 0.0), ceiling)
    return allowed, min(max(allowed + proportional * error, 0.0), ceiling)


@equation
def hold_slip_of_unit(eq, st, m, p, allowed, reference, slip, j, commanded):
    """Command of unit `j` that holds `slip` at `reference` [m/s] with the gains `p`; `allowed` (units,) is its integral."""
    sign = direction(commanded)
    to_torque = torque_per_coefficient(eq, j)
    ceiling = sign * m.unit.torque_target[j] / to_torque
    if math.isnan(allowed[j]):
        allowed[j] = ceiling
    if is_relieved(m, j):  # little slip now says nothing of how much is allowed
        return share_of_target(m, j)
    allowed[j], coefficient = hold_slip(
        allowed[j], slip, reference, ceiling, p.proportional, p.integral, st.period
    )
    m.unit.torque_command[j] = sign * coefficient * to_torque
    return share_of_target(m, j)


@equation
def creep_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    return hold_slip_of_unit(eq, st, m, p, k.allowed, p.reference, m.worst_slip[j], j, commanded)


# the integral: coefficient that is allowed; nan: nothing yet
@dataclass(frozen=True)
class CreepControl(BuiltInController, remembered={"allowed": math.nan}):
    """Creep control: the torque is what a PI controller of the slip velocity allows.

    The gains are from slip to coefficient; the searching controllers move the reference and use the same gains. The
    reference is a compromise: a larger one uses more of a wide peak, but slips longer beyond a narrow one. At 0.085 the
    multiple units of the ladder (eight events of seed 1000) slip no longer than they did at 0.10 under a reference speed
    that was about 0.015 below the train's; they use 94.8 %.

    Source: assumed: the poles of a wheelset on a flat curve are then at 40 1/s with damping 0.7.
    """

    name = "pi-creep"
    meaning = "a fixed slip velocity is held by PI control"
    colour = "#aac655"
    marker = "^"
    law = creep_unit

    reference: float = quantity(0.085, "km/h")
    """Slip of the unit's worst axle that is held [m/s]. Source: tuned on eight events of `studies.ladder.events` (seed
    1000)."""
    proportional: float = quantity(0.4, "s/m")
    """Proportional gain [s/m]."""
    integral: float = quantity(8.0, "1/m")
    """Integral gain [1/m]."""

    def __post_init__(self) -> None:
        OnboardError.check("creep", self, ("reference", "proportional", "integral"))


# Fuzzy creep control after Tian, Daniel, Meehan (2014): the torque follows from fuzzy inference of creep.
#
# From the source (Computers in Railways XIV, 885, abstract): a fuzzy logic creep controller of a Co-Co locomotive under
# Polach's contact law reaches more tractive force than a PI controller where the friction changes.
#
# Assumed, as the abstract prints no rules: the inputs, slip velocity and its rate; the sets; the output, a rate of the
# coefficient that is allowed. The nine rules are those of the slide protection: supply, hold and release of a valve
# become more, the same and less torque.


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
    large: ClassVar[float] = 0.3
    """Slip at which the highest set peaks, larger than `reference` [m/s]."""
    rate: float = quantity(1.7, "km/h/s")
    """Slip rates at which the outer sets of the rate peak, either way; the middle one peaks at 0 [m/s2]."""
    change: ClassVar[float] = 0.7
    """Greatest rate at which the allowed coefficient changes [1/s]."""
    pole: float = quantity(40.0, "1/s")
    """Pole of the pseudo-differentiator [1/s]."""

    def __post_init__(self) -> None:
        OnboardError.check("fuzzy-creep", self, ("reference", "rate", "pole"))
        OnboardError.check_order("fuzzy-creep", self, "reference", "large")

    def settings(self, period: float) -> Any:
        """Numbers of the law; `gain`: share of the new slip that the differentiator takes per control period."""
        return numbers_of(self, gain=differentiator_gain(self.pole, period))
