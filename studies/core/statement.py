"""A plain statement: a claim, whether it holds, under which conditions, and the numbers behind it."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import pandas as pd
from scipy.special import ndtri, stdtrit  # scipy.stats, which calls them, takes a second to import

HOLDS = "holds"
CONDITIONS = "holds with conditions"
FAILS = "does not hold"
TOO_FEW = "too few events"
VERDICTS = (HOLDS, CONDITIONS, FAILS, TOO_FEW)
"""Every verdict; the last where the table does not hold enough events that bear on the claim."""

CONFIDENCE = 0.95
"""Confidence of every interval of a whole; those of parts are widened by their number (see `studies.core.verdict`)."""


@dataclass(frozen=True)
class Interval:
    """A mean or a share with the limits of its confidence interval (nan where there is none) and its events."""

    value: float
    low: float
    high: float
    count: int


@dataclass(frozen=True)
class Statement:
    """What a sweep says about one claim."""

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

    def content(self) -> dict[str, Any]:
        """The statement as plain values for JSON; nan becomes None."""
        content = asdict(self)
        for numbers in content["numbers"].values():
            for key, value in numbers.items():
                numbers[key] = value if math.isfinite(value) else None
        return content


def interval_of(number: "Interval | float | pd.Series[Any]") -> Interval:
    """The interval of a number: of the share where a series of events holds truths, of the mean where it holds numbers."""
    if isinstance(number, Interval):
        return number
    if isinstance(number, pd.Series):
        return share_interval(number) if number.dtype == bool else mean_interval(number)
    return single(number)


def single(value: float) -> Interval:
    """A number that has no interval."""
    return Interval(float(value), math.nan, math.nan, int(math.isfinite(value)))


def in_words(form: str, scale: float = 1.0) -> Callable[[Interval], str]:
    """What puts an interval into words: `form` has places for value, low, high, all times `scale`, and the events."""
    return lambda i: form.format(scale * i.value, scale * i.low, scale * i.high, i.count)


def mean_interval(values: Any, confidence: float = CONFIDENCE) -> Interval:
    """Mean of a series of events with its interval by Student's t; nan entries do not bear on it and are left out.

    Of paired differences it is the interval of paired comparison.
    """
    known = values.dropna().astype(float)
    n = len(known)
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, 0)
    mean = float(known.mean())
    if n == 1:
        return Interval(mean, math.nan, math.nan, 1)
    half = half_width(float(known.std(ddof=1)), n, confidence)
    return Interval(mean, mean - half, mean + half, n)


def half_width(deviation: float, count: int, confidence: float = CONFIDENCE) -> float:
    """Half-width of the interval of a mean by Student's t, from the standard deviation of `count` > 1 events."""
    return float(stdtrit(count - 1, 0.5 + 0.5 * confidence)) * deviation / math.sqrt(count)


def share_interval(values: Any, confidence: float = CONFIDENCE) -> Interval:
    """Share of the events that are true, with Wilson's score interval (Wilson 1927, JASA 22)."""
    n = len(values)
    if n == 0:
        return Interval(math.nan, math.nan, math.nan, 0)
    p = float(values.mean())
    z = float(ndtri(0.5 + 0.5 * confidence))
    centre = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    # at the ends one limit is the share itself; rounding must not miss it
    low = 0.0 if p == 0.0 else max(centre - half, 0.0)
    return Interval(p, low, 1.0 if p == 1.0 else min(centre + half, 1.0), n)
