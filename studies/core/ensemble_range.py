"""What an ensemble of parameter sets does to a statement: its numbers get the ensemble's range, its verdict the members'."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from studies.core.statement import VERDICTS, Interval, Statement, share_interval

PERCENTILES = (5.0, 95.0)
"""Of the ensemble, between which its range lies."""
MOST = 0.95
"""Share of the members that must have the verdict of the set in use, or it is a condition that they have others."""
RANGE = "limits: 5 and 95 % of the ensemble's members"


def range_of(value: float, members: Iterable[float]) -> Interval:
    """A number of the set in use, with the range of the members that have it."""
    known = np.array([one for one in members if math.isfinite(one)], dtype=float)
    if known.size == 0:
        return Interval(float(value), math.nan, math.nan, 0)
    low, high = np.percentile(known, PERCENTILES)
    return Interval(float(value), float(low), float(high), known.size)


def median_of(members: Iterable[float]) -> Interval:
    """Median of the members with their range."""
    known = [one for one in members if math.isfinite(one)]
    return range_of(float(np.median(known)) if known else math.nan, known)


def over_members(own: Statement, others: Sequence[Statement]) -> Statement:
    """The statement of the set in use, with the verdicts of its members on the same claim.

    Its numbers get the members' range. If the claim holds for the set in use, but for fewer than `MOST` of them, it holds
    with conditions.
    """
    if not others:
        return own
    ranges = {
        quantity: range_of(
            interval.value, [one.numbers[quantity].value for one in others if quantity in one.numbers]
        )
        for quantity, interval in own.numbers.items()
    }  # fmt: skip
    counts = {verdict: sum(one.verdict == verdict for one in others) for verdict in VERDICTS}
    said_by_all = own
    if counts[own.verdict] < MOST * len(others):
        said = ", ".join(f"{word} of {count}" for word, count in counts.items() if count)
        said_by_all = own.conditioned(f"of the ensemble's {len(others)} members it {said}")
    same = pd.Series([one.verdict == own.verdict for one in others], dtype=bool)
    ranges["share of the members with the same verdict"] = share_interval(same)
    method = "; ".join(part for part in (own.method, RANGE) if part)
    return replace(said_by_all, numbers=ranges, method=method)
