"""How narrowly the readhesion paper determines what it does not print: objective over each parameter."""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.core.collection import sweep_folder
from studies.readhesion_paper import calibration_study as calibration
from studies.readhesion_paper.calibration import RANGES, best, fulfilling

LABELS = {
    "residual_ratio": r"$\mu_\infty/\mu_\mathrm{max}$ [–]",
    "rise": "$T_u$ [s]",
    "fall": "$T_d$ [s]",
    "time_constant": r"$\tau$ [s]",
}
UNIT_LOOKS = {"km/h/s": ("o", "#0072b2"), "m/s2": ("^", "#e69f00")}
"""Marker and colour of each unit that a_0 and a_w may be meant in."""
TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)
"""Ticks of logarithmic axes."""
FEW_EVENTS = 60
"""Samples that are drawn for the figure where the results hold none."""
HEADROOM = 12.0
"""Objective above the best one up to which sets are shown."""


def figure(source: Source) -> Figure:
    """The figure, from what the results hold of the sweep `calibration`, or a small one of its own."""
    folder = sweep_folder(source.store.folder, "calibration")
    table = calibration.stored(folder)
    if table is None:
        table = calibration.run(folder, FEW_EVENTS, 0, source.jobs, source.on_row)
    return draw(table)


def draw(table: pd.DataFrame) -> Figure:
    """A panel per parameter. Filled: sets that fulfil all findings but the half-slip; star: the best of them."""
    good, chosen = fulfilling(table), best(table)
    lowest = float(table["objective"].min())
    shown = table[table["objective"] <= lowest + HEADROOM]
    drawn = new_figure(7.1, 4.8)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(2, 2, sharey=True)
        for axes, (name, (low, high, logarithmic)) in zip(panels.flat, RANGES.items(), strict=True):
            for unit, (marker, colour) in UNIT_LOOKS.items():
                display = unit.replace("s2", "s²")
                for rows, face, label in (
                    (
                        shown.drop(good.index, errors="ignore"),
                        "none",
                        f"{display}, not all findings",
                    ),
                    (good, colour, f"{display}, all findings but the half-slip"),
                ):
                    own = rows[rows["unit"] == unit]
                    axes.plot(
                        own[name], own["objective"], marker, color=colour, markersize=3.6,
                        markerfacecolor=face, markeredgewidth=0.7, label=label,
                    )  # fmt: skip
            axes.plot(
                [chosen[name]], [chosen["objective"]], "*", color="black", markersize=10, label="best",
            )  # fmt: skip
            if logarithmic:
                axes.set_xscale("log")
                axes.xaxis.set_major_locator(FixedLocator(TICKS))
                axes.xaxis.set_major_formatter("{x:g}")
                axes.xaxis.set_minor_locator(NullLocator())
            axes.set(xlim=(low, high), ylim=(0.0, lowest + HEADROOM), xlabel=LABELS[name])
            if len(good) > 1:
                axes.axvspan(good[name].min(), good[name].max(), color="#0072b2", alpha=0.10)
        for axes in panels[:, 0]:
            axes.set_ylabel("objective [–]")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        drawn.legend(handles, labels, loc="outside lower center", ncols=3)
    return drawn
