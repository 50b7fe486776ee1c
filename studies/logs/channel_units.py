"""Units of a log's channels, by the library pint; what loggers write in ways of their own is spelt for it here."""

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from studies.files.study_error import StudyError

if TYPE_CHECKING:
    from pint import UnitRegistry

SPELT = {
    "kmh": "km/hour", "km/h": "km/hour", "kph": "km/hour", "kmph": "km/hour", "mph": "mile/hour",
    "ms": "m/s", "rads": "rad/s", "1/min": "rpm", "u/min": "rpm", "min-1": "rpm", "min^-1": "rpm", "r/min": "rpm",
    "umin": "rpm", "1/s": "turn/s", "hz": "turn/s", "kmhs": "km/hour/s", "km/h/s": "km/hour/s",
    "ms2": "m/s**2", "m/s2": "m/s**2", "m/s^2": "m/s**2", "g": "g_0",
    "nm": "N*m", "knm": "kN*m", "n": "N", "kn": "kN", "mn": "MN", "dan": "daN", "kgf": "kgf", "lbf": "lbf", "kp": "kgf",
    "kpa": "kPa", "mpa": "MPa", "pa": "Pa", "hpa": "hPa", "psi": "psi", "bar": "bar", "mbar": "mbar",
    "kgf/cm2": "kgf/cm**2", "kgf/cm^2": "kgf/cm**2", "kg/cm2": "kgf/cm**2", "kgf/cm²": "kgf/cm**2", "kg/cm²": "kgf/cm**2",
    "kt": "knot", "kts": "knot", "knots": "knot",
    "permille": "1e-3", "percent": "1e-2", "m": "m", "km": "km", "mm": "mm", "mi": "mile", "ft": "ft",
    "pulses": "1", "imp": "1", "impulse": "1", "counts": "1", "count": "1", "s": "s", "sec": "s", "min": "min", "h": "hour",
    "us": "us", "ns": "ns", "msec": "ms", "millis": "ms", "": "1", "1": "1", "-": "1",
}  # fmt: skip
"""Spelling in small letters -> that of the library."""
SIGNS = {
    "‰": "1e-3",
    "%": "1e-2",
    "²": "**2",
    "³": "**3",
    "⁻¹": "**-1",
    "·": "*",
    "⋅": "*",
    "µ": "u",
    "μ": "u",
}
SCALED = re.compile(r"(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)[*x·]?([^\d/*.^+-].*)")
"""A number and a unit: the worth of a digit, such as 0.01 km/h."""
SI = {
    "time": "s", "speed": "m/s", "turning": "rad/s", "force": "N", "torque": "N*m", "acceleration": "m/s**2",
    "slope": "1", "position": "m", "pressure": "Pa", "pulses": "1",
}  # fmt: skip
"""Unit of the analysis by kind of quantity."""


@lru_cache(maxsize=1)
def registry() -> "UnitRegistry[Any]":
    """The library's units."""
    try:
        import pint
    except ImportError:
        raise StudyError(
            "units of a log need the package pint; install it with `pip install pint`"
        ) from None
    return pint.UnitRegistry()


def clean(unit: str) -> str:
    """A unit without brackets and blanks."""
    return re.sub(r"[\s\[\](){}<>]", "", unit)


def _spelt(unit: str) -> str:
    text = clean(unit)
    known = SPELT.get(text.lower())
    if known is not None and not (text in ("g", "ms") and known == "g_0" and text != "g"):
        return known
    for sign, word in SIGNS.items():
        text = text.replace(sign, word)
    return text


@lru_cache(maxsize=512)
def factor(unit: str, kind: str) -> float | None:
    """What a value in `unit` is multiplied with to be in the unit of `SI[kind]`; None for a unit of something else."""
    text = clean(unit)
    if kind == "time" and text.lower() == "ms":
        return 1e-3
    scaled = SCALED.fullmatch(text)
    if scaled and text.lower() not in SPELT:
        whole = factor(scaled[2], kind)
        return None if whole is None else float(scaled[1]) * whole
    units, number = registry(), _number(unit)
    try:
        one = units.Quantity(number, "") if number else units.Quantity(1.0, _spelt(unit))
        return float(one.to(SI[kind]).magnitude)
    except Exception:  # the library has many errors for what is no unit
        return None


def _number(unit: str) -> float | None:
    """The number that a unit without dimension is."""
    try:
        return float(_spelt(unit))
    except ValueError:
        return None


def kinds_of(unit: str) -> list[str]:
    """Kinds of quantities that a unit can be of."""
    return [kind for kind in SI if factor(unit, kind) is not None]
