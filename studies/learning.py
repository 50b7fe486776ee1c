"""JP5484215: growth of adhesion along the train, from counts of slides (12) to (15), and learnt on the way (16), (17).

In embodiment 2 every unit tells the leader the coefficient at its slips; less the leader's own one it is a datum of the
unit's increment. Increments change "after several stations", so between runs: what the leader was told stands in the record
of a run, and learning needs no code on board. Here trains begin with increments of zero or twice the true ones, on an even
and on a scattered rail. The rule is asked at slips alone, as printed, because there (5) decides every cap.
"""

from collections.abc import Iterable
from dataclasses import replace
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import norm

from alloc.evaluation.metrics import METRICS
from alloc.laws import speed_law
from alloc.plant.rail import SPEED_LAWS, logarithmic_increments
from alloc.plant.rows import rows_of_train
from alloc.rules import RULES
from alloc.run.event import Event
from alloc.run.simulation import simulate
from studies.files.scenario import Scenario
from studies.files.scenario_files import load_scenario
from studies.runner.study import WIDE, Cell, Row, Study, StudyError
from studies.standing import Statistic
from studies.statistics import Claim, Statement, judge

Floats = NDArray[np.float64]
Counts = NDArray[np.int64]

# From slides per axle to increments.

SIGMA, LEAD = 0.012, 4
"""Standard deviation of measured coefficients about the planned one, par. 0054; axles of the lead car, whose mean counts."""


def plan_at(speed: Floats) -> Floats:
    """Coefficient that an automatic brake asks for at `speed` [m/s], (12)."""
    return np.asarray(speed_law(speed, *SPEED_LAWS["shinkansen"]))


def draw_counts(axles: int, brakings: int, seed: int = 0) -> Counts:
    """Slides per axle over some brakings, drawn from (14) and (15), (axles,); the counts of Fig. 11 are lost."""
    often = norm.cdf(-logarithmic_increments(axles) / SIGMA)
    return np.random.default_rng(seed).poisson(brakings * often)


def axle_shifts(slides: Counts) -> tuple[Floats, Floats]:
    """k_j sigma of each axle from its slides, (13) and (14), and its covariance due to counting; (axles,), (axles, axles).

    Counts are Poisson; the covariance is linearised and has the error of the lead car's mean, which all axles share. nan for
    axles without a slide, or with twice the lead car's mean.
    """
    count, lead = slides.astype(float), np.arange(slides.size) < LEAD
    average = count[lead].mean()
    if average == 0.0:
        raise StudyError("slides: the lead car never slid, so there is no reference")
    ratio = count / (2.0 * average)
    usable = (ratio > 0.0) & (ratio < 1.0)
    k = np.where(usable, -norm.ppf(np.where(usable, ratio, 0.5)), np.nan)
    change = np.diag(1.0 / np.where(usable, count, 1.0)) - lead / (LEAD * average)
    jacobian = -SIGMA * (ratio / norm.pdf(k))[:, None] * change
    return SIGMA * k, jacobian * count @ jacobian.T


def fit_slope(shift: Floats, covariance: Floats) -> tuple[float, float]:
    """Slope of k_j sigma over ln j and its standard error; axles count by their errors, the lead car's mean is 0, (15)."""
    usable = np.flatnonzero(np.isfinite(shift))
    if usable.size < 3:
        raise StudyError(f"slides: {usable.size} axles with a usable count; a line needs 3")
    log, weight = np.log(usable + 1.0), 1.0 / np.diag(covariance)[usable]
    centred = log - np.average(log, weights=weight)
    gain = weight * centred / (weight @ centred**2)
    variance = gain @ covariance[np.ix_(usable, usable)] @ gain
    return float(gain @ shift[usable]), float(np.sqrt(variance))


def unit_increments(per_axle: Floats, axle_unit: NDArray[np.int64]) -> Floats:
    """Mean over a unit's axles less that of the foremost unit, (units,); `axle_unit` (axles,) is -1 for axles of none."""
    means = np.array([per_axle[axle_unit == j].mean() for j in range(int(axle_unit.max()) + 1)])
    return means - means[0]


# Learning from recorded runs.

FIRST, FURTHER = 10, 5
"""N_min and N_arg: new data for the first update of a unit, and for later ones. The source prints no numbers."""
ORIGINAL, DEVIATION = 10.0, 0.010
"""N_z, number of data behind the increments stored at first; their standard deviation, half of the largest one. Assumed."""


class Arm(NamedTuple):
    """How a train learns. By (16), (17), or a Gaussian posterior after each datum; "none" and "truth" keep what is stored.

    `held`: data are relative to the leader's own last slip, not to its coefficient at their receipt (par. 0064). `grows`:
    N_z counts data that were learnt, not the original ones alone (par. 0067).
    """

    learner: Literal["none", "truth", "mean", "gaussian"]
    held: bool = False
    grows: bool = False


ARMS = {
    "none": Arm("none"),
    "truth": Arm("truth"),
    "mean": Arm("mean"),
    "mean_growing": Arm("mean", grows=True),
    "mean_held": Arm("mean", held=True, grows=True),
    "gaussian_held": Arm("gaussian", held=True),
}
LEARNING = [name for name, arm in ARMS.items() if arm.learner not in ("none", "truth")]


class Stored:
    """What the leader has stored of each unit: its increment, the data behind it and those that wait."""

    def __init__(self, increment: Floats) -> None:
        n = increment.size
        self.increment, self.deviation = increment.copy(), np.full(n, DEVIATION)
        self.behind, self.updates = np.full(n, ORIGINAL), np.zeros(n, dtype=int)
        self.waiting: list[list[float]] = [[] for _ in range(n)]

    def learn(self, arm: Arm, data: Iterable[tuple[int, float]]) -> None:
        """Take data of units."""
        for j, datum in data:
            if arm.learner == "mean":
                self.waiting[j].append(datum)
            elif arm.learner == "gaussian":
                gain = self.deviation[j] ** 2 / (self.deviation[j] ** 2 + SIGMA**2)
                self.increment[j] += gain * (datum - self.increment[j])
                self.deviation[j] *= np.sqrt(1.0 - gain)
        for j, new in enumerate(self.waiting):
            n, old = len(new), self.behind[j]
            if n >= (FURTHER if self.updates[j] else FIRST):
                average = sum(new) / n  # (16)
                self.increment[j] = (self.increment[j] * old + average * n) / (old + n)  # (17)
                self.behind[j] += n * arm.grows
                self.updates[j] += 1
                new.clear()


def collect_data(run: xr.Dataset, event: Event, held: bool) -> list[tuple[int, float]]:
    """Unit and datum of each slip behind the leader in a `run`, in the order of their receipt.

    The train is sound and its telegrams arrive: a slip is told in the next one. `held`: see `Arm`; the leader's last slip
    counts for its hold time.
    """
    time, estimate = run["time"].values, run["coefficient_estimate"].values
    telegrams, hold = event.onboard.telegrams, event.onboard.hold_time
    slips = np.argwhere(np.diff(run["slipping"].values, axis=0, prepend=0) > 0)
    leader, received = slips[slips[:, 1] == 0, 0], list[tuple[int, int, float]]()
    for at, unit in slips[slips[:, 1] > 0]:
        after = np.ceil(time[at] / telegrams.period - 1e-6)
        receipt = after * telegrams.period + telegrams.latency
        k = round(float(receipt / (time[1] - time[0])))
        before = leader[leader <= k]
        if k >= time.size or (held and not (before.size and receipt - time[before[-1]] <= hold)):
            continue
        reference = estimate[before[-1] if held else k, 0]
        received.append((k, int(unit), float(estimate[at, unit] - reference)))
    return [(unit, datum) for _, unit, datum in sorted(received)]


# The study: an event is a train in one running direction, which starts at every station of a line.

STATIONS, DURATION = 24, 12.0
"""Number of starts, and their length [s]."""
LEVEL, HALF_WIDTH = 0.128, 0.0147
"""Adhesion coefficient of the rail, uniform over stations: below 0.147, so that the foremost unit slips at every start, on
both sides of the level at which the train as a whole reaches the plan."""
RAILS = {"even": 0.0, "scattered": 0.0085}
"""Scatter along the rail, assumed half of the variance of `SIGMA`; the level has the other half."""
AT_FIRST = {"too low": 0.0, "too high": 2.0}
"""Increments stored at first over the true ones."""
Kind = tuple[str, str]
KINDS: tuple[Kind, ...] = tuple(product(RAILS, AT_FIRST))
TOLERANCE, LITTLE = 0.002, 0.01
"""Largest error of a unit with which increments count as learnt, a tenth of the largest one; share of the plan's effort that
is little."""
METRIC_NAMES = ("effort_ratio", "slip_time", "damage")

RULE, CONTROLLER = RULES["exact"].with_belief("any detected"), "cut-and-ramp"


def make_start(base: Scenario, kind: Kind, event: int, station: int, seed: int) -> Event:
    """A start at a station, the same in every arm; trains run forward in even events, backward in odd ones."""
    train, backward = divmod(event, 2)
    numbers = (seed, train, KINDS.index(kind), backward, station)
    event_seed, level_seed = np.random.SeedSequence(numbers).generate_state(2).tolist()
    level = LEVEL + HALF_WIDTH * float(np.random.default_rng(level_seed).uniform(-1.0, 1.0))
    rail = base.rail.model_dump() | {"level": level, "scatter": RAILS[kind[0]]}
    how = {"variation": None, "duration_s": DURATION, "reversed": backward == 1}
    return base.changed(rail=rail, **how).event(event_seed)


def run(base: Scenario, kind: Kind, arm: str, event: int, seed: int, stations: int) -> list[Row]:
    """All starts of an event; `base` is the scenario of a start on a wet rail."""
    learning, rows, stored = ARMS[arm], list[Row](), None
    for station in range(1, stations + 1):
        start = make_start(base, kind, event, station, seed)
        truth = unit_increments(
            np.array(start.rail.increments), rows_of_train(start.train).wheelsets.unit
        )
        if stored is None:
            stored = Stored((1.0 if learning.learner == "truth" else AT_FIRST[kind[1]]) * truth)
        belief = replace(start.onboard.belief, unit_increments=tuple(stored.increment.tolist()))
        recording = simulate(
            replace(start, onboard=replace(start.onboard, belief=belief)), RULE, CONTROLLER
        )
        kinds = ("received", "held")
        data = {name: collect_data(recording, start, name == "held") for name in kinds}
        stored.learn(learning, data["held" if learning.held else "received"])
        row: Row = {"station": station, "error": float(np.abs(stored.increment - truth)[1:].max())}
        for name, received in data.items():
            row[f"data_{name}"] = len(received)
            row[f"above_{name}"] = float(sum(datum - truth[j] for j, datum in received))
        rows.append(row | {name: float(METRICS[name].function(recording)) for name in METRIC_NAMES})
    return rows


def cells(events: int, seed: int) -> list[Cell]:
    """Every event on each kind of rail and with each kind of stored increments, in every arm."""
    base, cells = load_scenario("wet-start"), []
    for event, kind, arm in product(range(events), KINDS, ARMS):
        columns = {"rail": kind[0], "at_first": kind[1], "arm": arm, "event": event}
        name = f"{kind[0]}/{kind[1]}/{arm}/{event}"
        cells.append(Cell(name, (base, kind, arm, event, seed, STATIONS), columns))
    return cells


def spread_arms(rows: pd.DataFrame) -> pd.DataFrame:
    """A row per kind and event, with a column NAME_ARM for each number.

    These are: error after the last station; station from which it stays within `TOLERANCE`, nan for never; mean excess of
    data over the truth; and of the second half of the stations mean effort over the plan's, slip time [axle s], damage [kJ].
    """
    rows = rows[rows["status"] == "ok"].sort_values("station")
    keys, last = ["rail", "at_first", "event", "arm"], rows["station"].max()
    means = rows[rows["station"] > last // 2].groupby(keys)[list(METRIC_NAMES)].mean()
    groups = rows.groupby(keys)
    means["error"] = groups["error"].last()
    outside = rows[rows["error"] > TOLERANCE].groupby(keys)["station"].max()
    until = outside.reindex(means.index).fillna(0.0) + 1.0
    means["stations"] = until.where(until <= last)
    for reference in ("received", "held"):
        number = groups[f"data_{reference}"].sum()
        means[f"excess_{reference}"] = groups[f"above_{reference}"].sum() / number.where(number > 0)
    wide = means.unstack("arm")
    wide.columns = [f"{name}_{arm}" for name, arm in wide.columns]
    return wide.reset_index()


def statements(rows: pd.DataFrame) -> list[Statement]:
    """Verdicts as one family, and by kind."""
    by = spread_arms(rows)
    rail, first = by["rail"], by["at_first"]
    parts = {f"{a} rail, stored {b}": (rail == a) & (first == b) for a, b in KINDS}
    claims, stays = [], f"errors stay below {TOLERANCE} in most events"
    for arm in LEARNING:
        error, until = by[f"error_{arm}"], by[f"stations_{arm}"]
        effort, label = by[f"effort_ratio_{arm}"], arm.replace("_", ", ")
        gained, lost = effort - by["effort_ratio_none"], effort - by["effort_ratio_truth"]
        for name, text, values, least, digits in (
            ("learnt", stays, until.notna() * 1.0, 0.5, 2),
            ("closer", "errors are smaller than at first", by["error_none"] - error, 0.0, 4),
            ("effort", "learning gains effort over the plan's", gained, 0.0, 4),
            ("as good", "true increments would gain little more", lost, -LITTLE, 4),
        ):
            claims.append(Claim(f"{label}: {name}", text, values, least, digits=digits))
    for name in ("received", "held"):
        text = "data lie about the truth where true increments are stored"
        values = by[f"excess_{name}_truth"]
        claims.append(Claim(f"unbiased: {name}", text, values, -TOLERANCE, TOLERANCE, digits=4))
    return judge([claim._replace(parts=parts) for claim in claims])


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """By kind and arm: means over events and their 95 % intervals of the numbers of `spread_arms`."""
    series, lines = spread_arms(rows), []
    for (rail, first), arm in product(KINDS, ARMS):
        numbers = series[(series["rail"] == rail) & (series["at_first"] == first)]
        reference = "held" if ARMS[arm].held else "received"
        columns = {
            "largest error": Statistic(f"error_{arm}", 4),
            "stations until learnt": Statistic(f"stations_{arm}"),
            "data above truth": Statistic(f"excess_{reference}_{arm}", 4),
            "effort [% of plan]": Statistic(f"effort_ratio_{arm}", 2, 100.0),
            "slip time [axle s]": Statistic(f"slip_time_{arm}", 2),
        }
        line = {"rail": rail, "stored": first, "learning": arm.replace("_", ", ")}
        lines.append(line | {name: column.text(numbers) for name, column in columns.items()})
    return pd.DataFrame(lines)


def figure(rows: pd.DataFrame) -> Figure:
    """The error that learning leaves of increments that were stored too high."""
    drawn = Figure(figsize=(WIDE, 2.2), layout="constrained")
    high = rows[(rows["status"] == "ok") & (rows["at_first"] == "too high")]
    panels = drawn.subplots(1, 2, sharey=True)
    for axes, rail in zip(panels, RAILS, strict=True):
        for arm in LEARNING:
            errors = high[(high["rail"] == rail) & (high["arm"] == arm)]
            axes.plot(errors.groupby("station")["error"].mean(), label=arm.replace("_", ", "))
        axes.set(xlabel="station", title=f"{rail} rail", ylim=(0.0, None))
    panels[0].set_ylabel("largest error [1]")
    panels[1].legend()
    return drawn


QUESTION = "How fast does a train learn increments of adhesion that are wrong at first, and what does it gain?"
STUDY = Study("learning", QUESTION, cells, run, table, figure, statements, events=10, seed=77)
