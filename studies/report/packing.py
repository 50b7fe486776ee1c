"""Recorded series as short text: whole steps of a stated resolution, differences in time, deflated, base64.

A browser takes it apart without any library (`unpack.js`). A replay of 32 axles and 20 s takes some 10 kB; its
numbers in single precision would take 300 kB.
"""

import base64
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST_STEPS = 32_000
"""Steps of the resolution up to which a number is kept; where a series goes beyond, its steps are longer."""
NOTHING = -32_768
"""Represents a missing number, such as a limit that is not set."""


@dataclass(frozen=True)
class Packed:
    """Series by name, each (instants,) or (instants, n), in one text."""

    text: str
    columns: dict[str, int | None]
    """Columns of each series, in their order; None for a series of one number per instant."""
    steps: dict[str, float]
    """What one step of each series is worth, in its unit: no number is off by more than half of it."""
    instants: int

    def content(self) -> dict[str, Any]:
        """The same as plain values, as the page keeps them."""
        return {
            "text": self.text,
            "instants": self.instants,
            "series": [[name, self.columns[name], self.steps[name]] for name in self.columns],
        }


def pack(series: Mapping[str, tuple[ArrayLike, float]]) -> Packed:
    """Pack series of equal length, each with the resolution that is wanted of it."""
    columns: dict[str, int | None] = {}
    steps, parts, instants = {}, [], 0
    for name, (given, resolution) in series.items():
        values = np.asarray(given, dtype=float)
        columns[name] = None if values.ndim == 1 else values.shape[1]
        instants = len(values)
        known = np.isfinite(values)
        largest = float(np.abs(values[known]).max(initial=0.0))
        step = steps[name] = max(resolution, largest / MOST_STEPS)
        whole = np.full(values.shape, NOTHING, np.int64)
        whole[known] = np.rint(values[known] / step)
        table = whole if values.ndim > 1 else whole[:, None]
        change = np.diff(table, axis=0, prepend=0).astype(
            "<i2"
        )  # what wraps round comes back round
        parts.append(np.ascontiguousarray(change.T).ravel())
    numbers = np.concatenate(parts) if parts else np.empty(0, "<i2")
    planes = numbers.view(np.uint8).reshape(-1, 2).T.tobytes()  # low bytes, then high bytes
    text = base64.b64encode(zlib.compress(planes, 9)).decode()
    return Packed(text, columns, steps, instants)


def unpack(packed: Packed) -> dict[str, NDArray[np.float64]]:
    """The series again, as a browser makes them of the text."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed.text)), np.uint8)
    numbers = planes.reshape(2, -1).T.copy().view("<i2").ravel()
    found: dict[str, NDArray[np.float64]] = {}
    start = 0
    for name, columns in packed.columns.items():
        width = 1 if columns is None else columns
        size = packed.instants * width
        change = numbers[start : start + size].reshape(width, packed.instants)
        start += size
        whole = np.cumsum(change, axis=1, dtype=np.int16).T
        values = np.where(whole == NOTHING, np.nan, whole * packed.steps[name])
        found[name] = values[:, 0] if columns is None else values
    return found


def deflated(text: str) -> str:
    """A text, such as a program, deflated, as base64."""
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()
