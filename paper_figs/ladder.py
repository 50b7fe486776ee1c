"""The ladder of readhesion controllers over random events: adhesion used, search, fluctuation, slip, damage, ride."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from paper_figs.source import Source
from paper_figs.style import CONTROLLER_COLOURS, CONTROLLER_MARKERS, STYLE_FILE, new_figure
from studies.core.collection import sweep_folder
from studies.core.statement import mean_interval
from studies.ladder import study as ladder
from studies.ladder.statements import LADDER, LOCOMOTIVE, YARDSTICKS

FEW_EVENTS = 6
"""Events that are run for the figure where the results hold fewer: two of each train."""
PANELS = (
    ("utilisation_short", "adhesion used\nwhere short [%]", 100.0, False),
    ("effort_ratio", "effort\nover plan [%]", 100.0, False),
    ("search_time", "search time [s]", 1.0, False),
    ("unfinished_searches", "searches\nunfinished [%]", 100.0, False),
    ("torque_fluctuation", "torque fluctuation\nover plan [%]", 100.0, False),
    ("slip_time", "slip, summed\nover axles [s]", 1.0, False),
    ("damage", "wheel damage Q\n[kJ]", 1.0, True),
    ("jerk_rms", "jerk rms\n[m/s³]", 1.0, False),
)
"""Metric, label, factor to the label's unit, whether the axis is logarithmic."""


def figure(source: Source) -> Figure:
    """The figure, from what the results hold of the sweep `ladder`, at least `FEW_EVENTS`."""
    folder = sweep_folder(source.store.folder, "ladder")
    events = max(FEW_EVENTS, ladder.stored(folder))
    return draw(ladder.run(folder, events, 0, source.jobs, source.on_row))


def draw(table: pd.DataFrame) -> Figure:
    """A panel per metric: means with their intervals by controller, filled with a free axle, open for the locomotive."""
    good = ladder.complete(table)
    free = good["train"] != LOCOMOTIVE
    drawn = new_figure(7.1, 4.6)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(2, len(PANELS) // 2, sharey=True)
        for panel, one in zip(PANELS, axes.flat, strict=True):
            for y, controller in enumerate(LADDER):
                rows = good["controller"] == controller
                _mark(one, good[rows & free], panel, controller, y - 0.16, filled=True)
                _mark(one, good[rows & ~free], panel, controller, y + 0.16, filled=False)
            one.set_xlabel(panel[1])
            if panel[3]:
                one.set_xscale("log")
                one.xaxis.set_minor_formatter(NullFormatter())
            one.grid(visible=False, axis="y")
            one.tick_params(axis="y", length=0)
        for bar in YARDSTICKS:
            axes[0, 0].axvline(100 * bar, color="#444444", linewidth=0.8, linestyle="--", zorder=0)
        axes[0, 0].set_yticks(range(len(LADDER)), LADDER)
        axes[0, 0].set_ylim(len(LADDER) - 0.5, -0.5)
        counts = [good["scenario"][kind].nunique() for kind in (free, ~free)]
        drawn.suptitle(
            f"filled: multiple units ({counts[0]} events); open: locomotive, no free axle ({counts[1]} events); "
            "mpc: part of them",
            fontsize=8,
        )
    return drawn


def _mark(
    axes: Axes,
    rows: pd.DataFrame,
    panel: tuple[str, str, float, bool],
    controller: str,
    y: float,
    filled: bool,
) -> None:
    """Events as pale points, their mean with its interval in the controller's colour."""
    metric, _, factor, logarithmic = panel
    values = factor * rows[metric].dropna().to_numpy(dtype=float)
    if not values.size:
        return
    colour = CONTROLLER_COLOURS[controller]
    axes.plot(
        values, np.full(values.size, y), linestyle="none", marker="|", color=colour, markersize=3.0, alpha=0.35
    )  # fmt: skip
    found = mean_interval(rows[metric])
    low, high = factor * (found.value - found.low), factor * (found.high - found.value)
    if logarithmic:  # an interval that reaches below zero has no place on this axis
        low = min(low, 0.9 * factor * found.value)
    axes.errorbar(
        factor * found.value, y, xerr=None if found.count < 2 else [[low], [high]],
        color=colour, marker=CONTROLLER_MARKERS[controller], markersize=4.5, linestyle="none",
        markerfacecolor=colour if filled else "white", elinewidth=1.0,
    )  # fmt: skip
