"""Paired differences of rules and controllers under several adhesion curves: does their sign stand?"""

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.core.collection import sweep_folder
from studies.curves import study as curves
from studies.curves.statements import CURVES, METRICS, PAIRS, paired_difference

FEW_EVENTS = 4
"""Events that are run for the figure where the results hold fewer."""
CURVE_LOOKS: dict[str, tuple[str, str]] = {
    "piecewise": ("#222222", "o"),
    "flat piecewise": ("#0072b2", "s"),
    "Polach wet": ("#d55e00", "^"),
    "flat slip ratio": ("#009e73", "D"),
}
"""Colour and marker of a curve."""
LABELS = {
    "held_effort": ("effort over plan [%]", 100.0),
    "utilisation": ("adhesion used [%]", 100.0),
    "slip_time": ("slip over axles [s]", 1.0),
    "damage": ("wheel damage Q [kJ]", 1.0),
    "jerk_rms": ("jerk rms [m/s³]", 1.0),
}
"""Metric -> label, and factor to the label's unit."""


def figure(source: Source) -> Figure:
    """The figure, from what the results hold of the sweep `curves`, at least `FEW_EVENTS`."""
    folder = sweep_folder(source.store.folder, "curves")
    events = max(FEW_EVENTS, curves.stored(folder))
    return draw(curves.run(folder, events, 0, source.jobs, source.on_row))


def draw(table: pd.DataFrame) -> Figure:
    """A row per pair, a panel per metric, each with a scale of its own: mean paired difference and interval by curve."""
    good = table[table["status"] == "ok"]
    drawn = new_figure(7.1, 5.6)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(len(PAIRS), len(METRICS), sharey=True)
        for pair, row in zip(PAIRS, axes, strict=True):
            for metric, one in zip(METRICS, row, strict=True):
                factor = LABELS[metric][1]
                for y, curve in enumerate(CURVES):
                    found = paired_difference(good, curve, pair, metric)
                    if not found.count:
                        continue
                    colour, marker = CURVE_LOOKS[curve]
                    width = None if found.count < 2 else factor * (found.high - found.value)
                    one.errorbar(
                        factor * found.value, y, xerr=width, color=colour, marker=marker, markersize=4.0,
                        linestyle="none", elinewidth=0.9,
                    )  # fmt: skip
                one.axvline(0.0, color="#888888", linewidth=0.8, zorder=0)
                one.grid(visible=False, axis="y")
                one.set_yticks([])
                one.locator_params(axis="x", nbins=3)
                one.set_ylim(len(CURVES) - 0.5, -0.5)
            row[0].set_title(pair.name, loc="left")
        for metric, one in zip(METRICS, axes[-1], strict=True):
            one.set_xlabel(LABELS[metric][0])
        handles = [
            Line2D([], [], linestyle="none", marker=marker, color=colour, label=curve)
            for curve, (colour, marker) in CURVE_LOOKS.items()
        ]
        drawn.legend(handles=handles, loc="outside lower center", ncols=4)
    return drawn
