"""What a picture can show of many numbers: points of a long line, and cells of a map that look alike."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from matplotlib.image import AxesImage
from numpy.typing import NDArray

Floats = NDArray[np.float64]
COLUMNS = 1000
"""Columns of dots that a panel has at most, in print."""
MOST_CELLS = 4000
"""Cells of a picture that are all told; of more, neighbours of one shade are told together."""


class Stretch(NamedTuple):
    """Neighbouring cells of one row that have the same shade."""

    row: int
    first: int
    """Its first column."""
    end: int
    """The column after its last."""
    value: float
    """Mean of the cells."""


def shown_points(x: Floats, y: Floats) -> NDArray[np.int64]:
    """Numbers of the points that decide how a line looks: the first, last, lowest and highest in each column of dots.

    All of them where there are few, or where the line does not run from left to right. Source: Jugel et al., M4: a
    visualization-oriented time series data aggregation, VLDB 2014.
    """
    count = len(x)
    known = np.isfinite(x) & np.isfinite(y)
    # a gap ends a line, so lines with gaps stay as they are
    if count <= 4 * COLUMNS or not known.all() or (np.diff(x) < 0.0).any() or x[0] == x[-1]:
        return np.arange(count)
    column = np.minimum((x - x[0]) / (x[-1] - x[0]) * COLUMNS, COLUMNS - 1).astype(int)
    begin = np.flatnonzero(np.diff(column, prepend=-1))
    end = np.append(begin[1:], count)
    extreme = [
        start + at
        for start, stop in zip(begin.tolist(), end.tolist(), strict=True)
        for at in (int(y[start:stop].argmin()), int(y[start:stop].argmax()))
    ]
    return np.unique(np.concatenate([begin, end - 1, extreme]).astype(np.int64))


def stretches(image: AxesImage, cells: Floats) -> Iterator[Stretch]:
    """The cells (row, column) of a picture in stretches of one shade; unknown ones are left out."""
    scaled: Floats = np.ma.filled(
        np.ma.asarray(image.norm(np.ma.masked_invalid(cells)), float), -1.0
    )
    shade = np.floor(scaled * image.get_cmap().N).astype(int)
    for row, own in enumerate(shade):
        begin = np.flatnonzero(np.diff(own, prepend=own[0] - 1))
        for first, end in zip(begin.tolist(), [*begin[1:].tolist(), own.size], strict=True):
            values = cells[row, first:end]
            if np.isfinite(values).all():
                yield Stretch(row, first, end, float(values.mean()))
