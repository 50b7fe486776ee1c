"""Numbers with intervals, and verdicts on claims about random events.

Intervals are of the mean over events. A claim holds where its interval lies within the claim's bounds. Many claims that are
judged together share the risk of being wrong once (Holm 1979).
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import scipy  # loads `stats` when it is needed: it takes half a second
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CONFIDENCE = 0.95
FEWEST = 10
"""Events below which a claim gets no verdict."""
SHOWN = 5
"""Events below which a number is printed without its interval."""
BOOTSTRAPPED = (8, 1000)
"""Numbers of events for which the mean is bootstrapped; fewer have too little to draw from, more make t as good."""
RESAMPLES = 1999

Floats = NDArray[np.float64]


class Interval(NamedTuple):
    """A mean or a share, its 95 % interval (nan where there is none), and how many `events` are behind it."""

    value: float
    low: float
    high: float
    events: int

    def text(self, digits: int = 2, scale: float = 1.0, sign: bool = False) -> str:
        """Such as ``+1.25 [0.98, 1.51]``; the value alone where there are few events or no spread."""
        if self.events == 0 or np.isnan(self.value):
            return "–"
        value = in_digits(scale * self.value, digits, sign)
        low, high = (in_digits(scale * bound, digits, False) for bound in (self.low, self.high))
        shown = self.events >= SHOWN and self.low < self.high
        return f"{value} [{low}, {high}]" if shown else value

    def tied(self, little: float) -> bool:
        """Of a difference: whether it cannot be told from 0, or nobody chooses by it, being less than `little`."""
        return bool(self.low <= 0.0 <= self.high or abs(self.value) < little)

    def times(self, scale: float) -> "Interval":
        """The same number in another unit."""
        return Interval(scale * self.value, scale * self.low, scale * self.high, self.events)


def in_digits(value: float, digits: int, sign: bool) -> str:
    """A number with the typographic minus, and without one before a zero."""
    rounded = round(value, digits) + 0.0
    text = f"{rounded:+.{digits}f}" if sign else f"{rounded:.{digits}f}"
    return text.replace("-", "\N{MINUS SIGN}")


def mean(values: Any) -> Interval:
    """Mean of numbers or of paired differences, one per event; values that are not finite are left out.

    The interval is a bootstrap (BCa) for 8 to 1000 events, else Student's t. It is drawn at a level as much wider as t is
    than normal, since a bootstrap of few values is too narrow (Hesterberg 2015, section 5.3).
    """
    x = _finite(values)
    if x.size < 2 or np.ptp(x) <= 1e-12 * np.abs(x).max():
        centre = float(x.mean()) if x.size else np.nan
        bound = centre if x.size > 1 else np.nan
        return Interval(centre, bound, bound, x.size)
    low = high = np.nan
    if BOOTSTRAPPED[0] <= x.size <= BOOTSTRAPPED[1]:
        low, high = _bootstrap_mean(x.tobytes())
    if not np.isfinite([low, high]).all():  # a jackknife without spread gives none
        low, high = _student_bounds(x, CONFIDENCE)
    return Interval(float(x.mean()), float(low), float(high), x.size)


@lru_cache(maxsize=4096)  # tables, statements and figure ask for the same means
def _bootstrap_mean(values: bytes) -> tuple[float, float]:
    x = np.frombuffer(values)
    wider = scipy.stats.t.ppf(0.5 + CONFIDENCE / 2, x.size - 1) * np.sqrt(x.size / (x.size - 1))
    interval = scipy.stats.bootstrap(
        (x,),
        np.mean,
        n_resamples=RESAMPLES,
        method="BCa",
        rng=np.random.default_rng(0),
        confidence_level=1 - 2 * scipy.stats.norm.cdf(-wider),
    ).confidence_interval
    return float(interval.low), float(interval.high)


def share(true: Any) -> Interval:
    """Share of events in which something is true, with Wilson's interval."""
    x = np.asarray(true, dtype=bool)
    if not x.size:
        return Interval(np.nan, np.nan, np.nan, 0)
    bounds = scipy.stats.binomtest(int(x.sum()), x.size).proportion_ci(CONFIDENCE, method="wilson")
    return Interval(float(x.mean()), float(bounds.low), float(bounds.high), x.size)


def _finite(values: Any) -> Floats:
    x = np.asarray(values, dtype=float)
    return x[np.isfinite(x)]


def _student_bounds(x: Floats, confidence: float) -> tuple[float, float]:
    if not np.ptp(x):
        return float(x[0]), float(x[0])
    low, high = scipy.stats.ttest_1samp(x, 0.0).confidence_interval(confidence)
    return float(low), float(high)


def draw_forest(
    axes: "Axes",
    rows: Mapping[str, Sequence[Interval]],
    parts: Mapping[str, Any] = {},
    bound: float | None = None,
) -> None:
    """Draw a row for each name, in its colour among `parts`: means with intervals, a circle and a hollow square.

    `bound`: where a line stands that intervals are compared with.
    """
    for j, (name, numbers) in enumerate(rows.items()):
        colour = parts[name].colour if name in parts else "0.2"
        for k, number in enumerate(numbers):
            x, y = (number.low, number.value, number.high), [j + 0.25 * k] * 3
            face = "white" if k else colour
            axes.plot(x, y, "os"[k] + "-", color=colour, mfc=face, markevery=[1])
    axes.set_yticks(np.arange(len(rows)) + 0.125, rows)
    axes.set_ylim(max(len(rows), 1) - 0.4, -0.4)
    if bound is not None:
        axes.axvline(bound, color="0.5", linewidth=0.8)


# claims and what becomes of them


class Claim(NamedTuple):
    """That the mean of `values` over events lies within bounds."""

    name: str
    text: str
    values: Any
    """One per event, a Series where there are `parts`; nan where the claim does not apply to the event."""
    least: float = -np.inf
    most: float = np.inf
    parts: Mapping[str, Any] = {}
    """Parts of the events by words, as truth on the index of `values`: where the claim fails in one, it has conditions."""
    besides: "Sequence[Claim]" = ()
    """What it implies too, over the same events."""
    digits: int = 3
    scale: float = 1.0
    """Digits and scale of its numbers as texts."""

    @property
    def bound(self) -> float:
        """The one that decides."""
        return self.least if np.isfinite(self.least) else self.most


HOLDS = "holds"
CONDITIONS = "holds with conditions"
FAILS = "does not hold"
UNDECIDED = "undecided"
TOO_FEW = "too few events"


class Statement(NamedTuple):
    """What became of a claim."""

    claim: Claim
    verdict: str
    number: Interval
    conditions: tuple[str, ...] = ()

    def text(self, number: Interval) -> str:
        """A number in the digits and the scale of the claim."""
        return number.text(self.claim.digits, self.claim.scale)


def judge(claims: Sequence[Claim], family: bool = True) -> list[Statement]:
    """Verdicts by Student's t: at the levels of Holm over all `claims` if they are one `family`, else at 95 % each.

    Parts share the level of their claim (Bonferroni). What a claim implies besides is tested at 95 %.
    """
    values = [_finite(claim.values) for claim in claims]
    p = np.array([_find_p_value(x, claim) for x, claim in zip(values, claims, strict=True)])
    levels = holm(p) if family else np.full(len(claims), 1 - CONFIDENCE)
    cases = zip(claims, values, levels.tolist(), strict=True)
    return [_judge_claim(*case) for case in cases]


def _judge_claim(claim: Claim, x: Floats, alpha: float) -> Statement:
    statement = Statement(claim, TOO_FEW, mean(x))
    if x.size < FEWEST:
        return statement
    whole = _find_side(x, claim.least, claim.most, alpha)
    conditions: dict[int, list[str]] = {-1: [], 0: [], 1: []}
    for name, true in claim.parts.items():
        part = _finite(claim.values[true])
        side = _find_side(part, claim.least, claim.most, alpha / len(claim.parts))
        word = "not with" if whole > 0 else "with"
        conditions[side].append(f"{word} {name}: {statement.text(mean(part))}")
    if whole > 0:
        wrong = conditions[-1]
        for implied in claim.besides:
            if _find_side(_finite(implied.values), implied.least, implied.most, 1 - CONFIDENCE) < 0:
                number = mean(implied.values).text(implied.digits, implied.scale)
                wrong.append(f"not besides, {implied.text}: {number}")
        return statement._replace(verdict=CONDITIONS if wrong else HOLDS, conditions=tuple(wrong))
    verdict = CONDITIONS if conditions[1] else UNDECIDED if whole == 0 else FAILS
    return statement._replace(verdict=verdict, conditions=tuple(conditions[1]))


def _find_side(x: Floats, least: float, most: float, alpha: float) -> int:
    """1: the interval of the mean lies within the bounds; -1: beyond one of them; 0: it contains one."""
    if x.size < FEWEST:
        return 0
    low, high = _student_bounds(x, 1 - alpha)
    return int(low > least and high < most) - int(high < least or low > most)


def _find_p_value(x: Floats, claim: Claim) -> float:
    """Of the bound that decides; nan where there is no verdict."""
    if x.size < FEWEST:
        return np.nan
    if not np.ptp(x):
        return float(x[0] == claim.bound)
    return float(scipy.stats.ttest_1samp(x, claim.bound).pvalue)


def holm(p: Floats) -> Floats:
    """Level at which each hypothesis is tested, from their p values (Holm 1979); nan is not tested."""
    order = np.argsort(p)  # nan comes last
    tested = int(np.isfinite(p).sum())
    left = np.maximum(tested - np.arange(p.size), 1)
    steps = np.where(np.isfinite(p[order]), left * p[order], 1.0)
    rejected = int((np.maximum.accumulate(steps) < 1 - CONFIDENCE).sum())
    levels = np.empty(p.size)
    levels[order] = (1 - CONFIDENCE) / np.maximum(left, max(tested - rejected, 1))
    return levels


def statement_table(statements: Sequence[Statement]) -> pd.DataFrame:
    """One row per statement: name, claim, bound, verdict, mean with interval, number of events, conditions."""
    rows = []
    for claim, verdict, number, conditions in statements:
        bounds = [
            f"{sign} {in_digits(claim.scale * bound, claim.digits, False)}"
            for sign, bound in ((">", claim.least), ("<", claim.most))
            if np.isfinite(bound)
        ]
        texts = ", ".join(bounds), verdict, number.text(claim.digits, claim.scale)
        rows.append((claim.name, claim.text, *texts, number.events, "; ".join(conditions)))
    heads = ["name", "claim", "bound", "verdict", "mean [95 %]", "events", "conditions"]
    return pd.DataFrame(rows, columns=heads)


def shorten_statements(table: pd.DataFrame) -> pd.DataFrame:
    """A `statement_table` for people: each claim once, with its bound, before all of which it is claimed; conditions have
    means alone."""
    claim = table["claim"].str.cat(table["bound"], ": ")
    conditions = table["conditions"].str.replace(r" \[[\d−].*?\]", "", regex=True)
    verdict = table["verdict"].str.cat(conditions, ": ").str.removesuffix(": ")
    short = table.assign(claim=claim, verdict=verdict).drop(columns=["bound", "conditions"])
    short = short.iloc[np.argsort(pd.factorize(claim)[0], kind="stable")]
    return short.assign(claim=short["claim"].mask(short["claim"].duplicated(), ""))
