"""Interrupts from the keyboard and SIGTERM: seen even where the exception that they raise is lost.

Python raises `KeyboardInterrupt` wherever the program is, also in a destructor or a callback, which print it and go on.
"""

import signal
import sys
from collections.abc import Callable

INTERRUPTED, TERMINATED = 130, 143
"""Exit codes."""

_asked: list[type[KeyboardInterrupt]] = []


class Termination(KeyboardInterrupt):
    """SIGTERM: like an interrupt, except for the exit code."""


def listen() -> None:
    """Raise `KeyboardInterrupt` or `Termination` on these signals from now on; to be called by the main thread."""
    signal.signal(signal.SIGINT, _stop)
    signal.signal(signal.SIGTERM, _stop)


def check() -> None:
    """Raise what a signal raised before, in case it was lost."""
    if _asked:
        raise _asked[0]


def ends(work: Callable[[], int]) -> int:
    """Exit code of `work`, the last that a process does: that of a signal if one stopped it.

    What the signal raised may have become another error on its way, as in the import of a compiled module.
    """
    stopped = None
    try:
        code = work()
    except BaseException as error:
        stopped = _asked[0] if _asked else type(error)
        if not issubclass(stopped, KeyboardInterrupt):
            raise
        code = TERMINATED if issubclass(stopped, Termination) else INTERRUPTED
    for number in (signal.SIGINT, signal.SIGTERM):  # nothing is left to stop
        signal.signal(number, signal.SIG_IGN)
    if stopped is not None:
        print(
            "readhesion: stopped; finished rows are kept, the same command goes on", file=sys.stderr
        )
    return code


def _stop(number: int, frame: object) -> None:
    _asked.append(Termination if number == signal.SIGTERM else KeyboardInterrupt)
    raise _asked[0]
