"""Learning the increments of adhesion along the train, station by station (JP5484215, embodiment 2)."""

import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import norm

from alloc.estimation.increments import (
    DIRECTIONS,
    learnt_in,
    load_learning,
    save_learning,
    unit_increments,
)
from alloc.event import Event
from alloc.metrics import METRICS
from alloc.onboard.equipment import equipment
from alloc.onboard.increment_learning import IncrementLearning
from alloc.rules.qp import PROBABILITY
from alloc.simulation import simulate
from studies.core.cell import Task
from studies.core.claims import ABOUT, AT_LEAST, AT_MOST, Claim, Side, conjunction, family
from studies.core.statement import INTERVALS_OF_MEANS, LEAST_EVENTS, Interval, Statement, in_words
from studies.core.study import Study
from studies.scenario.scenario import shipped_scenario

# The arms of the sweep `learning`: who learns from what, by which learner, and allocates by which rule.

Reference = Literal["received", "held"]

NEVER = 1_000_000_000
"""N_min of arms that keep their belief; they collect data all the same, and own slips cap units under them too."""


class LearningArm(NamedTuple):
    """How a train learns and allocates."""

    learner: Literal["none", "truth", "running-mean", "gaussian"]
    rule: str = "exact"
    reference: Reference = "received"
    update: Literal["run", "next run"] = "run"
    weight: Literal["all", "original"] = "all"

    @property
    def learning(self) -> IncrementLearning:
        """What runs on board."""
        if self.learner == "none" or self.learner == "truth":
            return IncrementLearning("running-mean", self.reference, first=NEVER)
        return IncrementLearning(
            self.learner, self.reference, update=self.update, weight=self.weight
        )


ARMS: dict[str, LearningArm] = {
    "no learning": LearningArm("none"),
    "truth": LearningArm("truth"),
    "truth, held": LearningArm("truth", reference="held"),
    "running mean": LearningArm("running-mean"),
    "running mean, held": LearningArm("running-mean", reference="held"),
    "running mean, next run": LearningArm("running-mean", update="next run"),
    "running mean, original weight": LearningArm("running-mean", weight="original"),
    "running mean, both": LearningArm("running-mean", update="next run", weight="original"),
    "Gaussian": LearningArm("gaussian", reference="held"),
    "Gaussian, robust": LearningArm("gaussian", rule="qp-robust", reference="held"),
}
"""Arms by name: "no learning" keeps the stored values, "truth" has the true ones; "truth, held" runs in the same way and
collects other data. "running mean" is the patent's learning with the patent's data. "held" uses the leader's estimate at
its last slip as reference, as the Gaussian learners do, whose model has no room for biased data."""
EXACT: dict[Reference, str] = {"received": "truth", "held": "truth, held"}
"""Arms whose data show what a reference gives where the stored increments are right."""

Floats = NDArray[np.float64]

STATIONS = 24
"""Starts of a train in each running direction: stations of a commuter line, end to end."""
DURATION = 12.0
"""Length of a start [s]; at its end, near 36 km/h, the motors still reach the plan."""
BASE = "wet-start"

LEVEL, HALF_WIDTH = 0.128, 0.0147
"""Level of the rail, uniform from station to station: below 0.147, so that the foremost unit slips at every start, and on
both sides of the level at which the train as a whole reaches the plan. Deviation 0.0085."""
SCATTER = 0.0085
"""Scatter along a rail that is not even. With the level's deviation it makes 0.012, that of JP5484215 par. 0055, half of the
variance each (assumed)."""
RAILS: dict[str, float] = {"even": 0.0, "scattered": SCATTER}
"""Scatter along the rail, by name."""
STORED: dict[str, float] = {"too low": 0.0, "too high": 2.0}
"""Increments stored at first, as a multiple of the true ones."""


class StartCase(NamedTuple):
    """What differs from the rule of the patent on a train in which everything works."""

    trigger: Literal["slip", "limited"] = "slip"
    """The rule is called at the leader's detection, as printed. If it is called while units report that they are limited, it
    caps each of them by its own mark, and increments matter for the others alone: they are learnt, but decide little."""
    loss: float = 0.0
    """Share of the telegrams that are lost."""
    fails: float | None = None
    """Instant of every start at which the leader's motors fail [s]."""


CASES: dict[str, StartCase] = {
    "sound": StartCase(),
    "telegrams lost": StartCase(loss=0.2),
    "leader fails": StartCase(fails=5.0),
    "on reports": StartCase(trigger="limited"),
}
"""Cases by name. The leader fails when units have slipped a few times, and another one leads for the rest of the start."""


class Kind(NamedTuple):
    """A kind of series: rail, stored values, case."""

    rail: str
    stored: str
    case: str

    @property
    def words(self) -> str:
        """Its name."""
        words = f"{self.rail} rail, stored values {self.stored}"
        return words if self.case == "sound" else f"{words}, {self.case}"


KINDS: tuple[Kind, ...] = (
    *(Kind(rail, stored, "sound") for rail, stored in product(RAILS, STORED)),
    Kind("even", "too high", "telegrams lost"),
    Kind("even", "too high", "leader fails"),
    Kind("even", "too low", "on reports"),
    Kind("scattered", "too low", "on reports"),
)
"""Kinds of series. Faults are judged where a sound train learns best; reports, where the rule as printed learns nothing."""

METRIC_NAMES = ("effort_ratio", "utilisation", "slip_time", "damage", "unit_detections")


class Series(NamedTuple):
    """One train in one arm: both directions, station by station."""

    kind: Kind
    arm: str
    train: int
    stations: int
    seed: int
    duration: float

    @property
    def label(self) -> str:
        """Name for people and files."""
        label = "/".join((*self.kind, self.arm, str(self.train)))
        return label.replace(" ", "-").replace(",", "")


def series_of_train(train: int, stations: int, seed: int, duration: float) -> list[Series]:
    """The series of a train in every arm, of each kind."""
    return [Series(*both, train, stations, seed, duration) for both in product(KINDS, ARMS)]


def series_rows(series: Series) -> list[dict[str, Any]]:
    """Run a train through all its stations, both directions; a row per start, with the file of what it learns at hand."""
    with tempfile.TemporaryDirectory() as folder:
        memory = Path(folder) / "learning.json"
        return [
            _start(series, direction, station, memory)
            for direction in DIRECTIONS
            for station in range(1, series.stations + 1)
        ]


def _start(series: Series, direction: str, station: int, memory: Path) -> dict[str, Any]:
    """One start: begin with what was learnt before, and keep what is learnt."""
    arm = ARMS[series.arm]
    event, level = station_event(series, direction, station)
    truth = true_unit_increments(event)
    stored = (1.0 if arm.learner == "truth" else STORED[series.kind.stored]) * truth
    known = load_learning(memory, event.model.train.name)
    belief = replace(
        event.onboard.belief, unit_increments=tuple(stored.tolist()), learnt=known.get(direction)
    )
    onboard = replace(event.onboard, belief=belief, learning=arm.learning)
    believed = equipment(event.model, onboard).learnt
    run = simulate(replace(event, onboard=onboard), arm.rule)
    learnt = learnt_in(run)
    save_learning(memory, event.model.train.name, known | {direction: learnt})
    return {
        **series.kind._asdict(),
        "arm": series.arm,
        "train": series.train,
        "direction": direction,
        "station": station,
        "level": level,
        "seed": event.seed,
        **{name: float(METRICS[name].function(run)) for name in METRIC_NAMES},
        **_judged(run, believed.increment, believed.deviation, np.array(learnt.increment), truth),
        **_too_high(run, truth),
        **{f"increment_{j + 1}": value for j, value in enumerate(learnt.increment) if j},
    }


def station_event(series: Series, direction: str, station: int) -> tuple[Event, float]:
    """The start of a train at a station, and the rail's level there: the same for all arms."""
    kind = series.kind
    numbers = (
        series.seed, series.train, KINDS.index(kind), DIRECTIONS.index(direction), station
    )  # fmt: skip
    event_seed, level_seed = np.random.SeedSequence(numbers).generate_state(2)
    level = LEVEL + HALF_WIDTH * float(np.random.default_rng(level_seed).uniform(-1.0, 1.0))
    base, case = shipped_scenario(BASE), CASES[kind.case]
    changed = base.changed(
        rail=base.rail.model_dump() | {"level": level, "scatter": RAILS[kind.rail]},
        variation=None,  # drawn here
        duration_s=series.duration,
        reversed=DIRECTIONS.index(direction) > 0,
        failures=() if case.fails is None else ({"unit": 1, "time_s": case.fails},),
        onboard={"trigger": case.trigger, "telegrams": {"loss": case.loss}},
    )
    return changed.event(int(event_seed)), level


def true_unit_increments(event: Event) -> Floats:
    """Increment of each unit over the foremost one as the rail has it on average, (units,)."""
    rail, structure = event.model.rail, event.model.structure
    return unit_increments(np.asarray(rail.increments, dtype=float), structure.axle_unit)


def _judged(
    run: xr.Dataset, believed: Floats, deviation: Floats, learnt: Floats, truth: Floats
) -> dict[str, float]:
    """Errors of what was believed and learnt, over the units behind the foremost unit, and their slips."""
    error = (learnt - truth)[1:]
    lowered = believed - float(norm.ppf(PROBABILITY)) * deviation
    slips = np.diff(run["slipping"].values, axis=0, prepend=0) > 0
    return {
        "error": float(np.abs(error).max()),
        "bias": float(error.mean()),
        "covered": float((truth >= lowered - 1e-12)[1:].mean()),
        "deviation": float(deviation[1:].mean()),
        "rear_detections": float(slips[:, 1:].sum()),
    }


def _too_high(run: xr.Dataset, truth: Floats) -> dict[str, float]:
    """Number of data that the leader took, of each unit too, and mean of what they exceed the truth by (nan: no data)."""
    number = run["increment_data"].values
    instant, unit = np.nonzero(np.diff(number, axis=0, prepend=0.0) > 0.0)
    excess = run["increment_datum"].values[instant, unit] - truth[unit]
    return {
        "data": float(excess.size),
        "excess": float(excess.mean()) if excess.size else np.nan,
        **{f"data_{j + 1}": float(count) for j, count in enumerate(number[-1]) if j},
    }


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
