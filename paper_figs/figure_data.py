"""The data that a figure shows, as a table: read from what is drawn, so that no figure has to give it a second time."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter

NEAR = 0.03
"""Of the figure's size: panels whose ends differ by less stand in one row or column, where one label is enough."""


def tabulate_figure(figure: Figure) -> pd.DataFrame:
    """A row for each point of a figure that was laid out; empty for a chart without axes.

    "panel": its number; "kind": line, area (its outline), bar (base and end), points, image, text; "label": as in the
    legend of this panel or another; "piece": number of a bar or a stretch; "x", "y": nan where something crosses the whole
    panel; "value": of what is coloured by it. "x_axis", "y_axis", "value_axis": quantity and unit; "x_name", "y_name": what
    stands at the axis in place of a number. A column is left out where nothing is in it.
    """
    artists: list[Any] = [artist for axes in figure.axes for artist in axes.get_children()]
    bars = [artist.colorbar.ax for artist in artists if getattr(artist, "colorbar", None)]
    panels = [axes for axes in figure.axes if axes.axison and axes not in bars]
    legend = {_find_look(artist): label for artist in artists if (label := _find_label(artist))}
    tables = []
    for number, axes in enumerate(panels, 1):
        axis_of = {side: _describe_axis(axes, panels, side) for side in ("x", "y")}
        for kind, artist, label, pieces in _list_pieces(axes):
            bar = getattr(artist, "colorbar", None)
            for piece, points in enumerate(pieces, 1):
                table = pd.DataFrame(points, columns=["x", "y", "value"][: points.shape[1]])
                table = table.dropna(subset=["x", "y"], how="all").drop_duplicates()
                table["value_axis"] = bar.ax.get_ylabel() if bar else ""
                for side, (axis, names) in axis_of.items():
                    table[f"{side}_axis"] = axis
                    table[f"{side}_name"] = [_find_nearest(names, x) for x in table[side]]
                label = label or legend.get(_find_look(artist), "")
                first = {"panel": number, "kind": kind, "label": label, "piece": piece}
                tables.append(pd.DataFrame(first, table.index).join(table))
    whole = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    return whole.replace("", None).dropna(axis="columns", how="all")


def _list_pieces(axes: Axes) -> Iterator[tuple[str, Any, str, list[Any]]]:
    """Kind, artist, label and points of all that a panel shows; a coordinate that is none of the data's is nan."""
    wholes = {id(part): whole for whole in axes.containers for part in whole.get_children()}
    drawn: list[tuple[str, Any, Any, list[Any]]] = []
    for line in axes.lines:
        drawn.append(("line", line, line.get_transform(), [line.get_xydata()]))
    for group in axes.collections:
        pieces: list[Any] = [path.vertices for path in group.get_paths()]
        kind, transform = (
            "line" if isinstance(group, LineCollection) else "area",
            group.get_transform(),
        )
        if isinstance(group, PathCollection):
            kind, transform, shades = "points", group.get_offset_transform(), group.get_array()
            pieces = [np.column_stack([group.get_offsets(), *([] if shades is None else [shades])])]
        drawn.append((kind, group, transform, pieces))
    for text in axes.texts:
        drawn.append(("text", text, text.get_transform(), [np.array([text.get_position()])]))
    for kind, artist, transform, pieces in drawn:
        inside = np.array(transform.contains_branch_seperately(axes.transData))
        label = artist.get_text() if kind == "text" else _find_label(wholes.get(id(artist), artist))
        if inside.any() and (label or kind != "text"):
            place = np.where(inside, 0.0, np.nan)
            yield kind, artist, label, [piece + [*place, 0.0][: piece.shape[1]] for piece in pieces]
    for bars in axes.containers:
        if isinstance(bars, BarContainer):
            pieces = [_find_ends(bar.get_bbox(), bars.orientation == "vertical") for bar in bars]
            yield "bar", bars.patches[0], _find_label(bars), pieces
    for image in axes.images:
        values, (left, right, low, high) = np.asarray(image.get_array()), image.get_extent()
        rows, columns = values.shape[:2]
        x = left + (np.arange(columns) + 0.5) * (right - left) / columns
        y = high + (np.arange(rows) + 0.5) * (low - high) / rows
        places = (
            places.ravel() for places in np.meshgrid(x, y[:: 1 if image.origin == "upper" else -1])
        )
        yield "image", image, "", [np.column_stack([*places, values.ravel()])]


def _find_ends(box: Any, upright: bool) -> Any:
    """The middle of a bar's base and of its end."""
    x, y = (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2
    return np.array([[x, box.y0], [x, box.y1]] if upright else [[box.x0, y], [box.x1, y]])


def _find_label(artist: Any) -> str:
    """As a legend would have it; what begins with an underscore is none."""
    return "" if (label := str(artist.get_label())).startswith("_") else label


def _find_look(artist: Any) -> str:
    """By which a reader knows a line of one panel again in the legend of another."""
    return str([getattr(artist, f"get_{part}", str)() for part in ("color", "linestyle", "marker")])


def _describe_axis(
    axes: Axes, panels: Sequence[Axes], side: str
) -> tuple[str, Mapping[float, str]]:
    """What an axis says, or that of a panel in its row or column: its label, and words by where they stand."""
    label, names = "", dict[float, str]()
    for panel in (axes, *panels):
        ends, beside = (getattr(at.get_position(), f"interval{side}") for at in (axes, panel))
        if np.abs(ends - beside).max() < NEAR:
            axis = getattr(panel, f"{side}axis")
            ticks = axis.get_major_formatter()
            words = ticks.seq if isinstance(ticks, FixedFormatter) else ()
            label = label or " ".join(axis.get_label_text().split())
            names = names or dict(zip(axis.get_majorticklocs(), words, strict=False))
    return label, names


def _find_nearest(names: Mapping[float, str], x: float) -> str:
    """The word at most half a place away, which is no number."""
    at = min(names, key=lambda place: abs(place - x), default=np.inf)
    word = names[at] if abs(at - x) <= 0.5 else ""
    return "" if word.lstrip("\N{MINUS SIGN}-").replace(".", "").isdecimal() else word
