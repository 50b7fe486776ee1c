"""What long work says of itself: a bar at a terminal, elsewhere a line every ten seconds; and a log."""

import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LOG = logging.getLogger("readhesion")
"""A line for all that is compiled, found or computed. It is shown after `write_log`, or as a program sets `logging` up."""
VERBOSE = "READHESION_VERBOSE"
"""Environment variable: processes that import this write the log too."""
EVERY = 10.0
"""Seconds between two lines of `print_progress`."""


def write_log() -> None:
    """Write the log to stderr, in this process and in those that it starts."""
    from numba.core import event  # the help is there without it

    class CompileLog(event.Listener):
        """What is compiled; what is loaded is no such event."""

        def on_start(self, event: event.Event) -> None:
            function = event.data["dispatcher"].py_func
            LOG.info("compiling %s.%s", function.__module__, function.__qualname__)

        def on_end(self, event: event.Event) -> None:
            pass

    os.environ[VERBOSE] = "1"
    logging.basicConfig(format="readhesion: %(message)s")
    LOG.setLevel(logging.INFO)
    event.register("numba:compile", CompileLog())


_working: list[Callable[[], str]] = []
"""What is at work, the innermost last; each says how far it is."""


@contextmanager
def print_progress(name: str, verbose: bool) -> Iterator[None]:
    """Print how far the work in this context is, every ten seconds where stderr is no terminal; `verbose`: and the log."""
    if verbose:
        write_log()
    ended, started = threading.Event(), time.monotonic()

    def print_lines() -> None:
        while not ended.wait(EVERY):
            spent = f"at work for {time.monotonic() - started:.0f} s"
            text = next((describe() for describe in _working[-1:]), f"{name}: {spent}")
            print(f"readhesion: {text}", file=sys.stderr, flush=True)

    if sys.stderr is not None and not sys.stderr.isatty():
        threading.Thread(target=print_lines, daemon=True).start()
    try:
        yield
    finally:
        ended.set()


@contextmanager
def show_progress(name: str, total: int, quiet: bool) -> Iterator[Callable[[int], None]]:
    """A bar at a terminal, which a number of things done advances; elsewhere `print_progress` says where it stands."""
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress

    console, columns = Console(stderr=True), (*Progress.get_default_columns(), MofNCompleteColumn())
    off = quiet or not console.is_terminal or LOG.isEnabledFor(logging.INFO)
    with Progress(*columns, console=console, transient=True, disable=off) as bar:
        task = bar.add_task(f"{name} (compiles at first)", total=total)

        def describe() -> str:
            minutes, seconds = divmod(round(bar.tasks[0].time_remaining or 0.0), 60)
            forecast = f", about {minutes} min {seconds} s left" if minutes + seconds else ""
            return f"{bar.tasks[0].description}: {bar.tasks[0].completed:.0f} of {total}{forecast}"

        _working.append(describe)
        try:
            yield lambda count: bar.advance(task, count)
        finally:
            _working.remove(describe)


if VERBOSE in os.environ:
    write_log()
