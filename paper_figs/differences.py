"""Where greedy and exact level differ: over random problems and in closed loop, kind by kind."""

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure, rule_colour, rule_handles, rule_marker
from studies.core.collection import sweep_folder
from studies.differences import study as differences
from studies.differences.statements import closed_loop

FEW_PROBLEMS = 100
"""Problems of each kind that are run where the results hold none."""
SHOWN = ("greedy", "greedy-claim")
PANELS = (
    ("held_effort", "effort over plan,\nless exact [%]", 100.0),
    ("damage", "wheel damage Q,\nless exact [kJ]", 1.0),
    ("jerk_rms", "jerk rms,\nless exact [m/s³]", 1.0),
)
"""Closed loop: metric, label, factor to the label's unit."""


def figure(source: Source) -> Figure:
    """The figure, from the sweep `differences`; a small one is run if the results hold none."""
    folder = sweep_folder(source.store.folder, "differences")
    table = differences.stored(folder)
    if table is None:
        table = differences.run(folder, FEW_PROBLEMS, 0, source.jobs, source.on_row)
    return draw(table)


def draw(table: pd.DataFrame) -> Figure:
    """Left: effort of problems within reach, less what the plan asks: median, quartiles, 1 and 99 %. Right: closed loop."""
    good = table[table["status"] == "ok"]
    problems, events = good[good["part"] == "problem"], good[good["part"] == "event"]
    kinds = list(dict.fromkeys(problems["kind"]))
    drawn = new_figure(7.1, 3.4)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(1, 1 + len(PANELS), sharey=True, width_ratios=(1.6, 1, 1, 1))
        for rule, shift in zip(SHOWN, (-0.15, 0.15), strict=True):
            _problems(axes[0], problems, kinds, rule, shift)
            for panel, one in zip(PANELS, axes[1:], strict=True):
                for y, kind in enumerate(kinds):
                    _closed_loop(one, events, kind, rule, panel, y + shift)
        axes[0].set_yticks(range(len(kinds)), [_counted(problems, kind) for kind in kinds])
        axes[0].set_ylim(len(kinds) - 0.5, -0.5)
        axes[0].set_xlabel("effort of the limits,\nless the exact one's [%]")
        axes[0].set_title("random problems")
        axes[1].set_title("closed loop")
        for one, (_, label, _) in zip(axes[1:], PANELS, strict=True):
            one.set_xlabel(label)
        for one in axes:
            one.axvline(0.0, color=rule_colour("exact"), linewidth=0.9, zorder=0)
            one.grid(visible=False, axis="y")
            one.tick_params(axis="y", length=0)
        drawn.legend(handles=rule_handles(SHOWN), loc="outside lower center", ncols=2)
    return drawn


def _reached(problems: pd.DataFrame, kind: str, rule: str) -> pd.DataFrame:
    chosen = (problems["kind"] == kind) & (problems["rule"] == rule)
    return problems[chosen & problems["within_reach"].astype(bool)]


def _counted(problems: pd.DataFrame, kind: str) -> str:
    return f"{kind} ({len(_reached(problems, kind, SHOWN[0]))})"


def _problems(
    axes: Axes, problems: pd.DataFrame, kinds: list[str], rule: str, shift: float
) -> None:
    for y, kind in enumerate(kinds):
        rows = _reached(problems, kind, rule)
        if rows.empty:
            continue
        values = 100 * (rows["over"] - rows["short"])
        low, q1, median, q3, high = np.quantile(values, (0.01, 0.25, 0.5, 0.75, 0.99))
        colour = rule_colour(rule)
        axes.plot([low, high], 2 * [y + shift], color=colour, linewidth=0.8)
        axes.plot([q1, q3], 2 * [y + shift], color=colour, linewidth=3.5, solid_capstyle="butt")
        axes.plot(
            median, y + shift, marker=rule_marker(rule), color=colour, markeredgecolor="black"
        )


def _closed_loop(
    axes: Axes,
    events: pd.DataFrame,
    kind: str,
    rule: str,
    panel: tuple[str, str, float],
    y: float,
) -> None:
    metric, _, factor = panel
    found = closed_loop(events, kind, metric, rule)
    if found.count < 2:
        return
    axes.errorbar(
        factor * found.value, y, xerr=factor * (found.high - found.value), color=rule_colour(rule),
        marker=rule_marker(rule), markersize=4.0, elinewidth=0.9,
    )  # fmt: skip
