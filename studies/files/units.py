"""Units in the names of keys: files speak km/h, t and per mille, the code SI."""

import math
import reprlib
from typing import Any

from pydantic import BaseModel

SUFFIXES: dict[str, float] = {
    "_n_per_m3": 1.0,
    "_n_per_m": 1.0,
    "_ns_per_m": 1.0,
    "_m2_per_s2": 1.0,
    "_s_per_m": 1.0,
    "_g_per_m": 1e-3,
    "_kg_per_min": 1.0 / 60.0,
    "_per_m": 1.0,
    "_per_s": 1.0,
    "_permille": 1e-3,
    "_kmhs": 1.0 / 3.6,
    "_kmh": 1.0 / 3.6,
    "_kn": 1e3,
    "_mm": 1e-3,
    "_m": 1.0,
    "_t": 1e3,
    "_s": 1.0,
}
"""Ending of a key and the factor to SI; longer endings first."""

RANGES: dict[str, tuple[float, float]] = {
    "_n_per_m3": (1.0, 1e13),
    "_n_per_m": (1.0, 1e10),
    "_ns_per_m": (1e-3, 1e9),
    "_ns2_per_m2": (1e-6, 1e6),
    "_m2_per_s2": (1e-6, 1e3),
    "_g_per_m": (1e-3, 1e3),
    "_kg_per_min": (1e-3, 1e2),
    "_per_s": (1e-6, 1e6),
    "_permille": (1e-6, 300.0),
    "_kmhs": (1e-6, 40.0),
    "_kmh": (1e-6, 600.0),
    "_kgm2": (1e-2, 1e5),
    "_kpa": (1.0, 2e3),
    "_kn": (1e-3, 2e3),
    "_kw": (1e-3, 1e5),
    "_nm": (1e-2, 1e6),
    "_mm": (1e-3, 1e4),
    "_m": (1e-4, 1e7),
    "_t": (1e-3, 1e4),
    "_s": (1e-6, 1e6),
    "": (1e-9, 1e6),
}
"""Ending of a key, longer ones first; least size but 0, and greatest, that its values have on a railway, generously."""

ENDINGS: dict[str, str] = {
    "1": "",
    "m": "_m",
    "s": "_s",
    "1/s": "_per_s",
    "1/m": "_per_m",
    "s/m": "_s_per_m",
    "m2/s2": "_m2_per_s2",
    "km/h": "_kmh",
    "km/h/s": "_kmhs",
}
"""Ending of a key by the unit that `alloc.onboard.quantity` states."""


def stated(key: str, size: float) -> float:
    """A random draw as a file may state it: 0 where it happens to be smaller than the least size of its unit."""
    least, _ = next(bounds for ending, bounds in RANGES.items() if key.endswith(ending))
    return size if abs(size) >= least else 0.0


def range_fault(key: str, value: Any) -> str | None:
    """What is wrong with a value, or with one of several, whose size no railway knows; None if nothing is."""
    least, most = next(bounds for ending, bounds in RANGES.items() if key.endswith(ending))
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
        suffix = next((s for s in SUFFIXES if key.endswith(s)), None)
        if suffix is None:
            converted[key] = value
        else:
            factor = SUFFIXES[suffix]
            scaled = (
                tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
            )
            converted[key.removesuffix(suffix)] = scaled
    return converted
