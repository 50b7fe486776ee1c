"""Rows of cells: a file that is only added to, and tables as files.

A killed program loses the cells that were running, two writers do no harm to each other, and the union of two folders is one
file behind the other.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_float

from alloc.files import write_whole
from studies import StudyError
from studies.runner.provenance import describe_origin, origin_line
from studies.runner.row_key import ROWS
from studies.statistics import in_digits

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
    _append_lines(folder, lines)


def append_origin(folder: str | Path) -> None:
    """Add a line that says what computes the rows below it; readers of rows pass it over."""
    _append_lines(folder, [f"{json.dumps({'origin': describe_origin()})}\n"])


def _append_lines(folder: str | Path, lines: list[str]) -> None:
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


COMMENTS = {"md": "\n<!-- {} -->\n", "tex": "% {}\n"}


def write_table(table: pd.DataFrame, path: str | Path, texts: Mapping[str, str]) -> None:
    """The table as .parquet, .csv, and as `texts` by their endings, which say in a comment what computed it; `path` has no
    ending."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = table.copy()
    plain.attrs = dict(describe_origin())
    writers: dict[str, Callable[[Path], object]] = {
        "parquet": lambda aside: plain.to_parquet(aside, index=False),
        "csv": lambda aside: plain.to_csv(aside, index=False),
    }
    for ending, text in texts.items():
        data = text + COMMENTS[ending].format(origin_line())
        writers[ending] = partial(Path.write_text, data=data, encoding="utf-8")
    for ending, write in writers.items():
        write_whole(path.with_name(f"{path.name}.{ending}"), write)


def markdown_table(table: pd.DataFrame) -> str:
    """A table of GitHub's Markdown; columns of numbers are flush right."""
    head, *body = [[text.replace("|", "\\|") for text in row] for row in _format_rows(table)]
    rule = ["--:" if is_number else "---" for is_number in _find_numbers(table)]
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, rule, *body))


LATEX = {
    "\\": r"\textbackslash{}", **{x: f"\\{x}" for x in "&%$#_{}"}, "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}", "[": "{[}", "*": "{*}", "<": "$<$", ">": "$>$", "|": "$|$", "\N{MINUS SIGN}": "$-$",
    "–": "--", "±": r"$\pm$",
    "×": r"$\times$", "≥": r"$\geq$", "≤": r"$\leq$", "²": "$^2$", "³": "$^3$", "°": r"$^\circ$", "‰": r"\textperthousand{}",
    "†": r"$\dagger$", "µ": r"$\mu$", "σ": r"$\sigma$", "ρ": r"$\rho$", "θ": r"$\theta$",
}  # fmt: skip
"""What plain LaTeX sets otherwise or does not know, and what behind the end of a row would belong to that."""


def latex_table(table: pd.DataFrame) -> str:
    """A table of LaTeX's package booktabs; columns of numbers are flush right."""
    escapes = str.maketrans(LATEX)
    rows = [[text.translate(escapes) for text in row] for row in _format_rows(table)]
    head, *body = [f"{' & '.join(row)} \\\\\n" for row in rows]
    columns = "".join("r" if is_number else "l" for is_number in _find_numbers(table))
    inner = f"\\toprule\n{head}\\midrule\n{''.join(body)}\\bottomrule\n"
    return f"\\begin{{tabular}}{{{columns}}}\n{inner}\\end{{tabular}}\n"


def _find_numbers(table: pd.DataFrame) -> list[bool]:
    """Which columns are numbers."""
    return [table[name].dtype.kind in "fiu" for name in table]


def _format_rows(table: pd.DataFrame) -> Iterator[list[str]]:
    """Heads and entries as texts."""

    def format_entry(value: Any) -> str:
        if isinstance(value, float):
            return "" if np.isnan(value) else in_digits(value, 3, False)
        return str(value)

    yield [str(name) for name in table]
    for row in table.itertuples(index=False):
        yield [format_entry(value) for value in row]
