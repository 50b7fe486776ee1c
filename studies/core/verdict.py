"""From numbers to a verdict: bounds and parts of a whole stated as data, and the one place that decides."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import pandas as pd

from studies.core.statement import (
    CONDITIONS,
    CONFIDENCE,
    FAILS,
    HOLDS,
    TOO_FEW,
    Interval,
    Statement,
    interval_of,
    mean_interval,
)

LEAST_EVENTS = 10
"""A whole or a part of fewer events says nothing."""

Numbers = Mapping[str, "Interval | float | pd.Series[Any]"]
"""Quantity, with its unit where it has one, and what `interval_of` makes its interval from."""
Part = Callable[[pd.DataFrame], "pd.Series[bool]"]
"""Which events belong to a part."""


def decide(
    essential: Iterable[bool],
    further: Iterable[bool] = (),
    partly: bool = False,
    enough: bool = True,
) -> str:
    """The verdict: it holds where everything is met, with conditions where only all that is essential is.

    `partly`: with conditions too where something essential is not met. `enough`: whether there are events enough to say.
    """
    if not enough:
        return TOO_FEW
    if all(essential):
        return HOLDS if all(further) else CONDITIONS
    return CONDITIONS if partly else FAILS


def intervals_of(numbers: Numbers) -> dict[str, Interval]:
    """The intervals of a statement's numbers."""
    return {quantity: interval_of(number) for quantity, number in numbers.items()}


def decided(
    name: str,
    claim: str,
    essential: Mapping[str, bool],
    numbers: Numbers,
    method: str = "",
    further: Mapping[str, bool] = MappingProxyType({}),
    partly: bool = False,
    enough: bool = True,
) -> Statement:
    """A statement over what is met or not, as `decide` has it: the words of what is not met are its conditions."""
    return Statement(
        name,
        claim,
        decide(essential.values(), further.values(), partly, enough),
        intervals_of(numbers),
        tuple(words for words, met in (*essential.items(), *further.items()) if words and not met),
        method,
    )


def over_cases(
    name: str,
    claim: str,
    met: Mapping[str, bool],
    numbers: Numbers,
    method: str = "",
) -> Statement:
    """A statement over cases that count alike: with conditions where some are met, which are those not met in words."""
    return decided(name, claim, met, numbers, method, partly=any(met.values()))


def with_and_without(met: Mapping[str, bool]) -> tuple[str, ...]:
    """Conditions in words: with which cases it holds, and then with which it does not."""
    return (
        *(f"with {case}" for case, holds in met.items() if holds),
        *(f"not with {case}" for case, holds in met.items() if not holds),
    )


class Bound(NamedTuple):
    """A mean over days and the side of a threshold on which the claim puts it."""

    text: str
    values: "pd.Series[float]"
    least: float = -math.inf
    most: float = math.inf

    @property
    def words(self) -> str:
        """The thresholds in words; empty where there are none."""
        sides = (("at least", self.least), ("at most", self.most))
        return ", ".join(f"{word} {value:g}" for word, value in sides if math.isfinite(value))

    def met(self, interval: Interval) -> bool:
        """Whether the whole interval lies within."""
        return interval.low >= self.least and interval.high <= self.most


BOUNDS_METHOD = (
    "mean over days with its 95 % interval, which must lie wholly within the bound stated"
)


def judged(name: str, claim: str, bounds: Sequence[Bound], note: str = "") -> Statement:
    """A statement over bounds: the first is essential, the others are conditions."""
    intervals = [mean_interval(bound.values) for bound in bounds]
    unmet = [b for b, interval in zip(bounds, intervals, strict=True) if not b.met(interval)]
    enough = min(interval.count for interval in intervals) >= LEAST_EVENTS
    return Statement(
        name,
        claim,
        decide([bounds[0] not in unmet], [not unmet], enough=enough),
        {
            bound.text + (f" ({bound.words})" if bound.words else ""): interval
            for bound, interval in zip(bounds, intervals, strict=True)
        },
        tuple(f"not within its bound: {b.text} ({b.words})" for b in unmet) if enough else (),
        BOUNDS_METHOD + (f"; {note}" if note else ""),
    )


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
        return -1 if all(distance < 0.0 for distance in ahead) else 0


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
    every: bool = False,
) -> Judgement:
    """Judge a claim over `events` (one row each).

    The whole must pass `test`; parts that fail it and `others` that fail (what the claim implies besides) are conditions.
    Where the whole does not pass, it holds with conditions if a part does. Intervals of parts are widened after Bonferroni:
    (1 - CONFIDENCE) is shared among them. `show` puts an interval of `test` into words. `every`: parts that show neither
    are conditions too.
    """
    whole = test.interval(events)
    if whole.count < LEAST_EVENTS:
        return Judgement(decide((), enough=False), whole, ())
    confidence = 1.0 - (1.0 - CONFIDENCE) / max(len(parts), 1)
    found: dict[int, list[str]] = {1: [], 0: [], -1: []}
    for name, part in parts.items():
        interval = test.interval(events[part(events)], confidence)
        found[test.sign(interval)].append(f"with {name}: {show(interval)}")
    broken = [
        f"otherwise with {name}: {interval.value:.3g} [{interval.low:.3g}, {interval.high:.3g}]"
        for name, other in others
        for interval in (other.interval(events),)
        if other.sign(interval) < 0
    ]
    unmet = [*(f"not {text}" for text in found[-1]), *broken]
    unmet += [f"not shown {text}" for text in found[0]] if every else []
    holds = test.sign(whole) > 0
    verdict = decide([holds], [not unmet], partly=bool(found[1]))
    return Judgement(verdict, whole, tuple(unmet if holds else [*found[1], *unmet]))


def compared(
    name: str,
    claim: str,
    events: pd.DataFrame,
    test: Test,
    parts: Mapping[str, Part],
    show: Callable[[Interval], str],
    numbers: Numbers,
    method: str,
    others: Sequence[tuple[str, Test]] = (),
    every: bool = False,
) -> Statement:
    """The statement of `judge`, with `numbers`."""
    found = judge(events, test, parts, show, others, every)
    return Statement(name, claim, found.verdict, intervals_of(numbers), found.conditions, method)
