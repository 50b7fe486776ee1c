"""The data that a figure shows, as a table: read from what is drawn, so that no figure has to give it a second time."""

import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.container import BarContainer
from matplotlib.figure import Figure

NEAR = 0.03
"""Of the figure's size: panels whose ends differ by less stand in one row or column, where one label is enough."""
COLUMNS = [
    "panel", "title", "kind", "label", "x", "y", "value", "x_axis", "y_axis", "value_axis", "x_name", "y_name",
]  # fmt: skip


def tabulate_figure(figure: Figure) -> pd.DataFrame:
    """A row for each point of a figure that was laid out; empty for a chart without axes.

    "panel" and its "title"; "kind": line, area (its outline), bar (its end), points, image, text; "label": as in the legend
    of this panel or another; "x", "y": nan where something crosses the whole panel, both between two pieces; "value": of
    what is coloured by it. "x_axis", "y_axis", "value_axis": quantity and unit; "x_name", "y_name": a word at the axis.
    """
    artists: list[Any] = [artist for axes in figure.axes for artist in axes.get_children()]
    mapped = [artist for artist in artists if getattr(artist, "colorbar", None)]
    bars = {artist.norm: artist.colorbar.ax for artist in mapped}  # images may share one
    panels = [axes for axes in figure.axes if axes.axison and axes not in bars.values()]
    lines = [line for axes in panels for line in axes.lines]
    legend = {_find_look(line): label for line in lines if (label := _find_label(line))}
    tables = [pd.DataFrame()]
    for number, axes in enumerate(panels, 1):
        titles = [axes.get_title(place) for place in ("left", "center", "right")]
        (x_axis, columns), (y_axis, rows) = (_read_axis(axes, panels, side) for side in ("x", "y"))
        for kind, artist, label, points in _list_drawn(axes):
            bar = bars.get(getattr(artist, "norm", None))
            table = pd.DataFrame(points, columns=["x", "y", "value"][: points.shape[1]]).assign(
                panel=number,
                title=" ".join(" ".join(titles).split()),
                kind=kind,
                label=label or legend.get(_find_look(artist), ""),
                x_axis=x_axis,
                y_axis=y_axis,
                value_axis=bar.get_ylabel() if bar else "",
                x_name=[_find_word(columns, x) for x in points[:, 0]],
                y_name=[_find_word(rows, y) for y in points[:, 1]],
            )
            tables.append(table if points.shape[0] > 2 else table.drop_duplicates())
    whole = pd.concat(tables, ignore_index=True).reindex(columns=COLUMNS)
    return whole.replace("", None).dropna(axis="columns", how="all")


def _list_drawn(axes: Axes) -> Iterator[tuple[str, Any, str, Any]]:
    """Kind, artist, label and points of all that a panel shows; a coordinate that is none of the data's is nan."""
    wholes: dict[int, Any] = {
        id(part): bars for bars in axes.containers for part in bars.get_children()
    }
    drawn: list[tuple[str, Any, Any]] = [("line", line, line.get_xydata()) for line in axes.lines]
    drawn += [("text", text, np.array([text.get_position()])) for text in axes.texts]
    for group in axes.collections:
        if isinstance(group, PathCollection):
            values: list[Any] = [group.get_offsets(), group.get_array()]
            drawn.append(("points", group, np.column_stack([x for x in values if x is not None])))
        elif paths := [np.vstack([path.vertices, [np.nan] * 2]) for path in group.get_paths()]:
            kind = "area" if len(group.get_facecolor()) else "line"
            drawn.append((kind, group, np.concatenate(paths)[:-1]))
    for kind, artist, points in drawn:
        place = artist.get_offset_transform() if kind == "points" else artist.get_transform()
        inside = np.array(place.contains_branch_seperately(axes.transData))
        label = artist.get_text() if kind == "text" else _find_label(wholes.get(id(artist), artist))
        if inside.any() and (label or kind != "text"):
            shown: Any = np.ma.array(points, float, copy=True).filled(np.nan)
            shown[:, :2][:, ~inside] = np.nan
            yield kind, artist, label, shown
    for bars in axes.containers:
        if isinstance(bars, BarContainer):
            boxes = np.array([bar.get_bbox().get_points() for bar in bars])  # (bar, corner, x or y)
            along = int(bars.orientation == "vertical")
            points = boxes.mean(axis=1)
            points[:, along] = boxes[:, 1, along]
            yield "bar", bars, _find_label(bars), points
    for image in axes.images:
        values_at, (left, right, low, high) = np.asarray(image.get_array()), image.get_extent()
        first, last = (high, low) if image.origin == "upper" else (low, high)
        rows, across = ((np.arange(size) + 0.5) / size for size in values_at.shape[:2])
        grid = np.meshgrid(left + across * (right - left), first + rows * (last - first))
        yield "image", image, "", np.column_stack([*map(np.ravel, (*grid, values_at))])


def _find_label(artist: Any) -> str:
    """As a legend would have it; what begins with an underscore is none."""
    return "" if (label := str(artist.get_label())).startswith("_") else label


def _find_look(artist: Any) -> str:
    """By which a reader knows a line of one panel again in the legend of another."""
    return str([getattr(artist, f"get_{x}", list)() for x in ("color", "linestyle", "marker")])


def _read_axis(axes: Axes, panels: Sequence[Axes], side: str) -> tuple[str, dict[float, str]]:
    """What an axis says, or that of a panel in its row or column: its label, and names by where they stand."""
    label, names = "", dict[float, str]()
    shared = getattr(axes, f"get_shared_{side}_axes")()
    for panel in (axes, *panels):
        ends, beside = (getattr(at.get_position(), f"interval{side}") for at in (axes, panel))
        if shared.joined(axes, panel) or np.abs(ends - beside).max() < NEAR:
            axis = getattr(panel, f"{side}axis")
            label = label or " ".join(axis.get_label_text().split())
            texts = [text.get_text() for text in axis.get_ticklabels()]
            places = {text: x for x, text in zip(axis.get_majorticklocs(), texts, strict=False)}
            names = names or {
                x: text for text, x in places.items() if re.search(r"^[^$]*[^\W\d]", text)
            }
    return label, names


def _find_word(names: dict[float, str], x: float) -> str:
    """The word at most half a place away."""
    place = min(names, key=lambda place: abs(place - x), default=np.inf)
    return names[place] if abs(place - x) <= 0.5 else ""
