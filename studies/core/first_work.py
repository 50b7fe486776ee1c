"""The first work with a program on a machine goes alone: it compiles, and the others load what it compiled.

Locks and marks lie in the machine's own temporary folder, for locks on a network's folders cannot be relied on.
"""

import hashlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from pathlib import Path

from filelock import FileLock

from alloc.sources import cache_folder, code_hash, private

MARK = ".done"
"""Ending of the file that says that a program has been run here."""


@contextmanager
def alone_at_first(programs: Sequence[str]) -> Iterator[None]:
    """Do what stands inside alone if it is this machine's first work with one of `programs`, see `Cell.programs`.

    Where kernels were deleted since, several processes compile them at once, which is slower and nothing worse.
    """
    first = []
    with ExitStack() as held:
        for program in programs:
            place = _place(program)
            if place is None or _marked(place):
                continue
            lock = held.enter_context(FileLock(f"{place}.lock"))
            if _marked(place):  # by the one that was waited for
                lock.release()
            else:
                first.append(place)
        yield
        for place in first:
            place.with_suffix(MARK).touch()


@lru_cache(maxsize=256)
def _place(program: str) -> Path | None:
    """Where lock and mark of a program lie, by its code and by where its kernels lie; None where they cannot."""
    code = f"{code_hash(program, later=False)} {cache_folder()}"
    user = f"readhesion-{getattr(os, 'getuid', int)()}"
    try:
        folder = private(Path(tempfile.gettempdir()) / user / "first-work")
    except OSError:
        return None
    return folder / hashlib.sha256(code.encode()).hexdigest()[:16]


_KNOWN: set[Path] = set()
"""Programs whose mark this process has seen."""


def _marked(place: Path) -> bool:
    if place not in _KNOWN and place.with_suffix(MARK).exists():
        _KNOWN.add(place)
    return place in _KNOWN
