"""What files say in numbers: sizes that no railway knows, numbers in quotes, and a record's values in SI."""

import math
import reprlib
from typing import Any

from pydantic import BaseModel

from alloc import units
from alloc.units import UNITS, Unit, unit_of


def unit_called(symbol: str) -> Unit:
    """Unit by its symbol, such as "km/h"; raises `KeyError` for one that files do not have."""
    return {unit.symbol: unit for unit in UNITS}[symbol]


def stated(key: str, size: float) -> float:
    """A random draw as a file may state it: 0 where it happens to be smaller than the least size of its unit."""
    return size if abs(size) >= unit_of(key).least else 0.0


def range_fault(key: str, value: Any) -> str | None:
    """What is wrong with a value, or with one of several, whose size no railway knows; None if nothing is."""
    *_, least, most = unit_of(key)
    for number in value if isinstance(value, tuple) else (value,):
        size = abs(number) if isinstance(number, float | int) else 0.0
        if size in (0.0, math.inf) or least <= size <= most:
            continue
        bound = f"at most {most:g}" if size > most else f"0 or at least {least:g}"
        of_several = f"{shown(number)} " if isinstance(value, tuple) else ""
        return f"{of_several}must be {bound} in size"
    return None


def is_number(text: str) -> bool:
    """Whether a text says a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def shown(value: object) -> str:
    """A value as a message shows it, shortened where it is long."""
    short = reprlib.Repr()
    short.maxstring = short.maxother = short.maxlong = 80
    return short.repr(value)


def si(record: BaseModel) -> dict[str, Any]:
    """Plain values of a record that were given, as SI values under names without the unit; nested records stay out."""
    return units.si({key: value for key, value in record if not isinstance(value, BaseModel)})
