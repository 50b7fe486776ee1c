"""Compilation in this project: one set of Numba options, and a cache that cannot become stale.

Numba's own cache checks only the file of the compiled function. A change to an equation in another file would go unnoticed,
and a changed comment would cost minutes.
"""

import hashlib
import inspect
import io
import logging
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher
from numba.core.registry import CPUDispatcher
from numba.extending import register_jitable

from alloc.sources import cache_folder, cache_part, path_of, sealed, set_aside_damaged, syntax_hash

# No `nnan`/`ninf`: a nan must surface. No `contract`: fused multiply-adds follow the borders of inlining, so merging two
# functions would move last digits, and processors would differ.
# `nsz` lets LLVM turn the equations' selections into vector minimum and maximum.
FASTMATH = {"nsz"}


COMPILING = "readhesion: compiling the simulation, about a minute; later runs load what is compiled"


def _someone_waits() -> bool:
    """Whether a person sees what is written to stderr: at a terminal, at a Python prompt, or in a notebook."""
    if "ipykernel" in sys.modules or hasattr(sys, "ps1"):
        return True
    return sys.stderr is not None and sys.stderr.isatty()


class _Said:
    """Whether this process, or the one that it is a fork of, has said that it compiles."""

    compiling = logged = False

    @classmethod
    def once(cls) -> None:
        """Tell the one who waits; where nobody does, the program's log at level INFO."""
        if cls.compiling:
            return
        if _someone_waits():
            cls.compiling = True
            print(COMPILING, file=sys.stderr, flush=True)
        elif not cls.logged:
            cls.logged = True
            logging.getLogger(__name__).info(COMPILING)


KEPT_DAYS = 30.0
"""Kernels that were not used for this many days are deleted when new ones are made."""


class _Place(CompileResultCacheImpl):
    """Where the kernels of one function lie: a folder per hash of all that its file imports.

    Numba's own choice looks at the function's file alone, and at its line.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._py_file = inspect.getfile(function)
        self._locator = self  # what Numba asks for path and stamp
        self._stamp = kernel_hash(function.__module__, self._py_file)
        self._filename_base = self.get_filename_base(
            f"{function.__module__}.{function.__qualname__}", sys.abiflags
        )

    def get_disambiguator(self) -> str:
        return "kernel"  # functions of equal name differ in their bytecode, which Numba compares

    def get_cache_path(self) -> str:
        return str(cache_folder() / f"kernels-{self._stamp}")

    def ensure_cache_path(self) -> None:
        _make(f"kernels-{self._stamp}")

    def get_source_stamp(self) -> str:
        return self._stamp


class _Files(IndexDataCacheFile):
    """Numba's files of one function, sealed: machine code with one flipped bit is run, and may do anything."""

    def _load_index(self) -> Any:
        set_aside_damaged(Path(self._index_path))
        return super()._load_index()

    def _load_data(self, name: str) -> Any:
        set_aside_damaged(Path(self._data_path(name)))
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        with super()._open_for_write(filepath) as file:
            content = io.BytesIO()
            yield content
            file.write(sealed(content.getvalue()))


class _Cache(FunctionCache):
    """Numba's cache of one function, in a folder of ours; what cannot be read is compiled again."""

    _impl_class = _Place

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        place = self._impl
        self._cache_file = _Files(place.get_cache_path(), place.filename_base, place._stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        self._impl.ensure_cache_path()
        try:
            found = super().load_overload(sig, target_context)
        except Exception:  # whatever a damaged file makes `pickle` do
            self.flush()
            found = None
        if found is None:
            _Said.once()
        return found


@lru_cache(maxsize=1024)
def kernel_hash(module: str, file: str) -> str:
    """Hash of all that decides what the compiled functions of a file do; `module`: its name."""
    source = module if path_of(module) == Path(file) else file
    libraries = (np.__version__, numba.__version__, llvmlite.__version__)
    text = " ".join((syntax_hash(source, later=False), *libraries))
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@lru_cache(maxsize=1024)
def _make(name: str) -> None:
    """Make a folder of kernels that is this user's alone."""
    if not (cache_folder() / name).exists():
        oldest = time.time() - KEPT_DAYS * 86400.0
        for other in cache_folder().glob("kernels-*"):
            if other.stat().st_mtime < oldest:
                shutil.rmtree(other, ignore_errors=True)
    os.utime(cache_part(name))


def compiled(function: Any, signature: Any = None, **options: Any) -> Any:
    """`numba.njit` with our cache; with a `signature` it is compiled, or loaded, at once and for no other."""
    dispatcher = numba.njit(**options)(function)
    if isinstance(dispatcher, Dispatcher):  # else compiling is switched off
        dispatcher._cache = _Cache(function)  # type: ignore[attr-defined]
        if signature is not None:
            dispatcher.compile(signature)
            dispatcher.disable_compile()
    return dispatcher


# Without reference counting (`_nrt`): every field that compiled code takes from a record of arrays would be counted up and
# down again, atomically, which costs ten times the arithmetic of a small train. Nothing compiled here allocates or keeps
# an array, so nothing has to be counted; Numba refuses to compile what would.
_COMPILED: Any = {
    "error_model": "numpy",
    "fastmath": FASTMATH,
    "nogil": True,
    "_nrt": False,
    "no_cfunc_wrapper": True,
}


def jit(function: Any) -> Any:
    """Decorator of every compiled entry point."""
    return compiled(function, **_COMPILED)


class _Part(CPUDispatcher):
    """A compiled function without the wrapper for calls from Python, without which Numba calls address 0."""

    __slots__ = ()

    def __call__(self, *_: Any, **__: Any) -> Any:
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}"
        raise TypeError(
            f"{name} is a part of compiled code: call it from a function under numba.njit"
        )


def inlined_jit(function: Any) -> Any:
    """Decorator of a part of a compiled loop that is called from one or two places.

    The compiler then sees the whole of a step, and keeps in registers what its parts share. No wrapper for calls from Python
    is made, for nobody makes any: such a call raises `TypeError`.
    """
    part = compiled(function, **_COMPILED, forceinline=True, no_cpython_wrapper=True)
    if isinstance(part, CPUDispatcher):
        part.__class__ = _Part
    return part


# (`Any`: Numba's own annotation of such options is private.)
INLINED: Any = {
    "error_model": "numpy",
    "fastmath": FASTMATH,
    "forceinline": True,
    "no_cfunc_wrapper": True,
}
"""Options of what is inlined where it is called.

A law is a few instructions; a call would cost more than they do.
"""

equation = register_jitable(**INLINED)
"""Decorator of a law that NumPy, Numba and CasADi evaluate from one text."""

called: Any = register_jitable(
    **{name: on for name, on in INLINED.items() if name != "forceinline"}
)
"""Decorator of a law that is called, not inlined: one so long that the call costs little and inlining costs much."""
