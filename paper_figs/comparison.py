"""Rules over all events of a comparison: effort, adhesion used, wheel damage, jerk."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from paper_figs.registry import figure
from paper_figs.source import comparison
from paper_figs.style import (
    CONTROLLER_FILL,
    PAGE,
    Look,
    Panel,
    bare_rows,
    controller_handles,
    name_rows,
    new_panels,
    plain_ticks,
    rule_handles,
    rule_look,
    sides_of,
)
from studies.comparison.summary import Line, summarise

PANELS = (
    Panel("effort_ratio", "effort over plan [%]", 100.0),
    Panel("bound_use", "used of the bound [%]", 100.0),
    Panel("damage", "wheel damage Q [kJ]", 1.0, True),
    Panel("jerk_rms", "jerk, rms [m/s³]", 1.0, True),
)
COLUMNS = 3
"""Panels side by side, of a panel per event."""
LARGEST, SMALLEST = 8.5, 3.5
"""Sizes of the marks of the first and the last rule [points]."""


@figure("rule-comparison", "rules over all events: effort, adhesion used, damage, jerk", comparison)
def rule_comparison(table: pd.DataFrame) -> Figure:
    """One panel per metric, one band per event; a bar is the confidence interval of a mean over seeds."""
    lines = summarise(table)
    scenarios = list(dict.fromkeys(line.scenario for line in lines))
    rules = list(dict.fromkeys(line.rule for line in lines))
    drawn, axes = new_panels(PAGE, 1.3 + 0.62 * len(scenarios), 1, len(PANELS), sharey=True)
    for panel, one in zip(PANELS, axes, strict=True):
        _metric(one, panel, lines, scenarios, rules)
    name_rows(axes[0], scenarios)
    _legend(drawn, lines)
    return drawn


def _metric(
    axes: Axes, panel: Panel, lines: Sequence[Line], scenarios: Sequence[str], rules: Sequence[str]
) -> None:
    offsets = np.linspace(-0.34, 0.34, len(rules)) if len(rules) > 1 else np.zeros(1)
    for line in lines:
        mean = line.metrics.get(panel.metric)
        if mean is None or not np.isfinite(mean.value):
            continue
        y = scenarios.index(line.scenario) + offsets[rules.index(line.rule)]
        look = _look(line, markersize=4.5, elinewidth=0.9)
        axes.errorbar(panel.factor * mean.value, y, xerr=sides_of(mean, panel.factor), **look)
    for k in range(1, len(scenarios), 2):
        axes.axhspan(k - 0.5, k + 0.5, color="#f4f4f4", zorder=-2, linewidth=0)
    axes.set_xlabel(panel.label)
    bare_rows(axes)
    if panel.logarithmic:
        axes.set_xscale("log")
        plain_ticks(axes.xaxis, LogLocator(subs=(1.0, 2.0, 5.0)))


def _look(line: Line, **look: Any) -> Look:
    """Mark of a rule under a controller."""
    fill = CONTROLLER_FILL.get(line.controller, "left")
    return rule_look(line.rule) | {"fillstyle": fill, "markerfacecoloralt": "white"} | look


def _legend(drawn: Figure, lines: Sequence[Line]) -> None:
    rules = dict.fromkeys(line.rule for line in lines)
    controllers = dict.fromkeys(line.controller for line in lines)
    handles = [*rule_handles(rules), *controller_handles(controllers)]
    drawn.legend(handles=handles, loc="outside lower center", ncols=min(6, len(handles)))


@figure("utilisation-damage", "adhesion used against wheel damage, event by event", comparison)
def utilisation_damage(table: pd.DataFrame) -> Figure:
    """One panel per event, one mark per rule and controller (mean over seeds); upper left is best."""
    lines = summarise(table)
    scenarios = list(dict.fromkeys(line.scenario for line in lines))
    rows = math.ceil(len(scenarios) / COLUMNS)
    drawn, axes = new_panels(PAGE, 0.9 + 1.75 * rows, rows, COLUMNS, squeeze=False)
    # rules that agree lie on one point: the later ones are smaller, so that all can be seen
    rules = list(dict.fromkeys(line.rule for line in lines))
    sizes = dict(zip(rules, np.linspace(LARGEST, SMALLEST, len(rules)), strict=True))
    for k, (scenario, one) in enumerate(zip(scenarios, axes.flat, strict=False)):
        for line in (line for line in lines if line.scenario == scenario):
            damage, used = line.metrics["damage"], line.metrics["utilisation"]
            one.errorbar(
                damage.value, 100.0 * used.value,
                xerr=sides_of(damage, 1.0), yerr=sides_of(used, 100.0),
                **_look(line, markersize=sizes[line.rule], elinewidth=0.7),
            )  # fmt: skip
        one.set_title(scenario)
        one.margins(0.14)
        if k % COLUMNS == 0:
            one.set_ylabel("adhesion used [%]")
        if k + COLUMNS >= len(scenarios):
            one.set_xlabel("wheel damage Q [kJ]")
    for one in axes.flat[len(scenarios) :]:
        one.set_visible(False)
    _legend(drawn, lines)
    return drawn
