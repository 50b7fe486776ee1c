"""The table of a comparison as a page shows it: a row per event, rule and controller, with values and differences."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from alloc.metrics import METRICS
from studies.comparison.summary import NO_MEAN, RULE_CALL_TIME, SummaryLine, plus_minus
from studies.comparison.table import COLUMNS, Column, applies, tells
from studies.core.statement import Interval

ALWAYS = 1
"""Columns that a narrow terminal does without sooner than this are shown on demand."""
WAYS = {1: "more is better", -1: "less is better", 0: ""}


@dataclass(frozen=True)
class Heading:
    """A column as its reader sees it."""

    metric: str
    text: str
    """With line breaks where it may have them."""
    unit: str
    """Of the metric itself; the heading names the one it is shown in."""
    meaning: str
    better: str
    extra: bool
    """Shown on demand."""


@dataclass(frozen=True)
class TableCell:
    """A mean over seeds, as number in the metric's unit and as text in the heading's."""

    number: float | None
    text: str
    tint: str = ""
    """Of a difference whose interval excludes zero: "better", "worse" or, where neither is, "other"."""


@dataclass(frozen=True)
class TableRow:
    """A line of the comparison."""

    line: SummaryLine
    status: str
    """What became of runs that do not count; empty where all count."""
    values: tuple[TableCell, ...]
    differences: tuple[TableCell, ...]


NO_CELL = TableCell(None, "–")


def shown_columns(lines: Sequence[SummaryLine]) -> list[Column]:
    """Columns that apply to any line."""
    return [column for column in COLUMNS if any(tells(line, column) for line in lines)]


def headings(columns: Sequence[Column]) -> list[Heading]:
    """What stands above the columns."""
    return [_heading(column) for column in columns]


def _heading(column: Column) -> Heading:
    text = column.heading.replace("-\n", "")
    extra = column.spare > ALWAYS
    if column.metric == RULE_CALL_TIME:
        return Heading(column.metric, text, "ms", "mean time of a call of the rule", "", extra)
    found = METRICS[column.metric]
    unit = "" if found.unit == "1" else found.unit
    return Heading(column.metric, text, unit, found.description, WAYS[found.better], extra)


def table_rows(lines: Sequence[SummaryLine], columns: Sequence[Column]) -> list[TableRow]:
    """The rows, in the order of `lines`."""
    return [
        TableRow(
            line, status_of(line),
            tuple(_value(line, column) for column in columns),
            tuple(_difference(line, column) for column in columns),
        )
        for line in lines
    ]  # fmt: skip


def status_of(line: SummaryLine) -> str:
    """What became of a line's runs, in words; empty where all count."""
    counts = ((line.failed, "failed"), (line.degraded, "degraded"))
    return ", ".join(f"{count} of {line.seeds} {word}" for count, word in counts if count)


def _value(line: SummaryLine, column: Column) -> TableCell:
    if not applies(line, column):
        return NO_CELL
    mean = line.metrics[column.metric]
    text = f"{round(column.factor * mean.value, column.digits) + 0.0:.{column.digits}f}"
    return TableCell(mean.value, text + plus_minus(mean, column.factor, column.digits))


def _difference(line: SummaryLine, column: Column) -> TableCell:
    mean = line.differences.get(column.metric, NO_MEAN)
    if mean.count == 0 or not math.isfinite(mean.value):
        return NO_CELL
    digits = column.digits + (column.factor != 1.0)  # points of a per cent are worth a digit more
    text = f"{round(column.factor * mean.value, digits) + 0.0:+.{digits}f}"  # no minus zero
    text += plus_minus(mean, column.factor, digits)
    return TableCell(mean.value, text, _tint(column.metric, mean))


def _tint(metric: str, mean: Interval) -> str:
    if not (mean.low > 0.0 or mean.high < 0.0):
        return ""
    way = METRICS[metric].better * math.copysign(1, mean.value)
    return {1: "better", -1: "worse"}.get(int(way), "other")
