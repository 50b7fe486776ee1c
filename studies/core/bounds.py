"""Statements that hold where means over days lie within bounds that were set before."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd

from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW, Statement, mean_interval
from studies.core.verdict import LEAST_EVENTS

METHOD = "mean over days with its 95 % interval, which must lie wholly within the bound stated"


class Bound(NamedTuple):
    """A mean over days and the side of a threshold on which the claim puts it."""

    text: str
    values: "pd.Series[float]"
    least: float = -math.inf
    most: float = math.inf


def judged(name: str, claim: str, bounds: Sequence[Bound], note: str = "") -> Statement:
    """Holds where every mean lies within its bound; with conditions where the first does but another does not."""
    numbers, unmet = {}, []
    for bound in bounds:
        interval = mean_interval(bound.values)
        numbers[bound.text + (f" ({words})" if (words := _words(bound)) else "")] = interval
        if not (interval.low >= bound.least and interval.high <= bound.most):
            unmet.append(bound)
    if min(interval.count for interval in numbers.values()) < LEAST_EVENTS:
        verdict = TOO_FEW
    else:
        verdict = HOLDS if not unmet else FAILS if bounds[0] in unmet else CONDITIONS
    broken = tuple(f"not within its bound: {bound.text} ({_words(bound)})" for bound in unmet)
    text = METHOD + (f"; {note}" if note else "")
    return Statement(name, claim, verdict, numbers, broken if verdict != TOO_FEW else (), text)


def _words(bound: Bound) -> str:
    parts = [
        f"{word} {value:g}"
        for word, value in (("at least", bound.least), ("at most", bound.most))
        if math.isfinite(value)
    ]
    return ", ".join(parts)


__all__ = ["Bound", "judged"]
