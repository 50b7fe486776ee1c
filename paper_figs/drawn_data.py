"""The numbers that a figure shows, read from what is drawn: nothing can stand in the picture and not in the table."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import FillBetweenPolyCollection, QuadMesh
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle, StepPatch
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FixedLocator, FuncFormatter
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = Iterator[dict[str, Any]]
COLUMNS = (
    "panel", "kind", "series", "x_axis", "y_axis", "place", "x", "x_low", "x_high", "y", "y_low", "y_high", "value",
)  # fmt: skip
"""Columns of the table; ends of intervals, bars and areas are `low` and `high`, numbers of images and notes `value`."""
DOTS = 1000
"""Columns of dots that a panel has at most, in print."""
MOST_CELLS = 4000
"""Cells of a picture that are all told; of more, neighbours of one shade are told together."""
NEAR = 0.5
"""Half the distance of two named places on an axis of names."""


def drawn_data(figure: Figure) -> pd.DataFrame:
    """Rows of every panel: what kind of mark, whose, and its numbers in the units of the axes.

    A series has the mark's `gid`, or its label in the legend. What spans an axis, such as a threshold, has one number.
    Of long lines and of maps it has what the picture can show.
    """
    rows = [
        {"panel": name, **row} for name, axes in _panels(figure).items() for row in rows_of(axes)
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS)).dropna(axis="columns", how="all")


def rows_of(axes: Axes) -> list[dict[str, Any]]:
    """Rows of one panel."""
    axis_names = {"x_axis": _plain(axes.get_xlabel()), "y_axis": _plain(axes.get_ylabel())}
    along, up = _named_places(axes.xaxis), _named_places(axes.yaxis)

    def place(row: dict[str, Any]) -> str:
        return " ".join(filter(None, (_nearest(along, row.get("x")), _nearest(up, row.get("y")))))

    return [
        {**axis_names, "place": place(row), **row}
        for row in _marks(axes)
        if not all(_nothing(value) for key, value in row.items() if key not in ("kind", "series"))
    ]


def _panels(figure: Figure) -> dict[str, Axes]:
    """Panels by title, or by their number; those of a colour bar show no data."""
    found: dict[str, Axes] = {}
    for k, axes in enumerate(figure.axes, 1):
        if axes.get_visible() and axes.get_label() != "<colorbar>":
            titles = (axes.get_title(side) for side in ("center", "left", "right"))
            title = _plain(next(filter(None, titles), ""))
            found[f"{k} {title}".strip()] = axes
    return found


def _marks(axes: Axes) -> Rows:
    done: set[Artist] = set()
    for container in axes.containers:
        done.update(_parts(container))
        if isinstance(container, ErrorbarContainer):
            yield from _intervals(container)
        elif isinstance(container, BarContainer):
            for bar in container.patches:
                yield _rectangle(_series(container, bar), bar)
    for artist in axes.get_children():
        if artist in done or not artist.get_visible():
            continue
        if isinstance(artist, Line2D):
            yield from _line(axes, artist)
        elif isinstance(artist, FillBetweenPolyCollection):
            yield from _area(artist)
        elif isinstance(artist, StepPatch):
            values, edges, _ = artist.get_data()
            for value, low, high in zip(values, edges[:-1], edges[1:], strict=True):
                yield {"kind": "step", "series": _series(artist), "x_low": low, "x_high": high, "y": value}  # fmt: skip
        elif isinstance(artist, AxesImage | QuadMesh):
            yield from _cells(artist)
        elif isinstance(artist, Rectangle) and artist is not axes.patch:
            if artist.get_transform().contains_branch(axes.transData):
                yield _rectangle(_series(artist), artist)
        elif isinstance(artist, Text) and artist.get_transform() == axes.transData:
            x, y = artist.get_position()
            yield {"kind": "note", "series": "", "x": x, "y": y, "value": _plain(artist.get_text())}


def _intervals(container: ErrorbarContainer) -> Rows:
    """The points of an error bar with their ends, one row each."""
    line, _, bars = container.lines
    if line is None:
        return
    ends = {}
    sides = [side for side, has in (("x", container.has_xerr), ("y", container.has_yerr)) if has]
    for side, bar in zip(sides, bars, strict=False):
        ends[side] = [segment[:, 0 if side == "x" else 1] for segment in bar.get_segments()]
    name = _series(container, line)
    points = zip(np.ravel(line.get_xdata()), np.ravel(line.get_ydata()), strict=True)
    for k, (x, y) in enumerate(points):
        row = {"kind": "mean" if ends else "point", "series": name, "x": x, "y": y}
        for side, segments in ends.items():
            if k < len(segments) and len(segments[k]):
                row |= {f"{side}_low": min(segments[k]), f"{side}_high": max(segments[k])}
        yield row


def _line(axes: Axes, line: Line2D) -> Rows:
    """Points of a line that decide how it looks; of one that spans an axis its one number."""
    x, y = (np.ravel(values) for values in (line.get_xdata(orig=False), line.get_ydata(orig=False)))
    spans_x, spans_y = (not has for has in line.get_transform().contains_branch_seperately(axes.transData))  # fmt: skip
    name = _series(line)
    if spans_x and spans_y:
        return
    if spans_x or spans_y:
        if len(x):
            yield {"kind": "bound", "series": name, **({"y": y[0]} if spans_x else {"x": x[0]})}
        return
    kind = "point" if line.get_linestyle() == "None" else "line"
    if kind == "line":
        shown = shown_points(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        x, y = x[shown], y[shown]
    for one, other in zip(x, y, strict=True):
        yield {"kind": kind, "series": name, "x": one, "y": other}


def _cells(image: AxesImage | QuadMesh) -> Rows:
    """Cells with their middle: in the units of the axes where an image has an extent, else their numbers.

    Of a map of many cells, neighbours in a row that have one shade are one row of the table.
    """
    cells = np.ma.filled(np.ma.asarray(image.get_array(), dtype=np.float64), np.nan)
    cells = np.atleast_2d(cells)
    up, across = (np.arange(count, dtype=np.float64) for count in cells.shape)
    if isinstance(image, AxesImage):
        left, right, bottom, top = image.get_extent()
        first, last = (bottom, top) if image.origin == "lower" else (top, bottom)
        width = (right - left) / cells.shape[1]
        across = left + (across + 0.5) * width
        up = first + (up + 0.5) * (last - first) / cells.shape[0]
        if cells.size > MOST_CELLS:
            for row, first, end, value in _stretches(image, cells):
                ends = {"x_low": left + first * width, "x_high": left + end * width}
                yield {"kind": "cells", "series": "", **ends, "y": up[row], "value": value}
            return
    for (row, column), value in np.ndenumerate(cells):
        yield {"kind": "cell", "series": "", "x": across[column], "y": up[row], "value": value}


def _area(area: FillBetweenPolyCollection) -> Rows:
    """A filled area: its two edges along the axis that it follows."""
    along, across = ("x", "y") if area.t_direction == "x" else ("y", "x")  # type: ignore[attr-defined]
    for path in area.get_paths():
        corners = np.asarray(path.vertices)[:, [0, 1] if along == "x" else [1, 0]]
        count = (len(corners) - 3) // 2  # there, back, the two ends and the first corner again
        there, back = corners[1 : count + 1], corners[count + 2 : 2 * count + 2][::-1]
        shown = np.union1d(shown_points(*there.T), shown_points(*back.T))
        edges = np.sort(np.stack([there[shown, 1], back[shown, 1]], axis=1), axis=1)
        for place, (low, high) in zip(there[shown, 0], edges, strict=True):
            ends = {f"{across}_low": low, f"{across}_high": high}
            yield {"kind": "area", "series": _series(area), along: place, **ends}


def _rectangle(series: str, bar: Rectangle) -> dict[str, Any]:
    x, y = (
        sorted((start, start + size))
        for start, size in ((bar.get_x(), bar.get_width()), (bar.get_y(), bar.get_height()))
    )
    ends = {"x_low": x[0], "x_high": x[1], "y_low": y[0], "y_high": y[1]}
    return {"kind": "bar", "series": series, **ends}


def _parts(container: Any) -> Iterator[Artist]:
    for part in container:
        if isinstance(part, Artist):
            yield part
        elif part is not None:
            yield from _parts(part)


def _series(*artists: Any) -> str:
    """Whose marks these are: what the figure says of them, or what the legend calls them."""
    for artist in artists:
        if gid := getattr(artist, "get_gid", lambda: None)():
            return str(gid)
    labels = [str(artist.get_label() or "") for artist in artists]
    return next((_plain(label) for label in labels if not label.startswith("_") and label), "")


def _named_places(axis: Axis) -> dict[float, str]:
    """Names by their place on an axis that has names; empty where its ticks are numbers."""
    named = isinstance(axis.get_major_formatter(), FixedFormatter | FuncFormatter)
    locator = axis.get_major_locator()
    if not named or not isinstance(locator, FixedLocator):
        return {}
    names = [_plain(label.get_text()) for label in axis.get_ticklabels()]
    return dict(zip(np.asarray(locator(), dtype=np.float64).tolist(), names, strict=False))


def _nearest(places: dict[float, str], value: Any) -> str:
    """The name that stands within half a place of `value`."""
    if value is None or not places:
        return ""
    place = min(places, key=lambda one: abs(one - float(value)))
    return places[place] if abs(place - float(value)) <= NEAR else ""


def _nothing(value: Any) -> bool:
    return isinstance(value, float | np.floating) and bool(np.isnan(value))


def _plain(words: str) -> str:
    """Words on one line."""
    return " ".join(words.split())


def shown_points(x: Floats, y: Floats) -> NDArray[np.int64]:
    """Numbers of the points that decide how a line looks: the first, last, lowest and highest in each column of dots.

    All of them where there are few, or where the line does not run from left to right. Source: Jugel et al., M4: a
    visualization-oriented time series data aggregation, VLDB 2014.
    """
    count = len(x)
    known = np.isfinite(x) & np.isfinite(y)
    # a gap ends a line, so lines with gaps stay as they are
    if count <= 4 * DOTS or not known.all() or (np.diff(x) < 0.0).any() or x[0] == x[-1]:
        return np.arange(count)
    column = np.minimum((x - x[0]) / (x[-1] - x[0]) * DOTS, DOTS - 1).astype(int)
    begin = np.flatnonzero(np.diff(column, prepend=-1))
    end = np.append(begin[1:], count)
    extreme = [
        start + at
        for start, stop in zip(begin.tolist(), end.tolist(), strict=True)
        for at in (int(y[start:stop].argmin()), int(y[start:stop].argmax()))
    ]
    return np.unique(np.concatenate([begin, end - 1, extreme]).astype(np.int64))


def _stretches(image: AxesImage, cells: Floats) -> Iterator[tuple[int, int, int, float]]:
    """Stretches of one shade in the rows of a picture: row, first column, the one after the last, mean of known cells."""
    scaled: Floats = np.ma.filled(
        np.ma.asarray(image.norm(np.ma.masked_invalid(cells)), float), -1.0
    )
    shade = np.floor(scaled * image.get_cmap().N).astype(int)
    for row, own in enumerate(shade):
        begin = np.flatnonzero(np.diff(own, prepend=own[0] - 1))
        for first, end in zip(begin.tolist(), [*begin[1:].tolist(), own.size], strict=True):
            values = cells[row, first:end]
            if np.isfinite(values).all():
                yield row, first, end, float(values.mean())
