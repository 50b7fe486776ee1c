"""The answer of a comparison: every rule under every controller over all events at once, as table, sentence and file."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.table import Table

from alloc.metrics.registry import UNLIMITED, range_of
from alloc.rules import RULES
from studies.comparison.summary import EFFORT, MOST_OVER, NO_MEAN, REFERENCE, SummaryLine, means_of
from studies.comparison.table import COLUMNS, Column, as_text, minus
from studies.core.statement import LEAST_SHOWN, Interval

ALL = "all events"
"""In place of the scenario in a line over all of them."""
SHOWN = (EFFORT, "over_delivery", "damage", "slip_time", "jerk_rms")
"""Metrics of the table: capped effort, and what it costs."""
DIFFERENT = (EFFORT, "damage", "slip_time")
"""Those of which the difference from `REFERENCE` is shown."""


def pooled(lines: Sequence[SummaryLine]) -> list[SummaryLine]:
    """One line per controller and rule: means over the events of the means over seeds, and differences paired by event.

    Only events count that have runs that count under every rule of the controller. `seeds` is their number. Intervals say
    how much events differ; where there is one event they are those over its seeds. Rules are in the order of capped effort.
    """
    found = []
    for controller in dict.fromkeys(line.controller for line in lines):
        own = [line for line in lines if line.controller == controller]
        by_rule = {
            rule: {one.scenario: one for one in own if one.rule == rule}
            for rule in dict.fromkeys(line.rule for line in own)
        }
        common = shared_events(own)
        rows = [
            _over_events([some[name] for name in common]) for some in by_rule.values() if common
        ]
        found += sorted(rows, key=lambda one: -_value(one, EFFORT))
    return found


def shared_events(own: Sequence[SummaryLine]) -> list[str]:
    """Scenarios of a controller's lines that have runs that count under every rule of it."""
    rules = {line.rule for line in own}
    counts: dict[str, set[str]] = {}
    for line in own:
        counts.setdefault(line.scenario, set()).update([line.rule] * (line.seeds > line.left_out))
    return [scenario for scenario, some in counts.items() if some == rules]


def _over_events(some: Sequence[SummaryLine]) -> SummaryLine:
    first = some[0]
    if len(some) == 1:
        return replace(first, scenario=ALL, seeds=1)
    names = list(first.metrics)
    return replace(
        first, scenario=ALL, seeds=len(some), failed=0, degraded=0, reasons=(),
        metrics=_means([line.metrics for line in some], names, [range_of(n) if n in SHOWN else UNLIMITED for n in names]),
        differences=_means([line.differences for line in some], list(first.differences), None),
    )  # fmt: skip


def _means(
    some: Sequence[dict[str, Interval]],
    names: Sequence[str],
    within: list[tuple[float, float]] | None,
) -> dict[str, Interval]:
    if not names:
        return {}
    values = np.array([[one.get(name, NO_MEAN).value for name in names] for one in some])
    return dict(zip(names, means_of(values, within or [UNLIMITED] * len(names)), strict=True))


def _value(line: SummaryLine, metric: str) -> float:
    return line.metrics.get(metric, NO_MEAN).value


def is_marked(line: SummaryLine) -> bool:
    """Whether a rule delivers so much beyond the plan that its effort is no use of the bound."""
    return line.over > MOST_OVER


def _columns(lines: Sequence[SummaryLine]) -> list[Column]:
    known = {column.metric: column for column in COLUMNS}
    return [
        known[name] for name in SHOWN if any(not math.isnan(_value(line, name)) for line in lines)
    ]


def _cells(line: SummaryLine, columns: Sequence[Column]) -> list[str]:
    """Value of each metric, and what it is less that of `REFERENCE` with its interval."""
    cells = []
    for column in columns:
        digits = max(column.digits, 1)
        value, less = _value(line, column.metric), line.differences.get(column.metric, NO_MEAN)
        cells.append("–" if math.isnan(value) else f"{column.factor * value:.{digits}f}")
        if column.metric in DIFFERENT:
            digits += column.factor != 1.0
            mean, low, high = (
                f"{round(column.factor * one, digits) + 0.0:+.{digits}f}" for one in (less.value, less.low, less.high)
            )  # fmt: skip
            told = f" [{low}, {high}]" if less.count >= LEAST_SHOWN and less.high > less.low else ""
            cells.append(mean + told if less.count else "")
    return [minus(text) for text in cells]


def _row(line: SummaryLine, columns: Sequence[Column]) -> list[str]:
    return [line.rule + _mark(line), line.controller, str(line.seeds), *_cells(line, columns)]


def _headings(columns: Sequence[Column]) -> list[str]:
    less = f"less {REFERENCE}\n[95 %]"
    found = []
    for column in columns:
        found += [column.heading.replace("-\n", ""), *[less] * (column.metric in DIFFERENT)]
    return found


def pooled_table(lines: Sequence[SummaryLine]) -> Table:
    """The pooled lines for a terminal."""
    columns = _columns(lines)
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in ("rule", "controller"):
        table.add_column(heading, no_wrap=True)
    for heading in ("events", *_headings(columns)):
        table.add_column(heading, justify="right", no_wrap=True)
    for k, line in enumerate(lines):
        if k and line.controller != lines[k - 1].controller:
            table.add_section()
        table.add_row(*_row(line, columns))
    return table


def _mark(line: SummaryLine) -> str:
    return " *" if is_marked(line) else " °" if RULES[line.rule].needs_truth else ""


def notes(lines: Sequence[SummaryLine]) -> list[str]:
    """What the marks of the table mean."""
    said = {
        " *": f"* delivers more than {MOST_OVER:.0%} beyond the plan: what exceeds the plan is no use of the bound",
        " °": "° knows the rail, as nobody on board can",
    }
    return [text for mark, text in said.items() if any(_mark(line) == mark for line in lines)]


def frame(lines: Sequence[SummaryLine]) -> pd.DataFrame:
    """Lines as a table of numbers: every printed metric with its interval, and the same less `REFERENCE`."""
    rows = []
    for line in lines:
        row: dict[str, object] = {
            "scenario": line.scenario, "rule": line.rule, "controller": line.controller,
            "events" if line.scenario == ALL else "seeds": line.seeds, "left_out": line.left_out,
        }  # fmt: skip
        for name in (column.metric for column in COLUMNS):
            for suffix, some in (("", line.metrics), (f"_less_{REFERENCE}", line.differences)):
                mean = some.get(name, NO_MEAN)
                row |= {
                    f"{name}{suffix}{end}": one
                    for end, one in (("", mean.value), ("_low", mean.low), ("_high", mean.high))
                }
        rows.append(row)
    found = pd.DataFrame(rows)
    return found.dropna(axis="columns", how="all")


def printed(lines: Sequence[SummaryLine], kind: str) -> str:
    """The pooled table as text to paste: as `kind` csv, markdown or latex."""
    if kind == "csv":
        return frame(lines).to_csv(index=False, lineterminator="\n")
    columns = _columns(lines)
    head = ["rule", "controller", "events", *(" ".join(one.split()) for one in _headings(columns))]
    rows = [_row(line, columns) for line in lines]
    return as_text(kind, "ll" + "r" * (len(head) - 2), head, rows)
