"""Units in the names of keys: files speak km/h, t and per mille, the code SI."""

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple


class Unit(NamedTuple):
    """A unit in which files give numbers: its symbol, the SI unit as CF writes it, the ending of its keys, the factor to SI.

    `least`, `most`: least size but 0, and greatest, that its values have on a railway, generously.
    """

    symbol: str
    si: str
    ending: str
    factor: float
    least: float
    most: float


UNITS: tuple[Unit, ...] = (
    Unit("N/m3", "N m-3", "_n_per_m3", 1.0, 1.0, 1e13),
    Unit("N/m", "N m-1", "_n_per_m", 1.0, 1.0, 1e10),
    Unit("N s/m", "N s m-1", "_ns_per_m", 1.0, 1e-3, 1e9),
    Unit("N s2/m2", "N s2 m-2", "_ns2_per_m2", 1.0, 1e-6, 1e6),
    Unit("s/m", "s m-1", "_s_per_m", 1.0, 1e-4, 1e7),
    Unit("m/s", "m s-1", "_m_per_s", 1.0, 1e-3, 1e3),
    Unit("1/s", "s-1", "_per_s", 1.0, 1e-6, 1e6),
    Unit("per mille", "1", "_permille", 1e-3, 1e-6, 300.0),
    Unit("km/h/s", "m s-2", "_kmhs", 1.0 / 3.6, 1e-6, 40.0),
    Unit("km/h", "m s-1", "_kmh", 1.0 / 3.6, 1e-6, 600.0),
    Unit("kg m2", "kg m2", "_kgm2", 1.0, 1e-2, 1e5),
    Unit("J/m", "J m-1", "_j_per_m", 1.0, 1e-2, 1e7),
    Unit("kPa", "Pa", "_kpa", 1e3, 1.0, 2e3),
    Unit("kN", "N", "_kn", 1e3, 1e-3, 2e3),
    Unit("kW", "W", "_kw", 1e3, 1e-3, 1e5),
    Unit("N m", "N m", "_nm", 1.0, 1e-2, 1e6),
    Unit("mm", "m", "_mm", 1e-3, 1e-3, 1e4),
    Unit("N", "N", "_n", 1.0, 1e-9, 1e6),
    Unit("m", "m", "_m", 1.0, 1e-4, 1e7),
    Unit("t", "kg", "_t", 1e3, 1e-3, 1e4),
    Unit("s", "s", "_s", 1.0, 1e-6, 1e6),
    Unit("1", "1", "", 1.0, 1e-9, 1e6),
)
"""Units of keys; longer endings first, and last that of a pure number."""


@cache
def unit_of_key(key: str) -> Unit:
    """Unit that the ending of a key states."""
    return next(unit for unit in UNITS if key.endswith(unit.ending))


def to_si(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Plain values by their keys as SI values under names without the unit; None and tables inside stay out."""
    converted: dict[str, Any] = {}
    for key, value in keys.items():
        if value is None or isinstance(value, Mapping):
            continue
        unit = unit_of_key(key)
        if isinstance(value, list | tuple):
            value = tuple(unit.factor * number if unit.ending else number for number in value)
        elif unit.ending:
            value = unit.factor * value
        converted[key.removesuffix(unit.ending)] = value
    return converted
