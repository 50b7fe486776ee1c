"""Processes that do the work of cells, and end with the process that started them."""

import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from joblib.externals.loky.process_executor import ProcessPoolExecutor

PARENT_PERIOD = 0.5
"""How often a worker looks whether its parent lives [s], where the system does not tell it."""
_PR_SET_PDEATHSIG = 1


@contextmanager
def processes(count: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of `count` new processes. Left by an error or an interrupt, it kills them."""
    executor = ProcessPoolExecutor(count, initializer=_begin, initargs=(os.getpid(),))
    interrupted = True
    try:
        yield executor
        interrupted = False
    finally:
        executor.shutdown(wait=True, kill_workers=interrupted)


def _begin(parent: int) -> None:
    """Leave signals to the parent, and end when it ends, however that comes about."""
    # an interrupt from the keyboard reaches every process; the parent alone decides what happens then
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(PARENT_PERIOD)
    os._exit(1)
