"""Names beside lines instead of a legend, each where it is farthest from every other line."""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

PLACES = 60
"""Places along a line that are tried."""
FINE = 400
"""Points of a line that a name keeps away from."""
GAPS = (2.5, 5.5, 9.0)
"""Distances of a name from its own line [points] that are tried, at the place that it belongs to."""
SIZE = 7.0
"""Of type [points]."""
ASIDE = (0.5, 0.0, 1.0)
"""Shares of a name that stand left of its place."""
MARGIN = 3.0
"""Distance of a name from the frame [points]."""
ENOUGH = 10.0
"""Distance to the others [points] beyond which a place is as good as any."""
HALO = [withStroke(linewidth=1.5, foreground="white")]
"""What keeps a name legible where it must cross a line."""

Floats = NDArray[np.float64]


def label_lines(*panels: Axes) -> None:
    """Write each line's label above or below it, in its colour; call it when the rest of the figure is complete.

    Lines without a label, or with one that begins with an underscore, are not named. Names keep away from
    all lines and texts.
    """
    figure = panels[0].get_figure(root=True)
    if figure is not None:
        figure.draw_without_rendering()  # panels get the place that they have on the page
    for axes in panels:
        _label_panel(axes)


def _label_panel(axes: Axes) -> None:
    every = axes.get_lines()
    lines = [line for line in every if not str(line.get_label()).startswith("_")]
    points = 72.0 / axes.get_figure(root=True).dpi  # type: ignore[union-attr]
    drawn = {line: _on_page(axes, line, points) for line in every}
    frame = np.asarray(axes.bbox.extents) * points + MARGIN * np.array([1.0, 1.0, -1.0, -1.0])
    taken = [points * np.asarray(text.get_window_extent().extents) for text in axes.texts]
    for line in lines:
        own = drawn[line]
        if not len(own):
            continue
        words = axes.text(
            0.0, 0.0, str(line.get_label()), color=line.get_color(), fontsize=SIZE, va="bottom", path_effects=HALO,
        )  # fmt: skip
        extent = words.get_window_extent()
        size = extent.width * points, extent.height * points
        others = [where for one, where in drawn.items() if one is not line]
        box = _best(own, others, taken, size, frame)
        x, y = axes.transData.inverted().transform(box[:2] / points)
        words.set_position((float(x), float(y)))
        taken.append(box)


def _on_page(axes: Axes, line: Line2D, points: float) -> Floats:
    """Points of a line inside its panel [points of the page], (n, 2), close to each other."""
    x, y = (np.asarray(axis(values), dtype=float) for axis, values in (
        (axes.convert_xunits, line.get_xdata(orig=False)), (axes.convert_yunits, line.get_ydata(orig=False)),
    ))  # fmt: skip
    page = axes.transData.transform(np.column_stack([x, y])) * points
    page = page[np.isfinite(page).all(axis=1)]
    if len(page) < 2:
        return page
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(page, axis=0).T))])
    even = np.linspace(0.0, length[-1], FINE)
    page = np.column_stack([np.interp(even, length, page[:, k]) for k in (0, 1)])
    low, high = np.reshape(axes.bbox.extents, (2, 2)) * points
    return np.asarray(page[((page >= low - 1.0) & (page <= high + 1.0)).all(axis=1)])


def _meet(box: Floats, other: Floats) -> bool:
    """Whether two boxes have a common place."""
    return bool((box[:2] < other[2:]).all() and (other[:2] < box[2:]).all())


def _distance(box: Floats, to: Floats) -> float:
    """Least distance of points (n, 2) from a box; 0 inside."""
    if not len(to):
        return np.inf
    outside = np.maximum(np.maximum(box[:2] - to, to - box[2:]), 0.0)
    return float(np.hypot(*outside.T).min())


def _places(
    own: Floats, size: tuple[float, float], frame: Floats
) -> Iterator[tuple[Floats, Floats]]:
    """Places along a line, each with a box (left, bottom, right, top) above or below it that is within the panel."""
    width, height = size
    for place in own[np.linspace(0, len(own) - 1, PLACES).astype(int)]:
        for aside, gap in product(ASIDE, GAPS):
            left = place[0] - aside * width
            left = float(np.clip(left, frame[0], max(frame[2] - width, frame[0])))
            for bottom in (place[1] + gap, place[1] - gap - height):
                if bottom >= frame[1] and bottom + height <= frame[3]:
                    yield place, np.array([left, bottom, left + width, bottom + height])


def _best(
    own: Floats,
    others: Sequence[Floats],
    taken: Sequence[Floats],
    size: tuple[float, float],
    frame: Floats,
) -> Floats:
    """The first box that is far enough from all lines, or that farthest from them, outside of `taken` boxes."""
    best, choice = -1.0, np.array([*frame[:2], *(frame[:2] + size)])
    rest = np.concatenate([*others, np.empty((0, 2))])
    for place, box in _places(own, size, frame):
        if any(_meet(box, other) for other in taken):
            continue
        # its own line passes at the first gap; nearer, it would cross the name
        score = min(_distance(box, rest), ENOUGH, (ENOUGH / GAPS[0]) * _distance(box, own))
        # where lines lie on each other, a name would be of either
        apart = min(_distance(np.tile(place, 2), rest) / ENOUGH, 1.0)
        score = apart * (score + 1.0)
        if score > best + 1e-6:
            best, choice = score, box
    return choice
