"""Interrupts from the keyboard and SIGTERM: seen even where the exception that they raise is lost.

Python raises `KeyboardInterrupt` wherever the program is, also in a destructor or a callback, which print it and go on.
"""

import signal

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


def _stop(number: int, frame: object) -> None:
    _asked.append(Termination if number == signal.SIGTERM else KeyboardInterrupt)
    raise _asked[0]
