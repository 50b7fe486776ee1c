"""Workers: cells are computed by this process, by processes of this machine, or by a Dask cluster."""

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
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING

from studies import SourcesChanged, StudyError, WorkerLost
from studies.runner.plugins import load_plugins, loaded_files
from studies.runner.row_key import hash_cell
from studies.runner.rows import Row

if TYPE_CHECKING:
    from studies.runner.study import Cell

REACHED = 10
"""Seconds within which a scheduler answers and has a worker."""
TOGETHER = 8
"""Cells that are handed out together; neighbours share what they prepare."""
MOST_TASKS = 20_000
"""Beyond, more cells are handed out together: a scheduler takes 2 ms a task, however much is in it."""
PARTS = "READHESION_PARTS"
"""Environment variable for the server of workers: rules and controllers, as JSON."""


def count_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def compute_rows(
    run: Callable[..., Row | list[Row]],
    cells: Sequence[tuple[str, "Cell"]],
    jobs: int,
    scheduler: str | None,
) -> Generator[dict[str, list[Row]], None, None]:
    """Rows of `cells`, which have their keys before them: of some cells at a time, by these keys."""
    size = min(max(TOGETHER, len(cells) // MOST_TASKS), len(cells) // (8 * jobs) + 1)
    tasks = (pickle.dumps((run, cells[k : k + size])) for k in range(0, len(cells), size))
    files, jobs = loaded_files(), min(jobs, len(cells))
    if scheduler is None and jobs == 1:
        yield from (compute_task(task, files) for task in tasks)
        return
    parts = list_parts(cells)
    with start_processes(jobs, parts) if scheduler is None else join_cluster(scheduler) as pool:
        for future in as_completed([pool.submit(compute_task, task, files) for task in tasks]):
            try:
                yield future.result()
            except WorkerLost:
                raise
            # what a cell raises is a row: a worker was lost, or its task
            except Exception as error:
                raise WorkerLost(
                    f"a worker was lost ({describe_error(error)}); what was computed is kept: run again, with fewer jobs "
                    'if memory was short. A script that asks for jobs does so under if __name__ == "__main__"'
                ) from None


def list_parts(cells: Sequence[tuple[str, "Cell"]]) -> list[list[str]]:
    """Rules and controllers that cells name."""
    named = [cell.columns for _, cell in cells]
    return [
        [*dict.fromkeys(columns[kind] for columns in named if kind in columns)]
        for kind in ("rule", "controller")
    ]


@contextmanager
def start_processes(jobs: int, parts: list[list[str]]) -> Iterator[Executor]:
    """Processes, which are killed where the work is broken off; `parts`: rules and controllers, whose code they share."""
    # never forked from here: a thread of this program may hold a lock that a fork would wait for
    context = multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")
    if sys.platform == "linux":
        context.set_forkserver_preload(["studies.run_cell", "studies.runner.shared_code"])
        if all(parts):
            os.environ[PARTS] = json.dumps(parts)
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
def join_cluster(scheduler: str) -> Iterator[Executor]:
    """The workers of a Dask scheduler, by its address or by the file that it wrote."""
    try:
        from distributed import Client
    except ImportError:
        advice = "--scheduler needs the package 'distributed': pip install distributed"
        raise StudyError(advice) from None
    place = {"scheduler_file" if os.path.isfile(scheduler) else "address": scheduler}
    try:
        client = Client(**place, timeout=REACHED, set_as_default=False)
        client.wait_for_workers(1, timeout=REACHED)
    except (OSError, TimeoutError, ValueError) as error:
        fault = f"--scheduler {scheduler}: nobody works there ({describe_error(error)})"
        raise StudyError(fault) from None
    with client:
        yield client.get_executor(pure=False, retries=3)


def begin_worker() -> None:
    """A worker leaves signals to its parent, and ends when that ends, however."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow_parent() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow_parent, daemon=True).start()


def compute_task(task: bytes, plugins: Sequence[str]) -> dict[str, list[Row]]:
    """The rows of some cells by their keys. What goes wrong in a cell is its row; a fault of the place is raised."""
    # before their functions are unpickled; and files of users count as they are now
    load_plugins(plugins)
    run, cells = pickle.loads(task)
    computed = {}
    for key, cell in cells:
        start = time.perf_counter()
        rows: list[Row]
        try:
            if hash_cell(run, cell.args, cell.sources) != key:
                raise SourcesChanged(
                    f"process {os.getpid()} on {platform.node()} has other sources than the program that asked: "
                    "they changed, or a part has no file that is loaded as a plug-in, then give jobs = 1; or workers "
                    "of a cluster are old, then start new ones. What was computed is kept"
                )
            with redirect_stdout(sys.stderr):  # where a part prints; stdout is for results
                result = run(*cell.args)
            rows = result if isinstance(result, list) else [result]
        except WorkerLost:
            raise
        except MemoryError as error:
            raise WorkerLost(
                f"{describe_error(error)}; what was computed is kept: run again with fewer jobs"
            ) from None
        except Exception as error:
            frame = traceback.extract_tb((error.__cause__ or error).__traceback__)[-1]
            place = f"{Path(frame.filename).name}:{frame.lineno}"
            rows = [{"status": "failed", "reason": f"{describe_error(error)} (at {place})"}]
        spent = (time.perf_counter() - start) / max(1, len(rows))
        usual = {"status": "ok", "reason": "", "wall_time": spent}
        computed[key] = [usual | row | {"batch": time.time_ns()} for row in rows]
    return computed


def describe_error(error: BaseException) -> str:
    """Type and message of an error, in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
