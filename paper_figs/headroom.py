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
from studies.headroom.statements import RULES, STRATA, gain, in_stratum, pairs_of, rules_of

FEW_EVENTS = 20
"""Events that are run for the figure where the results have fewer: every train in every class of headroom."""
COSTS = (
    Panel("slip_time", "slip over axles,\nless alone [s]"),
    Panel("damage", "wheel damage Q,\nless alone [kJ]"),
    Panel("jerk_rms", "jerk rms,\nless alone [m/s³]"),
)


@figure("headroom", "what rules gain over alone by headroom, and what it costs (sweep headroom)",
        study("headroom", FEW_EVENTS))  # fmt: skip
def headroom(table: pd.DataFrame) -> Figure:
    """Above, a panel per controller: the mean gain of each rule among events of like headroom. Below: what each rule costs.

    A dashed line is the mean headroom of these events, all that sharing could gain.
    """
    good = complete(table)
    controllers = list(dict.fromkeys(good["controller"]))
    pairs = {controller: pairs_of(good, controller) for controller in controllers}
    drawn = new_figure(PAGE, 5.4)
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[1.35, 1.0])).tolist()
    gains = above.subplots(1, len(controllers), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (controller, events) in zip(gains, pairs.items(), strict=True):
        _gains(axes, events)
        axes.set_title(f"{controller} ({len(events)} events)")
    gains[0].set_ylabel("gain over alone,\nof the plan [%]")
    handles = [*rule_handles(RULES[1:]), handle("the headroom", **BOUND)]
    above.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    costs = below.subplots(1, len(COSTS), sharey=True)
    for panel, axes in zip(COSTS, costs, strict=True):
        _costs(axes, panel, pairs)
    name_rows(costs[0], RULES[1:])
    fills = controller_handles(controllers)
    below.legend(handles=fills, loc="outside lower center", ncols=len(fills))
    return drawn


def _gains(axes: Axes, events: pd.DataFrame) -> None:
    """A band per stratum: mean gain of each rule beside the others, and the mean headroom there as a line."""
    rules = rules_of(events)[1:]
    for band, name in enumerate(STRATA):
        chosen = events[in_stratum(events, name)]
        if len(chosen) < 2:
            continue
        room = 100 * float(chosen["headroom"].mean())
        axes.plot([band - 0.46, band + 0.46], [room, room], gid="headroom", **BOUND)
        places = np.linspace(-0.36, 0.36, len(rules)) if len(rules) > 1 else np.zeros(1)
        for place, rule in zip(places, rules, strict=True):
            found = mean_interval(100 * gain(chosen, rule))
            counted(axes, [found])
            look = rule_look(rule) | {"markersize": 3.2, "elinewidth": 0.9}
            axes.errorbar(band + place, found.value, sides_of(found, 1.0), **look)
    for edge in range(1, len(STRATA)):
        axes.axvline(edge - 0.5, color="#dddddd", linewidth=0.6, zorder=0)
    axes.axhline(0.0, color="#888888", linewidth=0.8, zorder=0)
    axes.grid(visible=False, axis="x")
    axes.tick_params(axis="x", length=0)
    axes.set_xticks(range(len(STRATA)), [name.removesuffix(" points") for name in STRATA])
    axes.set(xlim=(-0.5, len(STRATA) - 0.5), xlabel="headroom, of the plan [%]")


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
