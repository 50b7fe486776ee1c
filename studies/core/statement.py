"""A plain statement: a claim, whether it holds, under which conditions, and the numbers that decide it.

All verdicts are made here, by `side` and `decide`.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import ndtri  # scipy.stats, which calls it, takes a second to import

from alloc.display import cut, displayed
from alloc.metrics.registry import UNLIMITED, range_of
from studies.core.mean_limits import mean_limits

HOLDS = "holds"
CONDITIONS = "holds with conditions"
FAILS = "does not hold"
UNDECIDED = "undecided"
TOO_FEW = "too few events"
VERDICTS = (HOLDS, CONDITIONS, FAILS, UNDECIDED, TOO_FEW)
"""Every verdict. Undecided: the interval contains the threshold. The last: too few events bear on the claim."""

LEAST_EVENTS = 10
"""Smallest number of events on which a verdict about a whole or a part can rest."""

CONFIDENCE = 0.95
"""Confidence of every interval that is printed; verdicts on several claims use wider ones (see `studies.core.claims`)."""
INTERVALS_OF_MEANS = "means with a bootstrap of the events, verdicts by Student's t"
"""How intervals of means are made, in the words of a statement's method."""
LEAST_AGREEMENT = 0.95
"""Share of bootstrap resamples that must give a verdict again; one with less is fragile."""


@displayed
@dataclass(frozen=True, repr=False)
class Interval:
    """A mean or a share with the limits of its confidence interval (nan where there is none) and its events."""

    value: float
    """The mean, or the share."""
    low: float
    """Lower limit of the interval."""
    high: float
    """Upper limit of the interval."""
    count: int
    """Events that bear on it."""

    def __repr__(self) -> str:
        limits = f" [{self.low:.4g}, {self.high:.4g}]" if self.low == self.low else ""
        return f"<Interval {self.value:.4g}{limits}, events: {self.count}>"

    def cut(self, within: tuple[float, float]) -> "Interval":
        """The interval without the part beyond the smallest and the largest value that its quantity can have."""
        least, most = within
        low = min(max(self.low, least), self.value) if self.low < least else self.low
        high = max(min(self.high, most), self.value) if self.high > most else self.high
        return Interval(self.value, low, high, self.count)


@displayed
@dataclass(frozen=True)
class Tested:
    """The mean that decides a statement, and its threshold."""

    direction: str
    """Side of the threshold that is claimed: "at least" or "at most"."""
    threshold: float
    estimate: Interval
    """Mean with its interval at `CONFIDENCE`, computed by `mean_interval`."""
    adjusted: Interval
    """The same by Student's t, at the level that Holm's procedure gives it among the claims of the study; it decides."""
    level: float
    """Confidence of `adjusted`."""
    p: float
    """Two-sided p-value by Student's t, paired where the claim compares."""
    p_holm: float
    """The same adjusted after Holm over the claims of the study: a claim is decided if it is below 1 - `CONFIDENCE`."""


@displayed
@dataclass(frozen=True, repr=False)
class Statement:
    """Result of a sweep for one claim."""

    name: str
    """Short name, unique in the sweep."""
    claim: str
    verdict: str
    """One of `VERDICTS`, computed from the numbers."""
    numbers: dict[str, Interval] = field(default_factory=dict)
    """Quantity, with its unit where it has one, and its interval."""
    conditions: tuple[str, ...] = ()
    """Where it holds and where it does not, each in words."""
    method: str = ""
    """How the intervals were made, and the thresholds of the verdict."""
    test: Tested | None = None
    """Test of a claim about one mean."""
    agreement: float = math.nan
    """Share of bootstrap resamples of the events that give this verdict; nan where the verdict does not rest on means."""

    def __repr__(self) -> str:
        return f"<Statement {self.name!r}: {self.verdict}: {cut(self.claim)}>"

    @property
    def fragile(self) -> bool:
        """Whether it is decided, but too few resamples give the same verdict."""
        return self.verdict in (HOLDS, CONDITIONS, FAILS) and self.agreement < LEAST_AGREEMENT

    @property
    def holds(self) -> bool:
        """Whether it holds, with or without conditions."""
        return self.verdict in (HOLDS, CONDITIONS)

    def conditioned(self, *conditions: str) -> "Statement":
        """The statement with more `conditions`: it then holds only under these."""
        verdict = CONDITIONS if conditions and self.verdict == HOLDS else self.verdict
        return replace(self, conditions=(*self.conditions, *conditions), verdict=verdict)

    @property
    def in_parts(self) -> bool:
        """Whether it holds in some parts of the events while the whole is undecided."""
        whole = self.test is not None and self.test.p_holm >= 1.0 - CONFIDENCE
        return whole and self.verdict == CONDITIONS

    def content(self) -> dict[str, Any]:
        """The statement as plain values for JSON; nan becomes None."""
        content: dict[str, Any] = _plain(asdict(self) | {"fragile": self.fragile})
        return content


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return None if isinstance(value, float) and not math.isfinite(value) else value


def interval_of(number: "Interval | float | pd.Series[Any]") -> Interval:
    """The interval of a number: of the share where a series of events has truth values, of the mean where it has numbers."""
    if isinstance(number, Interval):
        return number
    if isinstance(number, pd.Series):
        return share_interval(number) if number.dtype == bool else mean_interval(number)
    return single(number)


def single(value: float) -> Interval:
    """A number without an interval."""
    return Interval(float(value), math.nan, math.nan, int(math.isfinite(value)))


def in_words(form: str, scale: float = 1.0) -> Callable[[Interval], str]:
    """Function that puts an interval into words: `form` has places for value, low, high, times `scale`, and events."""
    return lambda i: form.format(scale * i.value, scale * i.low, scale * i.high, i.count)


def mean_interval(
    values: Any, confidence: float = CONFIDENCE, within: tuple[float, float] = UNLIMITED
) -> Interval:
    """Mean of a series of events with its interval by `mean_limits`; nan entries do not bear on it and are left out.

    For paired differences it is the interval of the paired comparison. `within`: smallest and largest value that the
    quantity can have. The true mean is between them, so limits beyond them are cut.
    """
    known = values.dropna().astype(float)
    n = len(known)
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, 0)
    (mean,), (low,), (high,) = mean_limits(known.to_numpy()[np.newaxis], confidence)
    return Interval(float(mean), float(low), float(high), n).cut(within)


def column_interval(events: pd.DataFrame, column: str, scale: float = 1.0) -> Interval:
    """Mean of the column ``metric@arm`` of paired events times `scale`; its interval ends where the metric's range does."""
    least, most = range_of(column.partition("@")[0])
    return mean_interval(scale * events[column], within=(scale * least, scale * most))


def share_interval(values: Any, confidence: float = CONFIDENCE) -> Interval:
    """Share of the events that are true, with Wilson's score interval."""
    n = len(values)
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, 0)
    p = float(values.mean())
    low, high = share_limits(p, n, confidence)
    return Interval(p, float(low), float(high), n)


def share_limits(share: Any, count: Any, confidence: Any = CONFIDENCE) -> tuple[Any, Any]:
    """Limits of Wilson's score interval (Wilson 1927, JASA 22) of a share of `count` > 0 events."""
    z = ndtri(0.5 + 0.5 * confidence)
    centre = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = (
        z / (1 + z * z / count) * np.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    )
    # at the ends one limit is the share itself; rounding must not miss it
    low = np.where(share == 0.0, 0.0, np.maximum(centre - half, 0.0))
    return low, np.where(share == 1.0, 1.0, np.minimum(centre + half, 1.0))


# from numbers to a verdict

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
