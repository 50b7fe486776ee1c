"""Verdicts over their thresholds: what decides a statement, how certain it is, and its result."""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.palette import BLUE, DARK, GREEN, GREY, ORANGE, VERMILION
from paper_figs.style import (
    BOUND,
    NOTE,
    PAGE,
    Look,
    bare_rows,
    handle,
    interval_mark,
    name_rows,
    new_panels,
)
from studies.core.statement import (
    CONDITIONS,
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
    Statement,
    Tested,
)

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


class Strip(NamedTuple):
    """Statements that share a threshold: title, label of the axis with its unit, factor to that unit."""

    title: str
    label: str
    factor: float
    rows: Mapping[str, Statement]
    """By the name of a row."""


def verdict_strips(strips: Iterable[Strip]) -> Figure:
    """One panel per threshold: each mean with its interval, and that after Holm, coloured by its verdict."""
    shown = list(strips)
    rows = [ROW * max(len(strip.rows), 1.5) for strip in shown]
    height = BETWEEN * (1 + len(rows)) + sum(rows)
    drawn, panels = new_panels(PAGE, height, len(rows), 1, squeeze=False, height_ratios=rows)
    for axes, strip in zip(panels[:, 0], shown, strict=True):
        _draw(axes, strip)
    seen = {s.verdict for strip in shown for s in strip.rows.values()}
    handles = [handle(v, linestyle="none", **look) for v, look in LOOKS.items() if v in seen]
    handles += [
        handle("95 %, bootstrap", color=DARK, linewidth=2.2),
        handle("Student's t after Holm", color=DARK, linewidth=0.7),
        handle("threshold, claimed side shaded", **BOUND),
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=4)
    return drawn


def _draw(axes: Axes, strip: Strip) -> None:
    for y, statement in enumerate(strip.rows.values()):
        test, look = statement.test, LOOKS[statement.verdict]
        if test is None:
            continue
        if statement.verdict != TOO_FEW:
            _intervals(axes, test, y, strip.factor, look)
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
    axes.set_title(strip.title, loc="left")
    axes.set_xlabel(strip.label)


def _intervals(axes: Axes, test: Tested, y: float, factor: float, look: Look) -> None:
    plain = {"color": look["color"], "marker": "", "linestyle": "none"}
    interval_mark(axes, test.adjusted, y, factor, plain | {"elinewidth": 0.7, "capsize": 2.0})
    interval_mark(axes, test.estimate, y, factor, look | {"elinewidth": 2.2, "markersize": 5.5})


def _words(statement: Statement, test: Tested) -> str:
    """Verdict, number of events, and how sure it is; where only parts hold, what is to be said of the whole."""
    whole = ", whole undecided" if statement.in_parts else ""
    words = f"{statement.verdict}{whole}, n = {test.estimate.count}"
    if statement.verdict == TOO_FEW:
        return words
    fragile = ", fragile" if statement.fragile else ""
    return f"{words}\np {test.p_holm:.2g} (Holm), resamples {statement.agreement:.0%}{fragile}"
