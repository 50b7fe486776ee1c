"""Who does the work of cells: processes of this machine, or workers of a cluster, behind one small interface."""

import asyncio
import ctypes
import gc
import json
import multiprocessing
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from studies.files.study_error import StudyError

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
    from joblib.externals.loky.process_executor import ProcessPoolExecutor

    context = multiprocessing.get_context("fork") if sys.platform == "linux" else None
    executor = ProcessPoolExecutor(
        count, context=context, initializer=_begin, initargs=(os.getpid(),)
    )
    interrupted = True
    try:
        yield Workers(executor.submit, count)
        interrupted = False
    finally:
        if interrupted:
            _forget_waiting(executor._work_ids)
        executor.shutdown(wait=True, kill_workers=interrupted)


def _forget_waiting(numbers: "queue.Queue[int]") -> None:
    """Empty the queue of tasks that no worker was given: loky's thread would look for them after it has dropped them."""
    with suppress(queue.Empty):
        while True:
            numbers.get_nowait()


@contextmanager
def cluster(scheduler: str) -> Iterator[Workers]:
    """The workers of a Dask scheduler by its address, such as ``tcp://node7:8786``, or by the file that it wrote.

    What a lost worker had to do is done by another. Raises `StudyError` where nobody answers or `distributed` is missing.
    """
    try:
        from distributed import Client
    except ImportError:
        raise StudyError(
            "--executor dask needs the package 'distributed': pip install 'readhesion[dask]'"
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
