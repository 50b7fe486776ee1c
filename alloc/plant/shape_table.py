"""The shape of a user's own adhesion curve as a table, which the plant interpolates."""

from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.errors import PlantError

SHAPE_KNOTS = 16_384
KNOTS = np.append(np.arange(SHAPE_KNOTS) / np.arange(SHAPE_KNOTS, 0, -1), 1e6)
"""Slip over that of the peak at equal steps of slip / (slip + that of the peak); the last, infinity, as a large number."""


class Shaped(Protocol):
    """What has a shape over the slip velocity; equal ones have equal hashes."""

    def shape(self, slip: NDArray[np.float64]) -> ArrayLike:
        """Coefficient at `slip` >= 0 [m/s] to any scale."""

    def __hash__(self: object) -> int: ...


@lru_cache(maxsize=32)
def shape_table(curve: Shaped) -> NDArray[np.float64]:
    """Slip velocity of the peak [m/s], then the shape over the peak's at `KNOTS`; raises `PlantError` for no such curve."""
    owner = f"adhesion curve {type(curve).__name__}"
    slip = np.concatenate([[0.0], np.geomspace(1e-4, 20.0, 20_000)])
    values = np.asarray(curve.shape(slip), dtype=float)
    if values.shape != slip.shape or not np.all(np.isfinite(values)) or values.min() < -1e-9:
        raise PlantError(
            f"{owner}: shape must give a finite value, 0 or greater, per slip velocity"
        )
    top = int(values.argmax())
    if not 0 < top < slip.size - 1 or abs(values[0]) > 1e-6 * values[top]:
        raise PlantError(f"{owner}: shape must rise from 0 to one maximum below 20 m/s")
    at_knots = np.asarray(curve.shape(slip[top] * KNOTS), dtype=float)
    table = np.concatenate([[slip[top]], at_knots / values[top]])
    table.flags.writeable = False
    return table
