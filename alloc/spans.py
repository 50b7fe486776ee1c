"""Stretches of a series in which a condition is true."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


def spans(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First instant and first one after it of every stretch in which `flags` (instants,) are true, (spans, 2)."""
    padded = np.zeros(flags.size + 2, dtype=np.bool_)
    padded[1:-1] = flags
    return np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)


def bridged_spans(
    flags: NDArray[np.bool_], near: Callable[[int, int], bool]
) -> list[tuple[int, int]]:
    """As `spans`, but neighbours that are close count as one span.

    `near` gets the end of a span and the begin of the next one, as indices, and says whether they are close.
    """
    merged: list[tuple[int, int]] = []
    for begin, end in spans(flags).tolist():
        if merged and near(merged[-1][1], begin):
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((begin, end))
    return merged
