"""Readhesion controllers over random events, from none to MPC, and the effect of several adhesion curves on differences."""

from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from alloc.metrics.registry import range_of
from paper_figs.palette import BLUE, GREEN, VERMILION
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import (
    BOUND,
    PAGE,
    Look,
    Panel,
    bare_rows,
    controller_look,
    handle,
    interval_mark,
    name_rows,
    new_panels,
)
from studies.core.drawn_events import complete
from studies.core.statement import mean_interval
from studies.curves.statements import CURVES, PAIRS, paired_difference
from studies.ladder.statements import LADDER, LOCOMOTIVE, YARDSTICKS

FEW_EVENTS = 6
"""Events that are run for the figure where the results have fewer: two of each train."""
PANELS = (
    Panel("utilisation_short", "adhesion used\nwhere short [%]", 100.0),
    Panel("effort_ratio", "effort\nover plan [%]", 100.0),
    Panel("search_time", "search time [s]"),
    Panel("unfinished_searches", "searches\nunfinished [%]", 100.0),
    Panel("torque_fluctuation", "torque fluctuation\nover plan [%]", 100.0),
    Panel("slip_time", "slip, summed\nover axles [s]"),
    Panel("damage", "wheel damage Q\n[kJ]", 1.0, True),
    Panel("jerk_rms", "jerk rms\n[m/s³]"),
)
BELOW = 0.19
"""Distance of the single events from their mean, in rows: no mark stands on another."""
PLACES, PILE = 100.0, 0.16
"""Places along a panel that part events from each other, and the height of a pile of all of them, in rows."""
FEW_OF_CURVES = 4
"""Events that are run for the figure where the results have fewer."""
CURVE_LOOKS: dict[str, Look] = {
    "piecewise": {"color": "#222222", "marker": "o", "linestyle": "none"},
    "flat piecewise": {"color": BLUE, "marker": "s", "linestyle": "none"},
    "Polach wet": {"color": VERMILION, "marker": "^", "linestyle": "none"},
    "flat slip ratio": {"color": GREEN, "marker": "D", "linestyle": "none"},
}
CURVE_PANELS = (
    Panel("held_effort", "effort over plan [%]", 100.0),
    Panel("utilisation", "adhesion used [%]", 100.0),
    Panel("slip_time", "slip over axles [s]"),
    Panel("damage", "wheel damage Q [kJ]"),
    Panel("jerk_rms", "jerk rms [m/s³]"),
)


@figure("ladder", "readhesion controllers from none to MPC over random events (sweep ladder)",
        study("ladder", FEW_EVENTS))  # fmt: skip
def ladder(table: pd.DataFrame) -> Figure:
    """A panel per metric: means by controller, filled with a free axle, open for the locomotive.

    Below a mean a short line for each event; those of one place are piled up, so a tall line is many events.
    """
    good = complete(table)
    free = good["train"] != LOCOMOTIVE
    drawn, axes = new_panels(PAGE, 6.0, 2, len(PANELS) // 2, sharey=True)
    for panel, one in zip(PANELS, axes.flat, strict=True):
        spread = _spread(good[panel.metric].dropna().astype(float), panel)
        for y, controller in enumerate(LADDER):
            own = good["controller"] == controller
            look = controller_look(controller)
            for chosen, shift, face in ((free, -0.28, look["color"]), (~free, 0.2, "white")):
                values = good.loc[own & chosen, panel.metric].dropna().astype(float)
                _mark(one, values, panel, spread, y + shift, look | {"markerfacecolor": face})
        one.set_xlabel(panel.label)
        if panel.logarithmic:
            one.set_xscale("log")
            one.xaxis.set_minor_formatter(NullFormatter())
        bare_rows(one)
    for bar in YARDSTICKS:
        axes[0, 0].axvline(100 * bar, **BOUND)
    name_rows(axes[0, 0], LADDER)
    counts = [good["scenario"][kind].nunique() for kind in (free, ~free)]
    drawn.suptitle(
        f"filled: multiple units ({counts[0]} events); open: locomotive, no free axle ({counts[1]} events)",
    )
    return drawn


def _spread(values: "pd.Series[float]", panel: Panel) -> float:
    """Length of the panel's axis that the events take, in decades where it is logarithmic."""
    if values.empty:
        return 0.0
    shown = panel.factor * values.to_numpy()
    return float(np.ptp(np.log10(shown) if panel.logarithmic else shown))


def piled(values: NDArray[np.float64], spread: float) -> NDArray[np.float64]:
    """How far each value is moved up, in rows, so that those of one place pile up; `spread`: of all that the panel shows."""
    place = np.round(values * PLACES / (spread or 1.0))
    below = np.array([np.count_nonzero(place[:k] == one) for k, one in enumerate(place)])
    return np.asarray(below * PILE / max(len(values) - 1, 1), dtype=np.float64)


def _mark(
    axes: Axes, events: "pd.Series[float]", panel: Panel, spread: float, y: float, look: Look
) -> None:
    """Events as pale points, their mean with its interval in the controller's colour."""
    if events.empty:
        return
    pale = look | {"marker": "|", "markersize": 2.0, "markeredgewidth": 0.6, "alpha": 0.5}
    shown = np.asarray(panel.factor * events.to_numpy(), dtype=np.float64)
    along = np.log10(shown) if panel.logarithmic else shown
    axes.plot(shown, y + BELOW - 0.04 + piled(along, spread), **pale)
    found = mean_interval(events, within=range_of(panel.metric))
    if panel.logarithmic:  # an interval that reaches below zero has no place on this axis
        found = replace(found, low=max(found.low, 0.1 * found.value))
    interval_mark(axes, found, y, panel.factor, look | {"markersize": 4.0, "elinewidth": 1.0})


@figure("curves", "differences of rules and controllers under several adhesion curves (sweep curves)",
        study("curves", FEW_OF_CURVES))  # fmt: skip
def curves(table: pd.DataFrame) -> Figure:
    """A row per pair, a panel per metric, each with a scale of its own: mean paired difference and interval by curve."""
    good = table[table["status"] == "ok"]
    drawn, axes = new_panels(PAGE, 5.6, len(PAIRS), len(CURVE_PANELS), sharey=True)
    for pair, row in zip(PAIRS, axes, strict=True):
        for panel, one in zip(CURVE_PANELS, row, strict=True):
            for y, curve in enumerate(CURVES):
                found = mean_interval(paired_difference(good, curve, pair, panel.metric))
                if found.count:
                    look = {"markersize": 4.0, "elinewidth": 0.9, **CURVE_LOOKS[curve]}
                    interval_mark(one, found, y, panel.factor, look)
            one.axvline(0.0, color="#888888", linewidth=0.8, zorder=0)
            one.grid(visible=False, axis="y")
            one.set_yticks([])
            one.locator_params(axis="x", nbins=3)
            one.set_ylim(len(CURVES) - 0.5, -0.5)
        row[0].set_title(pair.name)
    for panel, one in zip(CURVE_PANELS, axes[-1], strict=True):
        one.set_xlabel(panel.label)
    handles = [handle(curve, **look) for curve, look in CURVE_LOOKS.items()]
    drawn.legend(handles=handles, loc="outside lower center", ncols=4)
    return drawn
