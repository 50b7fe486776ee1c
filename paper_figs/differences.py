"""Where greedy and exact level differ: over random problems and in closed loop, kind by kind."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.palette import DARK
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import (
    NOTE,
    PAGE,
    Panel,
    bare_rows,
    interval_mark,
    name_rows,
    new_panels,
    rule_colour,
    rule_handles,
    rule_look,
    tint_better,
)
from studies.differences.statements import closed_loop

FEW_PROBLEMS = 100
"""Problems of each kind that are run where the results have none."""
SHOWN = ("greedy", "greedy-claim")
NO_EVENT = "no event"
"""Where a kind of problem has no events in closed loop."""
PANELS = (
    Panel("held_effort", "effort over plan,\nless exact [%]", 100.0),
    Panel("damage", "wheel damage Q,\nless exact [kJ]"),
    Panel("jerk_rms", "jerk rms,\nless exact [m/s³]"),
)
"""Of the closed loop."""
BETTER_SIDES = (1, -1, -1)
"""Whether more or less of each is better."""


@figure("differences", "where greedy and exact level differ: random problems and closed loop",
        study("differences", FEW_PROBLEMS))  # fmt: skip
def differences(table: pd.DataFrame) -> Figure:
    """Left: effort of problems within reach, less that of the exact answer: median, quartiles, 1 and 99 %.

    Right: the same kinds in closed loop, means of paired differences with their intervals; the better side is tinted.
    """
    good = table[table["status"] == "ok"]
    problems, events = good[good["part"] == "problem"], good[good["part"] == "event"]
    within = problems[problems["within_reach"].astype(bool)]
    kinds = list(dict.fromkeys(problems["kind"]))
    widths = (1.6, 1, 1, 1)
    drawn, axes = new_panels(PAGE, 3.4, 1, 1 + len(PANELS), sharey=True, width_ratios=widths)
    for rule, shift in zip(SHOWN, (-0.15, 0.15), strict=True):
        for y, kind in enumerate(kinds):
            rows = within[(within["kind"] == kind) & (within["rule"] == rule)]
            _spread(axes[0], 100 * (rows["over"] - rows["short"]), rule, y + shift)
            for (metric, _, factor, _), one in zip(PANELS, axes[1:], strict=True):
                found = closed_loop(events, kind, metric, rule)
                if found.count == 0 and rule == SHOWN[0]:
                    one.text(0.0, y, NO_EVENT, ha="center", va="center", fontsize=NOTE, color=DARK)
                elif found.count:
                    look = rule_look(rule) | {"markersize": 4.0, "elinewidth": 0.9}
                    interval_mark(one, found, y + shift, factor, look)
    counts = within.loc[within["rule"] == SHOWN[0], "kind"].value_counts()
    name_rows(axes[0], [f"{kind} ({counts.get(kind, 0)})" for kind in kinds])
    axes[0].set(xlabel="effort of the limits,\nless the exact one's [%]", title="random problems")
    axes[1].set_title("closed loop")
    for panel, better, one in zip(PANELS, BETTER_SIDES, axes[1:], strict=True):
        one.set_xlabel(panel.label)
        tint_better(one, better)
    for one in axes:
        one.axvline(0.0, color=rule_colour("exact"), linewidth=0.9, zorder=0)
        bare_rows(one)
    drawn.legend(handles=rule_handles(SHOWN), loc="outside lower center", ncols=2)
    return drawn


def _spread(axes: Axes, values: "pd.Series[float]", rule: str, y: float) -> None:
    if values.empty:
        return
    low, q1, median, q3, high = np.quantile(values, (0.01, 0.25, 0.5, 0.75, 0.99))
    colour = rule_colour(rule)
    axes.plot([low, high], [y, y], color=colour, linewidth=0.8)
    axes.plot([q1, q3], [y, y], color=colour, linewidth=3.5, solid_capstyle="butt")
    axes.plot(median, y, **rule_look(rule) | {"markeredgecolor": "black", "markersize": 3.5})
