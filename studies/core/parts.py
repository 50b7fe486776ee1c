"""The rows of a table in parquet files that are added and never changed: processes and machines add at once, without locks.

Each writer keeps its last rows in one file, which it replaces by a longer one at each `add` until it is full. Of the rows of
a cell those added last count, wherever they stand: so rows may stand twice, and a crash at any instant does no harm.
"""

import math
import os
import re
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from studies.core.checked_file import DIGITS, Gone, read_checked, set_aside, write_checked
from studies.files.limits import check_parquet
from studies.files.study_error import StudyError

KEPT = ("cell", "code_hash", "status", "reason")
"""Columns of every row: identity of its cell, the code, and what became of it."""
ADDED = "added"
"""Column of the files alone: when a row was added [ns]; later than all that its writer had seen, whatever its clock says."""
SCHEMA = 2
"""Version of the files, in their metadata."""
FULL = 4096
"""Rows of a file to which no more are added."""
MANY, LARGE = 64, 32_768
"""If this many files are not full, they are joined into files of about this many rows."""
AGE = 600.0
"""Only files that no process has lengthened for this time [s] are joined."""
NAME = re.compile(rf"\d{{20}}-[0-9a-f]{{{DIGITS}}}\.parquet")
TRIES = 20
"""How often a folder is listed again whose list names files that are gone; a network file system may be late."""


class Index(NamedTuple):
    """The rows that count, in the order in which they were added."""

    names: list[str]
    """Files."""
    cell: pa.ChunkedArray
    failed: NDArray[np.bool_]
    part: NDArray[np.int32]
    """File of each row, by its number."""
    row: NDArray[np.int32]
    """Where it stands in the file."""


Choice = Callable[[Index], NDArray[np.int64]]
"""Requested rows of an index, in their order."""


class Parts:
    """The parts of a table in `folder`, which is made when rows are added."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._known: dict[str, pa.Table] = {}
        self._index = _indexed({})
        self._added: set[str] = set()
        self._passed_over: set[str] = set()
        self._newest = 0
        self._tail: pa.Table | None = None
        self._tail_path: Path | None = None

    def add(self, rows: pa.Table, added: int | None = None) -> None:
        """Add rows of whole cells [at the time `added`, now if nothing is said]."""
        if added is None:
            added = self._stamp()
        table = rows.append_column(ADDED, pa.repeat(added, len(rows)))
        replaced = None
        if self._tail is not None:
            with suppress(pa.ArrowTypeError):  # columns of another type: a file of their own
                table, replaced = _joined([self._tail, table]), self._tail_path
        self._tail_path = self._write(table, added)
        self._tail = table if table.num_rows < FULL else None
        self._added.update(rows["cell"].to_pylist())
        if replaced is not None:
            replaced.unlink(missing_ok=True)

    def index(self) -> Index:
        """The valid rows, by the present content of the folder.

        A list of a folder in which others join files may miss some. It is read again while a cell is missing that was there
        before or was added here.
        """
        before, complete = self._index.cell, not self._added
        for _ in range(TRIES):
            names = self._listed()
            new = sorted(names - self._known.keys())
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                columns = list(pool.map(self._columns, new))
            read = {n: table for n, table in zip(new, columns, strict=True) if table is not None}
            if read or not names >= self._known.keys():
                kept = {name: table for name, table in self._known.items() if name in names}
                self._known = dict(sorted((kept | read).items()))
                self._index = _indexed(self._known)
                pa.default_memory_pool().release_unused()  # half of what this took
                self._newest = max([self._newest, *(int(name[:20]) for name in names)])
                expected = pa.chunked_array([*before.chunks, pa.array(self._added, pa.string())])
                complete = pc.all(pc.is_in(expected, self._index.cell), min_count=0).as_py()
            if len(read) == len(new) and complete:
                break
            time.sleep(0.02)
        self._added.clear()
        return self._index

    def read(self, choose: Choice) -> pd.DataFrame:
        """The rows that `choose` chooses from an index."""
        while True:
            index = self.index()
            places = choose(index)
            by_part = np.argsort(index.part[places], kind="stable")
            with suppress(Gone):  # joined or set aside meanwhile
                found = _frame(self._tables(index, places[by_part]))
                if (np.diff(by_part) < 0).any():
                    found = found.iloc[np.argsort(by_part)].reset_index(drop=True)
                return found

    def rows_of(self, cells: Sequence[str]) -> pd.DataFrame:
        """Rows of these cells, in their order."""
        asked = pa.array(cells, pa.string())

        def choose(index: Index) -> NDArray[np.int64]:
            order = pc.index_in(index.cell, asked).fill_null(len(cells)).to_numpy()
            return np.argsort(order, kind="stable")[: np.count_nonzero(order < len(cells))]

        return self.read(choose)

    def gather(self) -> None:
        """Join small files where they are many, also of other writers: one that still works writes its rows again."""
        index = self.index()
        small = [k for k, name in enumerate(index.names) if len(self._known[name]) < FULL]
        if len(small) >= MANY:
            small = [k for k in small if _time_of(self.folder / index.names[k]) < time.time() - AGE]
        if len(small) < MANY:
            return
        sizes = np.cumsum([len(self._known[index.names[k]]) for k in small])
        for batch in np.split(small, np.flatnonzero(np.diff(sizes // LARGE)) + 1):
            if len(batch) < 2:
                continue
            places = np.flatnonzero(np.isin(index.part, batch))
            places = places[np.argsort(index.part[places], kind="stable")]
            # another process joins them; types differ; it is for reading alone or full
            with suppress(Gone, pa.ArrowTypeError, OSError):
                if len(places):
                    self._write(_joined(self._tables(index, places)), self._stamp())
                for k in batch:
                    (self.folder / index.names[k]).unlink(missing_ok=True)

    def _stamp(self) -> int:
        """Now [ns], or just after all that this writer has seen.

        Where rows stand twice, those of the latest file count. A file is removed only where a later one has its rows. So
        what several writers remove at once, each by what it has seen, is never the last copy.
        """
        self._newest = max(time.time_ns(), self._newest + 1)
        return self._newest

    def _write(self, table: pa.Table, stamp: int) -> Path:
        self.folder.mkdir(parents=True, exist_ok=True)
        repeated = [name for name, kind in zip(table.column_names, table.schema.types, strict=True)
                    if name != "cell" and not pa.types.is_floating(kind)]  # fmt: skip
        table = table.replace_schema_metadata({"readhesion": str(SCHEMA)}).combine_chunks()
        return write_checked(
            self.folder / f"{stamp:020d}", ".parquet",
            lambda aside: pq.write_table(table, aside, use_dictionary=repeated, write_statistics=False),
        )  # fmt: skip

    def _listed(self) -> set[str]:
        """Names of the parts. One list may miss a file that goes and what comes for it; two equal ones do not."""
        names: set[str] | None = None
        for _ in range(TRIES):
            before, names = names, set(filter(NAME.fullmatch, _names_in(self.folder)))
            if names == before:
                break
        return (names or set()) - self._passed_over

    def _columns(self, name: str) -> pa.Table | None:
        """What the index needs of a part; None where it is gone."""
        path = self.folder / name
        try:
            file = self._opened(path)
        except Gone:
            if path.exists():  # broken, where nothing can be set aside
                self._passed_over.add(name)
            return None
        if (file.schema_arrow.metadata or {}).get(b"readhesion") != str(SCHEMA).encode():
            raise other_version(path)
        table = file.read(["cell", "status", ADDED], use_threads=False)
        failed = pc.equal(table["status"], "failed")
        return pa.table(
            {"cell": table["cell"].cast(pa.string()), "failed": failed, ADDED: table[ADDED]}
        )

    @staticmethod
    def _opened(path: Path) -> pq.ParquetFile:
        """A part; raises `Gone` where it is gone, and where it was no table and is set aside."""
        content = read_checked(path)
        try:
            file = pq.ParquetFile(pa.BufferReader(content))
        except (pa.ArrowException, OSError) as error:
            set_aside(path, " ".join(str(error).split()))
            raise Gone from None
        check_parquet(f"table {str(path)!r}", file.metadata)
        return file

    def _tables(self, index: Index, places: NDArray[np.int64]) -> list[pa.Table]:
        """The rows at `places`, which are in the order of their files, by file; raises `Gone` where one is gone."""
        parts = index.part[places]
        tables = []
        for some in np.split(places, np.flatnonzero(np.diff(parts)) + 1) if len(places) else []:
            rows = index.row[some]
            table = self._opened(self.folder / index.names[index.part[some[0]]]).read()
            whole = len(rows) == len(table) and (np.diff(rows) == 1).all()
            tables.append(table if whole else table.take(rows))
        return tables


def other_version(path: Path) -> StudyError:
    """Error for a table that is none of this program."""
    return StudyError(
        f"table {str(path)!r} is one of another version of this program; move it away or choose another --out"
    )


def _names_in(folder: Path) -> list[str]:
    try:
        return os.listdir(folder)
    except FileNotFoundError:
        return []


def _time_of(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return math.inf


def _joined(tables: Sequence[pa.Table]) -> pa.Table:
    """One table of all; a column that is missing somewhere is empty there. Raises `pa.ArrowTypeError` where types clash."""
    return pa.concat_tables(tables, promote_options="permissive")


def _frame(tables: Sequence[pa.Table]) -> pd.DataFrame:
    if not tables:
        return pd.DataFrame(columns=list(KEPT))
    tables = [table.drop_columns(ADDED) for table in tables]
    try:
        found: pd.DataFrame = _joined(tables).to_pandas()
    except pa.ArrowTypeError:  # rows of older code, with other types under the same names
        found = pd.concat([table.to_pandas() for table in tables], ignore_index=True)
    return found


def _indexed(known: dict[str, pa.Table]) -> Index:
    names = list(known)
    if not names:
        nothing = np.empty(0, np.int32)
        return Index(
            [], pa.chunked_array([[]], pa.string()), nothing.astype(bool), nothing, nothing
        )
    every = pa.concat_tables(known.values())
    cell = pc.dictionary_encode(every["cell"]).combine_chunks().indices.to_numpy()
    added = every[ADDED].to_numpy()
    sizes = [len(table) for table in known.values()]
    part = np.repeat(np.arange(len(names), dtype=np.int32), sizes)
    row = np.concatenate([np.arange(size, dtype=np.int32) for size in sizes])
    order = np.lexsort((row, part, added))
    last = np.empty(len(every), np.int32)
    last[cell[order]] = order  # of equal cells the last one stays
    last = last[cell]
    order = order[((added == added[last]) & (part == part[last]))[order]]
    failed = every["failed"].to_numpy()
    return Index(names, every["cell"].take(order), failed[order], part[order], row[order])
