"""A study's results on disk: its table and its recorded runs, safe against interruption and other writers."""

import time
from collections.abc import Sequence
from contextlib import suppress
from glob import escape
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import xarray as xr

from alloc.recording import save
from alloc.sources import ASIDE
from studies.core.cell import Key, Row
from studies.core.checked_file import Gone, read_checked, write_checked
from studies.core.parts import Parts
from studies.core.single_table import take_over
from studies.files.writable import make_folder

ROWS, RUNS = "rows", "runs"
"""Folders of the table and of recorded runs."""
LITTER_AGE = 3600.0
"""Half-written files of a process that was killed are deleted after this time [s]."""


class Store:
    """A study's folder: its table as parquet files under `rows/`, recorded runs as netCDF under `runs/`.

    Several processes and machines may use one folder at once. A file whose content has changed since it was written is set
    aside with a `StoreWarning`. A folder that cannot be written can be read. Raises `StudyError` where there is none and
    none can be made, or the table belongs to another program.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        if not self.folder.is_dir():
            make_folder(self.folder)
        for path in self.folder.rglob(f".*{ASIDE}*"):
            with suppress(
                OSError
            ):  # another writer has just finished it; the folder is for reading alone
                if time.time() - path.stat().st_mtime > LITTER_AGE:
                    path.unlink()
        self.parts = Parts(self.path)
        take_over(self.folder, self.parts)

    @property
    def path(self) -> Path:
        """The table's folder."""
        return self.folder / ROWS

    def read(self) -> pd.DataFrame:
        """All rows, of every code version, in the order in which they were added; empty if there are none yet."""
        return self.parts.read(lambda index: np.arange(len(index.part)))

    def cells(self, among: Sequence[Key] | None = None) -> dict[str, bool]:
        """Digests of the cells in the table, optionally only of those `among` the given keys, and whether they succeeded."""
        self.parts.gather()
        index = self.parts.index()
        cell, failed = index.cell, pa.array(index.failed)
        if among is not None:
            asked = pc.is_in(cell, pa.array([key.digest for key in among], pa.string()))
            cell, failed = cell.filter(asked), failed.filter(asked)
        found = dict.fromkeys(cell.to_pylist(), True)
        found.update(dict.fromkeys(cell.filter(failed).to_pylist(), False))
        return found

    def check_writable(self) -> None:
        """Raise `StudyError` where the folder cannot be written."""
        make_folder(self.folder)

    def add(self, rows: Sequence[Row]) -> None:
        """Add the rows of whole cells; they replace older ones of the same cells."""
        if rows:
            self.parts.add(_columns(rows))

    def rows_of(self, keys: Sequence[Key]) -> pd.DataFrame:
        """Rows of these cells, in the order of `keys`."""
        return self.parts.rows_of([key.digest for key in keys])

    def save_run(self, key: Key, run: xr.Dataset) -> Path:
        """Write a recorded run; returns its file."""
        kept = self.run_path(key)
        if kept is not None:
            return kept
        beginning = self._run_beginning(key)
        beginning.parent.mkdir(parents=True, exist_ok=True)
        return write_checked(beginning, ".nc", lambda aside: save(run, aside))

    def has_run(self, key: Key) -> bool:
        """Whether the recorded run of this cell was kept and is unchanged."""
        return self.run_path(key) is not None

    def run_path(self, key: Key) -> Path | None:
        """File of the recorded run of this cell; None if it was not kept, or has changed since it was written."""
        beginning = self._run_beginning(key)
        for path in sorted(beginning.parent.glob(f"{escape(beginning.name)}-*.nc")):
            with suppress(Gone):
                read_checked(path)
                return path
        return None

    def _run_beginning(self, key: Key) -> Path:
        event, _, arm = key.label.partition("/")
        return self.folder / RUNS / _inside(event) / f"{_inside(arm)}_{key.digest[:12]}"


def _columns(rows: Sequence[Row]) -> pa.Table:
    """The same rows as a table; what a row lacks is empty."""
    columns = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        values = [row.get(name) for row in rows]
        column = pa.array(values, from_pandas=True)
        if pa.types.is_null(column.type) and any(isinstance(value, float) for value in values):
            column = column.cast(pa.float64())  # nan alone
        columns[name] = column
    return pa.table(columns)


def _inside(label: str) -> str:
    """A label as the name of one file or folder, which cannot lead out of the folder that it stands in."""
    name = quote(label.replace("/", "_"), safe=" ,;=+()[]")
    return name.replace(".", "%2E") if not name.strip(".") else name[:150]
