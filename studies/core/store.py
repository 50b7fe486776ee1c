"""The table of a study on disk: one parquet file, replaced as a whole, safe against interruption and other writers."""

import fcntl
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from alloc.recording import save
from studies.core.job import KEY, Key
from studies.core.study_error import StudyError

TABLE = "runs.parquet"


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
        """All rows, one per (event, rule, controller, seed) and code; empty if there are none yet."""
        if not self.path.exists():
            return pd.DataFrame(columns=[*KEY, "status", "reason"])
        try:
            return pd.read_parquet(self.path)
        except (OSError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise StudyError(
                f"table {str(self.path)!r} cannot be read ({reason}); move it away or choose another --out"
            ) from None

    def keys(self, failed_too: bool = False) -> set[Key]:
        """Identities of the rows that succeeded, or of all rows."""
        table = self.read()
        done = table if failed_too else table[table["status"] == "ok"]
        return {Key(*row) for row in done[list(KEY)].itertuples(index=False, name=None)}

    def add(self, rows: Sequence[dict[str, Any]]) -> None:
        """Add rows; a row replaces an older one of the same identity. The file is whole at every instant."""
        if not rows:
            return
        with self._lock():
            table = pd.concat([self.read(), pd.DataFrame(list(rows))], ignore_index=True)
            table = table.drop_duplicates(subset=list(KEY), keep="last", ignore_index=True)
            handle, name = tempfile.mkstemp(dir=self.folder, suffix=".parquet.part")
            os.close(handle)
            try:
                table.to_parquet(name, index=False)
                os.replace(name, self.path)
            except BaseException:
                Path(name).unlink(missing_ok=True)
                raise

    def save_run(self, key: Key, run: xr.Dataset) -> Path:
        """Write a recorded run; returns its file."""
        path = self.run_path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        save(run, part)
        os.replace(part, path)
        return path

    def run_path(self, key: Key) -> Path:
        """Where the recorded run of this identity lies, if it was kept."""
        name = "_".join((key.rule, key.controller, str(key.seed)))
        version = f"{key.scenario_hash[:6]}{key.code_hash[:6]}"
        return self.folder / "runs" / key.scenario / f"{name}_{version}.nc"

    @contextmanager
    def _lock(self) -> Iterator[None]:
        with open(self.folder / ".lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield


def select(table: pd.DataFrame, keys: Iterable[Key]) -> pd.DataFrame:
    """Rows of these identities, in the order of `keys`."""
    wanted = pd.DataFrame(list(keys), columns=list(KEY))
    return wanted.merge(table, on=list(KEY), how="inner")
