"""Studies: cells run in parallel, rows kept as they come, then a table, a figure and statements.

A study is one file that ends with a `Study`. The rows of a cell become a line of a file that is only added to. So a killed
program loses the cells that were running, two writers do no harm to each other, and the union of two folders is one file
behind the other. A cell is known by what decides its rows, see `studies.runner.row_key`; what is there is not run again.
"""

import json
import multiprocessing
import os
import pickle
import platform
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import closing, contextmanager, redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from pandas.api.types import is_float
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from alloc.files import write_whole
from studies import SourcesChanged, StudyError, WorkerLost
from studies.runner.plugins import ASKED, load_plugins, loaded_files, slow
from studies.runner.row_key import ROWS, key_of, read_anew
from studies.statistics import Statement, statement_table, told

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
    others: Mapping[str, Callable[[pd.DataFrame], pd.DataFrame]] = field(default_factory=dict)
    """Further tables of the same rows, by name."""

    def tables(self, rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
        """Everything that is made of the rows as a table, by name: first "table", last "statements"."""
        made = {"table": self.table, **self.others}
        found = {name: make(rows) for name, make in made.items()}
        if self.statements is not None:
            found["statements"] = statement_table(self.statements(rows))
        return found

    def keyed(self, events: int | None, seed: int | None) -> dict[str, Cell]:
        """The cells of so many events of this seed, by their keys; None stands for the study's own."""
        read_anew()
        cells = self.cells(events or self.events, self.seed if seed is None else seed)
        return {key_of(self.run, one.args, one.sources): one for one in cells}


# rows that are kept

BOOKKEEPING = ("cell", "name", "status", "reason", "wall_time", "batch")
"""Columns that every row has: its cell's key and name; ok, failed or degraded, and why; seconds; when it was made [ns]."""


def kept_rows(folder: str | Path) -> dict[str, list[Row]]:
    """Rows by their cell's key, of a cell those that were added last. A line that was cut off is passed over."""
    path, found = Path(folder) / ROWS, dict[str, list[Row]]()
    for line in path.read_bytes().splitlines() if path.exists() else ():
        with suppress(ValueError, KeyError, TypeError):
            one = json.loads(line)
            found[one["cell"]] = [
                {key: np.nan if x is None else x for key, x in row.items()} for row in one["rows"]
            ]
    return found


def _keep(folder: str | Path, made: Mapping[str, list[Row]]) -> None:
    """Add rows of cells, all at once, so that several programs can. Raises `StudyError` where they cannot be written."""
    strict = {key: [{name: None if is_float(x) and x != x else x for name, x in row.items()} for row in rows]
              for key, rows in made.items()}  # fmt: skip
    lines = [json.dumps({"cell": key, "rows": rows}, default=lambda one: one.tolist())
             for key, rows in strict.items()]  # fmt: skip
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
        with open(Path(folder) / ROWS, "ab+") as file:
            # the last line may have been cut off where a disk was full
            file.seek(max(0, file.tell() - 1))
            begin = "" if file.read(1) in (b"", b"\n") else "\n"
            file.write("\n".join([begin + lines[0], *lines[1:], ""]).encode())
    except OSError as error:
        told = f"{folder}: rows cannot be written there ({error.strerror})"
        raise StudyError(told) from None


def in_one_line(error: BaseException) -> str:
    """Type and message of an error."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


# who works

REACHED = 10
"""Seconds within which a scheduler answers and has a worker."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _done(
    tasks: Iterable[bytes], jobs: int, scheduler: str | None
) -> Generator[dict[str, list[Row]], None, None]:
    """Rows of each task as it is done: by this process, by processes of this machine, or by a Dask cluster."""
    files = loaded_files()
    if scheduler is None and jobs == 1:
        yield from (_do(task, files) for task in tasks)
        return
    with _processes(jobs) if scheduler is None else _cluster(scheduler) as pool:
        for one in as_completed([pool.submit(_do, task, files) for task in tasks]):
            try:
                yield one.result()
            except WorkerLost:
                raise
            # what a cell raises is a row: a worker was lost, or what it was given
            except Exception as error:
                raise WorkerLost(
                    f"a worker was lost ({in_one_line(error)}); what was computed is kept: run again, with fewer jobs if "
                    'memory was short. A script that asks for jobs does so under if __name__ == "__main__"'
                ) from None


@contextmanager
def _processes(jobs: int) -> Iterator[Executor]:
    """Processes, which are killed where the work is broken off."""
    # never forked from here: a thread of this program may hold a lock that a fork would wait for
    context = multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")
    if sys.platform == "linux":
        context.set_forkserver_preload(["studies.run_cell"])
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, context, begin_worker)
    try:
        yield pool
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.kill()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _cluster(scheduler: str) -> Iterator[Executor]:
    """The workers of a Dask scheduler, by its address or by the file that it wrote."""
    try:
        from distributed import Client
    except ImportError:
        told = "--scheduler needs the package 'distributed': pip install distributed"
        raise StudyError(told) from None
    given = {"scheduler_file" if os.path.isfile(scheduler) else "address": scheduler}
    try:
        client = Client(**given, timeout=REACHED, set_as_default=False)
        client.wait_for_workers(1, timeout=REACHED)
    except (OSError, TimeoutError, ValueError) as error:
        told = f"--scheduler {scheduler}: nobody works there ({in_one_line(error)})"
        raise StudyError(told) from None
    with client:
        yield client.get_executor(pure=False, retries=3)


def begin_worker() -> None:
    """A worker leaves signals to its parent, and ends when that ends, however."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


# running

TOGETHER = 8
"""Cells that are handed out together at most; neighbours share what they prepare."""


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
    cells, rows = study.keyed(events, seed), kept_rows(folder)
    if retry_failed:
        rows = {key: own for key, own in rows.items() if not own or own[0]["status"] != "failed"}
    todo = [one for one in cells.items() if one[0] not in rows]
    if slowed := [one for _, one in todo if one.columns.get("rule") in slow]:
        spent = sum(slow[one.columns["rule"]] * ASKED * one.args[0].duration_s for one in slowed)
        told = f"these {len(todo)} runs take about {spent / 60.0 / jobs:.1f} min"
        print(f"readhesion: {told}", file=sys.stderr)
    size = min(TOGETHER, len(todo) // (8 * jobs) + 1)
    tasks = (pickle.dumps((study.run, todo[k : k + size])) for k in range(0, len(todo), size))
    if todo:
        with (
            _progress(study.name, len(cells), quiet) as tell,
            closing(_done(tasks, min(jobs, len(todo)), scheduler)) as done,
        ):
            tell(len(cells) - len(todo))
            for made in done:
                _keep(folder, made)
                rows |= made
                tell(len(made))
    # what cells say of themselves is said anew: a label may have changed since the rows were computed
    own = {key: {"cell": key, "name": one.name, **one.columns} for key, one in cells.items()}
    found = pd.DataFrame(
        said | row | said for key, said in own.items() for row in rows.get(key, ())
    )
    return found if len(found) else pd.DataFrame(columns=list(BOOKKEEPING))


def _do(task: bytes, plugins: Sequence[str]) -> dict[str, list[Row]]:
    """The rows of some cells by their keys. What goes wrong in a cell is its row; a fault of the place is raised."""
    load_plugins(
        plugins
    )  # before their functions are unpickled; and files of users count as they are now
    run, cells = pickle.loads(task)
    found = {}
    for key, cell in cells:
        start = time.perf_counter()
        rows: list[Row]
        try:
            if key_of(run, cell.args, cell.sources) != key:
                raise SourcesChanged(
                    f"process {os.getpid()} on {platform.node()} has other sources than the program that asked: "
                    "they changed, or a part has no file that is loaded as a plug-in, then give jobs = 1; or workers "
                    "of a cluster are old, then start new ones. What was computed is kept"
                )
            with redirect_stdout(sys.stderr):  # where a part prints; stdout is for results
                made = run(*cell.args)
            rows = made if isinstance(made, list) else [made]
        except WorkerLost:
            raise
        except MemoryError as error:
            raise WorkerLost(
                f"{in_one_line(error)}; what was computed is kept: run again with fewer jobs"
            ) from None
        except Exception as error:
            at = traceback.extract_tb((error.__cause__ or error).__traceback__)[-1]
            place = f"{Path(at.filename).name}:{at.lineno}"
            rows = [{"status": "failed", "reason": f"{in_one_line(error)} (at {place})"}]
        spent = (time.perf_counter() - start) / max(1, len(rows))
        own = {"status": "ok", "reason": "", "wall_time": spent}
        found[key] = [own | row | {"batch": time.time_ns()} for row in rows]
    return found


@contextmanager
def _progress(name: str, total: int, quiet: bool) -> Iterator[Callable[[int], None]]:
    console, columns = Console(stderr=True), (*Progress.get_default_columns(), MofNCompleteColumn())
    off = quiet or not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=off) as bar:
        task = bar.add_task(f"{name} (compiles at first)", total=total)
        try:
            yield lambda cells: bar.advance(task, cells)
        except KeyboardInterrupt as stopped:
            if made := round(bar.tasks[0].completed):
                stopped.add_note(
                    f"finished rows are kept, {made} of {total}; the same command goes on"
                )
            raise


def missing(
    study: Study, folder: str | Path, events: int | None, seed: int | None
) -> tuple[int, int, float]:
    """Number of a study's cells, of those that `folder` lacks, and mean seconds of a stored row (nan without any)."""
    cells, have = study.keyed(events, seed), kept_rows(folder)
    spent = [row["wall_time"] for rows in have.values() for row in rows]
    return len(cells), len(set(cells) - set(have)), float(np.mean(spent)) if spent else np.nan


# what is written


def write_results(study: Study, rows: pd.DataFrame, folder: str | Path) -> dict[str, pd.DataFrame]:
    """Write the rows of a run as `rows.parquet`, and what the study makes of them: its tables, which are returned, and
    figure.pdf; nothing where all runs failed."""
    folder = Path(folder)
    write_whole(folder / "rows.parquet", lambda aside: rows.to_parquet(aside, index=False))
    if not (rows["status"] == "ok").any():
        return {}
    tables = study.tables(rows)
    for name, one in tables.items():
        write_table(one, folder / name, told(one) if name == "statements" else None)
    if study.figure is not None:
        write_whole(folder / "figure.pdf", study.figure(rows).savefig)
    return tables


def write_table(
    table: pd.DataFrame, path: str | Path, for_people: pd.DataFrame | None = None
) -> None:
    """The table as .parquet, .csv and .md (`for_people`) beside each other; `path` is without ending."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    plain = table.copy()
    plain.attrs = {}
    shown = markdown(plain if for_people is None else for_people)
    for ending, write in (
        (".parquet", lambda aside: plain.to_parquet(aside, index=False)),
        (".csv", lambda aside: plain.to_csv(aside, index=False)),
        (".md", lambda aside: aside.write_text(shown, "utf-8")),
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
