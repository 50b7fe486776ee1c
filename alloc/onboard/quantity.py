"""Fields of parameter records: the unit in which a file gives them, and what compiled code takes of them."""

from collections.abc import Mapping
from dataclasses import field
from typing import Any, TypeVar

Filled = TypeVar("Filled")

NOT_IN_FILES = {"unit": None}
"""Metadata of a field that no scenario file sets."""


def quantity(
    default: Any, unit: str, names: Mapping[str, float] | None = None, most: float | None = None
) -> Any:
    """A number of a parameter record, kept in SI units; MISSING: no default.

    `unit`: that of the key in scenario files, "1" for a pure number, see `studies.files.units`. `names`: values that
    have a name there. `most`: the greatest value that a file may give.
    """
    return field(default=default, metadata={"unit": unit, "names": names or {}, "most": most})


def filled(kind: type[Filled], source: Any, **others: Any) -> Filled:
    """Named tuple `kind` of the fields of `source` that have the same names, and of `others`.

    Every number gets the type that its field states: another type would make Numba compile everything again.
    """
    values = {}
    for name, stated in kind.__annotations__.items():
        value = others[name] if name in others else getattr(source, name)
        values[name] = stated(value) if stated in (float, int, bool) else value
    return kind(**values)
