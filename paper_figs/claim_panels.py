"""What the figures of the claims share: their events, and the panel that shows for which events a claim holds."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes

from paper_figs.source import Source
from paper_figs.style import rule_colour, rule_marker
from studies.claims import study as claims
from studies.claims.parts import PARTS
from studies.claims.statements import claim_population, paired
from studies.core.collection import sweep_folder
from studies.core.statement import CONFIDENCE, Interval
from studies.core.verdict import LEAST_EVENTS, Part, Test

FEW_EVENTS = 24
"""Events that are run where the results hold fewer: enough to see what a figure shows, not to believe it. `readhesion
sweep claims` runs as many as the statements need."""

SEASON_MARKERS = {"summer": ("o", "#222222"), "winter": ("s", "#999999")}
"""Marker and colour of a season; greys, since colours stand for rules."""


def claim_table(source: Source) -> pd.DataFrame:
    """Rows of the sweep `claims` that lie in the source's results; `FEW_EVENTS` events at least, run where missing."""
    folder = sweep_folder(source.store.folder, "claims")
    events = max(FEW_EVENTS, claims.stored(folder))
    return claims.run(folder, events, 0, source.jobs, source.on_row)


def bearing_on(table: pd.DataFrame, claim: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """All events of the sweep, one row each, and those that bear on a claim."""
    pairs = paired(claims.complete(table))
    return pairs, claim_population(pairs, claim)


def forest(
    axes: Axes,
    events: pd.DataFrame,
    test: Test,
    label: str,
    factor: float = 1.0,
    rule: str = "greedy",
    parts: Mapping[str, Part] = PARTS,
) -> None:
    """The quantity of a claim over all its events and over each part, with the interval that the verdict is made from.

    Parts of fewer than `LEAST_EVENTS` events are named, but have no mark. `factor`: to the label's unit.
    """
    confidence = 1.0 - (1.0 - CONFIDENCE) / len(parts)
    whole = test.interval(events)
    rows = {"all": whole} | {
        name: test.interval(events[part(events)], confidence) for name, part in parts.items()
    }
    for y, (name, interval) in enumerate(rows.items()):
        mark(axes, interval, y, factor, rule, large=name == "all")
    axes.set_yticks(range(len(rows)), [f"{n} ({i.count})" for n, i in rows.items()])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.axvline(factor * test.threshold, color="#444444", linewidth=0.8, linestyle="--", zorder=0)
    axes.axhline(0.5, color="#bbbbbb", linewidth=0.6)
    axes.tick_params(axis="y", length=0, labelsize=6.5)
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.08)
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlabel(label)


def mark(
    axes: Axes, interval: Interval, y: float, factor: float, rule: str, large: bool = False
) -> None:
    """One interval as a horizontal error bar in the rule's colour and marker."""
    if interval.count < LEAST_EVENTS:
        return
    axes.errorbar(
        factor * interval.value, y,
        xerr=[[factor * (interval.value - interval.low)], [factor * (interval.high - interval.value)]],
        color=rule_colour(rule), marker=rule_marker(rule), markersize=5.5 if large else 3.5, linestyle="none",
        elinewidth=1.3 if large else 0.8,
    )  # fmt: skip


def strips(axes: Axes, columns: Mapping[str, "pd.Series[float]"], factor: float) -> None:
    """One column of points per rule, side by side, with the median as a bar."""
    spread = np.random.default_rng(0)
    for x, (rule, values) in enumerate(columns.items()):
        known = factor * values.dropna().to_numpy(dtype=float)
        offset = spread.uniform(-0.28, 0.28, known.size)
        axes.plot(
            x + offset, known, linestyle="none", color=rule_colour(rule), marker=rule_marker(rule), markersize=2.0,
            alpha=0.5,
        )  # fmt: skip
        if known.size:
            axes.plot([x - 0.35, x + 0.35], 2 * [np.median(known)], color="black", linewidth=1.2)
    axes.set_xticks(range(len(columns)), list(columns), rotation=35, ha="right")
    axes.grid(visible=False, axis="x")


def diagonal(axes: Axes) -> None:
    """The line on which both rules are alike, and the same bounds for both axes."""
    low = min(axes.get_xlim()[0], axes.get_ylim()[0])
    high = max(axes.get_xlim()[1], axes.get_ylim()[1])
    axes.plot([low, high], [low, high], color="#444444", linewidth=0.8, zorder=0)
    axes.set_xlim(low, high)
    axes.set_ylim(low, high)
