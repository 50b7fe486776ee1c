"""Rows of cells: a file that is only added to, and tables as files.

A killed program loses the cells that were running, two writers do no harm to each other, and the union of two folders is one
file behind the other.
"""

import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_float

from alloc.files import write_whole
from studies import StudyError
from studies.runner.row_key import ROWS

Row = dict[str, Any]
BOOKKEEPING = ("cell", "name", "status", "reason", "wall_time", "batch")
"""Columns that every row has: its cell's key and name; ok, failed or degraded, and why; seconds; when it was made [ns]."""


def read_rows(folder: str | Path) -> dict[str, list[Row]]:
    """Rows by their cell's key, of a cell those that were added last. A line that was cut off is passed over."""
    path, stored = Path(folder) / ROWS, dict[str, list[Row]]()
    for line in path.read_bytes().splitlines() if path.exists() else ():
        with suppress(ValueError, KeyError, TypeError):
            cell = json.loads(line)
            stored[cell["cell"]] = [
                {name: np.nan if value is None else value for name, value in row.items()}
                for row in cell["rows"]
            ]
    return stored


def append_rows(folder: str | Path, cells: Mapping[str, list[Row]]) -> None:
    """Add rows of cells, all at once, so that several programs can. Raises `StudyError` where they cannot be written."""
    lines = []
    for key, rows in cells.items():
        strict = [
            {name: None if is_float(x) and x != x else x for name, x in row.items()} for row in rows
        ]
        text = json.dumps({"cell": key, "rows": strict}, default=lambda number: number.tolist())
        lines.append(f"{text}\n")
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with open(Path(folder) / ROWS, "ab+") as file:
            # the last line may have been cut off where a disk was full
            file.seek(max(0, file.tell() - 1))
            begin = "" if file.read(1) in (b"", b"\n") else "\n"
            file.write("".join([begin, *lines]).encode())
    except OSError as error:
        fault = f"{folder}: rows cannot be written there ({error.strerror})"
        raise StudyError(fault) from None


def write_table(
    table: pd.DataFrame, path: str | Path, for_people: pd.DataFrame | None = None
) -> None:
    """The table as .parquet, .csv and .md (`for_people`) beside each other; `path` is without ending."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = table.copy()
    plain.attrs = {}
    shown = markdown_table(plain if for_people is None else for_people)
    for ending, write in (
        (".parquet", lambda aside: plain.to_parquet(aside, index=False)),
        (".csv", lambda aside: plain.to_csv(aside, index=False)),
        (".md", lambda aside: aside.write_text(shown, "utf-8")),
    ):
        write_whole(path.with_name(path.name + ending), write)


def markdown_table(table: pd.DataFrame) -> str:
    """A table of GitHub's Markdown; columns of numbers are flush right."""

    def format_entry(value: Any) -> str:
        if isinstance(value, float):
            return "" if np.isnan(value) else f"{value:.3f}"
        return str(value).replace("|", "\\|")

    right = ["--:" if table[name].dtype.kind in "fiu" else "---" for name in table]
    body = [map(format_entry, row) for row in table.itertuples(index=False)]
    head = [str(name) for name in table]
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, right, *body))
