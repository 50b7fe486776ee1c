"""Drawn blended stops: bound used by controller and rule, what the estimated speed costs, its error (sweep blended)."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from alloc.metrics.registry import range_of
from paper_figs.mismatch import COLOURS
from paper_figs.palette import BLACK, DARK, ZERO
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import (
    BOUND,
    NOTE,
    PAGE,
    bare_rows,
    controller_look,
    handle,
    interval_mark,
    name_rows,
    new_figure,
    plain_ticks,
    rule_look,
)
from studies.blended.events import CURVES, TRAINS
from studies.blended.statements import (
    CONTROLLERS,
    ERROR,
    ESTIMATE,
    LOST,
    RULES,
    TRUTH,
    arm_name,
    less,
    pairs_of,
)
from studies.core.arms import Arm
from studies.core.claims import quantity
from studies.core.statement import column_interval, mean_interval

FEW_EVENTS = 2
"""Events that are run for the figure where the results have fewer."""
SHIFTS = (-0.24, 0.0, 0.24)
"""Places of the rules in a controller's row."""
SHOWN_RULE = "cooperative"
"""Rule of the lower panels."""
FULL = 15.0
"""Difference [points] of full colour."""
SHORT_NAMES = {
    "exponential-difference": "double\nexponential",
    "polach-by-friction": "polach\nby friction",
}


@figure("blended", "drawn stops with motors and air brakes: controllers, rules, error of the speed (sweep blended)",
        study("blended", FEW_EVENTS), events="stops")  # fmt: skip
def blended(table: pd.DataFrame) -> Figure:
    """Above: means with intervals by controller and rule, open marks with the true speed, and single stops of the estimate
    under all rules. Below: bound used in per cent under one rule by train and by curve; blue is more and orange less than
    cut-and-ramp."""
    events = pairs_of(table)
    drawn = new_figure(PAGE, 5.2)
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[1.0, 1.3])).tolist()
    upper = above.subplots(1, 4)
    used, lost, error, ratio = upper
    _used(used, events)
    _lost(lost, events)
    _stops(
        error,
        events,
        "reference_error",
        "largest error of the\nreference speed [m/s]",
        ERROR,
    )
    _stops(ratio, events, "reference_ratio", "error over stated\ndeviation, rms [–]", 1.0)
    for one in upper:
        name_rows(one, CONTROLLERS if one is used else [""] * len(CONTROLLERS))
        bare_rows(one)
    by_train, by_curve = below.subplots(1, 2)
    _cells(by_train, events, "train", list(TRAINS))
    _cells(by_curve, events, "curve", list(CURVES))
    look = {"linestyle": "none", "marker": "o", "color": DARK}
    handles = [handle(rule, **{**rule_look(rule), "gid": None}) for rule in RULES]
    handles += [
        handle("estimated speed", **look),
        handle("true speed", **look, markerfacecolor="white"),
    ]
    below.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return drawn


def _used(axes: Axes, events: pd.DataFrame) -> None:
    for y, controller in enumerate(CONTROLLERS):
        for rule, shift in zip(RULES, SHIFTS, strict=True):
            look = {**rule_look(rule), "markersize": 4.0, "elinewidth": 0.9}
            for source, face, off in ((ESTIMATE, look["color"], -0.04), (TRUTH, "white", 0.06)):
                found = column_interval(
                    events, f"bound_use@{arm_name(Arm(rule, controller), source)}"
                )
                own = {"markerfacecolor": face, "gid": f"{rule}, {source}"}
                interval_mark(axes, found, y + shift + off, 100.0, look | own)
    axes.set_xlabel("bound used [%]")


def _lost(axes: Axes, events: pd.DataFrame) -> None:
    for y, controller in enumerate(CONTROLLERS):
        for rule, shift in zip(RULES, SHIFTS, strict=True):
            arm = Arm(rule, controller)
            values = quantity(events, less("bound_use", arm_name(arm, TRUTH), arm_name(arm)))
            look = {**rule_look(rule), "markersize": 4.0, "elinewidth": 0.9}
            interval_mark(axes, mean_interval(values), y + shift, 100.0, look)
    axes.axvline(0.0, color=ZERO, linewidth=0.8, zorder=0)
    axes.axvline(100.0 * LOST, **BOUND)
    axes.set_xlabel("lost to the estimate,\nof the bound [%]")


def _stops(axes: Axes, events: pd.DataFrame, metric: str, label: str, bound: float) -> None:
    """Every stop under every rule as a tick, their mean or median as a mark."""
    for y, controller in enumerate(CONTROLLERS):
        columns = [f"{metric}@{arm_name(Arm(rule, controller))}" for rule in RULES]
        values = events[columns].astype(float).to_numpy().ravel()
        values = values[np.isfinite(values)]
        look = controller_look(controller)
        pale = look | {"marker": "|", "markersize": 5.0, "alpha": 0.3}
        axes.plot(values, np.full(values.size, y + 0.17), **pale)
        found = mean_interval(events[columns].astype(float).mean(axis=1), within=range_of(metric))
        interval_mark(axes, found, y - 0.17, 1.0, look | {"markersize": 4.0, "elinewidth": 0.9})
    axes.set_xscale("log")
    plain_ticks(axes.xaxis, LogLocator(base=10.0))
    axes.axvline(bound, **BOUND)
    axes.set_xlabel(label)


def _cells(axes: Axes, events: pd.DataFrame, column: str, names: Sequence[str]) -> None:
    """A cell per controller and kind of stop: the mean as a number, its difference from cut-and-ramp as a colour."""
    scale = Normalize(-FULL, FULL)
    reference = f"bound_use@{arm_name(Arm(SHOWN_RULE, CONTROLLERS[0]))}"
    for y, name in enumerate(names):
        own = events[events[column] == name]
        if own.empty:
            continue
        for x, controller in enumerate(CONTROLLERS):
            mean = 100.0 * float(own[f"bound_use@{arm_name(Arm(SHOWN_RULE, controller))}"].mean())
            worth = float(scale(mean - 100.0 * float(own[reference].mean())))
            axes.bar(
                x, 0.94, 0.96, y - 0.47, color=COLOURS(worth), edgecolor="#cccccc", linewidth=0.4
            )
            axes.text(
                x, y, f"{mean:.0f}", ha="center", va="center", fontsize=NOTE,
                color="white" if abs(worth - 0.5) > 0.35 else BLACK,
            )  # fmt: skip
    count = events[column].value_counts()
    name_rows(axes, [f"{SHORT_NAMES.get(name, name)} (n = {count.get(name, 0)})" for name in names])
    axes.set_xticks(range(len(CONTROLLERS)), [one.replace("-", "-\n", 1) for one in CONTROLLERS])
    axes.set_xlim(-0.6, len(CONTROLLERS) - 0.4)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.set_title(f"bound used by {column}, {SHOWN_RULE} [%]", loc="left")
    for side in axes.spines.values():
        side.set_visible(False)
