"""From the table of runs to what is compared: means over seeds with their confidence, and the same as JSON."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.metrics import METRICS
from studies.core.run_status import DEGRADED
from studies.core.statement import CONFIDENCE, half_width

Floats = NDArray[np.float64]

Cell = tuple[str, str, str]
CELL = ("scenario", "rule", "controller")
"""What a line is about."""
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


def means_of(values: Floats) -> list[Mean]:
    """Means of the columns of `values` (runs, metrics) with their confidence intervals by Student's t.

    Runs where a metric does not apply (nan) are left out. All at once: a comparison has thousands of such columns.
    """
    columns = np.ascontiguousarray(values.T)
    known = ~np.isnan(columns)
    return [_mean(column[some]) for column, some in zip(columns, known, strict=True)]


def _mean(known: Floats) -> Mean:
    n = known.size
    if n < 2:
        return Mean(float(known[0]) if n else math.nan, math.nan, n)
    mean = float(known.sum()) / n
    rest = known - mean
    half = half_width(math.sqrt(float((rest * rest).sum()) / (n - 1)), n)
    return Mean(mean, 0.5 * ((mean + half) - (mean - half)), n)


def summarise(table: pd.DataFrame) -> list[Line]:
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
            Line(
                *cell,
                len(mine),
                len(bad) - degraded,
                degraded,
                tuple(dict.fromkeys(table["reason"].iloc[bad])),
                dict(zip(names, means_of(numbers[good[cell]]), strict=True)),
                {} if rule == REFERENCE or not pairs else _differences(names, np.array(pairs)),
            )
        )
    return lines


def _differences(names: Sequence[str], pairs: Floats) -> dict[str, Mean]:
    """Means of what a rule has more than the reference, by metric; the time of a call is no metric."""
    found = dict(zip(names, means_of(pairs), strict=True))
    found.pop(RULE_CALL_TIME, None)
    return found


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
