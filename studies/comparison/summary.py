"""From the table of runs to what is compared: means over seeds with their confidence, and the same as JSON."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.metrics import METRICS
from alloc.metrics.registry import NEVER_NEGATIVE, UNLIMITED, range_of
from alloc.rules import RULES
from studies.core.drawn_events import COMPARED
from studies.core.job import DEGRADED, Job, check_controller
from studies.core.statement import CONFIDENCE, Interval, mean_limits
from studies.files.study_error import StudyError, unknown
from studies.scenario.scenario import Scenario, default_scenarios

Floats = NDArray[np.float64]

Cell = tuple[str, str, str]
CELL = ("scenario", "rule", "controller")
"""What a line is about."""
RULE_CALL_TIME = "rule_call_time"
"""Mean time of a call of a rule that is called from Python [ms]; follows from two metrics."""

REFERENCE = "alone"
"""Rule from which the differences of the others are counted, seed by seed."""
EFFORT = "bound_use"
"""What rules are ranked by: effort that counts, at each instant, up to the bound. By `effort_ratio`, whoever asks all units
for more than the plan would rank first."""
MOST_OVER = 0.01
"""Delivery beyond the plan, as a share of it, above which a rule is marked and not named the best: whoever asks for more has
torque in hand wherever the rail recovers, and the driver gets what he did not ask for."""


@displayed
@dataclass(frozen=True)
class SummaryLine:
    """One scenario under one rule and one controller, over all its seeds."""

    scenario: str
    rule: str
    controller: str
    seeds: int
    failed: int
    degraded: int
    """Runs in which rule or controller failed too often to count (`studies.core.job`)."""
    reasons: tuple[str, ...]
    metrics: dict[str, Interval]
    """Of the runs that are ok."""
    differences: dict[str, Interval]
    """Metric of this rule less that of `REFERENCE` under the same controller, paired by seed; empty without pairs."""

    @property
    def over(self) -> float:
        """Mean delivery beyond the plan, as a share of it; nan where it is not known."""
        return self.metrics.get("over_delivery", NO_MEAN).value

    @property
    def left_out(self) -> int:
        """Runs whose numbers do not enter."""
        return self.failed + self.degraded


NO_MEAN = Interval(math.nan, math.nan, math.nan, 0)
"""What there is where no run has a number."""


def means_of(values: Floats, within: Sequence[tuple[float, float]]) -> list[Interval]:
    """Means of the columns of `values` (runs, metrics) with their confidence intervals; `within`: the columns' ranges.

    Runs where a metric does not apply (nan) are left out. Columns known in the same runs are done together, and share their
    resamples.
    """
    known = ~np.isnan(values)
    found = [NO_MEAN] * values.shape[1]
    groups: dict[bytes, list[int]] = {}
    for k, some in enumerate(known.T):
        groups.setdefault(some.tobytes(), []).append(k)
    for mine in groups.values():
        some = known[:, mine[0]]
        if not some.any():
            continue
        columns = np.ascontiguousarray(values[np.ix_(some, np.array(mine))].T)
        limits = (one.tolist() for one in mean_limits(columns, CONFIDENCE))
        for k, value, low, high in zip(mine, *limits, strict=True):
            found[k] = Interval(value, low, high, columns.shape[1]).cut(within[k])
    return found


def plus_minus(mean: Interval, factor: float, digits: int) -> str:
    """The interval as text beside its mean: " ±1.2", or " +0.3/-1.2" where its sides differ.

    Empty for one seed, or where the event leaves nothing to chance.
    """
    if not mean.high > mean.low:
        return ""
    above, below = (
        f"{factor * side:.{digits}f}" for side in (mean.high - mean.value, mean.value - mean.low)
    )
    return f" ±{above}" if above == below else f" +{above}/-{below}"


def summarise(table: pd.DataFrame) -> list[SummaryLine]:
    """Lines in the table's own order of scenario, rule, controller."""
    names = [name for name in METRICS if name in table]
    numbers = table[names].to_numpy(dtype=float)
    if {"rule_time", "rule_calls"} <= set(names):
        # compiled rules take no time of their own that could be told from the simulation's
        time, calls = (numbers[:, names.index(name)] for name in ("rule_time", "rule_calls"))
        asked = (time > 0.0) & (calls > 0.0)
        share = np.divide(time, calls, out=np.full_like(time, math.nan), where=asked)
        numbers, names = np.column_stack([numbers, share]), [*names, RULE_CALL_TIME]
    status, seeds = table["status"].to_numpy(dtype=object), table["seed"].tolist()
    reasons = table["reason"].to_numpy(dtype=object)
    ranges = [NEVER_NEGATIVE if name == RULE_CALL_TIME else range_of(name) for name in names]
    rows: dict[Cell, list[int]] = {}
    for k, cell in enumerate(zip(*(table[name] for name in CELL), strict=True)):
        rows.setdefault(cell, []).append(k)
    good = {cell: [k for k in some if status[k] == "ok"] for cell, some in rows.items()}
    lines = []
    for cell, mine in rows.items():
        scenario, rule, controller = cell
        bad = [k for k in mine if status[k] != "ok"]
        degraded = sum(status[k] == DEGRADED for k in bad)
        other = {seeds[k]: numbers[k] for k in good.get((scenario, REFERENCE, controller), [])}
        pairs = [numbers[k] - other[seeds[k]] for k in good[cell] if seeds[k] in other]
        lines.append(
            SummaryLine(
                *cell,
                len(mine),
                len(bad) - degraded,
                degraded,
                tuple(dict.fromkeys(reasons[bad])),
                _means(names, numbers[good[cell]], ranges),
                {} if rule == REFERENCE or not pairs else _differences(names, np.array(pairs)),
            )
        )
    return lines


def _means(
    names: Sequence[str], values: Floats, within: Sequence[tuple[float, float]]
) -> dict[str, Interval]:
    return dict(zip(names, means_of(values, within), strict=True))


def _differences(names: Sequence[str], pairs: Floats) -> dict[str, Interval]:
    """Means of what a rule has more than the reference, by metric; the time of a call is no metric."""
    found = _means(names, pairs, [UNLIMITED] * len(names))
    found.pop(RULE_CALL_TIME, None)
    return found


def to_json(lines: list[SummaryLine], about: dict[str, Any]) -> str:
    """The same lines with every metric; nan becomes null. `about` says what the comparison was."""
    content = {
        "about": about,
        "metrics": {
            **{m.name: {"unit": m.unit, "description": m.description} for m in METRICS.values()},
            RULE_CALL_TIME: {"unit": "ms", "description": "mean time of a call of the rule"},
        },
        "confidence": CONFIDENCE,
        "reference": REFERENCE,
        "rows": [
            {
                "scenario": line.scenario,
                "rule": line.rule,
                "controller": line.controller,
                "seeds": line.seeds,
                "failed": line.failed,
                "degraded": line.degraded,
                "reasons": list(line.reasons),
                "metrics": _numbers(line.metrics),
                "differences": _numbers(line.differences),
            }
            for line in lines
        ],
    }
    return json.dumps(content, indent=2, allow_nan=False)


def _numbers(means: dict[str, Interval]) -> dict[str, dict[str, float | None]]:
    return {
        name: {"mean": _number(m.value), "low": _number(m.low), "high": _number(m.high)}
        for name, m in means.items()
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


# The grid scenario x rule x controller x seed of a comparison.


@displayed
@dataclass(frozen=True)
class Grid:
    """What a comparison consists of: the product of its parts over `seeds`, and slow controllers on the first of them."""

    scenarios: tuple[Scenario, ...]
    rules: tuple[str, ...]
    controllers: tuple[str, ...]
    seeds: tuple[int, ...]
    once: tuple[str, ...] = ()
    """Controllers that meet every scenario under every rule too, but on the first seed alone."""
    fixed: frozenset[str] = frozenset()
    """Scenarios that meet the first seed alone, for every other would be the same event."""

    def jobs(self) -> list[Job]:
        """Every cell once: by scenario, then rule, controller, seed."""
        jobs = [
            Job(scenario, rule, controller, seed)
            for scenario in dict.fromkeys(self.scenarios)
            for rule in self.rules
            for controller in dict.fromkeys((*self.controllers, *self.once))
            for seed in self._seeds(scenario.name, controller)
        ]
        names = {job.scenario.name: job.scenario for job in jobs}
        for job in jobs:
            if names[job.scenario.name] != job.scenario:
                raise StudyError(
                    f"two different scenarios are named {job.scenario.name!r}; rename one of the files"
                )
        order = {name: k for k, name in enumerate(names)}
        rules = {rule: k for k, rule in enumerate(dict.fromkeys(job.rule for job in jobs))}
        return sorted(jobs, key=lambda job: (order[job.scenario.name], rules[job.rule]))

    def _seeds(self, scenario: str, controller: str) -> tuple[int, ...]:
        """Seeds that this scenario meets under this controller."""
        alone = scenario in self.fixed or controller not in self.controllers
        return self.seeds[:1] if alone else self.seeds


# The default grid of `readhesion compare`.

DEFAULT_SEEDS = 5
"""Seeds of every event in which something is drawn; the first, 0, is the event as its file states it."""
LEFT_OUT = ("plan-times", "qp-daqp", "qp-cvxpy", "qp-robust", "wear-qp", "wear-cvxpy", "preview")
"""Rules left out unless asked for. The first shows what a ranking must not fall for; `preview` is told what no train knows.
The others repeat `qp` or `wear`. Those of cvxpy take milliseconds a call. The answer of `qp-robust` differs only where the
train believes in deviations of its caps, which no shipped scenario does."""
SLOW_CONTROLLER = "mpc"
"""What joins in where nothing is said about controllers, on the first seed alone: it takes tens of times as long as what is
compiled into the loop."""
KEPT_RUNS = ("wet-patch/alone/*/0", "wet-patch/exact/*/0", "wet-patch/cooperative/*/0")
"""Runs that a comparison records as netCDF."""


def default_rules() -> tuple[str, ...]:
    """Every rule but those left out."""
    return tuple(name for name in RULES if name not in LEFT_OUT)


def check_names(rules: Sequence[str], controllers: Sequence[str]) -> None:
    """Raise `StudyError` for an unknown rule or controller, or a controller that needs what is not installed."""
    for rule in rules:
        if rule not in RULES:
            raise unknown("rule", rule, RULES)
    for controller in controllers:
        check_controller(controller)


def make_grid(
    scenarios: Sequence[Scenario],
    rules: Sequence[str] | None,
    controllers: Sequence[str] | None,
    seeds: int | None,
) -> Grid:
    """The grid for these parts; None represents the default.

    Where no controllers are named, the MPC is added under every rule, on the first seed of every event. Raises `StudyError`
    where several seeds are asked for and a scenario leaves nothing to them.
    """
    if seeds is not None and seeds < 1:
        raise StudyError(f"--seeds {seeds}: give the number of seeds, 1 or more")
    count = DEFAULT_SEEDS if seeds is None else seeds
    fixed = [one.name for one in scenarios if count > 1 and not one.draws()]
    if seeds is not None and fixed:
        raise StudyError(
            f"--seeds {seeds}: nothing in scenario {fixed[0]!r} depends on the seed, all its rows would be equal; "
            "give it a table [variation], or leave --seeds out"
        )
    chosen = tuple(dict.fromkeys(default_rules() if rules is None else rules))
    built_in = tuple(dict.fromkeys(COMPARED if controllers is None else controllers))
    check_names(chosen, built_in)
    once = (SLOW_CONTROLLER,) if controllers is None else ()
    check_names(chosen, once)
    return Grid(
        tuple(scenarios), chosen, built_in, tuple(range(count)), once, frozenset(fixed),
    )  # fmt: skip


def default_grid() -> Grid:
    """The grid of `readhesion compare` without options."""
    return make_grid(default_scenarios(), None, None, None)
