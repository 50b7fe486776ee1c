"""One look for all figures: the style file, the looks of rules and controllers, and what panels share."""

from collections.abc import Iterable, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import Locator, NullLocator
from numpy.typing import NDArray

from alloc.onboard.host import CONTROLLERS
from alloc.rules import RULES
from paper_figs.counts import counted
from paper_figs.in_notebook import show_figures
from paper_figs.palette import BETTER, DARK
from studies.core.statement import Interval
from studies.files.study_error import StudyError

show_figures()

Look = dict[str, Any]
"""How something is drawn: matplotlib's properties."""
STYLE_FILE = Path(__file__).parent / "readhesion.mplstyle"

TRAIN_COLOURS = LinearSegmentedColormap.from_list(
    "train", ["#0b2a5b", "#3f7fb5", "#7fb7a0", "#e3b23c"]
)
"""From the front of the train (dark) to its rear (light); they differ by lightness alone."""
BOUND: Look = {"color": DARK, "linewidth": 0.8, "linestyle": "--", "zorder": 0}
"""Look of the line that a statement is judged by."""

BAND = 0.18
"""Opacity of what shows an ensemble's range."""
CONTROLLER_FILL: dict[str, str] = {"none": "bottom", "cut-and-ramp": "full", "mpc": "none"}
"""Fill of a rule's marker by readhesion controller, for those that are compared under several rules."""


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
NOTE = 6.0
"""Size of type inside a panel [points], where the style's 7 points have no room; nothing is smaller."""


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


OTHER_COLOUR = "#402020"
"""Of a rule that is not there: a plug-in's, in a stored comparison drawn without it."""


def rule_colour(rule: str) -> str:
    """The rule's colour, the same in every figure."""
    return RULES[rule].colour if rule in RULES else OTHER_COLOUR


def rule_marker(rule: str) -> str:
    """The rule's marker, so that colour is never the only sign."""
    return RULES[rule].marker if rule in RULES else "h"


def rule_look(rule: str) -> Look:
    """Colour and marker of a rule, without a line; the `gid` names it in the data beside the figure."""
    shown = {"color": rule_colour(rule), "marker": rule_marker(rule)}
    return {**shown, "linestyle": "none", "gid": rule}


def controller_look(controller: str) -> Look:
    """Colour and marker of a controller, without a line."""
    found = CONTROLLERS[controller]
    shown = {"color": found.colour, "marker": found.marker}
    return {**shown, "linestyle": "none", "gid": controller}


def handle(label: str, **look: Any) -> Line2D:
    """A legend entry."""
    return Line2D([], [], label=label, **look)


def rule_handles(rules: Iterable[str]) -> list[Line2D]:
    """Legend entries of rules: marker and colour."""
    return [handle(rule, **rule_look(rule)) for rule in rules]


def controller_handles(controllers: Iterable[str]) -> list[Line2D]:
    """Legend entries of controllers: fill of the marker."""
    look = {"linestyle": "none", "marker": "o", "color": DARK, "markerfacecoloralt": "white"}
    return [handle(c, fillstyle=CONTROLLER_FILL.get(c, "left"), **look) for c in controllers]


def legend_below(drawn: Figure, columns: int, *panels: Axes) -> None:
    """One legend under the figure, of what `panels` label."""
    handles = [entry for one in panels for entry in one.get_legend_handles_labels()[0]]
    drawn.legend(handles=handles, loc="outside lower center", ncols=columns)


def name_rows(axes: Axes, names: Sequence[str]) -> None:
    """Name the rows of a panel, the first at its top."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)


def bare_rows(axes: Axes) -> None:
    """Take grid and ticks from rows that only have names."""
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)


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


def interval_mark(axes: Axes, found: Interval, y: float, factor: float, look: Look) -> None:
    """A mean with its interval as a horizontal error bar; one event alone has no interval."""
    counted(axes, [found])
    axes.errorbar(factor * found.value, y, xerr=sides_of(found, factor), **look)


def sides_of(found: Interval, factor: float) -> list[list[float]] | None:
    """How far an interval reaches below and above its mean, as error bars want it; None of one event alone."""
    if found.count < 2:
        return None
    return [[factor * (found.value - found.low)], [factor * (found.high - found.value)]]


def along_train(count: int) -> NDArray[np.float64]:
    """Colours of this number of units, axles or cars from the front."""
    return np.asarray(TRAIN_COLOURS(np.linspace(0.0, 1.0, count)))


def train_bar(drawn: Figure, panels: Sequence[Axes], count: int, label: str) -> None:
    """The bar beside `panels` that explains the colours of `along_train`."""
    bar = drawn.colorbar(
        mpl.cm.ScalarMappable(Normalize(0.5, count + 0.5), TRAIN_COLOURS.resampled(count)),
        ax=list(panels), shrink=0.4, aspect=18, pad=0.02,
    )  # fmt: skip
    bar.set_ticks([1, count] if count > 4 else list(range(1, count + 1)))
    bar.set_label(label)
    bar.outline.set_visible(False)
