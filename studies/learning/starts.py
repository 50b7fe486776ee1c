"""Learning the increments of adhesion along the train, station by station (JP5484215, embodiment 2).

A train with wrong increments stored starts from station after station. After each start the data of its slips go to a
learner, and the next start uses what it has learnt, read from the file in which the train keeps it. Every arm (learner,
rule, kind of data) meets the same rails with the same noise; trains, directions, rails and kinds of wrong values are
drawn independently of each other.
"""

import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import norm

from alloc.estimation.increment_data import Reference, detections, increment_data
from alloc.estimation.increments import unit_increments
from alloc.estimation.learning import DIRECTIONS, GaussianPosterior, load_learning, save_learning
from alloc.event import Event
from alloc.metrics import METRICS
from alloc.rules.qp_robust import PROBABILITY
from alloc.simulation import simulate
from studies.learning.arms import ARMS, believed_increments, first_learning
from studies.scenario.loading import shipped_scenario

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

METRIC_NAMES = ("effort_ratio", "utilisation", "slip_time", "damage", "unit_detections")


class Series(NamedTuple):
    """One train in one arm: both directions, station by station."""

    rail: str
    stored: str
    arm: str
    train: int
    stations: int
    seed: int
    duration: float

    @property
    def label(self) -> str:
        """Name for people and files."""
        label = f"{self.rail}/{self.stored}/{self.arm}/{self.train}"
        return label.replace(" ", "-").replace(",", "")


def series_of_train(train: int, stations: int, seed: int, duration: float) -> list[Series]:
    """The series of a train in every arm, on each kind of rail, from each kind of wrong values."""
    kinds = product(RAILS, STORED, ARMS)
    return [Series(*kind, train, stations, seed, duration) for kind in kinds]


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
    """One start: allocate with what was learnt before, learn from what happens."""
    arm = ARMS[series.arm]
    event, level = station_event(series, direction, station)
    truth = true_unit_increments(event)
    stored = STORED[series.stored] * truth
    known = load_learning(memory, event.model.train.name)
    learner = known.get(direction) or first_learning(arm, stored)
    believed = believed_increments(arm, learner, stored, truth)
    deviation = learner.deviation() if isinstance(learner, GaussianPosterior) else 0.0 * truth
    belief = replace(
        event.onboard.belief, unit_increments=tuple(believed.tolist()), unit_deviation=tuple(deviation.tolist())
    )  # fmt: skip
    # as printed: it learns from what the foremost unit holds at its slip
    onboard = replace(event.onboard, belief=belief, trigger="slip")
    run = simulate(replace(event, onboard=onboard), arm.rule)
    data = increment_data(run, arm.reference)
    for datum in data:
        learner.add(datum.unit, datum.increment)
    save_learning(memory, event.model.train.name, known | {direction: learner})
    learnt = believed_increments(arm, learner, stored, truth)
    return {
        **{name: getattr(series, name) for name in ("rail", "stored", "arm", "train")},
        "direction": direction,
        "station": station,
        "level": level,
        "seed": event.seed,
        **{name: float(METRICS[name].function(run)) for name in METRIC_NAMES},
        **_judged(run, believed, deviation, learnt, truth),
        **_excess(run, truth),
        **{f"increment_{j + 1}": float(value) for j, value in enumerate(learnt) if j},
        **{f"data_{j + 1}": sum(datum.unit == j for datum in data) for j in range(1, truth.size)},
    }


def station_event(series: Series, direction: str, station: int) -> tuple[Event, float]:
    """The start of a train at a station, and the rail's level there: the same for all arms."""
    numbers = (
        series.seed, series.train, list(RAILS).index(series.rail), list(STORED).index(series.stored),
        DIRECTIONS.index(direction), station,
    )  # fmt: skip
    event_seed, level_seed = np.random.SeedSequence(numbers).generate_state(2)
    level = LEVEL + HALF_WIDTH * float(np.random.default_rng(level_seed).uniform(-1.0, 1.0))
    base = shipped_scenario(BASE)
    rail = base.rail.model_dump() | {"level": level, "scatter": RAILS[series.rail]}
    changed = base.changed(
        rail=rail,
        variation=None,  # drawn here
        duration_s=series.duration,
        reversed=DIRECTIONS.index(direction) > 0,
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
    return {
        "error": float(np.abs(error).max()),
        "bias": float(error.mean()),
        "covered": float((truth >= lowered - 1e-12)[1:].mean()),
        "deviation": float(deviation[1:].mean()),
        "rear_detections": float(sum(onset.size for onset in detections(run)[1:])),
    }


def _excess(run: xr.Dataset, truth: Floats) -> dict[str, float]:
    """By reference: number of data, and mean and mean square of what they exceed the truth by (nan: no data)."""
    found: dict[str, float] = {}
    for reference in get_args(Reference):
        data = increment_data(run, reference)
        excess = np.array([datum.increment - truth[datum.unit] for datum in data])
        found[f"data_{reference}"] = float(excess.size)
        for name, values in (("excess", excess), ("square", excess**2)):
            found[f"{name}_{reference}"] = float(values.mean()) if values.size else np.nan
    return found
