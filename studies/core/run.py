"""Run the cells that a store lacks, in parallel, and store every row as soon as it is computed."""

import asyncio
import ctypes
import gc
import json
import multiprocessing
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import closing, contextmanager, redirect_stdout
from copy import copy
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, NamedTuple, TypeVar

import pandas as pd

from studies.core import interruption
from studies.core.cell import Cell, Key, OnRow, Outcome, Row, Shared, key_of, run_cell
from studies.core.job import Job
from studies.core.plugins import VARIABLE
from studies.core.store import Store
from studies.files.study_error import StudyError

# Who does the work of cells: processes of this machine, or workers of a cluster, behind one small interface.

PARENT_PERIOD = 0.5
"""Period at which a worker checks whether its parent lives [s], where the system does not notify it."""
CONNECT_TIME = 10.0
"""Time [s] within which a scheduler must answer, and have a worker."""
TOGETHER = 32
"""Number of cells in a task for a cluster, whose scheduler takes milliseconds per task."""
_PR_SET_PDEATHSIG = 1


@dataclass(frozen=True)
class Workers:
    """Those who do tasks beside this process."""

    submit: Callable[..., "Future[Any]"]
    """Called with a function and its arguments; they travel, and so does what the function returns."""
    count: int
    """Tasks that are done at once."""
    together: int = 1
    """Cells that a task should have where they are compiled and short: handing out a task takes time too."""


@contextmanager
def processes(count: int) -> Iterator[Workers]:
    """`count` processes of this machine, started with the first task. Leaving by an error or an interrupt kills them.

    On Linux they are forks, which have what this process has imported and compiled; elsewhere they start from the beginning.
    """
    context: Any = copy(multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn"))
    start, made = context.Process, []

    def started(*arguments: Any, **options: Any) -> Any:
        made.append(start(*arguments, **options))
        return made[-1]

    context.Process = started  # of this copy: the executor names its processes nowhere
    executor = ProcessPoolExecutor(count, context, _begin, (os.getpid(),))
    interrupted = True
    try:
        yield Workers(executor.submit, count)
        interrupted = False
    finally:
        if interrupted:
            for process in made:
                if process.is_alive():
                    process.kill()
        executor.shutdown(wait=True, cancel_futures=interrupted)


@contextmanager
def cluster(scheduler: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler by its address, such as ``tcp://node7:8786``, or by the file that it wrote.

    What a lost worker had to do is done by another. Raises `StudyError` where nobody answers or `distributed` is missing.
    """
    try:
        from distributed import Client
    except ImportError:
        raise StudyError(
            "--executor dask needs the package 'distributed': pip install -e '.[dask]'"
        ) from None
    try:
        address = asyncio.run(_reach(scheduler))
    except (OSError, ValueError, TypeError, KeyError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise StudyError(f"--scheduler {scheduler!r}: nobody answers there: {reason}") from None
    with Client(address, timeout=CONNECT_TIME, set_as_default=False) as client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_TIME)
        except TimeoutError:
            raise StudyError(
                f"--scheduler {scheduler!r} has no workers; start some: dask worker {address}"
            ) from None
        executor = client.get_executor(
            pure=False
        )  # equal tasks are done again, as when they are retried
        yield Workers(executor.submit, sum(client.nthreads().values()), TOGETHER)


async def _reach(scheduler: str) -> str:
    """Address of the scheduler, if somebody answers there: a client that finds nobody would take long to give up."""
    from distributed.comm import connect
    from distributed.core import coerce_to_address
    from distributed.security import Security

    path = Path(scheduler)
    address = json.loads(path.read_text())["address"] if path.is_file() else scheduler
    found = str(coerce_to_address(address))
    secrets = Security().get_connection_args("client")  # of Dask's own configuration
    comm = await connect(found, timeout=CONNECT_TIME, **secrets)
    await comm.close()
    return found


Jobs = int | Workers | None
"""How many processes are to work, or who does; None, as 1, for this process alone."""


@contextmanager
def workers(jobs: Jobs) -> Iterator[Workers | None]:
    """Those who work: of `processes` if a number is given, which end with the block; None for this process alone."""
    if isinstance(jobs, int) and jobs > 1:
        with processes(jobs) as made:
            yield made
    else:
        yield jobs if isinstance(jobs, Workers) else None


def _begin(parent: int) -> None:
    """Leave signals to the parent, and end when it ends, however that comes about."""
    # an interrupt from the keyboard reaches every process; the parent alone decides what happens then
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    gc.freeze()  # what a fork inherits is not collected: looking at it would copy it
    # a thread of the parent may have held the lock of its stream when this process was forked
    sys.stderr = open(2, "w", errors="replace", closefd=False)  # noqa: SIM115
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_PERIOD)
    os._exit(1)


_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1  # of mallopt(3)
LARGEST, KEPT = 32 << 20, 1 << 30


def reuse_memory() -> None:
    """Let the next run have the memory of the last one: the system takes a tenth of a run to give the same pages again.

    Of blocks to `LARGEST` bytes, the greatest that glibc allows, and while no more than `KEPT` are free at the end.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:  # musl has none
        mallopt(_MMAP_THRESHOLD, LARGEST)
        mallopt(_TRIM_THRESHOLD, KEPT)


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
        reuse_memory()
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


def forecast(cells: Sequence[Cell], store: Store, jobs: int) -> str:
    """How many of the cells the store lacks, and about how long they take, by the rows of the store."""
    keys = [key_of(cell) for cell in cells]
    lacking = len(_missing(cells, keys, store, (), False))
    said = f"{len(cells)} runs, of which {lacking} are to be made"
    if not lacking:
        return said
    known = store.read()
    times = known["wall_time"].dropna() if "wall_time" in known else pd.Series(dtype=float)
    if times.empty:
        return f"{said}; no run is stored yet that would say how long one takes"
    seconds = float(times.mean()) * lacking / jobs
    told = f"{seconds / 60.0:.0f} min" if seconds > 90.0 else f"{seconds:.0f} s"
    return f"{said}: about {told} in {jobs} processes, by the {len(times)} runs that are stored"


Work = tuple[Cell, Key, bool]
"""A cell, its identity, and whether its recorded run is to be kept."""


def _missing(
    cells: Sequence[Cell],
    keys: Sequence[Key],
    store: Store,
    keep: Sequence[str],
    retry_failed: bool,
) -> list[Work]:
    """What is to be done: a slow cell and a quick one, which compile different things; other slow ones, lest one is last."""
    succeeded = store.cells(keys)
    work = []
    for cell, key in zip(cells, keys, strict=True):
        kept = any(fnmatchcase(key.label, pattern) for pattern in keep)
        done = succeeded.get(key.digest)  # None: not there
        again = kept and not store.has_run(key) if done else done is None or retry_failed
        if again:
            work.append((cell, key, kept))
    slow = [one for one in work if one[0].group is None]
    quick = [one for one in work if one[0].group is not None]
    return slow[:1] + quick[:1] + slow[1:] + quick[1:]


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
    reuse_memory()
    return list(_do(task))


def _do(task: Sequence[Work]) -> Iterator[Outcome]:
    shared: Shared = {}
    group = None
    for cell, key, keep in task:
        if cell.group != group:
            group, shared = cell.group, {}
        # a part of one's own may print; stdout is for results
        with redirect_stdout(sys.stderr):
            outcome = run_cell(cell, key, keep, shared)
        yield outcome


# A share of a study's events for one job of many: independent jobs that do each event once.

Item = TypeVar("Item")
MOST_SHARDS = 100_000


class Shard(NamedTuple):
    """Share number `number`, counted from 1, of `shares` shares."""

    number: int
    shares: int

    def __str__(self) -> str:
        """As it is given."""
        return f"{self.number}/{self.shares}"

    def of(self, items: Sequence[Item]) -> Sequence[Item]:
        """Every n-th item of n shares: slow and quick ones spread over all shares."""
        return items[self.number - 1 :: self.shares]

    def of_cells(self, cells: Sequence[Cell]) -> list[Cell]:
        """The cells of this share's events; those of one event stay together."""
        events = [
            (cell.scenario.name, cell.seed) if isinstance(cell, Job) else cell.label
            for cell in cells
        ]
        mine = set(self.of(list(dict.fromkeys(events))))
        return [cell for cell, event in zip(cells, events, strict=True) if event in mine]


ALL = Shard(1, 1)


def read_shard(text: str | None) -> Shard:
    """The share that ``k/n`` names, all if nothing is said; raises `StudyError` unless k is one of 1 ... n."""
    if text is None:
        return ALL
    numbers = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text.strip())
    shard = Shard(*map(int, numbers.groups())) if numbers else Shard(0, 0)
    if not 1 <= shard.number <= shard.shares <= MOST_SHARDS:
        raise StudyError(
            f"--shard {text[:50]!r}: give k/n, part k of n, such as 3/8; k from 1 to n, n at most {MOST_SHARDS}"
        )
    return shard
