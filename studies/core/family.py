"""Claims about means over random events: judged together, since some of many would hold by chance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.metrics.registry import UNLIMITED
from studies.core.resampling import resampled
from studies.core.statement import CONFIDENCE, Interval, Statement, Tested, mean_interval
from studies.core.verdict import (
    LEAST_EVENTS,
    MET,
    Bound,
    Numbers,
    agreement,
    decide,
    intervals_of,
    side,
    unmet,
)

Part = Callable[[pd.DataFrame], "pd.Series[bool]"]
"""Which events belong to a part."""
Floats = NDArray[np.float64]


class Test(NamedTuple):
    """A mean over events against a threshold."""

    quantity: Callable[[pd.DataFrame], "pd.Series[float]"]
    """One number per event; nan where the event does not bear on the claim."""
    threshold: float = 0.0
    wanted: Literal[-1, 1] = 1
    """Side of the threshold on which the mean is claimed to be."""
    within: tuple[float, float] = UNLIMITED
    """Smallest and largest value that the quantity can have."""

    def interval(self, events: pd.DataFrame, confidence: float = CONFIDENCE) -> Interval:
        """The mean over these events."""
        return mean_interval(self.quantity(events), confidence, self.within)

    def bound(self, events: pd.DataFrame) -> Bound:
        """The mean over these events, and the side on which it is claimed to be."""
        values = self.quantity(events).astype(float)
        if self.wanted > 0:
            return Bound("", values, least=self.threshold)
        return Bound("", values, most=self.threshold)


@displayed
@dataclass(frozen=True)
class Claim:
    """A claim over events, as data."""

    name: str
    claim: str
    events: pd.DataFrame
    """Events, one row each; the index names an event in all claims of a family."""
    test: Test
    """Test of all events together."""
    parts: Mapping[str, Part]
    """Parts of the events; those that fail the test are conditions. If the whole fails, the claim holds with conditions if a
    part passes."""
    show: Callable[[Interval], str]
    """Puts an interval of the test into words."""
    numbers: Numbers
    method: str
    others: Sequence[tuple[str, Test]] = ()
    """Further implications of the claim; those that fail are conditions."""
    every: bool = False
    """Whether undecided parts are conditions too."""

    @property
    def tests(self) -> list[Bound]:
        """Tests of the whole, of each part, and of the further implications."""
        parts = (self.test.bound(self.events[part(self.events)]) for part in self.parts.values())
        others = (test.bound(self.events) for _, test in self.others)
        return [self.test.bound(self.events), *parts, *others]


def compared(claims: Sequence[Claim]) -> list[Statement]:
    """Statements of a study's claims, which are one family.

    The whole of a claim is tested at the level that Holm's procedure gives it; its parts share that level after Bonferroni.
    Its further implications are tested at 1 - `CONFIDENCE`. Each resample of the events goes through the same steps. The
    share that gives the same verdict is the statement's agreement.
    """
    tests = [claim.tests for claim in claims]
    bounds = [bound for own in tests for bound in own]
    if not bounds:
        return []
    means = resampled([bound.values for bound in bounds])
    least, most = (np.array([getattr(b, name) for b in bounds]) for name in ("least", "most"))
    starts = np.cumsum([0, *map(len, tests)])
    enough = means.count >= LEAST_EVENTS
    p = np.where(enough, means.p_value(np.where(np.isfinite(least), least, most)), np.nan)
    p_holm, level = holm(p[:, starts[:-1]])
    levels = np.full_like(p, 1.0 - CONFIDENCE)
    for k, (claim, start) in enumerate(zip(claims, starts, strict=False)):
        levels[:, start] = level[:, k]
        parts = slice(start + 1, start + 1 + len(claim.parts))
        levels[:, parts] = level[:, [k]] / max(len(claim.parts), 1)
    low, high = means.limits(levels)
    sides = np.where(enough, side(low, high, least, most), 0)
    found = []
    for k, claim in enumerate(claims):
        own = slice(starts[k], starts[k + 1])
        intervals = [
            Interval(float(means.mean[0, j]), float(low[0, j]), float(high[0, j]), int(means.count[0, j]))
            for j in range(own.start, own.stop)
        ]  # fmt: skip
        own_tests = [claim.test] * (1 + len(claim.parts)) + [test for _, test in claim.others]
        intervals = [i.cut(one.within) for i, one in zip(intervals, own_tests, strict=True)]
        tested = Tested(
            "at least" if claim.test.wanted > 0 else "at most",
            claim.test.threshold,
            claim.test.interval(claim.events),
            intervals[0],
            1.0 - float(level[0, k]),
            float(p[0, own.start]),
            float(p_holm[0, k]),
        )
        rows = np.column_stack([enough[:, own.start], sides[:, own]])
        found.append(_statement(claim, tested, list(map(tuple, rows.tolist())), intervals))
    return found


def holm(p: Floats) -> tuple[Floats, Floats]:
    """Adjusted p-values, and the level at which each is tested, after Holm (1979, Scand. J. Statist. 6).

    Families along the last axis; nan marks entries that are not tested. The k-th smallest of m is tested at alpha / (m - k +
    1) if all before it were rejected, else at the level of the first that was not. So an interval of that level contains the
    threshold exactly where the adjusted p-value is alpha or more.
    """
    order = np.argsort(p, axis=-1)
    ordered = np.take_along_axis(p, order, axis=-1)
    left = np.isfinite(p).sum(axis=-1, keepdims=True) - np.arange(p.shape[-1])
    alpha = 1.0 - CONFIDENCE
    adjusted = np.minimum(np.maximum.accumulate(left * ordered, axis=-1), 1.0)
    rejected = (adjusted < alpha).sum(axis=-1, keepdims=True)
    level = alpha / np.maximum(np.maximum(left, left[..., :1] - rejected), 1)
    back = np.argsort(order, axis=-1)
    level = np.where(np.isfinite(ordered), level, np.nan)
    return np.take_along_axis(adjusted, back, axis=-1), np.take_along_axis(level, back, axis=-1)


def _statement(
    claim: Claim, tested: Tested, rows: Sequence[tuple[int, ...]], intervals: Sequence[Interval]
) -> Statement:
    """`rows`: whether there are events enough, and the sides of whole, parts and others, as drawn and by resample."""
    parts = slice(2, 2 + len(claim.parts))

    def verdict(row: tuple[int, ...]) -> str:
        more = [side >= (1 if claim.every else 0) for side in row[parts]]
        broken = [side < 0 for side in row[parts.stop :]]
        return decide(
            [MET[row[1]]], [all(more), not any(broken)], any(s > 0 for s in row[parts]), bool(row[0])
        )  # fmt: skip

    sides, found = rows[0], verdict(rows[0])
    shown: dict[int, list[str]] = {1: [], 0: [], -1: []}
    for name, one, interval in zip(claim.parts, sides[parts], intervals[1:], strict=False):
        shown[one].append(f"with {name}: {claim.show(interval)}")
    others = zip(claim.others, sides[parts.stop :], intervals[parts.stop - 1 :], strict=True)
    conditions = [
        *([] if sides[1] > 0 else shown[1]),
        *(unmet(text) for text in shown[-1]),
        *(unmet(f"besides, {name}: {i.value:.3g} [{i.low:.3g}, {i.high:.3g}]") for (name, _), one, i in others if one < 0),
        *(unmet(text, None) for text in shown[0] if claim.every),
    ]  # fmt: skip
    return Statement(
        claim.name,
        claim.claim,
        found,
        intervals_of(claim.numbers),
        tuple(conditions) if sides[0] else (),
        claim.method,
        tested,
        agreement(rows, verdict),
    )
