"""Sanders: the trials of RSSB T1107, and where the same sand stops eight cars soonest."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from paper_figs.counts import remark
from paper_figs.palette import BLUE, DARK, GREEN, GREY, PURPLE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import (
    BOUND,
    PAGE,
    Look,
    bare_rows,
    handle,
    interval_mark,
    name_rows,
    new_figure,
    plain_ticks,
)
from studies.sanders.placement import PLACEMENTS, SHARINGS, USUAL
from studies.sanders.statements import arms
from studies.sanders.study import CARS, TRIALS
from studies.sanders.trial import DISTANCES

TRIAL_LOOKS: dict[tuple[int, str], Look] = dict(
    zip(
        TRIALS,
        (
            {"color": DARK, "marker": "o"},
            {"color": SKY, "marker": "s"},
            {"color": PURPLE, "marker": "^"},
        ),
        strict=True,
    )
)
TRIAL_NAMES = ("here, two units", "here, one unit", "here, two units, Polach's curve")
SHARING_LOOKS: dict[str, Look] = {
    "equal": {"color": BLUE, "marker": "o"},
    "raised": {"color": GREEN, "marker": "s"},
    "by sand": {"color": VERMILION, "marker": "D"},
}
SHADES = (450, 600, 900)
"""Ticks of the scale of stopping distances [m]."""
BLANK: Look = {"linestyle": "none", "markersize": 4.5}


@figure("sanders", "sanders: trials of RSSB T1107, places of the same sand, and sharing of the brake force",
        study("sanders"))  # fmt: skip
def sanders(table: pd.DataFrame) -> Figure:
    """(a) Stopping distances of the trial; that without sanders did not end. (b) Half of the sand at each of two cars.

    The star has the shortest distance. (c) Placement and sharing.
    """
    drawn = new_figure(PAGE, 3.4)
    trial, pairs, places = drawn.subplots(1, 3, width_ratios=[1.0, 1.05, 1.1])
    ok = table[table["status"] == "ok"]
    _draw_trial(ok[ok["part"] == "trial"], trial)
    _draw_pairs(drawn, ok[ok["part"] == "pair"], pairs)
    _draw_places(ok, places)
    handles = [
        handle("trial", color=GREY, linewidth=6, alpha=0.6),
        *(
            handle(name, **TRIAL_LOOKS[key], **BLANK)
            for name, key in zip(TRIAL_NAMES, TRIALS, strict=True)
        ),
        *(handle(f"brake force shared: {name}", **look, **BLANK) for name, look in SHARING_LOOKS.items()),
    ]  # fmt: skip
    drawn.legend(handles=handles, loc="outside lower center", ncols=4)
    remark(trial, "(a) and (b): one stop for each mark and each cell; nothing is drawn at random.")
    return drawn


def _draw_trial(rows: pd.DataFrame, axes: Axes) -> None:
    """Bars of the trial; that without sanders has no end."""
    axes.barh(range(len(DISTANCES)), list(DISTANCES.values()), color=GREY, alpha=0.45, height=0.6)
    axes.annotate("", (1300.0, 0.0), (1195.0, 0.0), arrowprops={"arrowstyle": "->", "color": GREY})
    for k, ((units, curve), look) in enumerate(TRIAL_LOOKS.items()):
        found = rows[(rows["units"] == units) & (rows["curve"] == curve)].set_index("kind")
        metres = found["distance"].reindex(list(DISTANCES))
        axes.plot(metres, np.arange(len(DISTANCES)) + 0.2 * (k - 1), **look, **BLANK)
    name_rows(axes, list(DISTANCES))
    bare_rows(axes)
    axes.set(xlabel="stopping distance [m]", title="(a) 55 mph, friction 0.02", xlim=(0.0, None))


def _draw_pairs(drawn: Figure, rows: pd.DataFrame, axes: Axes) -> None:
    """Distance with half of the sand at the first axle of each of two cars; on the diagonal all at one."""
    metres = np.full((CARS, CARS), np.nan)
    metres[rows["second"].astype(int), rows["first"].astype(int)] = rows["distance"]
    image = axes.imshow(metres, cmap="cividis_r", origin="upper", norm=LogNorm())
    if np.isfinite(metres).any():
        best = np.unravel_index(np.nanargmin(metres), metres.shape)
        axes.plot(best[1], best[0], "*", color="white", markersize=9, markeredgecolor="black")
    numbers = [str(car) for car in range(1, CARS + 1)]
    axes.set_xticks(range(CARS), numbers)
    axes.set_yticks(range(CARS), numbers)
    axes.grid(visible=False)
    axes.set(
        xlabel="first half ahead of car",
        ylabel="second half ahead of car",
        title="(b) halves of the sand",
    )
    inside = axes.inset_axes((0.3, 0.91, 0.66, 0.07))  # where the triangle leaves room
    bar = drawn.colorbar(image, cax=inside, orientation="horizontal")
    plain_ticks(bar.ax.xaxis, FixedLocator(SHADES))
    bar.set_label("distance [m]")
    bar.outline.set_visible(False)


def _draw_places(table: pd.DataFrame, axes: Axes) -> None:
    """Distance over that of the usual placement with equal sharing, with 95 % intervals over events."""
    found = arms(table)
    for k, sharing in enumerate(SHARINGS):
        for row, place in enumerate(PLACEMENTS):
            look = SHARING_LOOKS[sharing] | {"markersize": 3.0, "capsize": 2.0, "linewidth": 0.9}
            interval_mark(axes, found[(place, sharing)], row + 0.25 * (k - 1), 1.0, look)
    axes.axvline(1.0, **BOUND)
    name_rows(axes, list(PLACEMENTS))
    bare_rows(axes)
    axes.set(xlabel=f"distance over that of\n{USUAL} [–]", title="(c) the same sand")
