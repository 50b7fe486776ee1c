"""Torque by a static table of the deviation of acceleration: readhesion paper, section 2.3."""

import math

from alloc.compilation import equation
from alloc.onboard.detector import differentiator_gain
from alloc.onboard.readhesion.parameters import TorqueTable


def lag_share(time_constant: float, period: float) -> float:
    """Share of the way to its input that a first-order lag goes in one `period` [s]."""
    return -math.expm1(-period / time_constant)


def table_constants(table: TorqueTable, period: float) -> tuple[float, ...]:
    """Constants of the law per `period` [s]: margin, width, pole and gain of the differentiator, shares of rise and fall."""
    pole = 1.0 / table.time_constant
    return (
        table.margin,
        table.width,
        pole,
        differentiator_gain(pole, period),
        lag_share(table.rise, period),
        lag_share(table.fall, period),
    )


@equation
def torque_factor(deviation, margin, width):
    """Factor Adl of Fig. 5: 1 up to `margin`, 0 from `margin` + `width` on, linear between; all [m/s2]."""
    return min(max(1.0 - (deviation - margin) / width, 0.0), 1.0)


@equation
def asymmetric_lag(value, wanted, rise_share, fall_share):
    """One period of the filter behind the table: its time constant differs between rising and falling."""
    return value + (rise_share if wanted > value else fall_share) * (wanted - value)
