"""The table of a study on disk: one parquet file, replaced as a whole, safe against interruption and other writers."""

import hashlib
import io
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

import pandas as pd
import xarray as xr
from filelock import FileLock

from alloc.recording import save
from alloc.whole_file import ASIDE, write_whole
from studies.core.cell import Key, Row
from studies.files.study_error import StudyError
from studies.files.writable import make_folder

TABLE = "runs.parquet"
SUMS = "SHA256SUMS"
"""Checksums of the table and of recorded runs; ``sha256sum -c SHA256SUMS`` checks them too."""
KEPT = ("cell", "code_hash", "status", "reason")
"""Columns of every row: identity of its cell, the code, and what became of it."""
SCHEMA = 1
"""Version of the table, in its attributes."""
LITTER_AGE = 3600.0
"""Half-written files of a process that was killed are deleted after so long [s]."""


class StoreWarning(UserWarning):
    """A file of a store was broken; it was set aside, and its content is computed again."""


class Store:
    """A study's folder: the table `runs.parquet`, recorded runs as netCDF under `runs/`, and their checksums.

    Several processes may use one folder at once. A file without its checksum, or that cannot be read, is set aside with a
    `StoreWarning`. Raises `StudyError` where the folder cannot be written or the table is one of another program.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        make_folder(self.folder)
        self._lock = FileLock(self.folder / ".lock")
        for path in self.folder.rglob(f".*{ASIDE}*"):
            with suppress(FileNotFoundError):  # another writer has just finished it
                if time.time() - path.stat().st_mtime > LITTER_AGE:
                    path.unlink()

    @property
    def path(self) -> Path:
        """The table's file."""
        return self.folder / TABLE

    def read(self) -> pd.DataFrame:
        """All rows, of every code; empty if there are none yet."""
        with self._lock:
            content = self._content(self.path)
            if content is None:
                return pd.DataFrame(columns=list(KEPT))
            try:
                table = pd.read_parquet(io.BytesIO(content))
            except Exception as error:  # whatever a damaged file makes the library raise
                self._set_aside(self.path, " ".join(str(error).split()) or type(error).__name__)
                return pd.DataFrame(columns=list(KEPT))
        if not set(KEPT) <= set(table) or table.attrs.get("schema", SCHEMA) != SCHEMA:
            raise StudyError(
                f"table {str(self.path)!r} is one of another version of this program; "
                "move it away or choose another --out"
            )
        return table

    def cells(self) -> dict[str, bool]:
        """Digests of the cells that the table holds, and whether they succeeded."""
        table = self.read()
        failed = set(table["cell"][table["status"] == "failed"])
        return {cell: cell not in failed for cell in table["cell"].unique()}

    def add(self, rows: Sequence[Row]) -> None:
        """Add the rows of whole cells; they replace older ones of the same cells. The file is whole at every instant."""
        if not rows:
            return
        new = pd.DataFrame(list(rows))
        with self._lock:
            old = self.read()
            old = old[~old["cell"].isin(new["cell"])]
            table = pd.concat([old, new], ignore_index=True) if len(old) else new
            table.attrs["schema"] = SCHEMA
            self._replace(self.path, lambda path: table.to_parquet(path, index=False))

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
        with self._lock:
            self._replace(path, lambda aside: save(run, aside))
        return path

    def has_run(self, key: Key) -> bool:
        """Whether the recorded run of this cell was kept, and is as it was written."""
        path = self.run_path(key)
        with self._lock:
            return self._name(path) in self._sums() and self._content(path) is not None

    def run_path(self, key: Key) -> Path:
        """Where the recorded run of this cell lies, if it was kept."""
        event, _, arm = key.label.partition("/")
        return self.folder / "runs" / _inside(event) / f"{_inside(arm)}_{key.digest[:12]}.nc"

    def _content(self, path: Path) -> bytes | None:
        """What a file holds; None where there is none. One that does not have its checksum is set aside."""
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise StudyError(f"file {str(path)!r} cannot be read: {error.strerror}") from None
        known = self._sums().get(self._name(path))
        if known is not None and _digest(content) not in known:
            self._set_aside(path, "it is not as it was written")
            return None
        return content

    def _set_aside(self, path: Path, reason: str) -> None:
        places = (path.with_name(f"{path.name}.broken-{k}") for k in range(1, 10**6))
        place = next(place for place in places if not place.exists())
        path.rename(place)
        warnings.warn(
            f"{str(path)!r} is broken ({reason}); it is now {place.name!r}, its content is computed again",
            StoreWarning,
            stacklevel=2,
        )

    def _replace(self, path: Path, write: Callable[[Path], object]) -> None:
        """Write a file and its checksum. In between those of both states are there: whichever a crash leaves is known."""
        sums, name = self._sums(), self._name(path)
        if name not in sums and path.exists():
            sums[name] = [_digest(path.read_bytes())]

        def replace(aside: Path) -> None:
            write(aside)
            sums[name] = [*sums.get(name, []), _digest(aside.read_bytes())]
            self._write_sums(sums)

        write_whole(path, replace)
        sums[name] = sums[name][-1:]
        self._write_sums(sums)

    def _sums(self) -> dict[str, list[str]]:
        """Checksums that a file may have, by its path in the folder."""
        path = self.folder / SUMS
        found: dict[str, list[str]] = {}
        lines = path.read_text(errors="replace").splitlines() if path.exists() else []
        for line in lines:
            digest, _, name = line.partition("  ")
            found.setdefault(name, []).append(digest)
        return found

    def _write_sums(self, sums: dict[str, list[str]]) -> None:
        text = "".join(f"{digest}  {name}\n" for name, all_ in sums.items() for digest in all_)
        write_whole(self.folder / SUMS, lambda path: path.write_text(text))

    def _name(self, path: Path) -> str:
        return path.relative_to(self.folder).as_posix()


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _inside(label: str) -> str:
    """A label as the name of one file or folder, which cannot lead out of the folder that it stands in."""
    name = quote(label.replace("/", "_"), safe=" ,;=+()[]")
    return name.replace(".", "%2E") if not name.strip(".") else name[:150]
