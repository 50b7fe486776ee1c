"""The data that a figure shows, as a table: read from what is drawn, so that no figure has to give it a second time."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection
from matplotlib.container import BarContainer
from matplotlib.figure import Figure

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
    mapped = [artist for artist in artists if getattr(artist, "colorbar", None)]
    bars = {artist.norm: artist.colorbar.ax for artist in mapped}  # images may share one
    panels = [axes for axes in figure.axes if axes.axison and axes not in bars.values()]
    lines = [line for axes in panels for line in axes.lines if _find_label(line)]
    legend = {_find_look(line): _find_label(line) for line in lines}
    tables = []
    for number, axes in enumerate(panels, 1):
        axis_of = {side: _describe_axis(axes, panels, side) for side in ("x", "y")}
        for kind, artist, label, pieces in _list_pieces(axes):
            points = np.concatenate(pieces)
            table = pd.DataFrame(points, columns=["x", "y", "value"][: points.shape[1]])
            table.insert(0, "panel", number)
            table.insert(1, "kind", kind)
            table.insert(2, "label", label or legend.get(_find_look(artist), ""))
            table.insert(3, "piece", np.repeat(range(1, len(pieces) + 1), [*map(len, pieces)]))
            bar = bars.get(getattr(artist, "norm", None))
            table["value_axis"] = bar.get_ylabel() if bar else ""
            for side, (axis, names) in axis_of.items():
                table[f"{side}_axis"] = axis
                words = [_find_nearest(names, x) for x in table[side]] if names else ""
                table[f"{side}_name"] = words
            tables.append(table.dropna(subset=["x", "y"], how="all").drop_duplicates())
    whole = pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()
    return whole.replace("", None).dropna(axis="columns", how="all")


def _list_pieces(axes: Axes) -> Iterator[tuple[str, Any, str, list[Any]]]:
    """Kind, artist, label and points of all that a panel shows; a coordinate that is none of the data's is nan."""
    wholes = {id(part): whole for whole in axes.containers for part in whole.get_children()}
    drawn: list[tuple[str, Any, Any, list[Any]]] = []
    for line in axes.lines:
        drawn.append(("line", line, line.get_transform(), [line.get_xydata()]))
    for group in axes.collections:
        kind = "line" if isinstance(group, LineCollection) else "area"
        pieces: list[Any] = [path.vertices for path in group.get_paths()]
        if isinstance(group, PathCollection):
            columns: list[Any] = [group.get_offsets(), group.get_array()]
            pieces = [np.column_stack([values for values in columns if values is not None])]
            drawn.append(("points", group, group.get_offset_transform(), pieces))
        elif pieces:
            drawn.append((kind, group, group.get_transform(), pieces))
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
        rows, across = values.shape[:2]
        x = left + (np.arange(across) + 0.5) * (right - left) / across
        y = high + (np.arange(rows) + 0.5) * (low - high) / rows
        grid = np.meshgrid(x, y if image.origin == "upper" else y[::-1])
        yield "image", image, "", [np.column_stack([*map(np.ravel, (*grid, values))])]


def _find_ends(box: Any, upright: bool) -> Any:
    """The middle of a bar's base and of its end."""
    x, y = (box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2
    return np.array([[x, box.y0], [x, box.y1]] if upright else [[box.x0, y], [box.x1, y]])


def _find_label(artist: Any) -> str:
    """As a legend would have it; what begins with an underscore is none."""
    return "" if (label := str(artist.get_label())).startswith("_") else label


def _find_look(artist: Any) -> str:
    """By which a reader knows a line of one panel again in the legend of another."""
    return str(
        [getattr(artist, f"get_{part}", list)() for part in ("color", "linestyle", "marker")]
    )


def _describe_axis(axes: Axes, panels: Sequence[Axes], side: str) -> tuple[str, dict[float, str]]:
    """What an axis says, or that of a panel in its row or column: its label, and words by where they stand."""
    label, names = "", dict[float, str]()
    shared = getattr(axes, f"get_shared_{side}_axes")()
    for panel in (axes, *panels):
        ends, beside = (getattr(at.get_position(), f"interval{side}") for at in (axes, panel))
        if shared.joined(axes, panel) or np.abs(ends - beside).max() < NEAR:
            axis = getattr(panel, f"{side}axis")
            texts = [text.get_text() for text in axis.get_ticklabels()]
            label = label or " ".join(axis.get_label_text().split())
            names = names or {
                place: text
                for place, text in zip(axis.get_majorticklocs(), texts, strict=False)
                if any(map(str.isalpha, text)) and "mathdefault" not in text
            }
    return label, names


def _find_nearest(names: dict[float, str], x: float) -> str:
    """The word at most half a place away."""
    place = min(names, key=lambda place: abs(place - x))
    return names[place] if abs(place - x) <= 0.5 else ""
