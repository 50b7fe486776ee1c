"""Adhesion used, wheel damage and slip of the MPC by curve, noise, computing time and given slip (sweep mismatch)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from paper_figs.counts import counted, remark
from paper_figs.palette import BLACK, BLUE, DARK, VERMILION
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import NOTE, PAGE, new_panels
from studies.core.statement import mean_interval
from studies.mismatch.rails import RAILS
from studies.mismatch.settings import (
    DELAYED,
    GIVEN,
    MIDDLE,
    NOISES,
    REFERENCE,
    SEARCHER,
    SOUGHT,
)
from studies.mismatch.statements import difference

FEW_EVENTS = 2
"""Events that are run for the figure where the results have fewer: one of each train."""
COLOURS = LinearSegmentedColormap.from_list("worse to better", [VERMILION, "#ffffff", BLUE])
"""From worse than the reference through equal to better."""

DARKEST = 0.45
"""Least brightness of a cell whose numbers are black."""


class MetricPanel(NamedTuple):
    """A metric's panel: title, factor to its unit, digits, what more of it is worth, the difference of full colour."""

    metric: str
    title: str
    factor: float
    form: str
    worth: int
    full: float


class CellColumn(NamedTuple):
    """A column of cells: the setting, its noise [km/h], and its name at the axis."""

    setting: str
    noise: float
    name: str


PANELS = (
    MetricPanel("utilisation_short", "adhesion used where short [%]", 100.0, "{:.1f}", 1, 10.0),
    MetricPanel("damage", "wheel damage Q [kJ]", 1.0, "{:.0f}", -1, 100.0),
    MetricPanel("slip_time", "slip over axles [s]", 1.0, "{:.1f}", -1, 10.0),
)
WHOSE = ("½", "1", "1½", "piece-\nwise", "Pol.\nwet", "slip\nratio")
"""Names of the given slips at the axis: shares of that of the rail's own peak, then curves whose peak it is."""
GIVEN_NAMES = tuple(zip(GIVEN, WHOSE, strict=True))
GROUPS: dict[str, Sequence[CellColumn]] = {
    **{
        title: [CellColumn(one.name, noise, f"{noise:g}") for noise in NOISES]
        for title, one in {
            REFERENCE.name: REFERENCE,
            SEARCHER.name: SEARCHER,
            "mpc": SOUGHT,
            "mpc,\na period late": DELAYED,
        }.items()
    },
    "mpc at\nown peak ×": [CellColumn(one.name, MIDDLE, name) for one, name in GIVEN_NAMES[:3]],
    "mpc at\npeak of": [CellColumn(one.name, MIDDLE, name) for one, name in GIVEN_NAMES[3:]],
}
"""Groups of columns from left to right."""


@figure("mismatch", "the MPC by curve, noise, computing time and given slip (sweep mismatch)",
        study("mismatch", FEW_EVENTS))  # fmt: skip
def mismatch(table: pd.DataFrame) -> Figure:
    """A panel per metric: means over events, and below them how far the difference from cut-and-ramp is known.

    That is half of the 95 % interval of the mean paired difference, with the same noise. Blue is better, orange worse; a
    cell is white where the interval contains no difference.
    """
    good = table[table["status"] == "ok"]
    drawn, axes = new_panels(PAGE, 7.4, len(PANELS), 1, sharex=True)
    for panel, one in zip(PANELS, axes, strict=True):
        _panel(one, panel, good)
    remark(axes[0], "±: half the interval of the difference from cut-and-ramp, event by event.")
    columns = [column for group in GROUPS.values() for column in group]
    axes[-1].set_xticks(_places(), [column.name for column in columns], fontsize=NOTE)
    axes[-1].set_xlabel(f"noise of measured speeds, at given slips {MIDDLE:g} [km/h]")
    for title, own in _grouped().items():
        axes[0].text(
            np.mean(own),
            -0.6,
            title,
            ha="center",
            va="bottom",
            fontsize=NOTE,
            color=DARK,
            linespacing=1.0,
        )
    drawn.suptitle(
        "blue: better than cut-and-ramp with the same noise; orange: worse; white: no difference known",
    )
    return drawn


def _brightness(colour: tuple[float, ...]) -> float:
    """Relative luminance of a colour, 0 to 1 (Rec. 709 weights)."""
    return float(np.dot(colour[:3], (0.2126, 0.7152, 0.0722)))


def _grouped() -> dict[str, list[float]]:
    """Places of the columns of each group, with a gap between two groups."""
    places: dict[str, list[float]] = {}
    begin = 0.0
    for title, columns in GROUPS.items():
        places[title] = [begin + k for k in range(len(columns))]
        begin += len(columns) + 0.35
    return places


def _places() -> list[float]:
    return [place for own in _grouped().values() for place in own]


def _panel(axes: Axes, panel: MetricPanel, good: pd.DataFrame) -> None:
    """A cell per curve and column: the mean as a number, its difference from the reference as a colour."""
    columns = [column for group in GROUPS.values() for column in group]
    scale = Normalize(-panel.full, panel.full)
    mean = good.groupby(["curve", "noise", "setting"])[panel.metric].mean()
    for y, curve in enumerate(RAILS):
        for x, column in zip(_places(), columns, strict=True):
            own = (curve, column.noise, column.setting)
            if own not in mean.index:
                continue
            other = mean_interval(difference(good, *own, REFERENCE.name, panel.metric))
            known = column.setting != REFERENCE.name and other.count > 1
            decided = known and not other.low <= 0.0 <= other.high
            worth = (
                scale(panel.worth * panel.factor * other.value)
                if decided or other.count == 1
                else 0.5
            )
            words = panel.form.format(panel.factor * mean[own])
            if known:
                counted(axes, [other])
                half = panel.factor * 0.5 * (other.high - other.low)
                words += "\n±" + (panel.form if half < 10.0 else "{:.0f}").format(half)
            axes.bar(
                x, 0.96, 0.96, y - 0.48, color=COLOURS(worth), edgecolor="#cccccc", linewidth=0.4
            )
            axes.text(
                x, y, words, ha="center", va="center", linespacing=1.0,
                fontsize=NOTE, color=BLACK if _brightness(COLOURS(worth)) > DARKEST else "white",
            )  # fmt: skip
    axes.set_yticks(range(len(RAILS)), list(RAILS))
    axes.set_ylim(len(RAILS) - 0.5, -0.5)
    axes.set_xlim(-0.6, _places()[-1] + 0.6)
    axes.set_ylabel("adhesion curve")
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.set_title(panel.title, loc="left", pad=22 if panel is PANELS[0] else 4)
    for side in axes.spines.values():
        side.set_visible(False)
