"""Readhesion controllers without a search: none, cut-and-ramp on the observer, the torque table of the readhesion paper.

In: the unit's target and what it senses. Out: its torque command and a torque factor.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from alloc.old.compilation import equation
from alloc.old.errors import OnboardError
from alloc.old.onboard.controllers.base import (
    BuiltInController,
    direction,
    share_of_target,
    torque_per_coefficient,
)
from alloc.old.onboard.laws import differentiate, differentiator_gain
from alloc.old.onboard.reference_speed import is_relieved
from alloc.old.plant.operations import maximum, minimum, where
from alloc.old.records import filled, quantity

# No readhesion control: the torque follows its target whatever the wheels do.


@equation
def follow_target(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    m.unit.torque_command[j] = m.unit.torque_target[j]
    return share_of_target(m, j)


@dataclass(frozen=True)
class NoControl(BuiltInController):
    """No readhesion control; it has no parameters."""

    name = "none"
    meaning = "torque follows the limit whatever the wheels do"
    colour = "#aa8e55"
    marker = "o"
    law = follow_target


# Readhesion control of one unit: cut the torque on slip, hold, ramp back; driven by the observer's estimate.


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


# Torque by a static table of the deviation of acceleration: readhesion paper, section 2.3.


class TorqueTableSettings(NamedTuple):
    """Numbers of the law per control period."""

    margin: float
    width: float
    pole: float
    gain: float
    rise_share: float
    fall_share: float


def lag_share(time_constant: float, period: float) -> float:
    """Share of the difference to its input by which a first-order lag moves in one `period` [s]."""
    return -math.expm1(-period / time_constant)


@equation
def torque_factor(deviation, margin, width):
    """Factor Adl of Fig. 5: 1 up to `margin`, 0 from `margin` + `width` on, linear between; all [m/s2]."""
    return minimum(maximum(1.0 - (deviation - margin) / width, 0.0), 1.0)


@equation
def asymmetric_lag(value, wanted, rise_share, fall_share):
    """One period of the filter behind the table: its time constant differs between rising and falling."""
    return value + where(wanted > value, rise_share, fall_share) * (wanted - value)


@equation
def table_unit(eq, st, m, p, k, j, commanded):
    """Command of unit `j`; returns the share before the filter."""
    sign = direction(commanded)
    if math.isnan(k.speed[j]):
        k.speed[j], k.torque[j] = m.speed[j], sign * m.unit.torque_command[j]
    k.speed[j], acceleration = differentiate(k.speed[j], m.speed[j], p.pole, p.gain)
    factor = torque_factor(sign * acceleration - abs(commanded), p.margin, p.width)
    if is_relieved(m, j):
        return share_of_target(m, j)
    k.torque[j] = asymmetric_lag(
        k.torque[j], factor * sign * m.unit.torque_target[j], p.rise_share, p.fall_share
    )
    m.unit.torque_command[j] = sign * k.torque[j]
    return factor


# rim speed behind the differentiator's filter [m/s], torque behind the table's [N m]; nan: nothing yet
@dataclass(frozen=True)
class TorqueTable(BuiltInController, remembered={"speed": math.nan, "torque": math.nan}):
    """Static table of the readhesion paper, section 2.3 and Fig. 5: torque factor over the deviation of acceleration.

    The deviation is the rim's acceleration, by a pseudo-differentiator, less the commanded one. The factor is 1 up to
    `margin`, 0 from `margin` + `width` on, and linear between. Factor times target passes a filter whose time constant
    differs between rise and fall. T_u, T_d and tau are not printed. These values are of a trial that reproduces everything
    that the paper says except its half-slip, as does the best set of `studies.readhesion_paper.calibration`.

    Source: calibrated in `studies.readhesion_paper.calibration`; the readhesion paper does not print it.
    """

    name = "table"
    meaning = "torque factor by the deviation of acceleration (readhesion paper, section 2.3)"
    colour = "#c60055"
    marker = "v"
    law = table_unit

    margin: float = quantity(0.4 / 3.6, "km/h/s")
    """Deviation a_0 up to which the factor is 1 [m/s2]. Source: readhesion paper, case A, read as km/h/s."""
    width: float = quantity(0.2 / 3.6, "km/h/s")
    """Further deviation a_w over which the factor falls to 0 [m/s2]. Source: readhesion paper, case A, read as km/h/s."""
    rise: float = quantity(1.8, "s")
    """Time constant T_u of the rising torque [s]."""
    fall: float = quantity(0.25, "s")
    """Time constant T_d of the falling torque [s]."""
    time_constant: float = quantity(0.18, "s")
    """Time constant tau of the pseudo-differentiator [s]."""

    def __post_init__(self) -> None:
        OnboardError.check("table", self, ("width", "rise", "fall", "time_constant"), ("margin",))

    def settings(self, period: float) -> TorqueTableSettings:
        """Numbers of the law for a control `period` [s]."""
        pole = 1.0 / self.time_constant
        return filled(
            TorqueTableSettings, self, pole=pole, gain=differentiator_gain(pole, period),
            rise_share=lag_share(self.rise, period), fall_share=lag_share(self.fall, period),
        )  # fmt: skip
