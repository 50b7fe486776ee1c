"""The patent over random events: each claim's verdict over its threshold, and increments that a train learns."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from paper_figs.drawing import figure, study
from paper_figs.style import (
    BLACK,
    BLUE,
    BOUND,
    DARK,
    GREEN,
    GREY,
    NOTE,
    ORANGE,
    PAGE,
    PURPLE,
    VERMILION,
    Look,
    bare_rows,
    handle,
    interval_mark,
    legend_below,
    name_rows,
    new_panels,
)
from studies.core.drawn_events import COMPARED, complete
from studies.core.statement import (
    CONDITIONS,
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
    Statement,
    Tested,
)
from studies.patent.claims_study import ARMS, claim_statements, statement_name
from studies.patent.learning_study import SERIES, TOLERANCE

LOOKS: Mapping[str, Look] = {
    HOLDS: {"color": GREEN, "marker": "o"},
    CONDITIONS: {"color": ORANGE, "marker": "D"},
    FAILS: {"color": VERMILION, "marker": "X"},
    UNDECIDED: {"color": BLUE, "marker": "s"},
    TOO_FEW: {"color": GREY, "marker": "."},
}
"""Colour and marker of a verdict; rules have the same colours in other figures, but none here."""
ROW, BETWEEN = 0.23, 0.5
"""Heights [inches] of a row, and of title and label of a panel."""
CLAIMED = "#eeeeee"
"""Shade of the side of the threshold that is claimed."""
FEW_CLAIMS = 24
"""Events that are run where the results have fewer: enough to show the form of a figure, not to support a conclusion."""
CLAIM_TABLE = study("claims", FEW_CLAIMS)


class Strip(NamedTuple):
    """Statements that share a threshold: title, label of the axis with its unit, factor to that unit."""

    title: str
    label: str
    factor: float
    rows: Mapping[str, Statement] = {}
    """By the name of a row."""


CLAIMS = {
    "a": Strip("(a) reaches the plan where alone does not", "effort over plan, at most 100 [%]", 100.0),
    "b": Strip("(b) every unit at about its bound", "adhesion used by the unit that uses least [%]", 100.0),
    "c": Strip("(c) about 95 % used when a cap is too high", "adhesion used, limit up to 15 % too high [%]", 100.0),
    "d": Strip("(d) better ride than sharing", "jerk rms less sharing [m/s³]", 1.0),
    "e": Strip("(e) better than the preset", "effort over plan less that of the preset [%]", 100.0),
}  # fmt: skip


@figure("claim-verdicts", "claims (a) to (e) of JP5484215 under cut-and-ramp: each verdict over its threshold",
        CLAIM_TABLE)  # fmt: skip
def claim_verdicts(table: pd.DataFrame) -> Figure:
    """One panel per claim: the mean that decides, with the interval that decides (Student's t, widened after Holm)."""
    return _of_claims(table, COMPARED[0])


@figure("claim-verdicts-search", "claims (a) to (e) of JP5484215 under perturb-observe: each verdict over its threshold",
        CLAIM_TABLE)  # fmt: skip
def claim_verdicts_search(table: pd.DataFrame) -> Figure:
    """As `claim_verdicts`, under the controller that searches for the peak."""
    return _of_claims(table, COMPARED[1])


def _of_claims(table: pd.DataFrame, controller: str) -> Figure:
    """Verdicts of the rules under `controller`, after Holm over those under all controllers."""
    found = {s.name: s for s in claim_statements(complete(table))}
    shown = [arm for arm in ARMS if arm.controller == controller]
    return verdict_strips(
        strip._replace(rows={arm.rule: found[statement_name(claim, arm)] for arm in shown})
        for claim, strip in CLAIMS.items()
    )


def verdict_strips(strips: Iterable[Strip]) -> Figure:
    """One panel per threshold: each mean with its interval after Holm, coloured by its verdict."""
    shown = list(strips)
    rows = [ROW * max(len(strip.rows), 1.5) for strip in shown]
    height = BETWEEN * (1 + len(rows)) + sum(rows)
    drawn, panels = new_panels(PAGE, height, len(rows), 1, squeeze=False, height_ratios=rows)
    for axes, strip in zip(panels[:, 0], shown, strict=True):
        _strip(axes, strip)
    seen = {s.verdict for strip in shown for s in strip.rows.values()}
    handles = [handle(v, linestyle="none", **look) for v, look in LOOKS.items() if v in seen]
    handles += [
        handle("interval that decides: Student's t after Holm", color=DARK, linewidth=1.2),
        handle("threshold, claimed side shaded", **BOUND),
    ]
    legend_below(drawn, handles, 4)
    return drawn


def _strip(axes: Axes, strip: Strip) -> None:
    tests = {y: s for y, s in enumerate(strip.rows.values()) if s.test is not None}
    for y, statement in tests.items():
        test, look = statement.test, LOOKS[statement.verdict]
        assert test is not None
        if statement.verdict != TOO_FEW:
            mark = look | {"elinewidth": 1.2, "capsize": 2.5, "markersize": 5.5}
            interval_mark(axes, test.adjusted, y, strip.factor, mark)
        axes.text(1.015, y, _words(statement, test), transform=axes.get_yaxis_transform(),
                  color=DARK, fontsize=NOTE, va="center")  # fmt: skip
    test = next(s.test for s in strip.rows.values() if s.test)
    threshold = strip.factor * test.threshold
    axes.axvline(threshold, **BOUND)
    axes.margins(x=0.12)
    axes.locator_params(axis="x", nbins=7)
    low, high = axes.get_xlim()
    ends = (threshold, high) if test.direction == "at least" else (low, threshold)
    axes.axvspan(*ends, color=CLAIMED, linewidth=0.0, zorder=-2)
    axes.set_xlim(low, high)
    name_rows(axes, list(strip.rows))
    bare_rows(axes)
    axes.set(title=strip.title, xlabel=strip.label)


def _words(statement: Statement, test: Tested) -> str:
    """Verdict, number of events, and how sure it is; where only parts hold, what is to be said of the whole."""
    whole = ", whole undecided" if statement.in_parts else ""
    words = f"{statement.verdict}{whole}, n = {test.estimate.count}"
    if statement.verdict == TOO_FEW:
        return words
    fragile = ", fragile" if statement.fragile else ""
    return f"{words}\np {test.p_holm:.2g} (Holm), resamples {statement.agreement:.0%}{fragile}"


LEARNERS = {
    "running mean": VERMILION,
    "running mean, held": ORANGE,
    "Gaussian": BLUE,
    "Gaussian, robust": PURPLE,
}
"""Arms that learn, and the colour of each."""
FEW_EVENTS = 12
"""Station starts that are run for the figure where the results have none: six in each direction."""


@figure("learning", "error of the increments against stations, by learner (sweep learning)",
        study("learning", FEW_EVENTS))  # fmt: skip
def learning(table: pd.DataFrame) -> Figure:
    """Largest error of any unit's increment, a panel per learner and kind of rail and stored values; trains that are sound.

    Thin: each train in each running direction; thick: their mean; dashed: without learning. Noted: how many ended within the
    tolerance, the dotted line.
    """
    table = table[table["case"] == "sound"]
    kinds = table[["rail", "stored"]].drop_duplicates().itertuples(index=False, name=None)
    groups = {
        kind: table[(table["rail"] == kind[0]) & (table["stored"] == kind[1])] for kind in kinds
    }
    shape = {"sharex": True, "sharey": True, "squeeze": False}
    height = 1.0 + 1.15 * len(groups)
    drawn, axes = new_panels(PAGE, height, len(groups), len(LEARNERS), **shape)
    for ((rail, stored), rows), line in zip(groups.items(), axes, strict=True):
        for one, (arm, colour) in zip(line, LEARNERS.items(), strict=True):
            _learner(one, rows, arm, colour)
        line[0].set_title(f"{rail} rail, stored values {stored}", fontweight="bold")
    for one, (arm, colour) in zip(axes[0], LEARNERS.items(), strict=True):
        one.annotate(arm, (0.0, 1.0), (0.0, 13.0), "axes fraction", "offset points", color=colour)
    for one in axes[-1]:
        one.set_xlabel("stations")
    first = axes[0, 0]
    first.set(yscale="log", xlim=(table["station"].min(), table["station"].max()))
    first.yaxis.set_major_formatter("{x:g}")
    first.yaxis.set_minor_formatter(NullFormatter())
    low, high = first.get_ylim()
    first.set_ylim(min(low, 0.5 * TOLERANCE), 1.2 * high)
    axes[len(axes) // 2, 0].set_ylabel("largest error of any unit [–]")
    legend_below(drawn, first)
    return drawn


def _learner(axes: Axes, rows: pd.DataFrame, arm: str, colour: str) -> None:
    def series_of(arm: str) -> pd.DataFrame:
        """Errors, (stations, trains and directions)."""
        return rows[rows["arm"] == arm].pivot(index="station", columns=SERIES, values="error")

    series = series_of(arm)
    stations = series.index
    thin: Look = {"color": colour, "linewidth": 0.5, "alpha": 0.5, "label": "_train"}
    axes.plot(stations, series, **thin)
    axes.plot(stations, series.mean(axis=1), color=colour, linewidth=1.8, label="_mean")
    without = series_of("no learning").mean(axis=1)
    axes.plot(without.index, without, color=GREY, linestyle="--", label="no learning")
    axes.plot(stations, np.full(len(series), TOLERANCE), ":", color=BLACK, label="tolerance")
    within = f"{int((series.iloc[-1] <= TOLERANCE).sum())} of {series.shape[1]} within"
    axes.annotate(within, (0.0, 0.0), (2.0, 1.0), "axes fraction", "offset points")
