"""What the sweep `learning` says, computed from its table; a series (one train, one direction) is one event."""

from collections.abc import Callable, Sequence
from typing import Literal, get_args

import pandas as pd

from alloc.estimation.increment_data import Reference
from studies.core.statement import (
    CONDITIONS,
    CONFIDENCE,
    FAILS,
    HOLDS,
    TOO_FEW,
    Interval,
    Statement,
    mean_interval,
    share_interval,
)
from studies.core.verdict import LEAST_EVENTS, Judgement, Test, judge
from studies.learning.series import (
    COARSE,
    LITTLE_EFFORT,
    PARTS,
    TOLERANCE,
    by_part,
    coefficient,
    difference,
    kilojoules,
    per_series,
    percent,
    seconds,
    share,
)

METHOD = (
    "one event = one train in one running direction, all its stations; 95 % intervals by Student's t over the paired "
    "differences of the series (those of parts widened after Bonferroni)"
)

LEARNERS = {"running mean": "patent", "running mean, held": "held", "Gaussian": "gaussian"}
"""Arms that learn and trust what they have learnt, and their short names."""


def learning_statements(table: pd.DataFrame) -> list[Statement]:
    """Every statement of the sweep."""
    series = per_series(table)
    return [
        *(_learnt(series, arm) for arm in LEARNERS),
        *(_closer(series, arm) for arm in LEARNERS),
        _gain(series, "effort", "effort_ratio", 1, "more effort", percent),
        _gain(series, "slip", "slip_time", -1, "less slip", seconds),
        _gain(series, "damage", "damage", -1, "less wheel damage", kilojoules),
        *(_as_good_as_truth(series, arm) for arm in LEARNERS),
        _unbiased(series),
        _held_is_better(series),
        _robust(series),
        _covered(series),
    ]


def _judge(
    series: pd.DataFrame,
    test: Test,
    show: Callable[[Interval], str],
    others: Sequence[tuple[str, Test]] = (),
) -> Judgement:
    """As `judge` over the kinds of series, but what a kind does not show is a condition too: kinds differ in everything."""
    judged = judge(series, test, PARTS, show, others)
    if judged.verdict == TOO_FEW:
        return judged
    confidence = 1.0 - (1.0 - CONFIDENCE) / len(PARTS)
    open_kinds = [
        f"not shown with {name}: {show(interval)}"
        for name, part in PARTS.items()
        for interval in (test.interval(series[part(series)], confidence),)
        if test.sign(interval) == 0
    ]
    verdict = CONDITIONS if open_kinds and judged.verdict == HOLDS else judged.verdict
    return Judgement(verdict, judged.whole, (*judged.conditions, *open_kinds))


def _learnt(series: pd.DataFrame, arm: str) -> Statement:
    """Verdict by the majority of the series of each kind: Wilson's interval lies above one half, or it does not."""
    numbers: dict[str, Interval] = {}
    learnt: list[str] = []
    not_learnt: list[str] = []
    for name, part in PARTS.items():
        rows = series[part(series)]
        if len(rows) < LEAST_EVENTS:
            continue
        within = share_interval(rows[f"stations, {arm}"].notna())
        numbers[f"share learnt within {TOLERANCE:g}, {name}"] = within
        numbers[f"stations until then, {name}"] = mean_interval(rows[f"stations, {arm}"])
        numbers[f"share learnt within {COARSE:g}, {name}"] = share_interval(
            rows[f"coarse, {arm}"].notna()
        )
        numbers[f"stations until within {COARSE:g}, {name}"] = mean_interval(rows[f"coarse, {arm}"])
        (learnt if within.low > 0.5 else not_learnt).append(
            f"{name}: {within.value:.0%} of the series"
        )
    verdict = HOLDS if learnt and not not_learnt else CONDITIONS if learnt else FAILS
    return Statement(
        name=f"learnt-{LEARNERS[arm]}",
        claim=f"the learner {arm!r} brings the increments of all units within {TOLERANCE:g} of the truth",
        verdict=verdict if learnt or not_learnt else TOO_FEW,
        numbers=numbers,
        conditions=(*(f"with {t}" for t in learnt), *(f"not with {t}" for t in not_learnt)),
        method=f"a kind of series learns where Wilson's interval of the share that stays within {TOLERANCE:g} from some "
        "station on lies above one half; stations until then are those of the series that get there",
    )


def _closer(series: pd.DataFrame, arm: str) -> Statement:
    test = Test(lambda e: difference(e, "error", "no learning", arm))
    judged = _judge(series, test, coefficient)
    return Statement(
        f"closer-{LEARNERS[arm]}",
        f"after all stations the increments of the learner {arm!r} are closer to the truth than the stored ones",
        judged.verdict,
        {
            "largest error taken away": judged.whole,
            **by_part(series, f"error, {arm}", "largest error at the end"),
            **by_part(series, f"bias, {arm}", "mean error at the end"),
        },
        judged.conditions,
        METHOD,
    )


def _gain(
    series: pd.DataFrame,
    name: str,
    quantity: str,
    wanted: Literal[-1, 1],
    words: str,
    show: Callable[[Interval], str],
) -> Statement:
    arms = (*LEARNERS, "truth")
    test = Test(
        lambda e: difference(e, quantity, "running mean", "no learning"),
        wanted=wanted,
    )
    judged = _judge(series, test, show)
    numbers = {
        f"{quantity}, {arm} minus no learning, {part}": mean_interval(
            difference(series[chosen(series)], quantity, arm, "no learning")
        )
        for arm in arms
        for part, chosen in PARTS.items()
    }
    return Statement(
        f"gain-{name}",
        f"learning by (16), (17) gives {words} than keeping the wrong increments",
        judged.verdict,
        {f"{quantity}, running mean minus no learning": judged.whole, **numbers},
        judged.conditions,
        f"second half of the stations; {METHOD}",
    )


def _as_good_as_truth(series: pd.DataFrame, arm: str) -> Statement:
    test = Test(lambda e: difference(e, "effort_ratio", arm, "truth"), threshold=-LITTLE_EFFORT)
    judged = _judge(series, test, percent)
    numbers = {f"effort_ratio, {arm} minus truth": judged.whole}
    for quantity in ("slip_time", "damage"):
        numbers[f"{quantity}, {arm} minus truth"] = mean_interval(
            difference(series, quantity, arm, "truth")
        )
    for name, part in PARTS.items():
        numbers[f"effort_ratio, {arm} minus truth, {name}"] = mean_interval(
            difference(series[part(series)], "effort_ratio", arm, "truth")
        )
    return Statement(
        f"as-good-as-truth-{LEARNERS[arm]}",
        f"with the increments of the learner {arm!r} the train loses less than {LITTLE_EFFORT:.0%} of the plan's effort "
        "against true ones",
        judged.verdict,
        numbers,
        judged.conditions,
        f"second half of the stations; {METHOD}",
    )


def _unbiased(series: pd.DataFrame) -> Statement:
    """Data taken with right caps should lie about the truth; but a unit slips where its rail is below its cap only."""
    numbers: dict[str, Interval] = {}
    right: list[str] = []
    wrong: list[str] = []
    for reference in get_args(Reference):
        for rail in series["rail"].unique():
            interval = mean_interval(series[series["rail"] == rail][f"excess {reference}, truth"])
            words = f"{reference} reference, {rail} rail"
            numbers[f"excess over the truth with true increments stored, {words}"] = interval
            if interval.count >= LEAST_EVENTS:
                inside = interval.low > -TOLERANCE and interval.high < TOLERANCE
                (right if inside else wrong).append(f"{words}: {coefficient(interval)}")
        for name, part in PARTS.items():
            rows = series[part(series)]
            numbers[f"excess over the truth, {reference} reference, never corrected, {name}"] = (
                mean_interval(rows[f"excess {reference}, no learning"])
            )
            numbers[f"data per series, {reference} reference, never corrected, {name}"] = (
                mean_interval(rows[f"data {reference}, no learning"])
            )
    verdict = HOLDS if right and not wrong else CONDITIONS if right else FAILS
    return Statement(
        "unbiased",
        "the data of slips lie about the truth where the stored increments are right",
        verdict if right or wrong else TOO_FEW,
        numbers,
        (*(f"with {t}" for t in right), *(f"not with {t}" for t in wrong)),
        f"holds where the whole interval of the mean excess lies within ±{TOLERANCE:g}",
    )


def _held_is_better(series: pd.DataFrame) -> Statement:
    test = Test(lambda e: difference(e, "error", "running mean, held", "running mean"), wanted=-1)
    judged = _judge(series, test, coefficient)
    return Statement(
        "held-reference",
        "B1's estimate at its own last slip is the better reference than the one at the telegram's receipt (par. 0064)",
        judged.verdict,
        {
            "largest error at the end, held minus received": judged.whole,
            **by_part(series, "bias, running mean, held", "mean error at the end, held"),
        },
        judged.conditions,
        METHOD,
    )


def _robust(series: pd.DataFrame) -> Statement:
    arms = ("Gaussian, robust", "Gaussian")
    test = Test(lambda e: difference(e, "slip_time", *arms), wanted=-1)
    cost = Test(lambda e: difference(e, "effort_ratio", *arms), threshold=-LITTLE_EFFORT)
    judged = _judge(series, test, seconds, [(f"effort: more than {LITTLE_EFFORT:.0%} lost", cost)])
    numbers = {"slip_time [axle s], robust minus plain": judged.whole}
    for quantity in ("effort_ratio", "damage", "rear_detections", "error", "data held"):
        numbers[f"{quantity}, robust minus plain"] = mean_interval(
            difference(series, quantity, *arms)
        )
    for name, part in PARTS.items():
        for quantity in ("effort_ratio", "slip_time", "rear_detections"):
            numbers[f"{quantity}, robust minus plain, {name}"] = mean_interval(
                difference(series[part(series)], quantity, *arms)
            )
    return Statement(
        "robust",
        f"the chance-constrained rule saves slip and costs less than {LITTLE_EFFORT:.0%} of the plan's effort",
        judged.verdict,
        numbers,
        judged.conditions,
        f"both learn by the Gaussian posterior; second half of the stations; {METHOD}",
    )


def _covered(series: pd.DataFrame) -> Statement:
    test = Test(lambda e: e["covered, Gaussian, robust"], threshold=0.9 - 1e-9)
    judged = _judge(series, test, share)
    return Statement(
        "coverage",
        "the increments that the robust rule allows lie below the true ones as often as it says, in 90 %",
        judged.verdict,
        {
            "share of units and stations": judged.whole,
            **by_part(series, "covered, Gaussian, robust", "share"),
        },
        judged.conditions,
        "share of units and stations whose true increment exceeds mean minus 1.28 posterior deviations; "
        + METHOD,
    )
