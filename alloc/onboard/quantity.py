"""Fields of parameter records that say in which unit a file gives them."""

from collections.abc import Mapping
from dataclasses import field
from typing import Any

NOT_IN_FILES = {"unit": None}
"""Metadata of a field that no scenario file sets."""


def quantity(default: Any, unit: str, names: Mapping[str, float] | None = None) -> Any:
    """A number of a parameter record, kept in SI units; MISSING: no default.

    `unit`: that of the key in scenario files, "1" for a pure number, see `studies.files.units`. `names`: values that
    have a name there.
    """
    return field(default=default, metadata={"unit": unit, "names": names or {}})
