"""From numbers to a verdict: the whole decides, and the parts of it in which it is otherwise are the conditions."""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import pandas as pd

from studies.core.statement import (
    CONDITIONS,
    CONFIDENCE,
    FAILS,
    HOLDS,
    TOO_FEW,
    Interval,
    mean_interval,
)

LEAST_EVENTS = 10
"""A whole or a part of fewer events says nothing."""

Part = Callable[[pd.DataFrame], "pd.Series[bool]"]
"""Which events belong to a part."""


class Test(NamedTuple):
    """A mean over events against a threshold."""

    quantity: Callable[[pd.DataFrame], "pd.Series[float]"]
    """One number per event; nan where the event does not bear on it."""
    threshold: float = 0.0
    wanted: Literal[-1, 1] = 1
    """Side of the threshold on which the claim says that the mean lies."""

    def interval(self, events: pd.DataFrame, confidence: float = CONFIDENCE) -> Interval:
        """The mean over these events."""
        return mean_interval(self.quantity(events), confidence)

    def sign(self, interval: Interval) -> int:
        """1 where the whole interval lies on the wanted side, -1 where it lies on the other, 0 undecided."""
        if interval.count < LEAST_EVENTS:
            return 0
        ahead = [self.wanted * (end - self.threshold) for end in (interval.low, interval.high)]
        if all(distance > 0.0 for distance in ahead):
            return 1
        if all(distance < 0.0 for distance in ahead):
            return -1
        return 0


class Judgement(NamedTuple):
    """Verdict, interval of the whole, and the conditions in words."""

    verdict: str
    whole: Interval
    conditions: tuple[str, ...]


def judge(
    events: pd.DataFrame,
    test: Test,
    parts: Mapping[str, Part],
    show: Callable[[Interval], str],
    others: Sequence[tuple[str, Test]] = (),
) -> Judgement:
    """Judge a claim over `events` (one row each).

    It holds where the whole passes `test` and no part fails it; with conditions where the whole passes but a part fails, or
    one of the `others` (what the claim implies besides) fails, or where the whole does not pass but a part does; else it
    does not hold. Intervals of parts are widened after Bonferroni: (1 - CONFIDENCE) is shared among them. `show` puts an
    interval of `test` into words.
    """
    whole = test.interval(events)
    if whole.count < LEAST_EVENTS:
        return Judgement(TOO_FEW, whole, ())
    confidence = 1.0 - (1.0 - CONFIDENCE) / max(len(parts), 1)
    passed: list[str] = []
    failed: list[str] = []
    for name, part in parts.items():
        interval = test.interval(events[part(events)], confidence)
        sign = test.sign(interval)
        if sign:
            (passed if sign > 0 else failed).append(f"{name}: {show(interval)}")
    implied = [(name, other, other.interval(events)) for name, other in others]
    broken = [
        f"otherwise with {name}: {interval.value:.3g} [{interval.low:.3g}, {interval.high:.3g}]"
        for name, other, interval in implied
        if other.sign(interval) < 0
    ]
    if test.sign(whole) > 0:
        conditions = (*(f"not with {text}" for text in failed), *broken)
        return Judgement(CONDITIONS if conditions else HOLDS, whole, conditions)
    conditions = (*(f"with {text}" for text in passed), *(f"not with {text}" for text in failed))
    return Judgement(CONDITIONS if passed else FAILS, whole, (*conditions, *broken))
