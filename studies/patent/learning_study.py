"""Learning the increments of adhesion along the train, station by station (JP5484215, embodiment 2)."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import product

import pandas as pd

from alloc.estimation.increments import DIRECTIONS
from studies.core.cell import Task
from studies.core.claims import ABOUT, AT_LEAST, AT_MOST, Claim, Side, conjunction, family
from studies.core.statement import INTERVALS_OF_MEANS, LEAST_EVENTS, Interval, Statement, in_words
from studies.core.study import Study
from studies.patent.learning_starts import (
    DURATION,
    EXACT,
    KINDS,
    RAILS,
    STATIONS,
    Kind,
    Reference,
    series_of_train,
    series_rows,
)

TOLERANCE = 0.002
"""Largest error of any unit's increment with which it counts as learnt: a tenth of what the increments reach."""
COARSE = 0.005
"""A second, coarser tolerance, reported beside it."""
SERIES = [*Kind._fields, "train", "direction"]


PARTS = {
    kind.words: f"rail == {kind.rail} and stored == '{kind.stored}' and case == '{kind.case}'"
    for kind in KINDS
}
"""The kinds of series."""


def per_series(table: pd.DataFrame) -> pd.DataFrame:
    """One row per series; columns "<quantity>, <arm>".

    Means over the second half of the stations of effort, slip time, damage and detections. After the last station: `error`
    (largest of a unit), `bias` (mean) and `deviation`. `stations`: station after which the error stays within `TOLERANCE`
    (nan: never), `coarse` the same for `COARSE`; `data`: number of data, `excess`: their mean excess over the truth.
    """
    wide: dict[str, pd.Series] = {}
    for arm, rows in table.groupby("arm", sort=False):
        ordered = rows.sort_values("station")
        late = ordered[ordered["station"] > ordered["station"].max() // 2].groupby(SERIES)
        for name in ("effort_ratio", "slip_time", "damage", "unit_detections", "rear_detections"):
            wide[f"{name}, {arm}"] = late[name].mean()
        groups = ordered.groupby(SERIES)
        for name in ("error", "bias", "deviation"):
            wide[f"{name}, {arm}"] = groups[name].last()
        wide[f"covered, {arm}"] = groups["covered"].mean()
        total = groups["data"].sum()
        summed = ordered.assign(excess=ordered["data"] * ordered["excess"]).groupby(SERIES)
        wide[f"data, {arm}"] = total
        wide[f"excess, {arm}"] = summed["excess"].sum() / total.where(total > 0.0)
        for name, tolerance in (("stations", TOLERANCE), ("coarse", COARSE)):
            wide[f"{name}, {arm}"] = groups[["station", "error"]].apply(_stations_until, tolerance)
    return pd.DataFrame(wide).reset_index()


def _stations_until(rows: pd.DataFrame, tolerance: float) -> float:
    """First station from which on the error stays within the tolerance; nan for never."""
    outside = rows["station"][rows["error"] > tolerance]
    if outside.empty:
        return float(rows["station"].iloc[0])
    later = rows["station"][rows["station"] > outside.iloc[-1]]
    return float(later.iloc[0]) if len(later) else float("nan")


LITTLE_EFFORT = 0.01
"""Loss of effort, as a share of the plan, that counts as little."""
COVERED = 0.9
"""Share of the units and stations in which the robust rule says that the true increment exceeds the one it allows."""
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
PATENT = "JP5484215, embodiment 2"

LEARNERS = {"running mean": "patent", "running mean, held": "held", "Gaussian": "gaussian"}
"""Arms that learn and trust what they have learnt, and their short names."""


def by_part(words: str, text: str) -> dict[str, str]:
    """A quantity over each kind of series, by `words` and kind."""
    return {f"{words}, {name}": f"{text} if {part}" for name, part in PARTS.items()}


def difference(quantity: str, arm: str, other: str) -> str:
    """A quantity under `arm` minus the same under `other`."""
    return f"{quantity}, {arm} - {quantity}, {other}"


def _minus(
    quantities: Iterable[str], arm: str, other: str, words: str = "", parts: bool = False
) -> dict[str, str]:
    """Differences of quantities by name; `words`: what stands for "arm minus other". `parts`: over each kind of series."""
    found: dict[str, str] = {}
    for quantity in quantities:
        name, text = (
            f"{quantity}, {words or f'{arm} minus {other}'}",
            difference(quantity, arm, other),
        )
        found |= by_part(name, text) if parts else {name: text}
    return found


def _claim(
    name: str, claim: str, mean: str, side: Side, show: Callable[[Interval], str], numbers: Mapping[str, str],
    reason: str, value: float = 0.0, method: str = METHOD, besides: tuple[Claim, ...] = (),
) -> Claim:  # fmt: skip
    return Claim(
        name, claim, mean, side, value, reason=reason, source=PATENT, parts=PARTS, show=show, numbers=numbers,
        method=method, besides=besides,
    )  # fmt: skip


def _learnt(arm: str) -> Claim:
    """By the majority of the series of each kind: Wilson's interval lies above one half, or it does not."""
    until, coarse = f"stations, {arm}", f"coarse, {arm}"
    return Claim(
        f"learnt-{LEARNERS[arm]}",
        f"the learner {arm!r} brings the increments of all units within {TOLERANCE:g} of the truth",
        cases=tuple(
            Claim(
                f"with {name}", mean=f"'{until}' > 0", value=0.5, only=part, show=in_words("{:.0%} of the series"),
                reason="most of the series of a kind", source=PATENT,
                numbers={
                    f"share learnt within {TOLERANCE:g}, {name}": f"'{until}' > 0 if {part}",
                    f"stations until then, {name}": f"'{until}' if {part}",
                    f"share learnt within {COARSE:g}, {name}": f"'{coarse}' > 0 if {part}",
                    f"stations until within {COARSE:g}, {name}": f"'{coarse}' if {part}",
                },
            )
            for name, part in PARTS.items()
        ),
        some=True,
        method=f"a kind of series learns where Wilson's interval of the share that stays within {TOLERANCE:g} from some "
        "station on lies above one half; stations until then are those of the series that get there",
    )  # fmt: skip


def _gain(
    name: str, quantity: str, side: Side, words: str, show: Callable[[Interval], str]
) -> Claim:
    numbers = _minus([quantity], "running mean", "no learning")
    for arm in (*LEARNERS, "truth"):
        numbers |= _minus([quantity], arm, "no learning", parts=True)
    return _claim(
        f"gain-{name}", f"learning by (16), (17) gives {words} than keeping the wrong increments",
        difference(quantity, "running mean", "no learning"), side, show, numbers, "learning pays", method=LATE,
    )  # fmt: skip


def _excess(reference: Reference, rail: str) -> Claim:
    """Data taken with right caps should lie about the truth; but a unit slips where its rail is below its cap only."""
    return Claim(
        f"with {reference} reference, {rail} rail", mean=f"'excess, {EXACT[reference]}'", side=ABOUT, tolerance=TOLERANCE,
        only=f"case == sound and rail == {rail}", show=COEFFICIENT, reason="an error that counts as learnt", source=PATENT,
    )  # fmt: skip


def _excesses() -> dict[str, str]:
    """What the data of slips exceed the truth by, where the stored increments are right and where they stay wrong."""
    words = "excess over the truth with true increments stored"
    found: dict[str, str] = {}
    for reference, arm in EXACT.items():
        text = f"'excess, {arm}'"
        found |= {
            f"{words}, {reference} reference, {rail} rail": f"{text} if case == sound and rail == {rail}"
            for rail in RAILS
        }
        found |= {
            f"excess over the truth with true increments stored, {reference} reference, {name}": f"{text} if {part}"
            for name, part in PARTS.items()
        }
    for name, quantity in (("excess over the truth", "excess"), ("data per series", "data")):
        found |= by_part(
            f"{name}, received reference, never corrected", f"'{quantity}, no learning'"
        )
    return found


ROBUST, GAUSSIAN, HELD = "Gaussian, robust", "Gaussian", "running mean, held"
PLAIN = (ROBUST, GAUSSIAN, "robust minus plain")
LEARNT = tuple(map(_learnt, LEARNERS))
FAMILY = (
    *(
        _claim(
            f"closer-{LEARNERS[arm]}",
            f"after all stations the increments of the learner {arm!r} are closer to the truth than the stored ones",
            difference("error", "no learning", arm), AT_LEAST, COEFFICIENT,
            {
                "largest error taken away": difference("error", "no learning", arm),
                **by_part("largest error at the end", f"'error, {arm}'"),
                **by_part("mean error at the end", f"'bias, {arm}'"),
            },
            "learning takes error away",
        )
        for arm in LEARNERS
    ),
    _gain("effort", "effort_ratio", AT_LEAST, "more effort", PERCENT),
    _gain("slip", "slip_time", AT_MOST, "less slip", AXLE_SECONDS),
    _gain("damage", "damage", AT_MOST, "less wheel damage", KILOJOULES),
    *(
        _claim(
            f"as-good-as-truth-{LEARNERS[arm]}",
            f"with the increments of the learner {arm!r} the train loses less than {LITTLE_EFFORT:.0%} of the plan's "
            "effort against true ones",
            difference("effort_ratio", arm, "truth"), AT_LEAST, PERCENT,
            _minus(("effort_ratio", "slip_time", "damage"), arm, "truth")
            | _minus(["effort_ratio"], arm, "truth", parts=True),
            "a hundredth of the plan's effort is little", -LITTLE_EFFORT, LATE,
        )
        for arm in LEARNERS
    ),
    _claim(
        "held-reference",
        "the foremost unit's estimate at its own last slip is the better reference than that at the telegram's receipt "
        "(par. 0064)",
        difference("error", HELD, "running mean"), AT_MOST, COEFFICIENT,
        {
            "largest error at the end, held minus received": difference("error", HELD, "running mean"),
            **by_part("mean error at the end, held", f"'bias, {HELD}'"),
        },
        "better is a smaller error",
    ),
    _claim(
        "robust", f"the chance-constrained rule saves slip and costs less than {LITTLE_EFFORT:.0%} of the plan's effort",
        difference("slip_time", ROBUST, GAUSSIAN), AT_MOST, AXLE_SECONDS,
        {
            "slip_time [axle s], robust minus plain": difference("slip_time", ROBUST, GAUSSIAN),
            **_minus(("effort_ratio", "damage", "rear_detections", "error", "data"), *PLAIN),
            **_minus(("effort_ratio", "slip_time", "rear_detections"), *PLAIN, parts=True),
        },
        "it is there to save slip", method=f"both learn by the Gaussian posterior; {LATE}",
        besides=(Claim(f"effort: more than {LITTLE_EFFORT:.0%} lost", mean=difference("effort_ratio", ROBUST, GAUSSIAN),
                       value=-LITTLE_EFFORT, reason="a hundredth of the plan's effort is little"),),
    ),
    _claim(
        "coverage", "the increments that the robust rule allows lie below the true ones as often as it says, in 90 %",
        f"'covered, {ROBUST}'", AT_LEAST, SHARE,
        {"share of units and stations": f"'covered, {ROBUST}'", **by_part("share", f"'covered, {ROBUST}'")},
        "what the rule states", COVERED - 1e-9,
        f"share of units and stations whose true increment exceeds mean minus 1.28 posterior deviations; {METHOD}",
    ),
)  # fmt: skip
UNBIASED = Claim(
    "unbiased", "the data of slips lie about the truth where the stored increments are right",
    cases=tuple(_excess(*both) for both in product(EXACT, RAILS)), some=True,
    numbers=_excesses(),
    method=f"holds where the whole interval of the mean excess lies within ±{TOLERANCE:g}",
)  # fmt: skip
CLAIMS = (*LEARNT, *FAMILY, UNBIASED)
"""What is claimed; those between are one family."""


def learning_statements(table: pd.DataFrame) -> list[Statement]:
    """Every statement of the sweep. What a kind of series does not show is a condition too: kinds differ in everything."""
    series = per_series(table)
    learnt = (_over_enough(series, claim) for claim in LEARNT)
    return [*learnt, *family((series, FAMILY), every=True), _over_enough(series, UNBIASED)]


def _over_enough(series: pd.DataFrame, claim: Claim) -> Statement:
    """The statement over the cases on which enough series bear."""
    known = tuple(one for one in claim.cases if one.values(series).notna().sum() >= LEAST_EVENTS)
    return conjunction(series, replace(claim, cases=known), enough=bool(known))


def cells(seed: int, starts: int, duration: float = DURATION) -> list[Task]:
    """`starts` of each arm, on each kind of rail, from each kind of wrong values; made up to whole trains.

    `duration` [s] shortens the starts.
    """
    stations = max(1, min(STATIONS, starts // len(DIRECTIONS)))
    trains = max(1, -(-starts // (len(DIRECTIONS) * stations)))
    return [
        Task(series.label, series_rows, (series,))
        for train in range(trains)
        for series in series_of_train(train, stations, seed, duration)
    ]


LEARNING = Study(
    name="learning",
    question="how fast wrong increments are learnt, what learning gains, what the robust rule costs",
    default_events=240,
    step=len(DIRECTIONS) * STATIONS,  # a whole train
    cells=cells,
    judge=learning_statements,
    claims=CLAIMS,
)
