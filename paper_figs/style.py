"""One look for all figures: the style file, colours, looks of rules and controllers, and what panels share."""

import sys
from collections.abc import Iterable, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import Locator, NullLocator

from alloc.onboard.host import CONTROLLERS
from alloc.rules import RULES
from studies.core.statement import CONFIDENCE, LEAST_SHOWN, Interval
from studies.files.study_error import StudyError

Look = dict[str, Any]
"""How something is drawn: matplotlib's properties."""
STYLE_FILE = Path(__file__).parent / "readhesion.mplstyle"

# after Okabe and Ito's palette for colour-blind readers, its yellow darkened to show on white
BLUE, VERMILION, ORANGE, SKY, GREEN = "#0072b2", "#d55e00", "#e69f00", "#56b4e9", "#009e73"
PURPLE, GREY, BLACK = "#7b3294", "#7f7f7f", "#000000"
DARK = "#444444"
"""Of bounds, and of legend entries that stand for every colour."""
ZERO = "#888888"
"""Of the line of no difference."""
BETTER = "#e3f1e4"
"""Tint of the side that is better."""
BAND_GREY = "#dddddd"
"""Of lines between bands of rows."""
OTHER_COLOUR = "#402020"
"""Of a rule that is not there: a plug-in's, in a stored comparison drawn without it."""
BOUND: Look = {"color": DARK, "linewidth": 0.8, "linestyle": "--", "zorder": 0}
"""Look of the line that a statement is judged by."""
BAND = 0.18
"""Opacity of what shows an ensemble's range."""
CONTROLLER_FILL: dict[str, str] = {"none": "bottom", "cut-and-ramp": "full", "mpc": "none"}
"""Fill of a rule's marker by readhesion controller, for those that are compared under several rules."""
NOTE = 6.0
"""Size of type inside a panel [points], where the style's 7 points have no room; nothing is smaller."""
NOTEBOOK_FORMATS = ("image/png", "image/svg+xml", "image/jpeg", "application/pdf")
"""What a notebook may show a figure as."""


WORSE_TO_BETTER = LinearSegmentedColormap.from_list("change", [VERMILION, "#ffffff", BLUE])
"""From worse than the reference through equal to better."""


class Panel(NamedTuple):
    """A metric's panel: its label, the factor to the label's unit, whether the axis is logarithmic."""

    metric: str
    label: str
    factor: float = 1.0
    logarithmic: bool = False


class Width(Enum):
    """Widths of a figure [inches]: nothing else fits the page without being scaled, which would change the type's size."""

    COLUMN = 3.5
    """A column of a page of two."""
    PAGE = 7.16
    """Both columns."""


COLUMN, PAGE = Width.COLUMN, Width.PAGE


def new_figure(width: Width, height: float) -> Figure:
    """An empty figure of this width and height [inches], outside of pyplot's memory."""
    if not isinstance(width, Width):
        raise StudyError(
            f"a figure of width {width}: take COLUMN (3.5 inches) or PAGE (7.16) of paper_figs.style"
        )
    return Figure(figsize=(width.value, height), layout="constrained")


def new_panels(
    width: Width, height: float, rows: int = 1, columns: int = 1, **layout: Any
) -> tuple[Figure, Any]:
    """A figure of this width and height [inches] and its panels, as `Figure.subplots` gives them."""
    drawn = new_figure(width, height)
    return drawn, drawn.subplots(rows, columns, **layout)


def rule_colour(rule: str) -> str:
    """The rule's colour, the same in every figure."""
    return RULES[rule].colour if rule in RULES else OTHER_COLOUR


def rule_look(rule: str) -> Look:
    """Colour and marker of a rule, without a line; the `gid` names it in the data beside the figure."""
    marker = RULES[rule].marker if rule in RULES else "h"
    return {"color": rule_colour(rule), "marker": marker, "linestyle": "none", "gid": rule}


def controller_look(controller: str) -> Look:
    """Colour and marker of a controller, without a line."""
    found = CONTROLLERS[controller]
    return {"color": found.colour, "marker": found.marker, "linestyle": "none", "gid": controller}


def controller_fill(controller: str) -> Look:
    """Fill of a rule's marker under a controller."""
    return {"fillstyle": CONTROLLER_FILL.get(controller, "left"), "markerfacecoloralt": "white"}


def handle(label: str, **look: Any) -> Line2D:
    """A legend entry."""
    return Line2D([], [], label=label, **look)


def rule_handles(rules: Iterable[str]) -> list[Line2D]:
    """Legend entries of rules: marker and colour."""
    return [handle(rule, **rule_look(rule)) for rule in rules]


def controller_handles(controllers: Iterable[str]) -> list[Line2D]:
    """Legend entries of controllers: fill of the marker."""
    look = {"linestyle": "none", "marker": "o", "color": DARK}
    return [handle(one, **look, **controller_fill(one)) for one in controllers]


def legend_below(
    drawn: Figure | SubFigure, shown: Axes | Sequence[Artist], columns: int = 0
) -> None:
    """One legend under the figure, of what a panel labels or of handles, in so many columns [default: one row]."""
    handles = shown.get_legend_handles_labels()[0] if isinstance(shown, Axes) else list(shown)
    drawn.legend(handles=handles, loc="outside lower center", ncols=columns or len(handles))


def name_rows(axes: Axes, names: Sequence[str]) -> None:
    """Name the rows of a panel, the first at its top."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)


def bare_rows(axes: Axes) -> None:
    """Take grid and ticks from rows that only have names."""
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


def zero_line(axes: Axes, colour: str = ZERO) -> None:
    """The upright line of no difference."""
    axes.axvline(0.0, color=colour, linewidth=0.8, zorder=0)


def tint_better(axes: Axes, better: int) -> None:
    """Tint the side of zero that is better: +1 right, -1 left, 0 neither; limits stay as the data made them."""
    low, high = axes.get_xlim()
    if better:
        axes.axvspan(*((0.0, high) if better > 0 else (low, 0.0)), color=BETTER, linewidth=0.0, zorder=-2)  # fmt: skip
    axes.set_xlim(low, high)


def plain_ticks(axis: Axis, locator: Locator) -> None:
    """Ticks of a logarithmic axis with plain numbers."""
    axis.set_major_locator(locator)
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def interval_mark(
    axes: Axes, found: Interval, place: float, factor: float, look: Look, upright: bool = False
) -> None:
    """A mean at a `place` across it, with its interval as an error bar; of fewer than `LEAST_SHOWN` events a point."""
    counted(axes, [found])
    value, sides = factor * found.value, sides_of(found, factor)
    if upright:
        axes.errorbar(place, value, sides, **look)
    else:
        axes.errorbar(value, place, xerr=sides, **look)


def sides_of(found: Interval, factor: float) -> list[list[float]] | None:
    """How far an interval reaches below and above its mean, as error bars want it; None of fewer than `LEAST_SHOWN`."""
    if found.count < LEAST_SHOWN:
        return None
    return [[factor * (found.value - found.low)], [factor * (found.high - found.value)]]


def number_cell(
    axes: Axes, x: float, y: float, size: tuple[float, float], worth: float, colours: Colormap, words: str
) -> None:  # fmt: skip
    """A number on a cell of a table: `worth` gives the cell's colour, 0 to 1; black or white, whichever is read on it."""
    colour = colours(worth)
    # relative luminance, weights of Rec. 709
    light = 0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2] > 0.45
    width, height = size
    axes.bar(x, height, width, y - 0.5 * height, color=colour, edgecolor="#cccccc", linewidth=0.4)
    axes.text(
        x, y, words, ha="center", va="center", fontsize=NOTE, linespacing=1.0, color=BLACK if light else "white"
    )  # fmt: skip


def bare_table(axes: Axes) -> None:
    """Take grid, ticks and frame from a table of cells."""
    axes.grid(visible=False)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)


# what a figure says of itself: `drawing` writes it below the panels
_COUNTS: "WeakKeyDictionary[Figure, set[int]]" = WeakKeyDictionary()
_REMARKS: "WeakKeyDictionary[Figure, list[str]]" = WeakKeyDictionary()


def counted(axes: Axes, found: Iterable[Interval]) -> None:
    """Note that a panel shows these means, so that their figure says how many events are behind them."""
    counts = _COUNTS.setdefault(axes.get_figure(root=True), set())  # type: ignore[arg-type]
    counts.update(one.count for one in found if one.count)


def remark(axes: Axes, words: str) -> None:
    """A sentence that the figure says of itself beside its counts."""
    _REMARKS.setdefault(axes.get_figure(root=True), []).append(words)  # type: ignore[arg-type]


def remarks(drawn: Figure, events: str) -> str:
    """What a figure says of itself: how many events, named by `events`, its means have; and its further sentences."""
    said = []
    if counts := _COUNTS.get(drawn):
        least, most = min(counts), max(counts)
        number = f"{most}" if least == most else f"{least} to {most}"
        said = [f"Means with {100 * CONFIDENCE:g} % intervals over n = {number} {events}."]
        if most == 1:
            said = [f"Each mark is one of the {events} alone, without an interval."]
        elif most < LEAST_SHOWN:
            said = [f"Means over n = {number} {events}, too few for an interval."]
        elif least < LEAST_SHOWN:
            said += [f"Fewer than {LEAST_SHOWN} have no interval."]
    return " ".join(said + _REMARKS.get(drawn, []))


def show_figures() -> None:
    """In a notebook, let a Matplotlib figure show as a picture; a choice that was made before stands.

    IPython does so only once pyplot has been imported, which the figures here do not use.
    """
    if "IPython" not in sys.modules:
        return
    from IPython.core.getipython import get_ipython
    from IPython.core.pylabtools import select_figure_formats

    shell: Any = get_ipython()  # IPython is not installed where types are checked
    if shell is None:
        return
    formatters = shell.display_formatter.formatters
    if not any(Figure in formatters[one] for one in NOTEBOOK_FORMATS if one in formatters):
        select_figure_formats(shell, {"png"})


show_figures()
