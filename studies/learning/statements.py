"""Statements of the sweep `learning`, computed from its table; a series (one train, one direction) is one event."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

import pandas as pd

from studies.core.family import Claim, Test, compared
from studies.core.statement import INTERVALS_OF_MEANS, Interval, Statement, in_words, mean_interval
from studies.core.verdict import LEAST_EVENTS, Bound, Numbers, over_cases
from studies.learning.arms import EXACT
from studies.learning.series import COARSE, PARTS, TOLERANCE, per_series

LITTLE_EFFORT = 0.01
"""Loss of effort, as a share of the plan, that counts as little."""
COEFFICIENT = in_words("{:+.4f} ({:+.4f} to {:+.4f})")
PERCENT = in_words("{:+.2f} % ({:+.2f} to {:+.2f})", 100.0)
AXLE_SECONDS = in_words("{:+.2f} axle s ({:+.2f} to {:+.2f})")
KILOJOULES = in_words("{:+.1f} kJ ({:+.1f} to {:+.1f})")
SHARE = in_words("{:.1%} ({:.1%} to {:.1%})")
"""What puts intervals into words."""
METHOD = (
    "one event = one train in one running direction, all its stations; 95 % intervals over the paired "
    f"differences of the series: {INTERVALS_OF_MEANS}; after Holm over all claims of this kind, parts after Bonferroni"
)
LATE = f"second half of the stations; {METHOD}"

LEARNERS = {"running mean": "patent", "running mean, held": "held", "Gaussian": "gaussian"}
"""Arms that learn and trust what they have learnt, and their short names."""


def learning_statements(table: pd.DataFrame) -> list[Statement]:
    """Every statement of the sweep."""
    series = per_series(table)
    claims = [
        *(_closer(series, arm) for arm in LEARNERS),
        _gain(series, "effort", "effort_ratio", 1, "more effort", PERCENT),
        _gain(series, "slip", "slip_time", -1, "less slip", AXLE_SECONDS),
        _gain(series, "damage", "damage", -1, "less wheel damage", KILOJOULES),
        *(_as_good_as_truth(series, arm) for arm in LEARNERS),
        _held_is_better(series),
        _robust(series),
        _covered(series),
    ]
    learnt = [_learnt(series, arm) for arm in LEARNERS]
    return [*learnt, *compared(claims), _unbiased(series)]


def _claim(
    series: pd.DataFrame, name: str, claim: str, test: Test, show: Callable[[Interval], str],
    numbers: Numbers, method: str = METHOD, others: Sequence[tuple[str, Test]] = (),
) -> Claim:  # fmt: skip
    """What a kind of series does not show is a condition too: kinds differ in everything."""
    return Claim(name, claim, series, test, PARTS, show, numbers, method, others, every=True)


def difference(series: pd.DataFrame, quantity: str, arm: str, other: str) -> "pd.Series[float]":
    """A quantity under `arm` minus the same under `other`, one number per series."""
    return series[f"{quantity}, {arm}"] - series[f"{quantity}, {other}"]


def _by_part(series: pd.DataFrame, column: str, words: str) -> dict[str, Any]:
    """A column over each kind of series, by `words` and kind."""
    return {f"{words}, {name}": series[part(series)][column] for name, part in PARTS.items()}


def _minus(
    series: pd.DataFrame, quantities: Iterable[str], arm: str, other: str, words: str = "", by_part: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Quantities under `arm` minus the same under `other`, series by series; `words`: what stands for "arm minus other".

    `by_part`: over each kind of series instead.
    """
    kinds = (
        {f", {name}": series[part(series)] for name, part in PARTS.items()}
        if by_part
        else {"": series}
    )
    return {
        f"{quantity}, {words or f'{arm} minus {other}'}{kind}": difference(rows, quantity, arm, other)
        for kind, rows in kinds.items()
        for quantity in quantities
    }  # fmt: skip


def _learnt(series: pd.DataFrame, arm: str) -> Statement:
    """Verdict by the majority of the series of each kind: Wilson's interval lies above one half, or it does not."""
    numbers: dict[str, Any] = {}
    met: dict[str, Bound] = {}
    for name, part in PARTS.items():
        rows = series[part(series)]
        if len(rows) < LEAST_EVENTS:
            continue
        until, coarse = rows[f"stations, {arm}"], rows[f"coarse, {arm}"]
        numbers[f"share learnt within {TOLERANCE:g}, {name}"] = until.notna()
        numbers[f"stations until then, {name}"] = until
        numbers[f"share learnt within {COARSE:g}, {name}"] = coarse.notna()
        numbers[f"stations until within {COARSE:g}, {name}"] = coarse
        words = f"with {name}: {until.notna().mean():.0%} of the series"
        met[words] = Bound("", until.notna(), least=0.5)
    return over_cases(
        f"learnt-{LEARNERS[arm]}",
        f"the learner {arm!r} brings the increments of all units within {TOLERANCE:g} of the truth",
        met, numbers,
        f"a kind of series learns where Wilson's interval of the share that stays within {TOLERANCE:g} from some "
        "station on lies above one half; stations until then are those of the series that get there",
        enough=bool(met),
    )  # fmt: skip


def _closer(series: pd.DataFrame, arm: str) -> Claim:
    test = Test(lambda e: difference(e, "error", "no learning", arm))
    return _claim(
        series, f"closer-{LEARNERS[arm]}",
        f"after all stations the increments of the learner {arm!r} are closer to the truth than the stored ones",
        test, COEFFICIENT,
        {
            "largest error taken away": test.quantity(series),
            **_by_part(series, f"error, {arm}", "largest error at the end"),
            **_by_part(series, f"bias, {arm}", "mean error at the end"),
        },
    )  # fmt: skip


def _gain(
    series: pd.DataFrame, name: str, quantity: str, wanted: Literal[-1, 1], words: str,
    show: Callable[[Interval], str],
) -> Claim:  # fmt: skip
    numbers = _minus(series, [quantity], "running mean", "no learning")
    for arm in (*LEARNERS, "truth"):
        numbers |= _minus(series, [quantity], arm, "no learning", by_part=True)
    return _claim(
        series, f"gain-{name}", f"learning by (16), (17) gives {words} than keeping the wrong increments",
        Test(lambda e: difference(e, quantity, "running mean", "no learning"), wanted=wanted),
        show, numbers, LATE,
    )  # fmt: skip


def _as_good_as_truth(series: pd.DataFrame, arm: str) -> Claim:
    return _claim(
        series, f"as-good-as-truth-{LEARNERS[arm]}",
        f"with the increments of the learner {arm!r} the train loses less than {LITTLE_EFFORT:.0%} of the plan's effort "
        "against true ones",
        Test(lambda e: difference(e, "effort_ratio", arm, "truth"), -LITTLE_EFFORT),
        PERCENT,
        _minus(series, ("effort_ratio", "slip_time", "damage"), arm, "truth")
        | _minus(series, ["effort_ratio"], arm, "truth", by_part=True),
        LATE,
    )  # fmt: skip


def _unbiased(series: pd.DataFrame) -> Statement:
    """Data taken with right caps should lie about the truth; but a unit slips where its rail is below its cap only."""
    numbers: dict[str, Interval] = {}
    met: dict[str, Bound] = {}
    sound = series[series["case"] == "sound"]
    for reference, arm in EXACT.items():
        for rail in sound["rail"].unique():
            excess = sound[sound["rail"] == rail][f"excess, {arm}"]
            interval = mean_interval(excess)
            words = f"{reference} reference, {rail} rail"
            numbers[f"excess over the truth with true increments stored, {words}"] = interval
            if interval.count >= LEAST_EVENTS:
                case = f"with {words}: {COEFFICIENT(interval)}"
                met[case] = Bound("", excess, -TOLERANCE, TOLERANCE)
        for name, part in PARTS.items():
            words = f"with true increments stored, {reference} reference, {name}"
            numbers[f"excess over the truth {words}"] = mean_interval(
                series[part(series)][f"excess, {arm}"]
            )
    for name, part in PARTS.items():
        for text, quantity in (("excess over the truth", "excess"), ("data per series", "data")):
            numbers[f"{text}, received reference, never corrected, {name}"] = mean_interval(
                series[part(series)][f"{quantity}, no learning"]
            )
    return over_cases(
        "unbiased", "the data of slips lie about the truth where the stored increments are right", met, numbers,
        f"holds where the whole interval of the mean excess lies within ±{TOLERANCE:g}", enough=bool(met),
    )  # fmt: skip


def _held_is_better(series: pd.DataFrame) -> Claim:
    test = Test(lambda e: difference(e, "error", "running mean, held", "running mean"), wanted=-1)
    return _claim(
        series, "held-reference",
        "the foremost unit's estimate at its own last slip is the better reference than that at the telegram's receipt "
        "(par. 0064)",
        test, COEFFICIENT,
        {
            "largest error at the end, held minus received": test.quantity(series),
            **_by_part(series, "bias, running mean, held", "mean error at the end, held"),
        },
    )  # fmt: skip


def _robust(series: pd.DataFrame) -> Claim:
    arms = ("Gaussian, robust", "Gaussian", "robust minus plain")
    test = Test(lambda e: difference(e, "slip_time", *arms[:2]), wanted=-1)
    cost = Test(lambda e: difference(e, "effort_ratio", *arms[:2]), -LITTLE_EFFORT)
    return _claim(
        series, "robust",
        f"the chance-constrained rule saves slip and costs less than {LITTLE_EFFORT:.0%} of the plan's effort",
        test, AXLE_SECONDS,
        {
            "slip_time [axle s], robust minus plain": test.quantity(series),
            **_minus(series, ("effort_ratio", "damage", "rear_detections", "error", "data"), *arms),
            **_minus(series, ("effort_ratio", "slip_time", "rear_detections"), *arms, by_part=True),
        },
        f"both learn by the Gaussian posterior; {LATE}",
        [(f"effort: more than {LITTLE_EFFORT:.0%} lost", cost)],
    )  # fmt: skip


def _covered(series: pd.DataFrame) -> Claim:
    test = Test(lambda e: e["covered, Gaussian, robust"], 0.9 - 1e-9)
    return _claim(
        series, "coverage",
        "the increments that the robust rule allows lie below the true ones as often as it says, in 90 %",
        test, SHARE,
        {
            "share of units and stations": test.quantity(series),
            **_by_part(series, "covered, Gaussian, robust", "share"),
        },
        f"share of units and stations whose true increment exceeds mean minus 1.28 posterior deviations; {METHOD}",
    )  # fmt: skip
