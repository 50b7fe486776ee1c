"""Units in the names of keys: files speak km/h, t and per mille, the code SI."""

from typing import Any

from pydantic import BaseModel

SUFFIXES: dict[str, float] = {
    "_n_per_m3": 1.0,
    "_n_per_m": 1.0,
    "_ns_per_m": 1.0,
    "_m2_per_s2": 1.0,
    "_s_per_m": 1.0,
    "_per_m": 1.0,
    "_per_s": 1.0,
    "_permille": 1e-3,
    "_kmhs": 1.0 / 3.6,
    "_kmh": 1.0 / 3.6,
    "_mm": 1e-3,
    "_m": 1.0,
    "_t": 1e3,
    "_s": 1.0,
}
"""Ending of a key and the factor to SI; longer endings first."""

ENDINGS: dict[str, str] = {
    "1": "",
    "s": "_s",
    "1/s": "_per_s",
    "1/m": "_per_m",
    "s/m": "_s_per_m",
    "m2/s2": "_m2_per_s2",
    "km/h": "_kmh",
    "km/h/s": "_kmhs",
}
"""Ending of a key by the unit that `alloc.onboard.quantity` states."""


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
