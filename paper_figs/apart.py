"""Marks that stand on one point, moved apart so that each is seen, with a line from each to its own point."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from paper_figs.palette import GREY
from paper_figs.style import Look

POINTS = 72.0
"""Points in an inch."""
ROUNDS = 400
"""Most rounds of moving apart; three dozen marks on one point need fewer."""
SEEN = 0.5
"""Offset [points] from which on a line leads to a mark's point."""
TURN = 2.399963
"""Golden angle [rad]: marks on exactly one point leave it in directions that stay different."""


class Mark(NamedTuple):
    """A mark: where it stands in the units of the axes, and its look."""

    x: float
    y: float
    look: Look


def marks_apart(drawn: Figure, panels: Sequence[tuple[Axes, Sequence[Mark]]], least: float) -> None:
    """Draw the marks of `panels` with centres `least` [points] apart or more; limits of the axes must be set before.

    A mark that moves keeps its numbers: it is drawn at its point with an offset on the page.
    """
    drawn.draw_without_rendering()  # the layout decides how far two points are from each other
    to_points = POINTS / drawn.dpi
    for axes, marks in panels:
        if not marks:
            continue
        places = axes.transData.transform([(mark.x, mark.y) for mark in marks])
        moved = apart(to_points * places, least) / to_points
        offsets = (moved - places) / drawn.dpi
        ends = axes.transData.inverted().transform(moved)
        leaders = [
            [(mark.x, mark.y), end]
            for mark, end, offset in zip(marks, ends, offsets, strict=True)
            if np.hypot(*offset) * POINTS > SEEN
        ]
        axes.add_collection(LineCollection(leaders, colors=GREY, linewidths=0.4), autolim=False)
        for mark, (right, up) in zip(marks, offsets, strict=True):
            shift = ScaledTranslation(right, up, drawn.dpi_scale_trans)
            look: dict[str, Any] = {"zorder": 3, **mark.look}
            axes.plot([mark.x], [mark.y], transform=axes.transData + shift, **look)


def apart(places: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Places (n, 2) nearest to these, by rounds of pushing, with at least this distance between any two."""
    found = np.array(places, dtype=np.float64)
    angles = TURN * np.arange(len(found))
    found += 1e-3 * least * np.column_stack([np.cos(angles), np.sin(angles)])
    for _ in range(ROUNDS):
        gaps = found[:, None] - found[None]
        distances = np.hypot(gaps[..., 0], gaps[..., 1])
        np.fill_diagonal(distances, np.inf)
        lacking = np.maximum(1.02 * least - distances, 0.0)
        if distances.min(initial=np.inf) >= least:
            break
        found += 0.5 * (gaps / distances[..., None] * lacking[..., None]).sum(axis=1)
    return found
