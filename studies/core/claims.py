"""Claims as data, and the two judges that make statements of them: a family after Holm, and a conjunction of bounds.

A claim names a mean over events, the side of a value on which it is claimed to be, the events that bear on it and its parts.
Means, conditions and numbers are written in the columns of a study's events, by `quantity`. So what `freeze`
keeps of a claim before the first event is drawn is what is tested.
"""

import hashlib
import json
import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import lru_cache
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtr

from alloc.display import displayed
from alloc.metrics.registry import UNLIMITED, range_of
from alloc.sources import write_whole
from studies.core.statement import (
    CONFIDENCE,
    LEAST_EVENTS,
    MET,
    Interval,
    Met,
    Statement,
    Tested,
    agreement,
    decide,
    half_width,
    has_events,
    in_words,
    interval_of,
    mean_interval,
    no_worse,
    share_interval,
    share_limits,
    side,
    single,
    unmet,
)

# Means over events with what decides on them: of the events as drawn, and of bootstrap resamples of them.
#
# These intervals are Student's t. Each must contain its threshold exactly where the p-value after Holm says so, and
# each of the resamples needs one. Those beside printed means are `studies.core.statement`.

RESAMPLES = 1000
"""Shares of them, as 0.95, are known to 0.007."""
SEED = 0
"""Of the resamples: the same table gives the same shares."""
AT_ONCE = 4_000_000
"""Events times resamples in memory."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Means:
    """Means of several quantities. The first row of each is of the events as drawn, the others are of resamples."""

    mean: Floats
    """Shape (1 + RESAMPLES, quantities)."""
    deviation: Floats
    count: Floats
    """Events that bear on the quantity."""
    share: NDArray[np.bool_]
    """Which quantities are shares of events."""

    def limits(self, level: Any) -> tuple[Floats, Floats]:
        """Limits of intervals of this two-sided level, by Student's t, of shares after Wilson; nan for one event."""
        with np.errstate(all="ignore"):
            half = half_width(self.deviation, self.count, 1.0 - level)
            low, high = share_limits(self.mean, self.count, 1.0 - level)
        return np.where(self.share, low, self.mean - half), np.where(
            self.share, high, self.mean + half
        )

    def p_value(self, threshold: Floats) -> Floats:
        """Two-sided p-values by Student's t of the means against thresholds, one for each quantity."""
        with np.errstate(all="ignore"):
            t = (self.mean - threshold) / (self.deviation / np.sqrt(self.count))
            p: Floats = 2.0 * stdtr(self.count - 1.0, -np.abs(t))
        return np.where((self.deviation == 0.0) & (self.mean == threshold), 1.0, p)


def resampled(quantities: Sequence["pd.Series[Any]"]) -> Means:
    """Means of quantities, one number per event each; nan where the event does not bear on the quantity.

    Events are distinguished by the index, and drawn with all their quantities: as many as there are, with replacement.
    """
    share = np.array([values.dtype == bool for values in quantities])
    columns = [values.astype(float).rename(k) for k, values in enumerate(quantities)]
    table = pd.concat(columns, axis=1).to_numpy()
    known = ~np.isnan(table)
    with np.errstate(all="ignore"):  # what is infinite has no interval
        centre = np.where(known, table, 0.0).sum(axis=0) / known.sum(axis=0)
        off = np.where(known, table - centre, 0.0)  # about the mean squares do not cancel
        moments = np.concatenate([known, off, off**2], axis=1)
        sums = np.concatenate([weights @ moments for weights in _weights(len(table))])
        count, first, second = np.split(sums, 3, axis=1)
        shift = first / count
        variance = (second / count - shift**2) * count / (count - 1.0)
    return Means(centre + shift, np.sqrt(np.maximum(variance, 0.0)), count, share)


def _weights(events: int) -> Any:
    """How often each event counts: once as drawn, then by resample, some resamples at a time."""
    yield np.ones((1, events))
    generator, each = np.random.default_rng(SEED), np.full(events, 1.0 / max(events, 1))
    step = max(1, AT_ONCE // max(events, 1))
    for start in range(0, RESAMPLES, step):
        shape = (min(step, RESAMPLES - start), events)
        drawn = generator.multinomial(events, each, shape[0]) if events else np.zeros(shape)
        yield drawn.astype(float)


Ranges = Mapping[str, tuple[float, float]]
"""Smallest and largest value of quantities that are no registered metrics, by name."""
AT_LEAST: Final = "at least"
AT_MOST: Final = "at most"
ABOUT: Final = "about"
Side = Literal["at least", "at most", "about"]
NOTHING: Mapping[str, Any] = MappingProxyType({})


# quantities

OPERATORS: Sequence[Mapping[str, Callable[[Any, Any], Any]]] = (
    {"if": lambda _, __: None},
    {"or": operator.or_},
    {"and": operator.and_},
    {"==": operator.eq, "!=": operator.ne, "<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt},
    {"per": lambda x, y: _ratio(x, y), "beyond": lambda x, y: _ratio(x, y, 1.0)},
    {"-": operator.sub, "+": operator.add},
    {"/": operator.truediv},
)  # fmt: skip
"""Signs between quantities, those that bind least first; signs of one level apply from left to right."""
_WORDS = re.compile(r"(?<= )(if|or|and|[=!<>]=|[<>]|per|beyond|[-+/])(?= )|('[^']*'|\|[^|]*\|)")
OVER_EVENTS: Mapping[str, Callable[[Any], Any]] = {
    "largest": lambda values: values.max(),
    "median": lambda values: values.median(),
    "root mean square": lambda values: (values**2).mean() ** 0.5,
}


def quantity(events: pd.DataFrame, text: str) -> Any:
    """A quantity of events, one row each: a series of numbers, of truth values where it is a condition, or one number.

    `text` has names of columns, numbers and words, with a space on both sides of each sign of `OPERATORS`, |x| for the size
    of x, and quotes around a word or name in which such a sign occurs: "effort@exact - effort@alone", "train == 'a and b'".
    "x if c": of the events that meet c. "x per y": numbers whose mean is the mean of x over that of y, and whose spread is
    that of this ratio; "x beyond y": this less 1. "largest of x", "median of x", "root mean square of x" are single numbers.
    """
    over, _, values = text.partition(" of ")
    if over in OVER_EVENTS:
        return float(OVER_EVENTS[over](quantity(events, values)))
    return _read(events, _parts(text))


@lru_cache(maxsize=4096)
def _parts(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in _WORDS.split(text) if part and part.strip())


def _read(events: pd.DataFrame, parts: tuple[str, ...], level: int = 0) -> Any:
    if level == len(OPERATORS):
        (word,) = parts
        return _value(events, word)
    for k in reversed(range(len(parts))):
        if parts[k] in OPERATORS[level]:
            right = _read(events, parts[k + 1 :], level + 1)
            if parts[k] == "if":  # what is left of it sees no other event
                return _read(events[right], parts[:k], level)
            return OPERATORS[level][parts[k]](_read(events, parts[:k], level), right)
    return _read(events, parts, level + 1)


def _value(events: pd.DataFrame, word: str) -> Any:
    if word in events:
        return events[word]
    if word[0] == "|":
        return quantity(events, word[1:-1]).abs()
    if word[0] == "'":
        return events[word[1:-1]] if word[1:-1] in events else word[1:-1]
    try:
        return float(word)
    except ValueError:
        if "@" in word or ", " in word:
            raise KeyError(f"no column {word!r}") from None
        return word


def _ratio(
    values: "pd.Series[float]", base: "pd.Series[float]", less: float = 0.0
) -> "pd.Series[float]":
    values, base = values.astype(float), base.astype(float)
    ratio = values.sum() / base.sum() if len(values) else math.nan
    linearised: pd.Series[float] = ratio - less + (values - ratio * base) / base.mean()
    return linearised


def names_in(text: str) -> list[str]:
    """Names of columns, numbers and words of a quantity."""
    whole = text.partition(" of ")
    parts = _parts(whole[2] if whole[0] in OVER_EVENTS else text)
    signs = {sign for level in OPERATORS for sign in level}
    inner = (
        names_in(one[1:-1]) if one[0] == "|" else [one.strip("'")]
        for one in parts
        if one not in signs
    )
    return [name for names in inner for name in names]


def known_in(events: pd.DataFrame, text: str) -> bool:
    """Whether the events have every column of a quantity, which compares nothing."""
    return all(name in events or name.replace(".", "").isdigit() for name in names_in(text))


def number(
    events: pd.DataFrame, text: str, ranges: Ranges = NOTHING, confidence: float = CONFIDENCE
) -> Interval:
    """The mean of a quantity with its interval, or the share of the events for which a condition is true.

    The interval of a single metric ends where the metric's range does.
    """
    found = quantity(events, text)
    if not isinstance(found, pd.Series):
        return single(found)
    if found.dtype == bool:
        return share_interval(found, confidence)
    return mean_interval(found, confidence, range_in(text, ranges))


def range_in(text: str, ranges: Ranges = NOTHING) -> tuple[float, float]:
    """Smallest and largest value of a quantity that is one metric of one arm; of others nothing is known."""
    column = text.partition(" if ")[0]
    if len(names_in(column)) > 1 or "|" in column:
        return UNLIMITED
    metric = column.partition("@")[0]
    return ranges.get(metric, range_of(metric))


# claims


@displayed
@dataclass(frozen=True)
class Claim:
    """A claim about the mean of a quantity over events, or a bound that is part of one."""

    name: str
    """Of a claim: unique in its study. Of a bound: what a condition says of it after "not"."""
    claim: str = ""
    """The sentence of its statement; empty for bounds."""
    mean: str = ""
    """The quantity, see `quantity`; empty where only `cases` decide."""
    side: Side = "at least"
    value: float = 0.0
    tolerance: float = 0.0
    """Distance on both sides of the value that "about" allows."""
    reason: str = ""
    """Why this value."""
    source: str = ""
    """Whose value it is; empty: this project's."""
    only: str = ""
    """Which events bear on it."""
    parts: Mapping[str, str] = field(default_factory=dict)
    """Parts of the events, each with its condition. In a family those that fail the test are conditions of the statement,
    and where the whole fails it holds with conditions if a part passes."""
    cases: tuple["Claim", ...] = ()
    """Bounds that a conjunction needs beside the mean."""
    each: str = ""
    """Column that names events of which each is a case: its own value decides, not the mean over them."""
    some: bool = False
    """Whether it holds with conditions where only some of the cases are met."""
    alike: bool = False
    """Whether the cases need the side of the value on which the mean is, whichever that is."""
    besides: tuple["Claim", ...] = ()
    """Bounds that the claim implies: those that fail are conditions."""
    exact: bool = False
    """Whether the mean's value decides and not its interval: nothing is random, or it must be so in every event."""
    numbers: Mapping[str, str] = field(default_factory=dict)
    """What stands beside it, by the name and unit of each."""
    method: str = ""
    show: Callable[[Interval], str] | None = None
    """Puts an interval into words; None: a condition has no number."""

    @property
    def least(self) -> float:
        """Lower threshold of the mean; -inf where there is none."""
        return -math.inf if self.side == AT_MOST else self.value - self.tolerance

    @property
    def most(self) -> float:
        """Upper threshold of the mean; inf where there is none."""
        return math.inf if self.side == AT_LEAST else self.value + self.tolerance

    @property
    def bounds(self) -> str:
        """The thresholds in words."""
        sides = ((AT_LEAST, self.least), (AT_MOST, self.most))
        return ", ".join(f"{word} {value:g}" for word, value in sides if math.isfinite(value))

    @property
    def leaves(self) -> tuple["Claim", ...]:
        """Bounds of a conjunction, those that decide first."""
        return (*((self,) if self.mean and not self.each else ()), *self.cases, *self.besides)

    def bearing(self, events: pd.DataFrame) -> pd.DataFrame:
        """The events that bear on it."""
        return events[quantity(events, self.only)] if self.only else events

    def values(self, events: pd.DataFrame) -> "pd.Series[Any]":
        """The quantity of the events that bear on it; nan where it has none."""
        found: pd.Series[Any] = quantity(self.bearing(events), self.mean)
        return found

    def words(self, interval: Interval) -> str:
        """What a condition says of the bound."""
        return f"{self.name}: {self.show(interval)}" if self.show else self.name


def meets(claim: Claim, value: float) -> bool:
    """Whether a value that is not random is within its bounds; nan is not."""
    if claim.side == ABOUT:  # as printed: the value decides, not its rounded limits
        return abs(value - claim.value) <= claim.tolerance
    return value >= claim.value if claim.side == AT_LEAST else value <= claim.value


def numbers_of(
    events: pd.DataFrame, numbers: Mapping[str, Any], ranges: Ranges = NOTHING
) -> dict[str, Interval]:
    """Intervals of the numbers beside a claim; what is no text is a number, a series of events or an interval already."""
    return {
        words: number(events, one, ranges) if isinstance(one, str) else interval_of(one)
        for words, one in numbers.items()
    }


def how_many(word: str, what: str) -> Callable[[Interval], str]:
    """Puts a share of faults into words: "in 3 of 40 stops"."""
    return lambda i: f"{word} {round(i.value * i.count) if i.count else 0} of {i.count} {what}"


# a conjunction of bounds


def conjunction(
    events: pd.DataFrame,
    claim: Claim,
    met: Mapping[str, Met] = NOTHING,
    further: Mapping[str, Met] = NOTHING,
    numbers: Mapping[str, Any] = NOTHING,
    least_events: int = LEAST_EVENTS,
    enough: bool = True,
    partly: bool = False,
) -> Statement:
    """The statement of a claim that holds where its mean and all its cases are within their bounds.

    `met`, `further`: what else is needed, and what else is a condition only, in the words of a condition. Bounds are decided
    by their 95 % intervals, and again on every resample of the events; exact ones by their value. Fewer than `least_events`
    events that bear on a bound are too few. `partly`: with conditions where something that is needed is not met.
    """
    events = claim.bearing(events)
    if claim.each:
        own = zip(events[claim.each].astype(str), claim.values(events).astype(float), strict=True)
        met = {name: meets(claim, value) for name, value in own} | dict(met)
    leaves = claim.leaves
    needed = len(leaves) - len(claim.besides)
    values = [leaf.values(events) for leaf in leaves]
    rows = _sides(leaves, values)
    enough = enough and all(int(one.notna().sum()) >= least_events for one in values)
    intervals = [single(0.0) if not leaf.show else share_interval(v) if v.dtype == bool else mean_interval(v)
                 for leaf, v in zip(leaves, values, strict=True)]  # fmt: skip

    def all_met(row: tuple[int, ...]) -> tuple[list[Met], list[Met]]:
        if claim.alike:
            first, *others = row
            return [first != 0 or None, *(one * first >= 0 for one in others)], [
                one == first for one in others
            ]
        found = [MET[one] for one in row]
        return [*found[:needed], *met.values()], [*found[needed:], *further.values()]

    def verdict(row: tuple[int, ...]) -> str:
        essential, rest = all_met(row)
        return decide(essential, rest, partly or (claim.some and any(essential)), enough)

    if claim.alike:
        conditions = _otherwise(leaves, rows[0])
    else:
        words = [leaf.words(i) for leaf, i in zip(leaves, intervals, strict=True)]
        if leaves[:1] == (claim,):  # the statement itself says what is claimed
            words[0] = claim.show(intervals[0]) if claim.show and len(values[0]) else ""
        words = [*words[:needed], *met, *words[needed:], *further]
        found = zip(words, chain(*all_met(rows[0])), strict=True)
        conditions = [unmet(word, one) for word, one in found if word and not one]
    beside = [leaf.numbers for leaf in leaves if leaf is not claim]
    merged = {words: one for each in (*beside, claim.numbers, numbers) for words, one in each.items()}  # fmt: skip
    random = any(not leaf.exact for leaf in leaves)
    return Statement(
        claim.name, claim.claim, verdict(rows[0]), numbers_of(events, merged), tuple(conditions), claim.method,
        agreement=agreement(rows, verdict) if random else math.nan,
    )  # fmt: skip


def _otherwise(leaves: Sequence[Claim], sides: tuple[int, ...]) -> list[str]:
    """Conditions where cases are to lie as the first does: those that do not, and how they lie."""
    words = {1: "more", -1: "less", 0: "neither more nor less"}
    return [
        unmet(f"{leaf.name}: {'the other way round' if one * sides[0] < 0 else words[one]}")
        for leaf, one in zip(leaves, sides, strict=True) if one != sides[0]
    ]  # fmt: skip


def _sides(leaves: Sequence[Claim], values: Sequence["pd.Series[Any]"]) -> list[tuple[int, ...]]:
    """Side of its thresholds for each bound: of the events as drawn, then of each resample."""
    random = [k for k, leaf in enumerate(leaves) if not leaf.exact]
    found = np.zeros((1, len(leaves)), dtype=int)
    if random:
        limits = resampled([values[k] for k in random]).limits(1.0 - CONFIDENCE)
        least, most = ([getattr(leaves[k], name) for k in random] for name in ("least", "most"))
        own = side(*limits, least, most)
        found = np.zeros((len(own), len(leaves)), dtype=int)
        found[:, random] = own
    for k, leaf in enumerate(leaves):
        if leaf.exact:
            found[:, k] = 1 if meets(leaf, float(values[k].astype(float).mean())) else -1
    return list(map(tuple, found.tolist()))


def survives(
    name: str, claim: str, finding: Statement, arms: Mapping[str, Statement], without: str, method: str
) -> Statement:  # fmt: skip
    """Whether a finding also appears in other arms: its verdict there is no worse than the original one, `without`."""
    return conjunction(
        pd.DataFrame(),
        Claim(name, claim, some=True, method=method),
        {f"with {arm}": no_worse(one.verdict, finding.verdict) for arm, one in arms.items()},
        numbers={
            f"{arm}: {quantity}": one.numbers[quantity]
            for arm, one in ({without: finding} | dict(arms)).items()
            for quantity in list(one.numbers)[:1]
        },
        enough=has_events(finding) and all(has_events(one) for one in arms.values()),
    )


# a family after Holm


def family(
    *groups: tuple[pd.DataFrame, Iterable[Claim]], ranges: Ranges = NOTHING, every: bool = False
) -> list[Statement]:
    """Statements of claims that are one family, given with the events of each; the index names an event in all of them.

    The whole of a claim is tested at the level that Holm's procedure gives it; its parts share that level after Bonferroni.
    Its further implications are tested at 1 - `CONFIDENCE`. Each resample of the events goes through the same steps. The
    share that gives the same verdict is the statement's agreement. `every`: undecided parts are conditions too.
    """
    tests = [_tests(claim, claim.bearing(events)) for events, claims in groups for claim in claims]
    bounds = [bound for own in tests for bound in own.values]
    if not bounds:
        return []
    means = resampled(bounds)
    least, most = (
        np.array([getattr(leaf, name) for own in tests for leaf in own.leaves])
        for name in ("least", "most")
    )
    starts = np.cumsum([0, *(len(own.values) for own in tests)])
    enough = means.count >= LEAST_EVENTS
    p = np.where(enough, means.p_value(np.where(np.isfinite(least), least, most)), np.nan)
    p_holm, level = holm(p[:, starts[:-1]])
    levels = np.full_like(p, 1.0 - CONFIDENCE)
    for k, (own, start) in enumerate(zip(tests, starts, strict=False)):
        levels[:, start] = level[:, k]
        parts = len(own.claim.parts)
        levels[:, start + 1 : start + 1 + parts] = level[:, [k]] / max(parts, 1)
    low, high = means.limits(levels)
    sides = np.where(enough, side(low, high, least, most), 0)
    found = []
    for k, own in enumerate(tests):
        claim, columns = own.claim, range(starts[k], starts[k + 1])
        intervals = [
            Interval(float(means.mean[0, j]), float(low[0, j]), float(high[0, j]), int(means.count[0, j]))
            .cut(range_in(leaf.mean, ranges))
            for j, leaf in zip(columns, own.leaves, strict=True)
        ]  # fmt: skip
        within = range_in(claim.mean, ranges)
        estimate = mean_interval(own.values[0], CONFIDENCE, within)
        tested = Tested(
            claim.side, claim.value, estimate, intervals[0], 1.0 - float(level[0, k]),
            float(p[0, columns.start]), float(p_holm[0, k]),
        )  # fmt: skip
        rows = np.column_stack([enough[:, columns.start], sides[:, columns]])
        beside = numbers_of(own.events, claim.numbers, ranges)
        judged = _judged(claim, list(map(tuple, rows.tolist())), intervals, every)
        found.append(replace(judged, numbers=beside, test=tested))
    return found


@dataclass(frozen=True)
class _Tests:
    """Whole, parts and further implications of a claim, with their values."""

    claim: Claim
    events: pd.DataFrame
    leaves: list[Claim]
    values: list["pd.Series[float]"]


def _tests(claim: Claim, events: pd.DataFrame) -> _Tests:
    parts = [quantity(events[quantity(events, part)], claim.mean) for part in claim.parts.values()]
    others = [one.values(events) for one in claim.besides]
    leaves = [claim] * (1 + len(parts)) + list(claim.besides)
    values = [quantity(events, claim.mean), *parts, *others]
    return _Tests(claim, events, leaves, [one.astype(float) for one in values])


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


PLAIN = in_words("{:.3g} [{:.3g}, {:.3g}]")
"""An interval in words where nothing else is said."""


def _judged(
    claim: Claim, rows: Sequence[tuple[int, ...]], intervals: Sequence[Interval], every: bool
) -> Statement:
    """`rows`: whether there are events enough, and the sides of whole, parts and others, as drawn and by resample."""
    parts = slice(2, 2 + len(claim.parts))
    show = claim.show or PLAIN

    def verdict(row: tuple[int, ...]) -> str:
        more = [one >= (1 if every else 0) for one in row[parts]]
        broken = [one < 0 for one in row[parts.stop :]]
        partly = any(one > 0 for one in row[parts])
        return decide([MET[row[1]]], [all(more), not any(broken)], partly, bool(row[0]))

    sides = rows[0]
    shown: dict[int, list[str]] = {1: [], 0: [], -1: []}
    for name, one, interval in zip(claim.parts, sides[parts], intervals[1:], strict=False):
        shown[one].append(f"with {name}: {show(interval)}")
    others = zip(claim.besides, sides[parts.stop :], intervals[parts.stop - 1 :], strict=True)
    conditions = [
        *([] if sides[1] > 0 else shown[1]),
        *(unmet(text) for text in shown[-1]),
        *(unmet(f"besides, {other.name}: {PLAIN(i)}") for other, one, i in others if one < 0),
        *(unmet(text, None) for text in shown[0] if every),
    ]
    return Statement(
        claim.name, claim.claim, verdict(sides), {}, tuple(conditions) if sides[0] else (), claim.method,
        agreement=agreement(rows, verdict),
    )  # fmt: skip


# what is frozen before the first event

FOLDER = "thresholds"
"""Folder of these records in a study's folder of results."""


def decisive(claim: Claim) -> dict[str, Any]:
    """What decides a claim, as plain values: no words, which may become better, and nothing that is as usual."""
    own = ("mean", "side", "value") if claim.mean else ()
    more = {
        name: getattr(claim, name)
        for name in ("tolerance", "only", "parts", "each", "some", "alike", "exact")
    }
    nested = {name: list(map(decisive, getattr(claim, name))) for name in ("cases", "besides")}
    kept = {name: value for name, value in (more | nested).items() if value}
    return {"name": claim.name} | {name: getattr(claim, name) for name in own} | kept


def fingerprint(claims: Sequence[Claim]) -> str:
    """Short SHA-256 of what decides these claims."""
    return hashlib.sha256(_text(claims).encode()).hexdigest()[:16]


def freeze(folder: Path, seed: int, claims: Sequence[Claim]) -> None:
    """Store in `folder` what decides the claims about events of `seed`; what is stored is never changed."""
    path = folder / FOLDER / f"seed-{seed}-{fingerprint(claims)}.json"
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    since = datetime.now(UTC).isoformat(timespec="seconds")
    content = {"seed": seed, "since": since, "thresholds": json.loads(_text(claims))}
    write_whole(path, lambda aside: aside.write_text(json.dumps(content, indent=1), "utf-8"))


def frozen(folder: Path, seed: int) -> dict[str, str]:
    """Fingerprints of the claims that judged events of `seed` in `folder`, and since when, the first one first."""
    found = {
        path.stem.rpartition("-")[2]: str(json.loads(path.read_text(encoding="utf-8"))["since"])
        for path in (folder / FOLDER).glob(f"seed-{seed}-*.json")
    }
    return dict(sorted(found.items(), key=lambda item: item[1]))


def _text(claims: Sequence[Claim]) -> str:
    return json.dumps([decisive(claim) for claim in claims], sort_keys=True, ensure_ascii=False)
