"""Studies: cells run in parallel, rows kept as they come, then a table, a figure and statements.

A study is one file that ends with a `Study`. Each batch of rows becomes one parquet file in the folder `parts`, written
aside and renamed under a name of its own. So a killed program loses the batches that were running, two writers do no harm
to each other, and the union of two folders is a copy of their files. A cell is known by what decides its rows, see
`studies.row_key`; what is there is not run again.
"""

import hashlib
import io
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from alloc.sources import write_whole
from studies import StudyError, WorkerLost
from studies.plugins import load_plugins, loaded_files
from studies.row_key import decides, key_of
from studies.statistics import Statement, statement_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure  # half a second that workers do not need

Row = dict[str, Any]
NARROW, WIDE = 3.5, 7.16
"""Widths [in] of a figure in one and in two columns of a paper."""


class Cell(NamedTuple):
    """A piece of work: `run(*args)` of its study gives one row, or a list of rows."""

    name: str
    """For people; in reasons and progress."""
    args: tuple[Any, ...]
    columns: Mapping[str, Any] = {}
    """What each of its rows says beside what `run` gives."""
    sources: tuple[str, ...] = ()
    """Modules that decide its rows and that `run` does not name: those of parts that `args` call by name."""


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
    """How many, and of which seed, where nobody says it: those of the stored tables."""

    def keyed(self, events: int | None, seed: int | None) -> dict[str, Cell]:
        """The cells of so many events of this seed, by their keys; None stands for the study's own."""
        cells = self.cells(events or self.events, self.seed if seed is None else seed)
        return {key_of(self.run, one.args, one.sources): one for one in cells}


# rows that are kept

FLUSH = 2.0
"""Rows are written at least this often [s]."""
MANY = 64
"""Files that a finished run joins into one."""
BOOKKEEPING = ("cell", "name", "status", "reason", "wall_time", "batch")
"""Columns that every row has: its cell's key and name; ok, failed or degraded, and why; seconds; when it was written."""


class Rows:
    """The rows of a study in a folder."""

    def __init__(self, folder: str | Path) -> None:
        self.parts = Path(folder) / "parts"

    def _paths(self) -> list[Path]:
        return sorted(self.parts.glob("[0-9]*.parquet"))  # by time

    def read(self) -> pd.DataFrame:
        """All rows; of a cell those that were written last. A damaged file is left out, with a warning."""
        while True:
            try:
                found = [table for path in self._paths() if (table := _part(path)) is not None]
                break
            except FileNotFoundError:  # another writer has joined it to others
                continue
        if not found:
            return pd.DataFrame(columns=list(BOOKKEEPING))
        rows = pa.concat_tables(found, promote_options="permissive").to_pandas()
        last = rows.groupby("cell")["batch"].transform("max")
        return rows[rows["batch"] == last].drop_duplicates().reset_index(drop=True)

    def add(self, rows: Sequence[Row]) -> None:
        """Keep rows, in one new file. Raises `StudyError` where it cannot be written."""
        if rows:
            self._write(pd.DataFrame(rows).assign(batch=time.time_ns()))

    def join(self) -> None:
        """Make one file of many; a reader that meets this reads again."""
        paths = self._paths()
        if len(paths) > MANY:
            self._write(self.read())
            for path in paths:
                path.unlink(missing_ok=True)

    def _write(self, table: pd.DataFrame) -> None:
        """As a file whose name has the time and the digest of its content."""
        buffer = io.BytesIO()
        table.to_parquet(buffer, index=False)
        content = buffer.getvalue()
        path = self.parts / f"{time.time_ns()}-{_digest(content)}.parquet"
        try:
            self.parts.mkdir(parents=True, exist_ok=True)
            write_whole(path, lambda aside: aside.write_bytes(content))
        except OSError as error:
            told = f"{self.parts}: rows cannot be written there ({error.strerror})"
            raise StudyError(told) from None


def _part(path: Path) -> pa.Table | None:
    """The table of a file; None of one that is damaged. Parquet's own checksums leave out what describes the columns."""
    content = path.read_bytes()
    try:
        if _digest(content) != path.stem.rpartition("-")[2]:
            raise ValueError("its content is not what was written")
        return pq.read_table(io.BytesIO(content))
    except (OSError, pa.ArrowException, ValueError) as error:
        warnings.warn(
            f"{path} is damaged ({in_one_line(error)}): it is left out, and its cells are run again; delete it",
            stacklevel=4,
        )
        return None


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def in_one_line(error: BaseException) -> str:
    """Type and message of an error."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


# who works

REACHED = 10
"""Seconds within which a scheduler answers and has a worker."""
AHEAD = 2
"""Tasks on their way for each worker, so that none waits."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Here(Executor):
    """Does a task at once, in this process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **options: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **options))
        return done


@contextmanager
def workers(jobs: int = 1, scheduler: str | None = None) -> Iterator[tuple[Executor, int]]:
    """An executor, and how many tasks it is to have: this process, processes of this machine, or a Dask cluster."""
    if scheduler is not None:
        with _cluster(scheduler) as found:
            yield found
    elif jobs == 1:
        yield _Here(), 1
    else:
        # never forked from here: a thread of this program may hold a lock that a fork would wait for
        server = "forkserver" if sys.platform == "linux" else "spawn"
        context = multiprocessing.get_context(server)
        if server == "forkserver":
            context.set_forkserver_preload(["studies.runs"])
        before = set(multiprocessing.active_children())
        pool = ProcessPoolExecutor(jobs, context, _begin, (loaded_files(),))
        try:
            yield pool, AHEAD * jobs
        except BaseException:
            for process in set(multiprocessing.active_children()) - before:
                process.kill()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _cluster(scheduler: str) -> Iterator[tuple[Executor, int]]:
    """The workers of a Dask scheduler, by its address or by the file that it wrote."""
    try:
        from distributed import Client
    except ImportError:
        told = "--scheduler needs the package 'distributed': pip install distributed"
        raise StudyError(told) from None
    given = {"scheduler_file": scheduler} if os.path.isfile(scheduler) else {"address": scheduler}
    try:
        client = Client(**given, timeout=REACHED, set_as_default=False)
        client.wait_for_workers(1, timeout=REACHED)
    except (OSError, TimeoutError, ValueError) as error:
        told = f"--scheduler {scheduler}: nobody works there ({in_one_line(error)})"
        raise StudyError(told) from None
    with client:
        threads = sum(client.nthreads().values())
        yield client.get_executor(pure=False, retries=3), AHEAD * threads


def _begin(plugins: Sequence[str]) -> None:
    """A worker loads the user's files, leaves signals to its parent, and ends when that ends, however."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
    load_plugins(plugins)


# running

BATCH_TIME = 1.0
"""Seconds of work that are handed out together; handing out takes milliseconds."""
LARGEST = 64
"""Cells that are handed out together at most."""


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
    cells, rows = study.keyed(events, seed), Rows(folder)
    have = rows.read()
    done = set(have["cell"] if not retry_failed else have.loc[have["status"] != "failed", "cell"])
    todo = [(key, cell) for key, cell in cells.items() if key not in done]
    if todo:
        at_once = workers(min(jobs, len(todo)), scheduler)
        with _progress(study.name, len(cells), quiet) as tell, at_once as (pool, ahead):
            tell(len(cells) - len(todo))
            _run(study.run, todo, rows, pool, ahead, tell)
        rows.join()
        have = rows.read()
    # what cells say of themselves is said anew: a label may have changed since the rows were computed
    told = pd.DataFrame(
        {"cell": key, "name": one.name, **one.columns} for key, one in cells.items()
    )
    own = have.drop(columns=[name for name in told if name != "cell" and name in have])
    return told.merge(own, on="cell") if cells else own


def _run(
    run: Callable[..., Any],
    left: list[tuple[str, Cell]],
    rows: Rows,
    pool: Executor,
    ahead: int,
    tell: Callable[[int], None],
) -> None:
    """Do what is left in batches of about `BATCH_TIME`; rows are kept every `FLUSH` seconds, and at the end."""
    files, running, pending = loaded_files(), set[Future[list[Row]]](), list[Row]()
    size, flushed = 1, time.monotonic()
    try:
        while left or running:
            while left and len(running) < ahead:
                batch, left = left[:size], left[size:]
                task = [(key, one, decides(run, one.sources)) for key, one in batch]
                running.add(pool.submit(_do, pickle.dumps((run, task)), files))
            done, running = wait(running, timeout=FLUSH, return_when=FIRST_COMPLETED)
            for one in done:
                pending += (made := _made(one))
                tell(len({row["cell"] for row in made}))
                spent = max(1e-3, float(np.mean([row["wall_time"] for row in made])))
                # the last batches are small, lest one is late
                size = max(1, min(int(BATCH_TIME / spent), LARGEST, len(left) // (2 * ahead)))
            if pending and time.monotonic() - flushed > FLUSH:
                rows.add(pending)
                pending, flushed = [], time.monotonic()
    finally:
        rows.add(pending)


def _made(future: Future[list[Row]]) -> list[Row]:
    try:
        return future.result()
    except StudyError:
        raise
    except Exception as error:
        # what a cell raises is a row: a worker was lost, or what it was given
        raise WorkerLost(
            f"a worker was lost ({in_one_line(error)}); what was computed is kept: run again, with fewer jobs if memory "
            'was short. A script that asks for jobs does so under if __name__ == "__main__"'
        ) from None


def _do(task: bytes, plugins: Sequence[str]) -> list[Row]:
    """The rows of some cells, in a worker. What goes wrong in a cell is its row."""
    load_plugins(plugins)
    run, cells = pickle.loads(task)
    found = []
    for key, cell, code in cells:
        start = time.perf_counter()
        rows: list[Row]
        try:
            if decides(run, cell.sources) != code:
                raise StudyError("the sources changed while the study ran; run it again")
            with redirect_stdout(sys.stderr):  # where a part prints; stdout is for results
                made = run(*cell.args)
            rows = list(made) if isinstance(made, list) else [made]
        except Exception as error:
            at = traceback.extract_tb(error.__traceback__)[-1]
            place = f"{Path(at.filename).name}:{at.lineno}"
            rows = [{"status": "failed", "reason": f"{in_one_line(error)} (at {place})"}]
        own = {"cell": key, "name": cell.name, **cell.columns, "status": "ok", "reason": ""}
        own["wall_time"] = (time.perf_counter() - start) / max(1, len(rows))
        found += [own | row for row in rows]
    return found


@contextmanager
def _progress(name: str, total: int, quiet: bool) -> Iterator[Callable[[int], None]]:
    console, columns = Console(stderr=True), (*Progress.get_default_columns(), MofNCompleteColumn())
    off = quiet or not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=off) as bar:
        task = bar.add_task(f"{name} (compiles at first)", total=total)
        yield lambda cells: bar.advance(task, cells)


def missing(
    study: Study, folder: str | Path, events: int | None, seed: int | None
) -> tuple[int, int, float]:
    """Number of a study's cells, of those that `folder` lacks, and mean seconds of a stored row (nan without any)."""
    cells, have = study.keyed(events, seed), Rows(folder).read()
    return len(cells), len(set(cells) - set(have["cell"])), float(have["wall_time"].mean())


# what is written


def write_results(study: Study, rows: pd.DataFrame, folder: str | Path) -> None:
    """The rows of a run as `rows.parquet`, and what the study makes of them: table, statements, figure.pdf."""
    folder = Path(folder)
    write_whole(folder / "rows.parquet", lambda aside: rows.to_parquet(aside, index=False))
    if not (rows["status"] == "ok").any():
        return
    write_table(study.table(rows), folder / "table")
    if study.statements is not None:
        write_table(statement_table(study.statements(rows)), folder / "statements")
    if study.figure is not None:
        write_whole(folder / "figure.pdf", study.figure(rows).savefig)


def write_table(table: pd.DataFrame, path: str | Path) -> None:
    """The table as .parquet, .csv and .md beside each other; `path` is without ending."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = table.copy()
    plain.attrs = {}
    for ending, write in (
        (".parquet", lambda aside: plain.to_parquet(aside, index=False)),
        (".csv", lambda aside: plain.to_csv(aside, index=False)),
        (".md", lambda aside: aside.write_text(markdown(plain), "utf-8")),
    ):
        write_whole(path.with_name(path.name + ending), write)


def markdown(table: pd.DataFrame) -> str:
    """A table of GitHub's Markdown; columns of numbers are flush right."""

    def text(value: Any) -> str:
        if isinstance(value, float):
            return "" if np.isnan(value) else f"{value:.3f}"
        return str(value).replace("|", "\\|")

    right = ["--:" if table[name].dtype.kind in "fiu" else "---" for name in table]
    body = [[text(one) for one in row] for row in table.itertuples(index=False)]
    head = [str(name) for name in table]
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, right, *body))
