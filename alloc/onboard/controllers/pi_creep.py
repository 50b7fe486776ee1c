"""Creep control: PI control of the slip velocity; its output is the coefficient from which the torque follows."""

import math
from dataclasses import dataclass

from alloc.compilation import equation
from alloc.errors import OnboardError
from alloc.onboard.controllers.built_in import (
    BuiltInController,
    direction,
    share_of_target,
    torque_per_coefficient,
)
from alloc.onboard.quantity import quantity
from alloc.onboard.reference_speed.sounding import is_relieved


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
