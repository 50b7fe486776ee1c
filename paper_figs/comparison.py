"""Rules over all events of a comparison: what each changes against `alone`, and adhesion used against wheel damage."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter

from alloc.metrics import METRICS
from paper_figs.apart import Mark, marks_apart
from paper_figs.counts import counted
from paper_figs.palette import BAND_GREY, ZERO
from paper_figs.registry import figure
from paper_figs.source import comparison
from paper_figs.style import (
    COLUMN,
    CONTROLLER_FILL,
    NOTE,
    PAGE,
    Look,
    bare_rows,
    controller_handles,
    name_rows,
    new_panels,
    rule_handles,
    rule_look,
    sides_of,
    tint_better,
)
from studies.comparison.summary import REFERENCE, SummaryLine, summarise


class Change(NamedTuple):
    """A metric as its difference from `REFERENCE`: label, factor to its unit, and up to where the axis is linear."""

    metric: str
    label: str
    factor: float
    linear: float


GAINS = (
    Change("effort_ratio", "effort over plan,\nless alone's [%]", 100.0, 1.0),
    Change("damage", "wheel damage Q,\nless alone's [kJ]", 1.0, 10.0),
)
BESIDES = (
    Change("bound_use", "used of the bound,\nless alone's [%]", 100.0, 1.0),
    Change("jerk_rms", "jerk rms,\nless alone's [m/s³]", 1.0, 0.01),
)
ABREAST = 3
"""Controllers side by side; more of them stand below each other."""
ROW, BETWEEN, LEAST_BANDS = 0.056, 0.95, 0.45
"""Heights [inches] of a rule's row, of what stands above and below the rows, and of all rows of one event alone."""
COLUMNS = 3
"""Panels side by side, of a panel per event."""
MARK: Look = {"markersize": 3.2, "elinewidth": 0.8, "markeredgewidth": 0.4, "clip_on": False}
"""Of a rule's row; the first and the last stand at the panel's edge, and are not cut there."""
SIZE = 3.6
"""Of the marks of adhesion used against damage, and the least distance of two of them [points]."""
NO_PAIRS = f"differences need the\nrule {REFERENCE} beside others"


@figure(
    "rule-comparison",
    "rules over all events: effort and wheel damage, less those of alone",
    comparison,
    events="seeds",
)
def rule_comparison(table: pd.DataFrame) -> Figure:
    """Mean of paired differences over the seeds, with its interval; one seed has none. A band per event, a row per rule.

    The better side is tinted. Axes are linear between the two inner ticks and logarithmic beyond.
    """
    return _changes(table, GAINS)


@figure(
    "rule-comparison-ride",
    "rules over all events: use of the bound and jerk, less those of alone",
    comparison,
    events="seeds",
)
def rule_comparison_ride(table: pd.DataFrame) -> Figure:
    """Mean of paired differences over the seeds, with its interval; one seed has none. A band per event, a row per rule.

    The better side is tinted. Axes are linear between the two inner ticks and logarithmic beyond.
    """
    return _changes(table, BESIDES)


def _changes(table: pd.DataFrame, changes: Sequence[Change]) -> Figure:
    """A panel per metric and controller; the axes of a metric are the same under all controllers."""
    lines = summarise(table)
    scenarios = list(dict.fromkeys(line.scenario for line in lines))
    rules = [rule for rule in dict.fromkeys(line.rule for line in lines) if rule != REFERENCE]
    controllers = list(dict.fromkeys(line.controller for line in lines))
    blocks = math.ceil(len(controllers) / ABREAST)
    abreast = math.ceil(len(controllers) / blocks)
    bands = max(ROW * max(len(rules), 3), 0.14) * len(scenarios)
    height = blocks * (BETWEEN + max(bands, LEAST_BANDS))
    shape = {"sharey": True, "squeeze": False}
    drawn, panels = new_panels(PAGE, height, blocks, abreast * len(changes), **shape)
    limits = {change: _limits(change, lines) for change in changes}
    for k, controller in enumerate(controllers):
        own = [line for line in lines if line.controller == controller]
        row = panels[k // abreast]
        for place, change in enumerate(changes):
            axes = row[place * abreast + k % abreast]
            _change(axes, change, own, scenarios, rules)
            _scale(axes, change, limits[change])
            axes.set_title(controller, loc="center")
            if k % abreast == (min(abreast, len(controllers)) - 1) // 2:
                axes.set_xlabel(change.label)
    for axes in panels.flat[: blocks * abreast * len(changes)]:
        axes.set_visible(bool(axes.get_title("center")))
    name_rows(panels[0, 0], scenarios)
    drawn.legend(handles=rule_handles(rules), loc="outside lower center", ncols=5)
    return drawn


def _change(
    axes: Axes,
    change: Change,
    lines: Sequence[SummaryLine],
    scenarios: Sequence[str],
    rules: Sequence[str],
) -> None:
    """Each rule's own row in each event's band, so no mark covers another."""
    offsets = dict(zip(rules, _rows(len(rules)), strict=True))
    for line in lines:
        found = line.differences.get(change.metric)
        if found is None or not math.isfinite(found.value):
            continue
        y = scenarios.index(line.scenario) + offsets[line.rule]
        look = rule_look(line.rule) | MARK
        counted(axes, [found])
        axes.errorbar(change.factor * found.value, y, xerr=sides_of(found, change.factor), **look)
    if not any(line.differences for line in lines):
        axes.text(0.5, 0.5, NO_PAIRS, transform=axes.transAxes, ha="center", va="center")
    for k in range(len(scenarios) + 1):
        axes.axhline(k - 0.5, color=BAND_GREY, linewidth=0.5, zorder=-1)
    axes.axvline(0.0, color=ZERO, linewidth=0.7, zorder=0)
    bare_rows(axes)


def _rows(count: int) -> list[float]:
    """Places of so many rows in a band from -0.5 to 0.5."""
    return [(k + 0.5) / count - 0.5 for k in range(count)]


def _limits(change: Change, lines: Sequence[SummaryLine]) -> tuple[float, float]:
    """Ends of the axis: all intervals, and at least what is linear."""
    ends = [-1.5 * change.linear, 1.5 * change.linear]
    for line in lines:
        found = line.differences.get(change.metric)
        if found is not None:
            known = (found.value, found.low, found.high)
            ends += [1.3 * change.factor * one for one in known if math.isfinite(one)]
    return min(ends), max(ends)


def _scale(axes: Axes, change: Change, limits: tuple[float, float]) -> None:
    """Linear around zero, logarithmic beyond, with numbers at zero and at the last tick of both sides."""
    axes.set_xscale("symlog", linthresh=change.linear)
    axes.set_xlim(limits)
    powers = change.linear * 10.0 ** np.arange(0, 9)
    ticks = [*(-powers[powers <= -limits[0]]), 0.0, *powers[powers <= limits[1]]]
    last = {min(ticks), 0.0, max(ticks)}
    axes.xaxis.set_major_locator(FixedLocator(sorted(last)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(FixedLocator([tick for tick in ticks if tick not in last]))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="x", labelsize=NOTE)  # those of neighbours would meet
    tint_better(axes, METRICS[change.metric].better)


@figure(
    "utilisation-damage",
    "adhesion used against wheel damage, event by event",
    comparison,
    events="seeds",
)
def utilisation_damage(table: pd.DataFrame) -> Figure:
    """One panel per event, one mark per rule and controller, mean over the seeds with its interval; upper left is best.

    Marks that stand on one point are moved apart, each with a line to its own point.
    """
    lines = summarise(table)
    scenarios = list(dict.fromkeys(line.scenario for line in lines))
    handles = [
        *rule_handles(dict.fromkeys(line.rule for line in lines)),
        *controller_handles(dict.fromkeys(line.controller for line in lines)),
    ]
    columns = min(COLUMNS, len(scenarios))
    rows = math.ceil(len(scenarios) / columns)
    width, abreast = (COLUMN, 3) if columns == 1 else (PAGE, 5)
    height = 0.9 + 1.6 * rows + 0.14 * max(0, math.ceil(len(handles) / abreast) - 4)
    drawn, axes = new_panels(width, height, rows, columns, squeeze=False)
    panels = dict(zip(scenarios, axes.flat, strict=False))
    marks = {scenario: _marks(lines, scenario) for scenario in scenarios}
    for k, (scenario, one) in enumerate(panels.items()):
        for line in (line for line in lines if line.scenario == scenario):
            damage, used = line.metrics["damage"], line.metrics["utilisation"]
            counted(one, [damage, used])
            one.errorbar(
                damage.value, 100.0 * used.value, xerr=sides_of(damage, 1.0), yerr=sides_of(used, 100.0),
                **_look(line), elinewidth=0.5, markersize=0.0,
            )  # fmt: skip
        one.set_title(scenario)
        one.margins(0.16)
        one.update_datalim([(mark.x, mark.y) for mark in marks[scenario]])
        one.autoscale_view()
        one.autoscale(enable=False)
        if k % columns == 0:
            one.set_ylabel("adhesion used [%]")
        if k + columns >= len(scenarios):
            one.set_xlabel("wheel damage Q [kJ]")
    for one in axes.flat[len(scenarios) :]:
        one.set_visible(False)
    drawn.legend(handles=handles, loc="outside lower center", ncols=min(abreast, len(handles)))
    marks_apart(drawn, [(one, marks[name]) for name, one in panels.items()], SIZE)
    return drawn


def _marks(lines: Sequence[SummaryLine], scenario: str) -> list[Mark]:
    """Marks of one event."""
    found = []
    for line in lines:
        at = line.metrics["damage"].value, 100.0 * line.metrics["utilisation"].value
        if line.scenario == scenario and all(map(math.isfinite, at)):
            found.append(Mark(*at, _look(line) | {"markersize": SIZE, "markeredgewidth": 0.5}))
    return found


def _look(line: SummaryLine) -> Look:
    """Mark of a rule under a controller."""
    fill = CONTROLLER_FILL.get(line.controller, "left")
    whose = {"gid": f"{line.rule} under {line.controller}"}
    return rule_look(line.rule) | {"fillstyle": fill, "markerfacecoloralt": "white"} | whose
