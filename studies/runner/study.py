"""Studies: one question over many events; cells that are run, then a table, a figure and statements.

A study is one file that ends with a `Study`. `studies.runner.workers` computes its cells, `studies.runner.rows` stores their
rows. A cell is known by what decides its rows, see `studies.runner.row_key`; what is stored is not run again.
"""

import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from alloc.files import write_whole
from studies import StudyError
from studies.runner.plugins import ASKED, slow
from studies.runner.progress import LOG, show_progress
from studies.runner.provenance import describe_origin
from studies.runner.row_key import hash_cell, read_anew
from studies.runner.rows import (
    BOOKKEEPING,
    Row,
    append_origin,
    append_rows,
    latex_table,
    markdown_table,
    read_rows,
    write_table,
)
from studies.runner.workers import compute_rows
from studies.statistics import Statement, shorten_statements, statement_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # half a second that workers do not need

NARROW, WIDE = 3.5, 7.16
"""Widths [in] of a figure in one and in two columns of a paper."""


class Cell(NamedTuple):
    """A piece of work: `run(*args)` of its study gives one row, or a list of rows."""

    name: str
    """For people; in reasons and progress."""
    args: tuple[Any, ...]
    columns: Mapping[str, Any] = {}
    """Columns of each of its rows beside those that `run` gives."""
    sources: tuple[str, ...] = ()
    """Modules that decide its rows and that `run` does not name: of parts that `args` call by name."""


@dataclass(frozen=True)
class Study:
    """One question over many events."""

    name: str
    question: str
    cells: Callable[[int, int], Iterable[Cell]]
    """Called with the number of events and a seed; more events add cells and change none."""
    run: Callable[..., Row | list[Row]]
    """A function of a module."""
    table: Callable[[pd.DataFrame], pd.DataFrame]
    """What is printed and written, from the rows."""
    figure: "Callable[[pd.DataFrame], Figure] | None" = None
    """None where `paper_figs` draws the rows."""
    statements: Callable[[pd.DataFrame], list[Statement]] | None = None
    events: int = 100
    seed: int = 0
    """Number of events and their seed, where nobody says them: as in the stored tables."""
    more_tables: Mapping[str, Callable[[pd.DataFrame], pd.DataFrame]] = field(default_factory=dict)
    """Further tables of the same rows, by name."""

    def make_tables(self, rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
        """Everything that is made of the rows as a table, by name: first "table", last "statements"."""
        makers = {"table": self.table, **self.more_tables}
        tables = {name: make(rows) for name, make in makers.items()}
        if self.statements is not None:
            tables["statements"] = statement_table(self.statements(rows))
        return tables

    def keyed_cells(self, events: int | None, seed: int | None) -> dict[str, Cell]:
        """The cells of so many events of this seed, by their keys; None stands for the study's number or seed."""
        read_anew()
        cells = self.cells(events or self.events, self.seed if seed is None else seed)
        return {hash_cell(self.run, cell.args, cell.sources): cell for cell in cells}


def run_study(
    study: Study,
    folder: str | Path,
    events: int | None = None,
    seed: int | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    retry_failed: bool = False,
    quiet: bool = True,
) -> pd.DataFrame:
    """The rows of a study's cells, in their order; what `folder` has is not run again, but `retry_failed`.

    `jobs`: processes of this machine; `scheduler`: address of a Dask scheduler, or its file. A cell that fails is a row with
    its reason. Raises `StudyError` where rows cannot be kept, `WorkerLost` where a worker ended; both keep what is done.
    """
    if not isinstance(folder, str | Path):
        raise StudyError(f"out = {folder!r}: give a folder")
    cells, stored = study.keyed_cells(events, seed), read_rows(folder)
    if retry_failed:
        for key in [key for key, rows in stored.items() if rows and rows[0]["status"] == "failed"]:
            del stored[key]
    left = [(key, cell) for key, cell in cells.items() if key not in stored]
    finished = len(cells) - len(left)
    LOG.info("%s: %d runs, of which %s has %d", study.name, len(cells), folder, finished)
    if slowed := [cell for _, cell in left if cell.columns.get("rule") in slow]:
        spent = sum(slow[cell.columns["rule"]] * ASKED * cell.args[0].duration_s for cell in slowed)
        forecast = f"these {len(left)} runs take about {spent / 60.0 / jobs:.1f} min"
        print(f"readhesion: {forecast}", file=sys.stderr)
    if left:
        append_origin(folder)
        try:
            with (
                show_progress(study.name, len(cells), quiet) as advance,
                closing(compute_rows(study.run, left, jobs, scheduler)) as batches,
            ):
                advance(finished)
                for batch in batches:
                    append_rows(folder, batch)
                    _log_rows((cells[key].name, row) for key, rows in batch.items() for row in rows)
                    stored |= batch
                    advance(len(batch))
        except KeyboardInterrupt as stopped:
            if finished := len({*cells} & {*stored}):
                total = f"{finished} of {len(cells)}"
                stopped.add_note(f"finished rows are kept, {total}; the same command goes on")
            raise
    table = []
    for key, cell in cells.items():
        # as the cell is labelled now: a label may have changed since the rows were computed
        labels = {"cell": key, "name": cell.name, **cell.columns}
        for row in stored.get(key, ()):
            table.append(labels | {name: x for name, x in row.items() if name not in labels})
    return pd.DataFrame(table) if table else pd.DataFrame(columns=list(BOOKKEEPING))


def _log_rows(rows: Iterable[tuple[str, Row]]) -> None:
    """A line for each row: how long it took, and what failed in it."""
    for name, row in rows:
        LOG.info("%s: %s in %.2f s %s", name, row["status"], row["wall_time"], row["reason"])
        for part in ("rule", "controller"):
            if failures := row.get(f"{part}_failures"):
                LOG.info("%s: the solver of the %s failed %d times", name, part, failures)


def count_missing(
    study: Study, folder: str | Path, events: int | None, seed: int | None
) -> tuple[int, int, float]:
    """How many cells a study has, how many of them `folder` lacks, and the mean time of those that it has [s] or nan."""
    cells, stored = study.keyed_cells(events, seed), read_rows(folder)
    spent = [row["wall_time"] for rows in stored.values() for row in rows]
    return len(cells), len(set(cells) - set(stored)), float(np.mean(spent)) if spent else np.nan


def forecast_runs(
    study: Study, folder: str | Path, events: int | None, seed: int | None, jobs: int
) -> str:
    """How many runs a study takes, how many are to be made, and about how long that takes, in a sentence."""
    cells, lacking, seconds = count_missing(study, folder, events, seed)
    forecast = ": no stored run says how long one takes" if lacking else ""
    if lacking and seconds == seconds:
        minutes, rest = divmod(round(lacking * seconds / jobs), 60)
        forecast = f": about {minutes} min {rest} s in {jobs} processes"
    return f"{cells} runs, of which {lacking} are to be made{forecast}"


def write_results(
    study: Study, rows: pd.DataFrame, folder: str | Path, kind: str = "md"
) -> dict[str, pd.DataFrame]:
    """Write the rows of a run as `rows.parquet`, and what the study makes of them: its tables, which are returned, and
    figure.pdf; nothing where all runs failed. `kind`: "tex" for tables in LaTeX beside the others."""
    folder, stored = Path(folder), rows.copy(deep=False)
    stored.attrs = dict(describe_origin())
    write_whole(folder / "rows.parquet", lambda aside: stored.to_parquet(aside, index=False))
    if not (rows["status"] == "ok").any():
        return {}
    tables = study.make_tables(rows)
    for name, table in tables.items():
        texts = {ending: format_tables({name: table}, ending)[0] for ending in {"md", kind}}
        write_table(table, folder / name, texts)
    if study.figure is not None:
        write_whole(folder / "figure.pdf", study.figure(rows).savefig)
    return tables


def format_tables(tables: Mapping[str, pd.DataFrame], kind: str) -> list[str]:
    """Tables for people, in Markdown ("md") or LaTeX ("tex"); statements are shortened."""
    write = latex_table if kind == "tex" else markdown_table
    return [
        write(shorten_statements(table) if name == "statements" else table)
        for name, table in tables.items()
    ]
