"""Standings: what a rule or a controller reaches over events, what it adds to another, and whether it has a place.

A column is declared once, by its metric, digits and scale; numbers, texts and the lines of a terminal follow. `runs` are the
rows of one rule or controller by event; those that are compared are over the same events.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import pandas as pd
import scipy

from alloc.rules import RULES
from studies.statistics import Interval, mean, share

EFFORT = "bound_use"
"""The metric that ranks."""
MOST_OVER = 0.01
"""Share of the plan delivered beyond it above which a rule is not ranked: the driver did not ask for that."""
NEGLIGIBLE = 1e-3
"""A tenth of a point of the bound: nobody chooses a rule by it, however sure it is."""
LITTLE = 3e-3
"""Three tenths of a point of the bound: an event that gains or loses more counts as gained or as harmed."""
TRIMMED = 0.1
"""Share of the events that a trimmed mean leaves out at each end."""


class Statistic(NamedTuple):
    """A column of a table: a metric's average over events, or how much more it is than a reference's."""

    metric: str
    digits: int = 1
    scale: float = 1.0
    """From the metric's unit to that of the heading."""
    compared: bool = True
    """Whether it is a difference, where there is a reference."""
    average: Callable[[Any], Interval] = mean
    heading: str = ""
    """In a terminal; left out: its name."""
    signed: bool = True
    """Whether a difference has a sign: the share of events with some difference has none."""

    def measure(self, runs: pd.DataFrame, reference: pd.DataFrame | None = None) -> Interval:
        """The number over the events of `runs`, in the metric's unit."""
        if self.compared and reference is not None:
            return self.average(runs[self.metric] - reference.loc[runs.index, self.metric])
        return self.average(runs[self.metric])

    def text(self, runs: pd.DataFrame, reference: pd.DataFrame | None = None) -> str:
        """The number in the unit of the heading, with its interval; a difference has a sign."""
        sign = self.signed and self.compared and reference is not None
        return self.measure(runs, reference).text(self.digits, self.scale, sign)


def without_interval(reduce: Callable[[Any], Any]) -> Callable[[Any], Interval]:
    """An average without an interval, such as a median."""
    return lambda values: Interval(float(reduce(values)), math.nan, math.nan, len(values))


Columns = Mapping[str, Statistic]
"""By their names in a table."""


def _trim(gains: "pd.Series[float]") -> float:
    return float(scipy.stats.trim_mean(gains, TRIMMED)) if len(gains) else math.nan


def _find_gained(gains: "pd.Series[float]") -> Interval:
    return share(gains.dropna() > LITTLE)


def _find_harmed(gains: "pd.Series[float]") -> Interval:
    return share(gains.dropna() < -LITTLE)


GAIN = Statistic(EFFORT, 2, 100.0)
DISTRIBUTION: Columns = {
    "median": GAIN._replace(
        average=without_interval(pd.Series.median), heading="median gain [points]"
    ),
    "trimmed": GAIN._replace(
        average=without_interval(_trim), heading="gain without the outer tenths [points]"
    ),
    "worst": GAIN._replace(
        digits=1, average=without_interval(pd.Series.min), heading="worst [points]"
    ),
    "gained": GAIN._replace(
        digits=0, average=_find_gained, heading="gained [% of events]", signed=False
    ),
    "harmed": GAIN._replace(
        digits=0, average=_find_harmed, heading="harmed [% of events]", signed=False
    ),
}
"""How gains are spread over events, said beside every mean of them: their tails are heavy, so a mean may be that of few."""

MARKS = {
    "°": "knows the rail, as nobody on board can",
    "*": f"delivers more than {MOST_OVER:.0%} beyond the plan",
}
"""Why a rule has no place."""


def find_mark(name: str, over: float) -> str:
    """The mark of a part that delivers this share of the plan beyond it; none where it has a place."""
    knows = name in RULES and RULES[name].belief.knows  # rows of a plug-in may be read without it
    return "°" if knows else "*" if over > MOST_OVER else ""


def is_tied(runs: pd.DataFrame, other_runs: pd.DataFrame) -> bool:
    """Whether nobody chooses between two parts by the bound that they use."""
    return mean(runs[EFFORT] - other_runs[EFFORT]).tied(NEGLIGIBLE)


def align_columns(rows: Sequence[Sequence[str]], left: int = 1) -> list[str]:
    """Lines of a table for a terminal; the first `left` columns flush left, and none that has a heading alone."""
    head, *body = rows
    shown = [k for k in range(len(head)) if any(row[k] for row in body)]
    width = [max(len(row[k]) for row in rows) for k in range(len(head))]
    lines = [
        [row[k].ljust(width[k]) if k < left else row[k].rjust(width[k]) for k in shown]
        for row in rows
    ]
    return ["  ".join(texts).rstrip() for texts in lines]


def list_marks(lines: Sequence[str], meanings: Mapping[str, str]) -> list[str]:
    """The meanings of those marks that stand in the lines of a table, after an empty line."""
    shown = [mark for mark in meanings if any(mark in line for line in lines)]
    return ["", *(f"{mark} {meanings[mark]}" for mark in shown)]
