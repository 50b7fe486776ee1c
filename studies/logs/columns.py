"""Columns of a log: names with units, what they mean, and how to read them.

A log is a table, CSV with decimal points and commas between columns or parquet, one row per instant. Axles and cars count
from 1, the foremost; coupler k joins the cars k and k + 1. Traction is positive, braking negative, tension positive.
"""

import re
from typing import NamedTuple

from studies.files.study_error import nearest


class Quantity(NamedTuple):
    """A measured quantity: ending of its column -> factor to SI, what it is, and whether a log must have it."""

    units: dict[str, float]
    description: str
    required: bool = False


QUANTITIES: dict[str, Quantity] = {
    "time": Quantity({"s": 1.0}, "time since any origin, growing from row to row", True),
    "speed": Quantity(
        {"kmh": 1.0 / 3.6, "ms": 1.0},
        "speed of the train over ground, not of a wheel; without it the speed is estimated from speed and torque or "
        "force of the axles, of all driven ones at least",
    ),
    "gradient": Quantity(
        {"permille": 1e-3}, "rise per run where the train is, for the estimate of its speed"
    ),
    "axleN_speed": Quantity(
        {"kmh": 1.0 / 3.6, "ms": 1.0, "rads": float("nan")},
        "circumferential or angular speed of the wheels of axle N; of one axle at least",
        True,
    ),
    "axleN_torque": Quantity(
        {"nm": 1.0, "knm": 1e3},
        "torque of motor and brake together on the wheelset of axle N (motor torque times gear ratio)",
    ),
    "axleN_force": Quantity(
        {"n": 1.0, "kn": 1e3}, "the same as a force at the rim, in place of the torque"
    ),
    "couplerK_force": Quantity(
        {"n": 1.0, "kn": 1e3}, "force between the cars K and K + 1; of all couplers or none"
    ),
    "carK_acceleration": Quantity(
        {"ms2": 1.0, "kmhs": 1.0 / 3.6}, "acceleration of car K; of all cars or none"
    ),
}
"""Quantity by the stem of its column; N and K stand for numbers. A rotational speed in rad/s takes the train's radius."""


class Column(NamedTuple):
    """What the name of a column says."""

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
    """What a column's name says; None if it is none of `QUANTITIES`."""
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
