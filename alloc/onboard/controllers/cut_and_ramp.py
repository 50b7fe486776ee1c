"""Readhesion control of one unit: cut the torque on slip, hold, ramp back; driven by the observer's estimate."""

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

FOLLOW, CUT, HOLD, RAMP = 0, 1, 2, 3
"""Phases of the controller."""

RECOVERY_TIMEOUT = 3.0
"""Time [s] after which an unsuccessful cut goes to zero torque: the estimate was too high for readhesion."""


@equation
def cut_and_ramp(phase, clock, base, torque, target, slipping, rail_torque, p, ramp_rate, period):
    """One control period under the settings `p`; torques as magnitudes in the direction of the demand [N m].

    `rail_torque` is the observer's estimate of the torque that the rail carries, `base` its value stored at detection.
    Returns phase, clock [s], base, torque command. A slip signal in any later phase starts the sequence again with the new
    estimate.
    """
    clock = clock + period
    if slipping and phase != CUT:
        phase, clock = CUT, 0.0
        base = min(max(rail_torque, 0.0), target)
    elif phase == CUT and not slipping:
        phase, clock = HOLD, 0.0
    elif phase == HOLD and clock >= p.hold:
        phase = RAMP
    elif phase == RAMP and torque >= target:
        phase = FOLLOW
    if phase == CUT:
        torque = p.cut * base if clock < RECOVERY_TIMEOUT else 0.0
    elif phase == HOLD:
        torque = p.recover * base
    elif phase == RAMP:
        torque = torque + ramp_rate * period
    else:
        torque = target
    return phase, clock, base, min(torque, target)


@equation
def cut_and_ramp_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    sign = direction(commanded)
    to_torque = torque_per_coefficient(eq, j)
    rate = m.train.expected[0] * to_torque / p.ramp
    # what the air brake takes of the rail's force is not the motors' to have
    air = m.air_force[j] * eq.radius[j] / eq.gear[j]
    k.phase[j], k.clock[j], k.base[j], torque = cut_and_ramp(
        k.phase[j], k.clock[j], k.base[j],
        sign * m.unit.torque_command[j], sign * m.unit.torque_target[j], m.unit.slipping[j] > 0.0,
        m.unit.coefficient_estimate[j] * to_torque - air, p, rate, st.period,
    )  # fmt: skip
    m.unit.torque_command[j] = sign * torque
    return share_of_target(m, j)


# time in the phase [s], and the torque [N m] that the rail carried at detection
@dataclass(frozen=True)
class CutAndRamp(BuiltInController, remembered={"phase": FOLLOW, "clock": 0.0, "base": 0.0}):
    """Readhesion control on the observer's estimate, after Kadowaki and Ohishi.

    On detection the torque is cut, held once the wheels have readhered, and raised to the target again.

    Source: after Kadowaki and Ohishi, who print no values; assumed, typical of published controllers.
    """

    name = "cut-and-ramp"
    meaning = "cut on slip to what the observer says the rail carries, hold, ramp back"
    colour = "#00aaaa"
    marker = "s"
    law = cut_and_ramp_unit

    cut: float = quantity(0.5, "1")
    """Torque after the cut at a detection, over the torque that the estimate says the rail can carry."""
    recover: float = quantity(0.9, "1")
    """Torque held once the wheels have readhered, over the torque that the estimate says the rail can carry; at most 1."""
    hold: float = quantity(0.1, "s")
    """Time for which it is held [s]."""
    ramp: float = quantity(3.0, "s")
    """Time in which the torque then rises by the expected torque [s]."""

    def __post_init__(self) -> None:
        OnboardError.check("cut-and-ramp", self, ("ramp",), ("cut", "recover", "hold"))
        if not self.cut <= self.recover <= 1.0:
            raise OnboardError(
                f"cut-and-ramp: needs cut <= recover <= 1, got {self.cut!r} and {self.recover!r}"
            )
