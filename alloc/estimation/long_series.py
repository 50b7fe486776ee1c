"""What a long series tells by pieces of it, as well as by the whole."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PIECES, PIECE = 20, 5000
"""Number of pieces of a long series, and number of values in a piece."""


def excerpt(values: Floats) -> Floats:
    """The values, or of a very long series pieces of `PIECE` from all over, which tell its noise and its pattern."""
    if values.size <= PIECES * PIECE:
        return values
    starts = np.linspace(0, values.size - PIECE, PIECES).astype(np.int64)
    return np.concatenate([values[k : k + PIECE] for k in starts])


def usual_period(time: Floats) -> float:
    """Median time between two of two or more instants [s]."""
    return float(np.median(np.diff(excerpt(time))))
