"""Content of the telegrams that the units of a train exchange under the joint MPC, as numbers.

Reports go to the leader and orders come from it; the rules' own report and limit are in the same telegrams.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from alloc.onboard.attachment import AddedNumbers
from alloc.onboard.host import UnitContext, UnitSense
from alloc.plant.structure import Floats


class Report(NamedTuple):
    """Report of a unit to the leader; in the direction of the demand."""

    time: float
    """Instant of its readings [s]."""
    speed: float
    omega: Floats
    torque: float
    command: float
    """Torque command in force from then on [N m]."""
    target: float
    """Torque that the driver wants of it [N m]; signed in a telegram, for it says which direction that is."""
    limit: float
    """Largest torque of its motors [N m]."""
    peak: Floats
    """Believed peak coefficient of its axles, (axles,)."""
    peak_slip: float
    """Of the believed curve [m/s], as is `steepness`."""
    steepness: float
    carried: float
    """Torque that its weakest axle is believed to carry beside the air brake [N m]."""
    air: float
    """Torque of the air brake at each wheelset [N m]."""


class Order(NamedTuple):
    """What the leader wants of a unit; in force when it arrives."""

    torque: float
    """[N m], in the direction of the demand."""
    demand: float
    """Driver's demand on the unit for which it was found [N m], signed: the driver's hand acts without telegrams."""


PER_AXLE = ("omega", "peak")
PER_UNIT = tuple(name for name in Report._fields if name not in PER_AXLE)


def added_numbers(contexts: Sequence[UnitContext]) -> AddedNumbers:
    """Numbers that reports and orders take; a report has room for the unit with the most axles."""
    axles = max(context.axles for context in contexts)
    return AddedNumbers(len(PER_UNIT) + axles * len(PER_AXLE), len(Order._fields))


def write_report(report: Report, numbers: Floats) -> None:
    """Put the report into the `numbers` of a telegram, (numbers,)."""
    single = [getattr(report, name) for name in PER_UNIT]
    written = np.concatenate([single, *(getattr(report, name) for name in PER_AXLE)])
    numbers[: written.size] = written


def read_report(numbers: Floats, axles: int) -> Report | None:
    """Report of a unit with this number of `axles` in the `numbers` of a telegram; None if there is none."""
    if math.isnan(numbers[0]):
        return None
    fields: dict[str, Any] = dict(zip(PER_UNIT, numbers.tolist(), strict=False))
    each = numbers[len(PER_UNIT) : len(PER_UNIT) + axles * len(PER_AXLE)].reshape(-1, axles)
    return Report(**(fields | dict(zip(PER_AXLE, each.copy(), strict=True))))


def read_order(numbers: Floats) -> Order | None:
    """Order in the `numbers` of a telegram; None if it has none."""
    order = Order(*numbers.tolist())
    return None if math.isnan(order.torque) else order


def ordered_target(order: Order | None, sense: UnitSense) -> float:
    """Torque target of a unit [N m]: the driver's where there is no order for this direction.

    Else the order, in proportion to what the driver wants now, within what the motors can.
    """
    if order is None or order.demand * sense.target <= 0.0:
        return sense.target
    limit = sense.drive_limit if sense.target > 0.0 else sense.brake_limit
    torque = order.torque * sense.target / order.demand
    return math.copysign(min(abs(torque), limit), sense.target)
