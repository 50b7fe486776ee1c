"""Columns of a log: names with units, what they mean, and how to read them.

Axles and cars count from 1, the foremost; coupler k joins the cars k and k + 1. Traction is positive, braking negative,
tension positive. Columns of other names are told by a mapping file (`studies.logs.mapping`), or guessed
(`studies.logs.guessing`).
"""

import math
import re
from typing import NamedTuple

from studies.files.study_error import nearest


class Quantity(NamedTuple):
    """A measured quantity: ending of its column -> factor to SI, what it is, and whether a log must have it."""

    units: dict[str, float]
    description: str
    required: bool = False
    kind: str = ""
    """Kind of its unit, see `studies.logs.channel_units.SI`; a speed of an axle may be a turning speed too."""


QUANTITIES: dict[str, Quantity] = {
    "time": Quantity({"s": 1.0}, "time since any origin, an epoch, or a time stamp", True, "time"),
    "speed": Quantity(
        {"kmh": 1.0 / 3.6, "ms": 1.0},
        "speed of the train over ground, not of a wheel; without it the speed is estimated from speed and torque or "
        "force of the axles, of all driven ones at least",
        kind="speed",
    ),
    "gradient": Quantity({"permille": 1e-3}, "rise per run where the train is", kind="slope"),
    "position": Quantity(
        {"m": 1.0, "km": 1e3}, "station of the train's front on the line of --line", kind="position"
    ),
    "axleN_speed": Quantity(
        {"kmh": 1.0 / 3.6, "ms": 1.0, "rads": 1.0, "rpm": 2.0 * math.pi / 60.0},
        "circumferential or turning speed of the wheels of axle N; of one axle at least",
        True,
        "speed",
    ),
    "axleN_pulses": Quantity(
        {"1": 1.0},
        "pulses of a wheel sensor counted so far, or since the row before; the mapping file has the pulses of a turn",
        kind="pulses",
    ),
    "axleN_torque": Quantity(
        {"nm": 1.0, "knm": 1e3},
        "torque of motor and brake together on the wheelset of axle N (motor torque times gear ratio)",
        kind="torque",
    ),
    "axleN_force": Quantity(
        {"n": 1.0, "kn": 1e3},
        "the same as a force at the rim, in place of the torque",
        kind="force",
    ),
    "axleN_pressure": Quantity(
        {"kpa": 1e3, "bar": 1e5},
        "pressure of the brake cylinder of axle N; with the mapping file's newton_per_kpa in place of a force",
        kind="pressure",
    ),
    "couplerK_force": Quantity(
        {"n": 1.0, "kn": 1e3},
        "force between the cars K and K + 1; of all couplers or none",
        kind="force",
    ),
    "carK_acceleration": Quantity(
        {"ms2": 1.0, "kmhs": 1.0 / 3.6},
        "acceleration of car K; of all cars or none",
        kind="acceleration",
    ),
    "carK_pressure": Quantity(
        {"kpa": 1e3, "bar": 1e5},
        "pressure of the brake cylinders of car K, for all its axles",
        kind="pressure",
    ),
}
"""Quantity by the stem of its column; N and K represent numbers. A turning speed uses the train's radius."""

TURNING = ("rads", "rpm")
"""Endings of turning speeds."""
WHEEL = ("axleN_speed", "axleN_pulses")
"""Quantities from which the speed of a wheel follows: an axle has one of them."""
EFFORT = ("axleN_torque", "axleN_force", "axleN_pressure")
"""Quantities from which the force on an axle follows: an axle has one of them."""


class Column(NamedTuple):
    """Meaning of a column's name."""

    name: str
    quantity: str
    number: int
    """From 1; 0 for a quantity of the whole train."""
    unit: str


def column_names() -> dict[str, str]:
    """Every column that a log may have, its units by |, and its meaning."""
    return {
        f"{stem}_{'|'.join(quantity.units)}": quantity.description
        + (" (required)" if quantity.required else "")
        for stem, quantity in QUANTITIES.items()
    }


def parse_column(name: str) -> Column | None:
    """Meaning of a column's name; None if it is none of `QUANTITIES`."""
    for stem, quantity in QUANTITIES.items():
        pattern = re.sub(r"(?<=[a-z])[NK](?=_)", r"([1-9]\\d*)", stem)
        found = re.fullmatch(rf"{pattern}_({'|'.join(quantity.units)})", name)
        if found:
            *number, unit = found.groups()
            return Column(name, stem, int(number[0]) if number else 0, unit)
    return None


def column_of(stem: str, number: int, unit: str) -> str:
    """Name of the column of a quantity, its number and its unit."""
    return re.sub(r"(?<=[a-z])[NK](?=_)", str(number), stem) + f"_{unit}"


def near_column(name: str) -> str | None:
    """The name that a misspelt column resembles most; None if it resembles none."""
    digits = re.search(r"\d+", name)
    number = int(digits.group()) if digits else 1
    known = [
        column_of(stem, number, unit)
        for stem, quantity in QUANTITIES.items()
        for unit in quantity.units
    ]
    return nearest(name, known)
