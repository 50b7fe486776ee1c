"""The printed tables of a comparison: one per scenario, as many columns as the terminal is wide."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from studies.comparison.summary import (
    EFFORT,
    MOST_OVER,
    NO_MEAN,
    REFERENCE,
    RULE_CALL_TIME,
    SummaryLine,
    plus_minus,
)


@dataclass(frozen=True)
class Column:
    """A column: metric, heading, factor to the heading's unit, digits, and how soon a narrow terminal does without it."""

    metric: str
    heading: str
    factor: float = 1.0
    digits: int = 1
    spare: int = 0
    """0: always shown; otherwise the largest goes first."""
    counts: bool = False
    """A count of faults: left out where none of a scenario's lines has any."""


COLUMNS = (
    Column("acceleration_ratio", "accel.\n% plan", 100.0),
    Column("effort_ratio", "effort\n% plan", 100.0),
    Column("bound_use", "% of\nbound", 100.0),
    Column("headroom", "head-\nroom %", 100.0, 2, spare=3),
    Column("over_delivery", "over\nplan %", 100.0, 2),
    Column("utilisation", "adhesion\nused %", 100.0),
    Column("time_to_speed", "time to\nspeed s", spare=2),
    Column("slip_time", "slip\naxle s"),
    Column("damage", "damage\nQ kJ", 1.0, 0),
    Column("excess_damage", "excess\nof Q %", 100.0, spare=3),
    Column("jerk_rms", "jerk rms\nm/s³", 1.0, 2, spare=1),
    Column("jerk_peak", "jerk pk\nm/s³", 1.0, 2, spare=4),
    Column("coupler_peak", "coupler\nkN", 1.0, 0, spare=3),
    Column("fallbacks", "fall-\nbacks", 1.0, 0, spare=2, counts=True),
    Column("blinded", "units\nblinded", 1.0, 0, spare=2, counts=True),
    Column("telegrams_lost", "lost\ntelegr.", 1.0, 0, spare=2, counts=True),
    Column("energy", "energy\nMJ", 1.0, 1, spare=6),
    Column("detections", "detec-\ntions", 1.0, 0, spare=5),
    Column("telegrams", "tele-\ngrams", 1.0, 0, spare=9),
    Column(RULE_CALL_TIME, "rule\nms/call", 1.0, 2, spare=7),
    Column("controller_median", "control\nms/step", 1.0, 2, spare=8),
)
"""Printed columns, from left to right; the JSON and the parquet file have every metric."""

DIFFERENCES = (
    Column(EFFORT, "of bound\npoints", 100.0, 2),
    Column("over_delivery", "over plan\npoints", 100.0, 2),
    Column("utilisation", "adhesion\npoints", 100.0, 2),
    Column("slip_time", "slip\naxle s"),
    Column("damage", "damage\nQ kJ", 1.0, 0),
    Column("jerk_rms", "jerk rms\nm/s³", 1.0, 2),
)
"""What is printed of the differences from the reference rule; the JSON has every metric."""


def minus(text: str) -> str:
    """Numbers with true minus signs."""
    return re.sub(r"-(?=[0-9])", "−", text)


TEX = str.maketrans({
    "%": r"\%", "_": r"\_", "&": r"\&", "−": "$-$", "²": "$^2$", "³": "$^3$", "*": "$^*$", "°": r"$^\circ$",
})  # fmt: skip
"""What LaTeX writes otherwise, of the characters that stand in tables."""


def as_text(kind: str, align: str, head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A table as text to paste, as `kind` csv, markdown or latex; numbers have all their digits in csv, else four.

    `align` has a letter per column, l or r.
    """
    if kind == "csv":
        return pd.DataFrame(rows, columns=list(head)).to_csv(index=False, lineterminator="\n")
    texts = [[_words(one) for one in row] for row in (head, *rows)]
    if kind == "markdown":
        escaped = ([one.replace("|", "\\|") for one in row] for row in texts)
        first, *others = (f"| {' | '.join(row)} |\n" for row in escaped)
        rule = "".join("---:|" if side == "r" else "---|" for side in align)
        return "".join([first, f"|{rule}\n", *others])
    first, *others = (" & ".join(one.translate(TEX) for one in row) + r" \\" for row in texts)
    begin, end = rf"\begin{{tabular}}{{{align}}}", r"\end{tabular}"
    return "\n".join([begin, r"\toprule", first, r"\midrule", *others, r"\bottomrule", end, ""])


def _words(value: object) -> str:
    if isinstance(value, float):
        return minus(f"{value:.4g}") if math.isfinite(value) else "–"
    return str(value)


GAP = 2
"""Spaces between two columns: one of padding, one in place of the box's line."""

EDGES = 2
"""Spaces at the table's ends."""


def tables(lines: Sequence[SummaryLine], titles: dict[str, str], width: int) -> list[Group]:
    """Title, rich table and notes, one group per scenario, at most `width` characters wide where that can be had.

    Columns that apply to none of a scenario's lines are left out; what is left out for want of width is named below.
    """
    groups = []
    for scenario in dict.fromkeys(line.scenario for line in lines):
        mine = [line for line in lines if line.scenario == scenario]
        groups.append(_table(mine, titles.get(scenario, ""), width))
        if paired := [line for line in mine if _pairs(line) > 1]:
            groups.append(_differences(paired, width))
    return groups


def _pairs(line: SummaryLine) -> int:
    """Seeds over which a line is paired with the reference rule."""
    return max((mean.count for mean in line.differences.values()), default=0)


def _differences(lines: list[SummaryLine], width: int) -> Group:
    """What each rule does more than the reference under the same controller."""
    table = Table(box=SIMPLE_HEAD, padding=(0, GAP - 1, 0, 0), pad_edge=False)
    for heading in ("rule", "controller"):
        table.add_column(heading, no_wrap=True)
    for column in DIFFERENCES:
        table.add_column(column.heading, justify="right", no_wrap=True)
    for line, (rule, controller) in zip(lines, _names(lines), strict=True):
        table.add_row(rule, controller, *(_signed(line, column) for column in DIFFERENCES))
    seeds = sorted({_pairs(line) for line in lines})
    counted = " or ".join(map(str, seeds))
    return Group(f"less {REFERENCE}, paired over {counted} seeds, ± 95 %:", table)


def _signed(line: SummaryLine, column: Column) -> str:
    mean = line.differences.get(column.metric, NO_MEAN)
    if mean.count == 0:
        return "–"
    text = f"{column.factor * mean.value:+.{column.digits}f}"
    return minus(text + plus_minus(mean, column.factor, column.digits))


def _table(lines: list[SummaryLine], title: str, width: int) -> Group:
    columns = [column for column in COLUMNS if any(tells(line, column) for line in lines)]
    names = _names(lines)
    cells = {column: [_cell(line, column) for line in lines] for column in columns}
    failures = [_failures(line) for line in lines]
    fixed = [("rule", [rule for rule, _ in names]), ("controller", [c for _, c in names])]
    taken = EDGES + sum(_width(*part) + GAP for part in [*fixed, ("solver\nfailures", failures)])
    shown, spared = list(columns), []
    while taken + sum(_width(c.heading, cells[c]) + GAP for c in shown) > width:
        spare = max(shown, key=lambda column: column.spare, default=None)
        if spare is None or spare.spare == 0:
            break
        shown.remove(spare)
        spared.append(spare.metric)

    table = Table(box=SIMPLE_HEAD, padding=(0, GAP - 1, 0, 0), pad_edge=False)
    for heading, _ in fixed:
        table.add_column(heading, no_wrap=True)
    for column in shown:
        table.add_column(column.heading, justify="right", no_wrap=True)
    table.add_column("solver\nfailures", justify="right", no_wrap=True)
    for k, (rule, controller) in enumerate(names):
        table.add_row(rule, controller, *(cells[column][k] for column in shown), failures[k])
    headline = f"[bold]{escape(lines[0].scenario)}[/bold]  {escape(title)}"
    return Group(headline, table, *_notes(lines, spared))


def _names(lines: list[SummaryLine]) -> list[tuple[str, str]]:
    """Rule and controller of each line; the rule is not repeated where one follows another."""
    rules = [line.rule for line in lines]
    first = [k == 0 or rule != rules[k - 1] for k, rule in enumerate(rules)]
    return [
        (line.rule if new else "", line.controller) for line, new in zip(lines, first, strict=True)
    ]


def applies(line: SummaryLine, column: Column) -> bool:
    """Whether a line has a number for a column."""
    mean = line.metrics.get(column.metric, NO_MEAN)
    # a built-in controller solves nothing: zero time says that there is nothing to say
    return mean.count > 0 and not (column.metric == "controller_median" and mean.value == 0.0)


def tells(line: SummaryLine, column: Column) -> bool:
    """Whether it has one that says something: not a count of faults of which there were none."""
    return applies(line, column) and not (
        column.counts and line.metrics[column.metric].value == 0.0
    )


def _cell(line: SummaryLine, column: Column) -> str:
    if line.left_out == line.seeds:
        return f"[red]{_fault(line)}[/red]" if column is COLUMNS[0] else "–"
    if not applies(line, column):
        return "–"
    mean = line.metrics[column.metric]
    text = f"{column.factor * mean.value:.{column.digits}f}"
    return minus(text + plus_minus(mean, column.factor, column.digits))


def _failures(line: SummaryLine) -> str:
    names = ("rule_failures", "controller_failures")
    values = [line.metrics.get(name, NO_MEAN).value for name in names]
    return "–" if line.left_out == line.seeds else f"{sum(v for v in values if v == v):.0f}"


def _fault(line: SummaryLine) -> str:
    return "failed" if line.failed else "degraded"


def _width(heading: str, cells: Sequence[str]) -> int:
    texts = [
        *heading.split("\n"),
        *(cell.removeprefix("[red]").removesuffix("[/red]") for cell in cells),
    ]
    return max(len(text) for text in texts)


def _left_out(line: SummaryLine) -> str:
    counts = ((line.failed, "failed"), (line.degraded, "degraded"))
    return ", ".join(f"{count} of {line.seeds} runs {word}" for count, word in counts if count)


def _notes(lines: list[SummaryLine], spared: Sequence[str]) -> list[str]:
    notes = [note for line in lines for note in left_out(line)]
    if over := [f"{line.rule}, {line.controller}" for line in lines if line.over > MOST_OVER]:
        notes.append(
            f"[yellow]more than {100 * MOST_OVER:g} % beyond the plan, no rule to rank by effort: {'; '.join(over)}[/yellow]"
        )
    if spared:
        notes.append(f"not shown for want of width: {', '.join(spared)} (--json shows all)")
    return notes


def left_out(line: SummaryLine) -> list[str]:
    """What became of a line's runs that do not count, if there are any."""
    if not line.left_out:
        return []
    name = f"{escape(line.rule)}, {escape(line.controller)}"
    return [f"[red]{name}: {_left_out(line)}: {escape(line.reasons[0])}[/red]"]
