"""From numbers to a verdict: thresholds stated as data, and the one place where verdicts are made."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from studies.core.resampling import resampled
from studies.core.statement import (
    CONDITIONS,
    CONFIDENCE,
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
    Interval,
    Statement,
    interval_of,
)

LEAST_EVENTS = 10
"""Smallest number of events on which a verdict about a whole or a part can rest."""

Numbers = Mapping[str, "Interval | float | pd.Series[Any]"]
"""Quantity, with its unit where it has one, and the data from which `interval_of` makes its interval."""
Met = bool | None
"""Whether a condition is met; None where that is undecided."""
MET: Mapping[int, Met] = MappingProxyType({1: True, 0: None, -1: False})
"""Result of `side` in these terms."""


def side(low: Any, high: Any, least: Any, most: Any = math.inf) -> NDArray[np.int_]:
    """Position of intervals: 1 wholly between two thresholds, -1 wholly beyond one, 0 where they contain one.

    Every claim about random events is decided here. The result is 0 where there is no interval.
    """
    inside = (np.asarray(low) > least) & (np.asarray(high) < most)
    outside = (np.asarray(high) < least) | (np.asarray(low) > most)
    return inside.astype(int) - outside


def decide(
    essential: Iterable[Met],
    further: Iterable[Met] = (),
    partly: bool = False,
    enough: bool = True,
) -> str:
    """The verdict: it holds where everything is met, and with conditions where only everything essential is met.

    `partly`: with conditions too where something essential is not met. `enough`: whether there are enough events.
    """
    if not enough:
        return TOO_FEW
    needed = list(essential)
    if all(needed):
        return HOLDS if all(further) else CONDITIONS
    if partly:
        return CONDITIONS
    return UNDECIDED if all(met or met is None for met in needed) else FAILS


RANK: Mapping[str, int] = MappingProxyType({FAILS: 0, UNDECIDED: 1, CONDITIONS: 2, HOLDS: 3})
"""Verdicts, starting with the worst."""


def has_events(statement: Statement) -> bool:
    """Whether it had enough events for a verdict."""
    return statement.verdict != TOO_FEW


def no_worse(verdict: str, reference: str) -> Met:
    """Whether a verdict is no worse than another of the same claim; None where it is undecided or had too few events."""
    if TOO_FEW in (verdict, reference):
        return None
    if RANK[verdict] >= RANK[reference]:
        return True
    return None if verdict == UNDECIDED else False


def unmet(words: str, met: Met = False) -> str:
    """A condition of a statement: that what these words name is not met, or that it is undecided whether it is."""
    return f"not shown {words}" if met is None else f"not {words}"


def agreement(rows: Iterable[Any], verdict: Callable[[Any], str]) -> float:
    """Share of rows that have the verdict of the first, which is not counted; nan where that has too few events."""
    drawn, *others = rows
    found = verdict(drawn)
    if found == TOO_FEW:
        return math.nan
    return sum(n for row, n in Counter(others).items() if verdict(row) == found) / len(others)


def intervals_of(numbers: Numbers) -> dict[str, Interval]:
    """The intervals of a statement's numbers."""
    return {quantity: interval_of(number) for quantity, number in numbers.items()}


class Bound(NamedTuple):
    """A mean over events, or a share of them, and the thresholds between which it is claimed to be."""

    text: str
    values: "pd.Series[Any]"
    """A number or truth value per event; nan where the event does not bear on it."""
    least: float = -math.inf
    most: float = math.inf

    @property
    def words(self) -> str:
        """The thresholds in words; empty where there are none."""
        sides = (("at least", self.least), ("at most", self.most))
        return ", ".join(f"{word} {value:g}" for word, value in sides if math.isfinite(value))

    @property
    def enough(self) -> bool:
        """Whether enough events bear on it."""
        return int(self.values.notna().sum()) >= LEAST_EVENTS


def sides_of(bounds: Sequence[Bound]) -> list[tuple[int, ...]]:
    """Side of its thresholds for the interval of each bound: of the events as drawn, then of each resample."""
    if not bounds:
        return [()]
    limits = resampled([bound.values for bound in bounds]).limits(1.0 - CONFIDENCE)
    found = side(*limits, [bound.least for bound in bounds], [bound.most for bound in bounds])
    return list(map(tuple, found.tolist()))


Item = Met | Bound
"""A condition of a statement: met or not, or a bound that a 95 % interval decides."""


def decided(
    name: str,
    claim: str,
    essential: Mapping[str, Item],
    numbers: Numbers,
    method: str = "",
    further: Mapping[str, Item] = MappingProxyType({}),
    partly: bool = False,
    some: bool = False,
    enough: bool = True,
) -> Statement:
    """A statement over what must be met, by `decide`: its conditions are what is not met, by the words of each.

    `some`: with conditions where something essential is met. A bound on fewer than `LEAST_EVENTS` events is not enough.
    """
    items = [*essential.items(), *further.items()]
    bounds = [item for _, item in items if isinstance(item, Bound)]
    rows = sides_of(bounds)
    enough = enough and all(bound.enough for bound in bounds)

    def met(row: tuple[int, ...]) -> list[Met]:
        left = iter(row)
        return [MET[next(left)] if isinstance(item, Bound) else item for _, item in items]

    def verdict(row: tuple[int, ...]) -> str:
        found = met(row)
        needed = found[: len(essential)]
        return decide(needed, found[len(essential) :], partly or (some and any(needed)), enough)

    found = zip(items, met(rows[0]), strict=True)
    return Statement(
        name,
        claim,
        verdict(rows[0]),
        intervals_of(numbers),
        tuple(unmet(words, one) for (words, _), one in found if words and not one),
        method,
        agreement=agreement(rows, verdict) if bounds else math.nan,
    )


def over_cases(
    name: str,
    claim: str,
    met: Mapping[str, Item],
    numbers: Numbers,
    method: str = "",
    enough: bool = True,
) -> Statement:
    """A statement over cases of equal weight: with conditions where only some are met."""
    return decided(name, claim, met, numbers, method, some=True, enough=enough)


def with_and_without(met: Mapping[str, bool]) -> tuple[str, ...]:
    """Conditions in words: the cases with which it holds, and then those with which it does not."""
    return (
        *(f"with {case}" for case, holds in met.items() if holds),
        *(unmet(f"with {case}") for case, holds in met.items() if not holds),
    )
