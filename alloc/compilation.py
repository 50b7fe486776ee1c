"""Compiled code: one decorator, and Numba's cache in a private folder that is named by the sources.

A cached function does not notice a change in another file, so every state of `alloc` and `mpc` has a folder of its own, and
code of other files is compiled in each process. What lies there is run: the folder and all above it must be writable by its
owner alone, else nothing is kept.
"""

import hashlib
import os
import shutil
import signal
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy

ROOT, PACKAGES = Path(__file__).parents[1], ("alloc", "mpc")
"""Where the project lies, and the packages whose compiled code is kept."""
KEPT = 30 * 24 * 3600.0
"""Folders of other sources are deleted when nobody has used them for this time [s]."""


def _hash_sources() -> str:
    """Hash of everything that compiled code can depend on."""
    libraries = [
        f"{library.__name__} {library.__version__}" for library in (numba, llvmlite, numpy)
    ]
    digest = hashlib.sha256("\n".join([sys.version, *libraries]).encode())
    for path in sorted(library for name in PACKAGES for library in (ROOT / name).rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def is_private(folder: Path) -> bool:
    """Whether nobody but this user (or root) can change `folder` or put another in its place, as ssh asks of its keys."""
    for place in (folder, *folder.parents):
        status = place.lstat()
        if status.st_uid not in (0, os.getuid()) or stat.S_ISLNK(status.st_mode):
            return False
        sticky = place != folder and status.st_mode & stat.S_ISVTX
        if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not sticky:
            return False
    return True


def _make_folder() -> Path | None:
    """The cache folder of these sources; None where it would not be private."""
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    place = Path(os.path.realpath(home)) / "readhesion"
    try:
        place.mkdir(parents=True, exist_ok=True, mode=0o700)
        folder = place / f"compiled-{_hash_sources()}"
        folder.mkdir(exist_ok=True, mode=0o700)
        if hasattr(os, "getuid") and not is_private(folder):
            return None
        os.utime(folder)
        for old in place.glob("compiled-*"):
            if time.time() - old.stat().st_mtime > KEPT:
                shutil.rmtree(old, ignore_errors=True)
    except OSError:  # a full or a read-only disk: every process compiles for itself
        return None
    return folder


FOLDER = _make_folder()
"""Where compiled code is kept between processes; None: it is not."""
if FOLDER is not None:
    numba.config.CACHE_DIR = str(FOLDER)  # type: ignore[attr-defined]


# without Python's error model a division need not be checked, which takes a fifth off a run
_KEPT: Any = {"error_model": "numpy", "cache": FOLDER is not None}


def jit(*signature: Any) -> Any:
    """Decorator of a compiled function: `@jit` on its own, or `@jit(signature)` to compile it at once.

    Division by zero gives inf or nan, as NumPy's does, and results are kept between processes.
    """
    if len(signature) == 1 and hasattr(signature[0], "__code__"):
        return numba.njit(**_jit_options(signature[0]))(signature[0])

    def decorate(function: Callable[..., Any]) -> Any:
        with _announced(function.__name__):
            return numba.njit(*signature, **_jit_options(function))(function)

    return decorate


def _jit_options(function: Any) -> dict[str, Any]:
    """Only code of `PACKAGES` is kept: any other may hold numbers of files that the folder's name does not know of."""
    file = Path(function.__code__.co_filename)
    return _KEPT | {
        "cache": _KEPT["cache"] and any(ROOT / name in file.parents for name in PACKAGES)
    }


def jit_threaded(function: Any) -> Any:
    """Decorator of a function that lets other threads of Python run beside it; it is compiled by `compile_once`."""
    return numba.njit(nogil=True, **_jit_options(function))(function)


_COMPILES = threading.Lock()


def compile_once(function: Any, signature: Callable[[], Any]) -> None:
    """Compile a decorated function, unless it is, for one signature and no other; it is asked for where it is needed."""
    if not function.overloads:
        with _COMPILES, _announced(function.__name__):
            if not function.overloads:  # another thread may just have done it
                function.compile(signature())
                function.disable_compile()


def jit_inline(function: Any) -> Any:
    """Decorator of a part of one or two compiled functions, which Numba writes into them, as a call takes time."""
    return numba.njit(inline="always", **_jit_options(function))(function)


def force_inline(function: Any) -> Any:
    """Decorator of a function that LLVM writes into those that call it; where a call might fail, they count references."""
    return numba.njit(forceinline=True, **_jit_options(function))(function)


@numba.njit(**_KEPT)
def last_use(*arrays: Any) -> None:
    """The last use of `arrays`, at the end of a function that is called very often; it does nothing.

    References to an array that is last used in a branch are counted, which took a quarter of a run; to one that is used at
    the end they are not.
    """


@contextmanager
def signals_afterwards() -> Iterator[Callable[[], None]]:
    """Signals that Python handles are handled at the end, or when the function is called that this gives. In compiled code,
    or in CasADi's, an exception that a handler raises can turn up as another, or nowhere."""
    handlers: dict[Any, Any] = {}
    came: list[tuple[Any, Any]] = []

    def note(number: Any, frame: Any) -> None:
        came.append((number, frame))

    def handle() -> None:
        while came:
            number, frame = came.pop(0)
            handlers[number](number, frame)

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if callable(handler := signal.getsignal(number)):
                handlers[number] = handler
                signal.signal(number, note)
    try:
        yield handle
    finally:
        for number, handler in handlers.items():
            if signal.getsignal(number) is note:  # a handler may have chosen another
                signal.signal(number, handler)
        handle()


@contextmanager
def _announced(name: str) -> Iterator[None]:
    """Says at a terminal that something is being compiled, once it takes long; the line goes when it is done."""
    shown = sys.stderr is not None and sys.stderr.isatty()
    if shown:
        sys.stderr.write(f"\rcompiling {name}, once after each change of the code \033[K")
        sys.stderr.flush()
    try:
        yield
    finally:
        if shown:
            with suppress(OSError):
                sys.stderr.write("\r\033[K")
