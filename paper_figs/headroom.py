"""Gain of rules over `alone` by headroom, and its cost (sweep headroom)."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.counts import counted
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import (
    BOUND,
    CONTROLLER_FILL,
    PAGE,
    Panel,
    bare_rows,
    controller_handles,
    handle,
    interval_mark,
    name_rows,
    new_figure,
    rule_handles,
    rule_look,
    sides_of,
)
from studies.core.drawn_events import complete
from studies.core.statement import mean_interval
from studies.headroom.statements import RULES, SHARERS, STRATA, gain, in_stratum, pairs_of, rules_of

FEW_EVENTS = 20
"""Events that are run for the figure where the results have fewer: every train in every class of headroom."""
COSTS = (
    Panel("slip_time", "slip over axles,\nless alone [s]"),
    Panel("damage", "wheel damage Q,\nless alone [kJ]"),
    Panel("jerk_rms", "jerk rms,\nless alone [m/s³]"),
)
APART = 0.012
"""Distance between rules of one stratum, as a share of the axis."""


@figure("headroom", "what rules gain over alone by headroom, and what it costs (sweep headroom)",
        study("headroom", FEW_EVENTS))  # fmt: skip
def headroom(table: pd.DataFrame) -> Figure:
    """Above a panel per controller: gain over headroom by stratum; below, the means of what each rule costs."""
    good = complete(table)
    controllers = list(dict.fromkeys(good["controller"]))
    pairs = {controller: pairs_of(good, controller) for controller in controllers}
    drawn = new_figure(PAGE, 5.4)
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[1.35, 1.0])).tolist()
    gains = above.subplots(1, len(controllers), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (controller, events) in zip(gains, pairs.items(), strict=True):
        _gains(axes, events)
        axes.set_title(f"{controller} ({len(events)} events)")
    gains[0].set_ylabel("gain over alone,\nover plan [%]")
    handles = [*rule_handles(RULES[1:]), handle("all of the headroom", **BOUND)]
    above.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    costs = below.subplots(1, len(COSTS), sharey=True)
    for panel, axes in zip(COSTS, costs, strict=True):
        _costs(axes, panel, pairs)
    name_rows(costs[0], RULES[1:])
    fills = controller_handles(controllers)
    below.legend(handles=fills, loc="outside lower center", ncols=len(fills))
    return drawn


def _gains(axes: Axes, events: pd.DataFrame) -> None:
    """Mean gain of each rule by stratum with its interval, at the stratum's mean headroom; every event of the last rule."""
    room = 100 * events["headroom"]
    reach = float(room.max())
    own = SHARERS[-1]
    axes.plot(
        room,
        100 * gain(events, own),
        **rule_look(own) | {"markersize": 1.8, "alpha": 0.35, "zorder": 1},
    )
    axes.plot([0.0, reach], [0.0, reach], **BOUND)
    axes.axhline(0.0, color="#888888", linewidth=0.8, zorder=0)
    for place, rule in enumerate(rules_of(events)[1:]):
        shift = APART * reach * (place - 0.5 * (len(RULES) - 2))
        centres, means = [], []
        for name in STRATA:
            chosen = events[in_stratum(events, name)]
            if len(chosen) < 2:
                continue
            found = mean_interval(100 * gain(chosen, rule))
            centres.append(100 * float(chosen["headroom"].mean()) + shift)
            means.append(found.value)
            counted(axes, [found])
            axes.errorbar(
                centres[-1],
                found.value,
                sides_of(found, 1.0),
                **rule_look(rule),
                markersize=3.4,
                elinewidth=0.9,
            )
        axes.plot(centres, means, color=rule_look(rule)["color"], linewidth=0.8, zorder=1)
    axes.locator_params(axis="x", nbins=8, steps=[1, 2, 5, 10])
    axes.set_xlabel("headroom over plan [%]")


def _costs(axes: Axes, panel: Panel, pairs: dict[str, pd.DataFrame]) -> None:
    """Mean of what each rule adds to a cost, a mark per controller."""
    shifts = np.linspace(-0.3, 0.3, len(pairs)) if len(pairs) > 1 else np.zeros(1)
    for shift, (controller, events) in zip(shifts, pairs.items(), strict=True):
        for rule in rules_of(events)[1:]:
            found = mean_interval(gain(events, rule, panel.metric))
            look = rule_look(rule) | {"markersize": 3.6, "elinewidth": 0.9}
            look |= {
                "fillstyle": CONTROLLER_FILL.get(controller, "left"),
                "markerfacecoloralt": "white",
            }
            interval_mark(axes, found, RULES.index(rule) - 1 + shift, panel.factor, look)
    axes.axvline(0.0, color="#888888", linewidth=0.8, zorder=0)
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel(panel.label)
    bare_rows(axes)
