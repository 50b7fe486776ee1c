"""Units in the names of keys: files speak km/h, t and per mille, the code SI."""

import math
import reprlib
from typing import Any, NamedTuple

from pydantic import BaseModel


class Unit(NamedTuple):
    """A unit in which files give numbers: its symbol, the ending of its keys, and the factor to SI.

    `least`, `most`: least size but 0, and greatest, that its values have on a railway, generously.
    """

    symbol: str
    ending: str
    factor: float
    least: float
    most: float


UNITS: tuple[Unit, ...] = (
    Unit("N/m3", "_n_per_m3", 1.0, 1.0, 1e13),
    Unit("N/m", "_n_per_m", 1.0, 1.0, 1e10),
    Unit("N s/m", "_ns_per_m", 1.0, 1e-3, 1e9),
    Unit("N s2/m2", "_ns2_per_m2", 1.0, 1e-6, 1e6),
    Unit("m2/s2", "_m2_per_s2", 1.0, 1e-6, 1e3),
    Unit("s/m", "_s_per_m", 1.0, 1e-4, 1e7),
    Unit("g/m", "_g_per_m", 1e-3, 1e-3, 1e3),
    Unit("kg/min", "_kg_per_min", 1.0 / 60.0, 1e-3, 1e2),
    Unit("1/m", "_per_m", 1.0, 1e-4, 1e7),
    Unit("1/s", "_per_s", 1.0, 1e-6, 1e6),
    Unit("per mille", "_permille", 1e-3, 1e-6, 300.0),
    Unit("km/h/s", "_kmhs", 1.0 / 3.6, 1e-6, 40.0),
    Unit("km/h", "_kmh", 1.0 / 3.6, 1e-6, 600.0),
    Unit("kg m2", "_kgm2", 1.0, 1e-2, 1e5),
    Unit("kPa", "_kpa", 1e3, 1.0, 2e3),
    Unit("kN", "_kn", 1e3, 1e-3, 2e3),
    Unit("kW", "_kw", 1e3, 1e-3, 1e5),
    Unit("N m", "_nm", 1.0, 1e-2, 1e6),
    Unit("mm", "_mm", 1e-3, 1e-3, 1e4),
    Unit("N", "_n", 1.0, 1e-9, 1e6),
    Unit("m", "_m", 1.0, 1e-4, 1e7),
    Unit("t", "_t", 1e3, 1e-3, 1e4),
    Unit("s", "_s", 1.0, 1e-6, 1e6),
    Unit("1", "", 1.0, 1e-9, 1e6),
)
"""Units of keys; longer endings first, and last that of a pure number."""


def unit_of(key: str) -> Unit:
    """Unit that the ending of a key states."""
    return next(unit for unit in UNITS if key.endswith(unit.ending))


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
    converted: dict[str, Any] = {}
    for key in type(record).model_fields:
        value = getattr(record, key)
        if value is None or isinstance(value, BaseModel):
            continue
        unit = unit_of(key)
        if unit.ending:
            several = isinstance(value, tuple)
            value = tuple(unit.factor * v for v in value) if several else unit.factor * value
        converted[key.removesuffix(unit.ending)] = value
    return converted
