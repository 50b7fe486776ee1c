"""Adhesion used against wheel damage: what a rule gains, and what the wheels pay for it."""

import math
from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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

COLUMNS = 3
LARGEST, SMALLEST = 8.5, 3.5
"""Sizes of the marks of the first and the last rule [points]."""


def figure(source: Source) -> Figure:
    """The figure, from the rows of a comparison."""
    return draw(source.table)


def draw(table: pd.DataFrame) -> Figure:
    """One panel per event, one mark per rule and controller (mean over seeds); upper left is best."""
    lines = summarise(table)
    scenarios = list(dict.fromkeys(line.scenario for line in lines))
    rows = math.ceil(len(scenarios) / COLUMNS)
    rules = list(dict.fromkeys(line.rule for line in lines))
    drawn = new_figure(7.1, 0.9 + 1.75 * rows)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(rows, COLUMNS, squeeze=False).ravel()
        for k, (scenario, one) in enumerate(zip(scenarios, axes, strict=False)):
            _event(one, [line for line in lines if line.scenario == scenario], rules)
            one.set_title(scenario)
            one.margins(0.14)
            if k % COLUMNS == 0:
                one.set_ylabel("adhesion used [%]")
            if k + COLUMNS >= len(scenarios):
                one.set_xlabel("wheel damage Q [kJ]")
        for one in axes[len(scenarios) :]:
            one.set_visible(False)
        controllers = dict.fromkeys(line.controller for line in lines)
        handles = [*rule_handles(rules), *controller_handles(controllers)]
        drawn.legend(handles=handles, loc="outside lower center", ncols=min(6, len(handles)))
    return drawn


def _event(axes: Axes, lines: Sequence[Line], rules: Sequence[str]) -> None:
    # rules that agree lie on one point: the later ones are smaller, so that all can be seen
    sizes = dict(zip(rules, np.linspace(LARGEST, SMALLEST, len(rules)), strict=True))
    for line in lines:
        damage, used = line.metrics["damage"], line.metrics["utilisation"]
        axes.errorbar(
            damage.value, 100.0 * used.value,
            xerr=damage.half_width if math.isfinite(damage.half_width) else None,
            yerr=100.0 * used.half_width if math.isfinite(used.half_width) else None,
            linestyle="none", color=rule_colour(line.rule), marker=rule_marker(line.rule),
            markersize=sizes[line.rule], fillstyle=CONTROLLER_FILL.get(line.controller, "left"),
            markerfacecoloralt="white", elinewidth=0.7,
        )  # fmt: skip
