"""The arms of the sweep `learning`: who learns from what, by which learner, and allocates by which rule."""

import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
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
from studies.scenario.loading import shipped_scenario

Reference = Literal["received", "held"]

NEVER = 1_000_000_000
"""N_min of arms that keep their belief; they collect data all the same, and own slips cap units under them too."""


class LearningArm(NamedTuple):
    """How a train learns and allocates."""

    learner: Literal["none", "truth", "running-mean", "gaussian"]
    rule: str = "exact"
    reference: Reference = "received"

    @property
    def learning(self) -> IncrementLearning:
        """What runs on board."""
        if self.learner == "none" or self.learner == "truth":
            return IncrementLearning("running-mean", self.reference, first=NEVER)
        return IncrementLearning(self.learner, self.reference)


ARMS: dict[str, LearningArm] = {
    "no learning": LearningArm("none"),
    "truth": LearningArm("truth"),
    "truth, held": LearningArm("truth", reference="held"),
    "running mean": LearningArm("running-mean"),
    "running mean, held": LearningArm("running-mean", reference="held"),
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
        **_excess(run, truth),
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


def _excess(run: xr.Dataset, truth: Floats) -> dict[str, float]:
    """Number of data that the leader took, of each unit too, and mean of what they exceed the truth by (nan: no data)."""
    number = run["increment_data"].values
    instant, unit = np.nonzero(np.diff(number, axis=0, prepend=0.0) > 0.0)
    excess = run["increment_datum"].values[instant, unit] - truth[unit]
    return {
        "data": float(excess.size),
        "excess": float(excess.mean()) if excess.size else np.nan,
        **{f"data_{j + 1}": float(count) for j, count in enumerate(number[-1]) if j},
    }
