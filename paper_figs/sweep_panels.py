"""Panels of the readhesion paper's sensitivity figures: readhesion possibility, mu_use and utilisation over mu_lim."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.core.collection import sweep_folder
from studies.readhesion_paper import study as readhesion
from studies.readhesion_paper.paper import CASE_A, PAPER_LIMITS

SYMBOLS = {"margin": "a_0", "width": "a_w"}
POSSIBLE, NOT_POSSIBLE = "#0072b2", "#d55e00"
SHADES = mpl.colormaps["viridis"]
"""Dark to light in every kind of colour vision; from small to large values."""


def table_of(source: Source) -> pd.DataFrame:
    """The sweep's table, from the results or made now (half a minute)."""
    folder = sweep_folder(source.store.folder, "readhesion")
    return readhesion.run(folder, readhesion.DEFAULT_EVENTS, 0, source.jobs, source.on_row)


def draw_sweep(table: pd.DataFrame, over: str) -> Figure:
    """Three panels for the sweep over "margin" (a_0) or "width" (a_w), the other as in case A."""
    other = "width" if over == "margin" else "margin"
    rows = table[
        (table["parabola"] == readhesion.PRINTED)
        & np.isclose(table[other].astype(float), getattr(CASE_A, other))
    ]
    drawn = new_figure(7.1, 5.6)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplot_mosaic([["possible", "possible"], ["used", "share"]])
        _possibility(panels["possible"], rows, over)
        _curves(panels["used"], panels["share"], rows[rows["part"] == "indices"], over)
        held = f"${SYMBOLS[other]}$ = {getattr(CASE_A, other):g} km/h/s"
        panels["possible"].set_title(f"(a) readhesion possibility, {held}")
        panels["used"].set_title("(b) used coefficient")
        panels["share"].set_title("(c) utilisation")
        handles, labels = panels["used"].get_legend_handles_labels()
        drawn.legend(
            handles, labels, loc="outside right center", title=f"${SYMBOLS[over]}$ [km/h/s]"
        )
    return drawn


def _possibility(axes: Axes, rows: pd.DataFrame, over: str) -> None:
    """Circle: readhesion possible; cross: not. Bars: the limit adhesion coefficient."""
    runs, limits = rows[rows["part"] == "indices"], rows[rows["part"] == "limit"]
    good = runs["possible"].astype(bool)
    for chosen, marker, colour, label in (
        (good, "o", POSSIBLE, "possible"),
        (~good, "x", NOT_POSSIBLE, "not possible"),
    ):
        axes.plot(
            runs["limit"][chosen], runs[over][chosen], marker, color=colour, markersize=3.6,
            markerfacecolor="none", markeredgewidth=0.9, label=label,
        )  # fmt: skip
    axes.plot(
        limits["limit_coefficient"], limits[over], "|", color="black", markersize=11,
        markeredgewidth=1.4, label="limit adhesion coefficient",
    )  # fmt: skip
    axes.set(xlabel=r"$\mu_\mathrm{lim}$ [–]", ylabel=f"${SYMBOLS[over]}$ [km/h/s]")
    axes.set_ylim(runs[over].min() - 0.08, runs[over].max() + 0.22)
    axes.legend(loc="upper left", ncols=3)


def _curves(used: Axes, share: Axes, runs: pd.DataFrame, over: str) -> None:
    values = sorted(runs[over].unique())
    for k, value in enumerate(values):
        own = runs[np.isclose(runs[over], value)].sort_values("limit")
        colour = SHADES(0.92 * k / max(len(values) - 1, 1))
        good = own["possible"].to_numpy(dtype=bool)
        for axes, quantity, scale in (
            (used, "used_coefficient", 1.0),
            (share, "utilisation", 100.0),
        ):
            y = scale * own[quantity].to_numpy(dtype=float)
            axes.plot(own["limit"], y, color=colour, linewidth=1.0, label=f"{value:g}")
            axes.plot(own["limit"][good], y[good], "o", color=colour, markersize=2.6)
    ends = [min(PAPER_LIMITS), max(PAPER_LIMITS)]
    used.plot(ends, ends, ":", color="black", linewidth=0.9, label="ideal")
    share.axhline(100.0, linestyle=":", color="black", linewidth=0.9)
    used.set(xlabel=r"$\mu_\mathrm{lim}$ [–]", ylabel=r"$\mu_\mathrm{use}$ [–]")
    share.set(xlabel=r"$\mu_\mathrm{lim}$ [–]", ylabel=r"$\mu_\mathrm{r}$ [%]")
    for axes in (used, share):
        axes.xaxis.set_major_locator(MultipleLocator(0.04))
