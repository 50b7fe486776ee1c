"""The table of a study on disk: one parquet file, replaced as a whole, safe against interruption and other writers."""

import fcntl
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import xarray as xr

from alloc.recording import save
from studies.core.cell import Key, Row
from studies.files.study_error import StudyError

TABLE = "runs.parquet"
KEPT = ("cell", "code_hash", "status", "reason")
"""Columns of every row: identity of its cell, the code, and what became of it."""


class Store:
    """A study's folder: the table `runs.parquet` and recorded runs as netCDF under `runs/`.

    Raises `StudyError` where the folder cannot be written or the table cannot be read.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self.folder):
                pass
        except OSError as error:
            raise StudyError(
                f"output folder {str(folder)!r} cannot be written: {error.strerror}; choose another with --out"
            ) from None

    @property
    def path(self) -> Path:
        """The table's file."""
        return self.folder / TABLE

    def read(self) -> pd.DataFrame:
        """All rows, of every code; empty if there are none yet."""
        if not self.path.exists():
            return pd.DataFrame(columns=list(KEPT))
        try:
            table = pd.read_parquet(self.path)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise self._unreadable(reason) from None
        if not set(KEPT) <= set(table):
            raise self._unreadable("another version of this program wrote it")
        return table

    def _unreadable(self, reason: str) -> StudyError:
        return StudyError(
            f"table {str(self.path)!r} cannot be read ({reason}); move it away or choose another --out"
        )

    def cells(self, failed_too: bool = False) -> set[str]:
        """Digests of the cells that succeeded, or of all."""
        table = self.read()
        failed = set(table["cell"][table["status"] == "failed"])
        return set(table["cell"]) - (set() if failed_too else failed)

    def add(self, rows: Sequence[Row]) -> None:
        """Add the rows of whole cells; they replace older ones of the same cells. The file is whole at every instant."""
        if not rows:
            return
        new = pd.DataFrame(list(rows))
        with self._lock():
            old = self.read()
            old = old[~old["cell"].isin(new["cell"])]
            table = pd.concat([old, new], ignore_index=True) if len(old) else new
            handle, name = tempfile.mkstemp(dir=self.folder, suffix=".parquet.part")
            os.close(handle)
            try:
                table.to_parquet(name, index=False)
                os.replace(name, self.path)
            except BaseException:
                Path(name).unlink(missing_ok=True)
                raise

    def rows_of(self, keys: Sequence[Key]) -> pd.DataFrame:
        """Rows of these cells, in the order of `keys`."""
        table = self.read()
        order = {key.digest: k for k, key in enumerate(keys)}
        chosen = table[table["cell"].isin(order)]
        return chosen.sort_values(
            "cell", key=lambda cells: cells.map(order), kind="stable", ignore_index=True
        )

    def save_run(self, key: Key, run: xr.Dataset) -> Path:
        """Write a recorded run; returns its file."""
        path = self.run_path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        save(run, part)
        os.replace(part, path)
        return path

    def run_path(self, key: Key) -> Path:
        """Where the recorded run of this cell lies, if it was kept."""
        event, _, arm = key.label.partition("/")
        return self.folder / "runs" / event / f"{arm.replace('/', '_')}_{key.digest[:12]}.nc"

    @contextmanager
    def _lock(self) -> Iterator[None]:
        with open(self.folder / ".lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield
