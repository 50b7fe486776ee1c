"""Run the cells that a store lacks, in parallel, and store every row as soon as it is computed."""

import os
import sys
import time
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import closing, redirect_stdout
from fnmatch import fnmatchcase
from itertools import islice
from queue import Empty, SimpleQueue

import pandas as pd

from studies.core import interruption
from studies.core.cell import Cell, Key, OnRow, Outcome, Row, Shared, key_of, run_cell
from studies.core.first_work import alone_at_first
from studies.core.plugins import VARIABLE
from studies.core.store import Store
from studies.core.workers import Jobs, Workers, workers
from studies.files.study_error import StudyError

FLUSH_INTERVAL = 2.0
"""Rows are written at least this often [s] while cells finish."""
TASKS_EACH = 4
"""Tasks that each worker should get at least: it may get longer ones than another."""
AHEAD = 2
"""Tasks per worker that are handed out at once, so that no worker waits for the next. The processes' own queue has room for
as many, and ends quietly when it is killed."""


def run_cells(
    cells: Sequence[Cell],
    store: Store,
    jobs: Jobs = 1,
    keep: Sequence[str] = (),
    retry_failed: bool = False,
    on_row: OnRow | None = None,
    check: Callable[[], None] | None = None,
) -> pd.DataFrame:
    """Run the cells that `store` does not have yet; returns the rows of all, in their order.

    `jobs`: processes, or workers that the caller has. `keep`: patterns of labels, such as ``wet-*/exact/*/0``, whose runs
    are recorded as netCDF. Cells that failed are kept with their reason and not run again unless `retry_failed`. After an
    interrupt, computed rows are kept. `check` is called first if anything is to be run. Raises `StudyError` where a worker
    is lost.
    """
    keys = [key_of(cell) for cell in cells]
    missing = _missing(cells, keys, store, keep, retry_failed)
    if missing:
        store.check_writable()
        if check is not None:
            check()
    done = len(cells) - len(missing)
    if on_row is not None:
        on_row("preparing (compiles on first use)" if missing else "", done, len(cells))
    pending: list[Row] = []
    flushed = time.monotonic()
    try:
        with workers(jobs) as others, closing(_outcomes(missing, others)) as outcomes:
            for outcome in outcomes:
                if outcome is not None:
                    pending += outcome.rows
                    if outcome.run is not None:
                        store.save_run(outcome.key, outcome.run)
                    done += 1
                    if on_row is not None:
                        on_row(outcome.key.label, done, len(cells))
                if pending and time.monotonic() - flushed > FLUSH_INTERVAL:
                    store.add(pending)
                    pending, flushed = [], time.monotonic()
                interruption.check()
    finally:
        store.add(pending)
    return store.rows_of(keys)


Work = tuple[Cell, Key, bool]
"""A cell, its identity, and whether its recorded run is to be kept."""


def _missing(
    cells: Sequence[Cell],
    keys: Sequence[Key],
    store: Store,
    keep: Sequence[str],
    retry_failed: bool,
) -> list[Work]:
    """What is to be done: the first cell, for it compiles; then the slow ones, lest one of them is left to the end."""
    succeeded = store.cells(keys)
    work = []
    for cell, key in zip(cells, keys, strict=True):
        kept = any(fnmatchcase(key.label, pattern) for pattern in keep)
        done = succeeded.get(key.digest)  # None: not there
        again = kept and not store.has_run(key) if done else done is None or retry_failed
        if again:
            work.append((cell, key, kept))
    return work[:1] + sorted(work[1:], key=lambda one: one[0].group is not None)


def _tasks(work: Sequence[Work], count: int, together: int = 1) -> list[list[Work]]:
    """The work in parts for `count` workers: the cells of a group in one, or in several where there were too few parts.

    A part takes groups until it has `together` cells. A cell without a group is a part of its own.
    """
    groups: dict[Hashable, list[Work]] = {}
    for k, one in enumerate(work):
        group = one[0].group
        groups.setdefault(k if group is None else group, []).append(one)
    longest = max(1, len(work) // max(1, count * TASKS_EACH))
    tasks: list[list[Work]] = []
    full = True
    for some in groups.values():
        single = some[0][0].group is None
        full = full or single or len(tasks[-1]) >= together
        for one in some:
            if full or len(tasks[-1]) >= longest:
                tasks.append([])
            tasks[-1].append(one)
            full = single
    return tasks


def _outcomes(work: Sequence[Work], others: Workers | None) -> Generator[Outcome | None]:
    """What becomes of the cells, as they finish; None where nothing did for a while."""
    if others is None or len(work) <= 1:
        for task in _tasks(work, 0):
            yield from _do(task)
    else:
        yield from _elsewhere(iter(_tasks(work, others.count, others.together)), others)


def _elsewhere(tasks: Iterator[list[Work]], others: Workers) -> Generator[Outcome | None]:
    finished: SimpleQueue[Future[list[Outcome]]] = SimpleQueue()
    lost: list[Exception] = []
    """What cells raise are rows; other errors say that a worker or its work was lost."""

    def submit(some: Iterable[list[Work]]) -> int:
        count = 0
        try:
            for task in some:
                future = others.submit(do_task, task, os.environ.get(VARIABLE, ""))
                future.add_done_callback(finished.put)
                count += 1
        except Exception as error:
            lost.append(error)
        return count

    running = submit(islice(tasks, others.count * AHEAD))
    while running:
        try:
            future = finished.get(timeout=FLUSH_INTERVAL)
        except Empty:
            yield None
            continue
        running -= 1
        try:
            outcomes = future.result()
        except Exception as error:
            lost.append(error)
            continue
        yield from outcomes
        running += submit(islice(tasks, 0 if lost else 1))
    if lost:
        raise _lost(lost[0])


def _lost(error: Exception) -> StudyError:
    if isinstance(error, StudyError):
        return error
    reason = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
    return StudyError(
        f"a worker or its work was lost ({reason}); what was computed is kept; run again, with fewer "
        "--jobs if memory was short"
    )


def do_task(task: Sequence[Work], plugins: str) -> list[Outcome]:
    """Do the cells of a task, in a worker; `plugins`: the caller's files, see `studies.core.plugins.VARIABLE`."""
    os.environ[VARIABLE] = plugins
    return list(_do(task))


def _do(task: Sequence[Work]) -> Iterator[Outcome]:
    shared: Shared = {}
    group = None
    for cell, key, keep in task:
        if cell.group != group:
            group, shared = cell.group, {}
        # a part of one's own may print; stdout is for results
        with alone_at_first(cell.programs), redirect_stdout(sys.stderr):
            outcome = run_cell(cell, key, keep, shared)
        yield outcome
