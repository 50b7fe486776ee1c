"""Torque by a static table of the deviation of acceleration: readhesion paper, section 2.3."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from alloc.compilation import equation
from alloc.errors import OnboardError
from alloc.onboard.controllers.built_in import (
    BuiltInController,
    direction,
    share_of_target,
)
from alloc.onboard.detector import differentiate, differentiator_gain
from alloc.onboard.quantity import filled, quantity
from alloc.onboard.reference_speed.sounding import is_relieved
from alloc.plant.operations import maximum, minimum, where

if TYPE_CHECKING:
    from alloc.onboard.parameters import Onboard


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

    def constants(self, period: float) -> TorqueTableSettings:
        """Numbers of the law for a control `period` [s]."""
        pole = 1.0 / self.time_constant
        return filled(
            TorqueTableSettings, self, pole=pole, gain=differentiator_gain(pole, period),
            rise_share=lag_share(self.rise, period), fall_share=lag_share(self.fall, period),
        )  # fmt: skip

    def settings(self, onboard: "Onboard") -> TorqueTableSettings:
        """Numbers of the law."""
        return self.constants(onboard.period)
