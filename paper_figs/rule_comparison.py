"""Rules over all events: effort, adhesion used, wheel damage and jerk."""

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from paper_figs.source import Source
from paper_figs.style import (
    CONTROLLER_FILL,
    STYLE_FILE,
    controller_handles,
    new_figure,
    rule_colour,
    rule_handles,
    rule_marker,
)
from studies.comparison.summary import Line, summarise


class Panel(NamedTuple):
    """A panel: metric, axis label, factor to the label's unit, logarithmic axis."""

    metric: str
    label: str
    factor: float
    logarithmic: bool


PANELS = (
    Panel("effort_ratio", "effort over plan [%]", 100.0, False),
    Panel("utilisation", "adhesion used [%]", 100.0, False),
    Panel("damage", "wheel damage Q [kJ]", 1.0, True),
    Panel("jerk_rms", "jerk, rms [m/s³]", 1.0, True),
)


def figure(source: Source) -> Figure:
    """The figure, from the rows of a comparison."""
    return draw(source.table)


def draw(table: pd.DataFrame) -> Figure:
    """One panel per metric, one band per event; a bar is the confidence interval of a mean over seeds."""
    lines = summarise(table)
    scenarios = list(dict.fromkeys(line.scenario for line in lines))
    rules = list(dict.fromkeys(line.rule for line in lines))
    controllers = list(dict.fromkeys(line.controller for line in lines))
    drawn = new_figure(7.1, 1.3 + 0.62 * len(scenarios))
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(1, len(PANELS), sharey=True)
        for panel, one in zip(PANELS, axes, strict=True):
            _panel(one, panel, lines, scenarios, rules)
        axes[0].set_yticks(range(len(scenarios)), scenarios)
        axes[0].set_ylim(len(scenarios) - 0.5, -0.5)
        handles = [*rule_handles(rules), *controller_handles(controllers)]
        drawn.legend(handles=handles, loc="outside lower center", ncols=min(6, len(handles)))
    return drawn


def _panel(
    axes: Axes, panel: Panel, lines: Sequence[Line], scenarios: Sequence[str], rules: Sequence[str]
) -> None:
    offsets = np.linspace(-0.34, 0.34, len(rules)) if len(rules) > 1 else np.zeros(1)
    for line in lines:
        mean = line.metrics.get(panel.metric)
        if mean is None or not np.isfinite(mean.value):
            continue
        y = scenarios.index(line.scenario) + offsets[rules.index(line.rule)]
        error = panel.factor * mean.half_width if np.isfinite(mean.half_width) else None
        colour = rule_colour(line.rule)
        axes.errorbar(
            panel.factor * mean.value, y, xerr=error, color=colour, marker=rule_marker(line.rule),
            fillstyle=CONTROLLER_FILL.get(line.controller, "left"), markerfacecoloralt="white",
            markersize=4.5, elinewidth=0.9,
        )  # fmt: skip
    for k in range(len(scenarios)):
        if k % 2:
            axes.axhspan(k - 0.5, k + 0.5, color="#f4f4f4", zorder=-2, linewidth=0)
    axes.set_xlabel(panel.label)
    axes.grid(visible=False, axis="y")
    axes.tick_params(axis="y", length=0)
    if panel.logarithmic:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
