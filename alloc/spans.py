"""Stretches of a series in which something holds."""

import numpy as np
from numpy.typing import NDArray


def spans(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First instant and first one after it of every stretch in which `flags` (instants,) are true, (spans, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2)
