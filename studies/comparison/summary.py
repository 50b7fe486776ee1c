"""From the table of runs to what is compared: means over seeds with their confidence, and the same as JSON."""

import json
import math
from dataclasses import dataclass
from typing import Any

import pandas as pd
from scipy.stats import t as student

from alloc.metrics import METRICS

RULE_CALL_TIME = "rule_call_time"
"""Mean time of a call of a rule that is called from Python [ms]; follows from two metrics."""

CONFIDENCE = 0.95
"""Level of the confidence interval of a mean over seeds."""


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
    reasons: tuple[str, ...]
    metrics: dict[str, Mean]


def mean_of(values: "pd.Series[float]") -> Mean:
    """Mean with its confidence interval by Student's t; runs where the metric does not apply (nan) are left out."""
    known = values.dropna().astype(float)
    n = len(known)
    if n == 0:
        return Mean(math.nan, math.nan, 0)
    if n == 1:
        return Mean(float(known.iloc[0]), math.nan, 1)
    quantile = float(student.ppf(0.5 + 0.5 * CONFIDENCE, n - 1))
    return Mean(float(known.mean()), quantile * float(known.std(ddof=1)) / math.sqrt(n), n)


def summarise(table: pd.DataFrame) -> list[Line]:
    """Lines in the table's own order of scenario, rule, controller."""
    lines = []
    for (scenario, rule, controller), rows in table.groupby(
        ["scenario", "rule", "controller"], sort=False
    ):
        good = rows[rows["status"] == "ok"]
        bad = rows[rows["status"] != "ok"]
        metrics = {name: mean_of(good[name]) for name in METRICS if name in good}
        if {"rule_time", "rule_calls"} <= set(good):
            # compiled rules take no time of their own that could be told from the simulation's
            time, calls = good["rule_time"], good["rule_calls"]
            metrics[RULE_CALL_TIME] = mean_of((time / calls)[(time > 0.0) & (calls > 0.0)])
        reasons = tuple(dict.fromkeys(bad["reason"]))
        lines.append(
            Line(str(scenario), str(rule), str(controller), len(rows), len(bad), reasons, metrics)
        )
    return lines


def to_json(lines: list[Line], about: dict[str, Any]) -> str:
    """The same lines with every metric; nan becomes null. `about` says what the comparison was."""
    content = {
        "about": about,
        "metrics": {
            **{m.name: {"unit": m.unit, "description": m.description} for m in METRICS.values()},
            RULE_CALL_TIME: {"unit": "ms", "description": "mean time of a call of the rule"},
        },
        "confidence": CONFIDENCE,
        "rows": [
            {
                "scenario": line.scenario,
                "rule": line.rule,
                "controller": line.controller,
                "seeds": line.seeds,
                "failed": line.failed,
                "reasons": list(line.reasons),
                "metrics": {
                    name: {"mean": _number(m.value), "half_width": _number(m.half_width)}
                    for name, m in line.metrics.items()
                },
            }
            for line in lines
        ],
    }
    return json.dumps(content, indent=2, allow_nan=False)


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
