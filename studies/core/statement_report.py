"""Statements of a sweep for people, and what a sweep was for machines."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd
from rich.console import Group
from rich.markup import escape
from rich.table import Table

from alloc.recording import provenance
from alloc.sources import code_hash
from studies.core.claims import fingerprint, frozen
from studies.core.statement import (
    CONDITIONS,
    CONFIDENCE,
    FAILS,
    HOLDS,
    UNDECIDED,
    Interval,
    Statement,
    Tested,
)
from studies.core.study import Study

COLOURS = {HOLDS: "green", CONDITIONS: "yellow", FAILS: "red", UNDECIDED: "blue"}


def printed(statements: list[Statement]) -> list[Group]:
    """One block per statement: claim and verdict, numbers with their intervals, conditions, method."""
    return [_block(statement) for statement in statements]


def numbers_of(statements: list[Statement]) -> tuple[str, list[str], list[list[object]]]:
    """Every number of every statement as a table: how its columns are aligned, their headings, and the rows."""
    rows: list[list[object]] = [
        [one.name, one.verdict, name, found.value, found.low, found.high, found.count]
        for one in statements
        for name, found in one.numbers.items()
    ]
    return "lllrrrr", ["statement", "verdict", "number", "value", "low", "high", "n"], rows


def about(
    study: Study, events: int, seed: int, folder: Path, rows: int, failed: int, **settings: object
) -> dict[str, Any]:
    """What a sweep was: events, seed, table, thresholds, code and versions."""
    return {
        "sweep": study.name,
        "events": events,
        "seed": seed,
        "folder": str(folder),
        "rows": rows,
        "failed": failed,
        "confidence": CONFIDENCE,
        "thresholds": fingerprint(claims) if (claims := study.claimed(**settings)) else None,
        "thresholds_since": frozen(folder, seed),
        "code": code_hash("studies.core.job"),
        **provenance(),
    }


def frozen_words(study: Study, folder: Path, seed: int, **settings: object) -> str:
    """Which thresholds judged events of `seed`, and whether others stood before them; empty for a study without."""
    claims = study.claimed(**settings)
    if not claims:
        return ""
    now = fingerprint(claims)
    since = frozen(folder, seed)
    others = [f"{one} since {when}" for one, when in since.items() if one != now]
    words = f"thresholds {now}, with seed {seed} since {since[now]}"
    return words + (f"; CHANGED: also judged by {', '.join(others)}" if others else "")


def rows_of(table: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows of a table for JSON, without what the store keeps of them; what is no number becomes None."""
    return [
        {
            str(name): None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in row.items()
        }
        for row in table.drop(columns=["cell", "code_hash", "wall_time"], errors="ignore").to_dict(
            "records"
        )
    ]


def shown_rows(table: pd.DataFrame, columns: Mapping[str, str]) -> Table:
    """These columns of every row, each under its heading; and why, where one is not ok."""
    if (table["status"] != "ok").any():
        columns = {**columns, "reason": "reason"}
    shown = Table(box=None, padding=(0, 1))
    for heading in columns.values():
        shown.add_column(escape(heading), overflow="fold")
    for row in rows_of(table):
        values = (row.get(name) for name in columns)
        shown.add_row(
            *(
                "–" if v is None else f"{v:.4g}" if isinstance(v, float) else escape(str(v))
                for v in values
            )
        )
    return shown


def _verdict(statement: Statement) -> str:
    """The verdict in its colour, and how many resamples agree."""
    colour = COLOURS.get(statement.verdict, "magenta")
    agree = (
        "" if math.isnan(statement.agreement) else f"{statement.agreement:.0%} of resamples agree"
    )
    parts = "in parts; the whole is undecided" if statement.in_parts else ""
    fragile = "fragile" if statement.fragile else ""
    words = ", ".join(word for word in (parts, fragile, agree) if word)
    return f"[bold {colour}]{statement.verdict}[/bold {colour}]" + (f" ({words})" if words else "")


def _tested(test: Tested) -> str:
    """The mean that decides, against its threshold."""
    now, wide = test.estimate, test.adjusted
    return (
        f"{now.value:.4g} [{now.low:.4g}, {now.high:.4g}], "
        f"[{wide.low:.4g}, {wide.high:.4g}] at {test.level:.1%} (Holm); claimed {test.direction} {test.threshold:g}, "
        f"p {test.p:.3g}, after Holm {test.p_holm:.3g}"
    )


def _block(statement: Statement) -> Group:
    table = Table(show_header=False, box=None, padding=(0, 1))
    table.add_column(overflow="fold")
    for _ in range(3):
        table.add_column(justify="right", no_wrap=True)
    for quantity, interval in statement.numbers.items():
        table.add_row(escape(quantity), *_cells(interval))
    return Group(
        f"[bold]{escape(statement.name)}[/bold]  {escape(statement.claim)}: {_verdict(statement)}",
        *([f"  {escape(_tested(statement.test))}"] if statement.test else []),
        table,
        *(f"  - {escape(condition)}" for condition in statement.conditions),
        f"[dim]  {escape(statement.method)}[/dim]",
        "",
    )


def _cells(interval: Interval) -> tuple[str, str, str]:
    if interval.count == 0:
        return ("–", "", "no events")
    known = math.isfinite(interval.low)
    limits = f"[{interval.low:.4g}, {interval.high:.4g}]" if known else ""
    return (f"{interval.value:.4g}", escape(limits), f"n = {interval.count}")
