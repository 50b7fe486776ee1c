"""From the table of runs to what is compared: means over seeds with their confidence, and the same as JSON."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from alloc.metrics import METRICS
from studies.core.run_status import DEGRADED
from studies.core.statement import CONFIDENCE, mean_interval

RULE_CALL_TIME = "rule_call_time"
"""Mean time of a call of a rule that is called from Python [ms]; follows from two metrics."""

REFERENCE = "alone"
"""Rule from which the differences of the others are counted, seed by seed."""


@dataclass(frozen=True)
class Mean:
    """Mean over seeds and half-width of its confidence interval (nan for one seed)."""

    value: float
    half_width: float
    count: int


@dataclass(frozen=True)
class Line:
    """One scenario under one rule and one controller, over all its seeds."""

    scenario: str
    rule: str
    controller: str
    seeds: int
    failed: int
    degraded: int
    """Runs in which rule or controller failed too often to count (`studies.core.run_status`)."""
    reasons: tuple[str, ...]
    metrics: dict[str, Mean]
    """Of the runs that are ok."""
    differences: dict[str, Mean]
    """Metric of this rule less that of `REFERENCE` under the same controller, paired by seed; empty without pairs."""

    @property
    def left_out(self) -> int:
        """Runs whose numbers do not enter."""
        return self.failed + self.degraded


def mean_of(values: "pd.Series[float]") -> Mean:
    """Mean with its confidence interval by Student's t; runs where the metric does not apply (nan) are left out."""
    found = mean_interval(values)
    return Mean(found.value, 0.5 * (found.high - found.low), found.count)


def summarise(table: pd.DataFrame) -> list[Line]:
    """Lines in the table's own order of scenario, rule, controller."""
    lines = []
    names = [name for name in METRICS if name in table]
    every = table[table["status"] == "ok"]
    reference = every[every["rule"] == REFERENCE]
    for (scenario, rule, controller), rows in table.groupby(
        ["scenario", "rule", "controller"], sort=False
    ):
        good = rows[rows["status"] == "ok"]
        bad = rows[rows["status"] != "ok"]
        metrics = {name: mean_of(good[name]) for name in names}
        if {"rule_time", "rule_calls"} <= set(good):
            # compiled rules take no time of their own that could be told from the simulation's
            time, calls = good["rule_time"], good["rule_calls"]
            metrics[RULE_CALL_TIME] = mean_of((time / calls)[(time > 0.0) & (calls > 0.0)])
        other = reference[
            (reference["scenario"] == scenario) & (reference["controller"] == controller)
        ]
        reasons = tuple(dict.fromkeys(bad["reason"]))
        degraded = int((bad["status"] == DEGRADED).sum())
        between = {} if rule == REFERENCE else _differences(good, other, names)
        counts = (len(rows), len(bad) - degraded, degraded)
        lines.append(
            Line(str(scenario), str(rule), str(controller), *counts, reasons, metrics, between)
        )
    return lines


def _differences(good: pd.DataFrame, other: pd.DataFrame, names: Sequence[str]) -> dict[str, Mean]:
    """Mean of `good` less `other` over the seeds that both have, by metric."""
    one, two = (rows.set_index("seed")[names].astype(float) for rows in (good, other))
    seeds = one.index.intersection(two.index)
    between = one.loc[seeds] - two.loc[seeds]
    return {name: mean_of(between[name]) for name in names} if len(seeds) else {}


def to_json(lines: list[Line], about: dict[str, Any]) -> str:
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


def _numbers(means: dict[str, Mean]) -> dict[str, dict[str, float | None]]:
    return {
        name: {"mean": _number(m.value), "half_width": _number(m.half_width)}
        for name, m in means.items()
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
