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
from scipy.special import ndtr, ndtri, stdtrit

from alloc.display import cut, displayed
from alloc.metrics.registry import UNLIMITED, range_of

# Limits of confidence intervals of means: a bootstrap of the events, and Student's t where these are too few for it.
#
# Coverage was simulated with 2000 samples of each size, drawn from stored events of `headroom` and `ladder` (adhesion used,
# wheel damage, slip time, paired gains), from beta(8, 0.3) and from the normal distribution. Intervals of 95 % cover:
#
# ================================  ====  ====  ====  ====  ====
# events                               5     8    11    20    50
# ================================  ====  ====  ====  ====  ====
# bound used: Student's t             91    91    91    92    94
# bound used: BCa                     81    86    88    91    94
# bound used: BCa, level widened      89    92    92    93    94
# beta(8, 0.3): Student's t           78    82    85    89    92
# beta(8, 0.3): BCa, level widened    80    86    90    93    94
# normal: Student's t                 94    95    94    95    96
# normal: BCa, level widened          91    94    94    95    96
# ================================  ====  ====  ====  ====  ====
#
# Of five days 38 %, and of beta(8, 0.3) 93 %, of the intervals by Student's t reach beyond 100 %. No bootstrap limit lies
# beyond the events. A bootstrap of three events covers 72 %, so it needs `LEAST`. A bootstrap of t covers best (93 to 96 %),
# but passes the bounds too, and is no part of SciPy. Of wheel damage, slip time and gains the order is the same; long slips
# are too rare for any of them (slip time, 20 events: 77, 80, 82 %). Of adhesion used where it is short, under cut-and-ramp,
# Student's t covers more: 94, 87 and 91 % of 11 events, and 94, 92 and 93 % of 50.

LEAST, MOST = 8, 1000
"""Numbers of events with a bootstrap. With fewer it is too narrow. With 1000 it is almost Student's t: limits move by a
tenth of the half-width with slip times, by 3 to 7 % with the others above."""
RESAMPLES = 1999
"""Another seed moves a limit by 4 % of the half-width."""
SEED = 0
"""Of the resamples: the same events give the same limits, and all quantities of the same events share their resamples."""
AT_ONCE = 4_000_000
"""Values of resamples in memory."""

Floats = NDArray[np.float64]


def mean_limits(values: Floats, confidence: float) -> tuple[Floats, Floats, Floats]:
    """Means of `values` (quantities, events), none of them nan, and their lower and upper limits, nan for one event.

    The mean of values that are not all finite has no limits.
    Paired differences are quantities as others: an event is drawn with both of its numbers.
    """
    count = values.shape[1]
    mean = values.mean(axis=1)
    if count < 2:
        return mean, np.full_like(mean, np.nan), np.full_like(mean, np.nan)
    with np.errstate(invalid="ignore"):
        half = half_width(values.std(axis=1, ddof=1), count, confidence)
        low, high = mean - half, mean + half
        # equal values have no spread to draw from
        spread = np.ptp(values, axis=1) > 1e-12 * np.abs(values).max(axis=1)
    if LEAST <= count <= MOST and spread.any():
        drawn, centre = values[spread], mean[spread]
        least, most = drawn.min(axis=1), drawn.max(axis=1)
        scale = most - least  # so that squares of tiny values are none too small
        found = _bootstrapped((drawn - centre[:, np.newaxis]) / scale[:, np.newaxis], confidence)
        for limits, off in zip((low, high), found, strict=True):
            # where all resamples lie on one side of the mean, its bias cannot be corrected
            known = np.where(np.isfinite(off), centre + scale * off, limits[spread])
            limits[spread] = np.clip(known, least, most)
    return mean, np.minimum(low, mean), np.maximum(high, mean)


def _bootstrapped(values: Floats, confidence: float) -> tuple[Floats, Floats]:
    """Bias-corrected and accelerated limits (Efron 1987, JASA 82), at a level that is as much wider as t is than normal.

    The level follows Hesterberg (2015, The American Statistician 69, section 5.3).
    """
    from scipy.stats import bootstrap

    count = values.shape[1]
    wider = stdtrit(count - 1, 0.5 + 0.5 * confidence) * math.sqrt(count / (count - 1))
    found = bootstrap(
        (values,), np.mean, axis=-1, vectorized=True, method="BCa", n_resamples=RESAMPLES,
        batch=max(1, AT_ONCE // values.size), confidence_level=1.0 - 2.0 * float(ndtr(-wider)),
        rng=np.random.default_rng(SEED),
    )  # fmt: skip
    return np.array(found.confidence_interval.low), np.array(found.confidence_interval.high)


def half_width(deviation: Floats, count: Floats | int, confidence: Floats | float) -> Floats:
    """Half-width of the interval of a mean by Student's t, from the standard deviation of `count` > 1 events."""
    half: Floats = stdtrit(count - 1, 0.5 + 0.5 * confidence) * deviation / np.sqrt(count)
    return half


HOLDS = "holds"
CONDITIONS = "holds with conditions"
FAILS = "does not hold"
UNDECIDED = "undecided"
TOO_FEW = "too few events"
VERDICTS = (HOLDS, CONDITIONS, FAILS, UNDECIDED, TOO_FEW)
"""Every verdict. Undecided: the interval contains the threshold. The last: too few events bear on the claim."""

LEAST_EVENTS = 10
"""Smallest number of events on which a verdict about a whole or a part can rest."""

LEAST_SHOWN = 5
"""Events of a mean whose interval is shown: with fewer it says nothing."""

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
        if not (self.low < least or self.high > most):
            return self
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


POINTS = in_words("{:+.2f} [{:+.2f}, {:+.2f}] points, n = {}", 100)
"""A difference of shares in points."""


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
