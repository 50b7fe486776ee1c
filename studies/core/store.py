"""A study's results on disk: its table and its recorded runs, safe against interruption and other writers."""

import errno
import hashlib
import io
import math
import os
import re
import shutil
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from glob import escape
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote
from warnings import warn

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import xarray as xr
from numpy.typing import NDArray

from alloc.recording import save
from alloc.sources import ASIDE, write_whole, writing
from studies.core.cell import Key, Row
from studies.core.claims import FOLDER
from studies.files.limits import check_parquet
from studies.files.study_error import StudyError
from studies.files.writable import make_folder

# Files whose names end with their checksum: written whole, never changed, and set aside where they are broken.
#
# Writers on several machines need no lock and no list of checksums: equal names mean equal content.

DIGITS = 16
"""Digits of SHA-256 in a name."""


class StoreWarning(UserWarning):
    """A file of a store was broken or contradicts another one; the message says which and what follows."""


class Gone(Exception):
    """Another process has replaced or set aside the file meanwhile."""


def write_checked(beginning: Path, suffix: str, write: Callable[[Path], object]) -> Path:
    """Make the file `beginning` + "-" + checksum + `suffix` by `write(file to fill)`; returns its path.

    It appears as a whole, and is on the disk by then. A `write` that raises leaves nothing behind.
    """
    with writing(beginning.with_name(f"{beginning.name}{suffix}")) as aside:
        write(aside)
        with open(aside, "rb+") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            os.fsync(file.fileno())
        path = beginning.with_name(f"{beginning.name}-{digest[:DIGITS]}{suffix}")
        os.replace(aside, path)
    return path


def read_checked(path: Path) -> bytes:
    """Content of a file; one that has changed since it was written is set aside. Raises `Gone` if nothing is left."""
    content = read_present(path)
    if hashlib.sha256(content).hexdigest()[:DIGITS] != path.stem[-DIGITS:]:
        set_aside(path, "it is not as it was written")
        raise Gone
    return content


def read_present(path: Path) -> bytes:
    """Content of a file; raises `Gone` where there is none."""
    try:
        return path.read_bytes()
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ESTALE):  # the latter over a network
            raise Gone from None
        raise StudyError(f"file {str(path)!r} cannot be read: {error.strerror}") from None


def set_aside(path: Path, reason: str) -> None:
    """Rename a broken file and warn; where another process has done so nothing is left to do."""
    places = (path.with_name(f"{path.name}.broken-{k}") for k in range(1, 10**6))
    place = next(place for place in places if not place.exists())
    try:
        path.rename(place)
    except FileNotFoundError:
        return
    except OSError:  # a folder for reading alone
        now = "it is passed over"
    else:
        now = f"it is now {place.name!r}, its content is computed again"
    warnings.warn(
        f"{str(path)!r} is broken ({reason}); {now}",
        StoreWarning,
        stacklevel=2,
    )


# The rows of a table in parquet files that are added and never changed: processes and machines add at once, without
# locks.
#
# Each writer keeps its last rows in one file, which it replaces by a longer one at each `add` until it is full. Of the
# rows of a cell those added last count, wherever they stand: so rows may stand twice, and a crash at any instant does
# no harm.

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


# The table as it was kept before: one file `runs.parquet` with its checksum in a list. It becomes a part of the new
# one.

TABLE, SUMS, LOCK = "runs.parquet", "SHA256SUMS", ".lock"
SCHEMA = 1


def take_over(folder: Path, parts: Parts) -> None:
    """Make the single table of `folder` a part; of another program it is refused, and left alone."""
    path = folder / TABLE
    try:
        added, content = path.stat().st_mtime_ns, read_present(path)
    except (FileNotFoundError, Gone):
        return
    sums = (folder / SUMS).read_text(errors="replace") if (folder / SUMS).exists() else ""
    listed = [line.partition("  ")[0] for line in sums.splitlines() if line.endswith(f"  {TABLE}")]
    if listed and hashlib.sha256(content).hexdigest() not in listed:
        set_aside(path, "it is not as it was written")
        return
    try:
        table = pd.read_parquet(io.BytesIO(content))
    except Exception as error:  # whatever a damaged file makes the library raise
        set_aside(path, " ".join(str(error).split()) or type(error).__name__)
        return
    if not set(KEPT) <= set(table) or table.attrs.get("schema", SCHEMA) != SCHEMA:
        raise other_version(path)
    if len(table):
        parts.add(pa.Table.from_pandas(table, preserve_index=False), added)
    for name in (TABLE, SUMS, LOCK):
        (folder / name).unlink(missing_ok=True)


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


# Stores of several folders united in one: what jobs on many machines computed apart.

MEASURED = ("wall_time", "solve_time", "rule_time", "controller_time", "controller_median", "controller_p99",
            "computing")  # fmt: skip
"""Columns, by their beginning, that are times of computing: another computation of the same has others."""
AT_ONCE = 20_000
"""Cells compared at once."""
CHECKED_RUN = re.compile(rf".*-[0-9a-f]{{{DIGITS}}}\.nc")


class Counts(NamedTuple):
    """Content of a folder in all its stores after a union."""

    cells: int
    runs: int


def unite(folders: Sequence[Path], out: Path) -> Counts:
    """Copy the tables and recorded runs of `folders`, and of all folders in them, to `out`.

    If rows of a cell differ, except for computing times, a `StoreWarning` is given; the rows that were added later count.
    Raises `StudyError` for a folder without a table.
    """
    found = {folder: sorted(_stores(folder)) for folder in folders}
    for folder, stores in found.items():
        # a folder without a file may be of a share without events
        if not stores and (not any(found.values()) or any(map(Path.is_file, folder.rglob("*")))):
            raise StudyError(
                f"folder {str(folder)!r} holds no table of a study; give an --out of before"
            )
    targets: dict[Path, Store] = {}
    for folder, stores in found.items():
        for place in stores:
            inside = place.relative_to(folder)
            target = targets.setdefault(inside, Store(out / inside))
            if target.folder.resolve() != place.resolve():
                _take(place, target)
    runs = sum(len(list((store.folder / RUNS).rglob("*.nc"))) for store in targets.values())
    return Counts(sum(len(store.cells()) for store in targets.values()), runs)


def _stores(folder: Path) -> Iterator[Path]:
    """Folders with a table: `folder` itself, or those in it."""
    yield from {path.parent for path in folder.rglob(TABLE)} | {
        path.parent for path in folder.rglob(ROWS) if any(map(NAME.fullmatch, (one.name for one in path.glob("*"))))
    }  # fmt: skip


def _take(place: Path, target: Store) -> None:
    source = Parts(place / ROWS)
    if (place / TABLE).exists():
        take_over(place, source)
    _compare(source, target.parts)
    while True:
        with suppress(Gone):  # else its owner works on, and has joined files meanwhile
            for name in source.index().names:
                _copy(place / ROWS / name, target.path / name)
            break
    for path in (place / RUNS).rglob("*.nc"):
        if CHECKED_RUN.fullmatch(path.name):
            with suppress(Gone):
                _copy(path, target.folder / path.relative_to(place))
    for path in (place / FOLDER).glob("*.json"):
        kept = target.folder / path.relative_to(place)
        kept.parent.mkdir(exist_ok=True)
        if not kept.exists():
            shutil.copyfile(path, kept)


def _copy(source: Path, target: Path) -> None:
    content = read_checked(source)
    if not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, lambda aside: aside.write_bytes(content))


def _compare(source: Parts, target: Parts) -> None:
    """Warn where rows of a cell differ that both hold."""
    mine, other = target.index(), source.index()
    both = other.cell.filter(pc.is_in(other.cell, mine.cell)).unique().to_pylist()
    differing, first = 0, ""
    for start in range(0, len(both), AT_ONCE):
        cells = both[start : start + AT_ONCE]
        bad, words = _differences(target.rows_of(cells), source.rows_of(cells))
        differing, first = differing + bad, first or words
    if differing:
        warn(
            f"{differing} cells have other rows in {str(source.folder)!r} than in {str(target.folder)!r}: {first}; "
            "the rows that were added later count",
            StoreWarning,
            stacklevel=4,
        )


def _differences(mine: pd.DataFrame, other: pd.DataFrame) -> tuple[int, str]:
    """Cells whose rows differ, and the first of them in words; both tables hold the same cells in the same order."""
    counts = mine["cell"].value_counts() - other["cell"].value_counts()
    uneven = sorted(counts.index[counts != 0])
    one, two = (
        rows[~rows["cell"].isin(uneven)].reset_index(drop=True).astype(object)
        for rows in (mine, other)
    )
    two = two.reindex(columns=[*one, *two.columns.difference(one.columns)])
    one = one.reindex(columns=two.columns)
    compared = [name for name in two if not str(name).startswith(MEASURED)]
    differ = ~((one == two) | (one.isna() & two.isna()))[compared]
    bad = np.flatnonzero(differ.any(axis=1))
    if uneven:
        words = f"cell {uneven[0]} has other numbers of rows"
    elif len(bad):
        row = one.iloc[bad[0]]
        name = next(name for name in compared if differ[name][bad[0]])
        known = [
            str(row[part]) for part in ("scenario", "rule", "controller", "seed") if part in row
        ]
        words = f"cell {row['cell']} {'/'.join(known)} has {name} = {two[name][bad[0]]}, not {row[name]}"
    else:
        words = ""
    return len(uneven) + one["cell"][bad].nunique(), words
