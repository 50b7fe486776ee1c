"""Compilation in this project: one set of Numba options, and a cache that cannot become stale.

Numba's own cache checks only the file of the compiled function. A change to an equation in another file would go unnoticed,
and a changed comment would cost minutes.
"""

import hashlib
import inspect
import logging
import multiprocessing
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numba
from numba.core.caching import Cache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature
from numba.core.targetconfig import TargetConfig
from numba.extending import register_jitable

from alloc.old.sources import cache_folder, code_hash, keep, kept, path_of, private

COMPILING = (
    "readhesion: compiling the simulation, 20 seconds to a minute; later runs load what is compiled"
)


@lru_cache(maxsize=1)
def _say_compiling() -> None:
    """Tell who waits, at a terminal, a Python prompt or in a notebook, once; else the program's log at level INFO.

    Where a worker compiles, the terminal shows the progress of its parent.
    """
    waits = "ipykernel" in sys.modules or hasattr(sys, "ps1")
    own = sys.stderr is not None and multiprocessing.parent_process() is None
    if waits or (own and sys.stderr.isatty()):
        print(COMPILING, file=sys.stderr, flush=True)
    else:
        logging.getLogger(__name__).info(COMPILING)


_equal: Any = TargetConfig.__eq__
# Numba compares its options with each type of a call, by every default of both: an eighth of the time of compiling
cast(Any, TargetConfig).__eq__ = lambda one, other: (
    one._values == getattr(other, "_values", None) or _equal(one, other)
)
cast(Any, TargetConfig).__hash__ = lambda one: hash(type(one))


class _Kernels(Cache):
    """Numba's cache of one function: for each signature, what is kept under a hash of all that decides what it does."""

    def __init__(self, function: Callable[..., Any], source: str | None = None) -> None:
        module, file = function.__module__, inspect.getfile(function)
        source = source or (module if path_of(module) == Path(file) else file)
        self._py_func = function  # Numba hashes its bytecode, and what it encloses
        self._cache_path = str(cache_folder())
        self._said = f"{module}.{function.__qualname__} {code_hash(source, later=False)}"

    def _key(self, sig: Any, codegen: Any) -> str:
        key = f"{self._said} {self._index_key(sig, codegen)}"
        return f"kernel-{hashlib.sha256(key.encode()).hexdigest()[:32]}"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        content = kept(self._key(sig, target_context.codegen()))
        with suppress(Exception):  # nothing is kept, or what another system's library made
            found = CompileResult._rebuild(target_context, *pickle.loads(content or b""))
            # types that look alike may be others: of a named tuple Numba shows neither fields nor module
            if found.signature.args == normalize_signature(sig)[0]:
                return found
        return None

    @contextmanager
    def alone(self, sig: Any, codegen: Any) -> Iterator[None]:
        """Let one process compile what is not kept, while others that need it wait, and then load it.

        The lock lies in the machine's own temporary folder, for locks on a network's folders cannot be relied on.
        """
        if (cache_folder() / self._key(sig, codegen)).exists():
            yield
            return
        _say_compiling()
        user = f"readhesion-{getattr(os, 'getuid', int)()}"
        name = f"{cache_folder()} {self._py_func.__module__}.{self._py_func.__qualname__}"
        file = f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.lock"
        with ExitStack() as held:
            with suppress(OSError, ImportError):  # then two may compile the same
                import fcntl  # Windows has none

                folder = private(Path(tempfile.gettempdir()) / user / "compiling")
                fcntl.flock(held.enter_context((folder / file).open("a")), fcntl.LOCK_EX)
            yield

    def save_overload(self, sig: Any, data: Any) -> None:
        if not data.library.has_dynamic_globals:  # addresses, which another process has not
            keep(self._key(sig, data.codegen), dumps(data._reduce()))


class _Linked(JITCodeLibrary):
    """Code that is linked into what calls it and optimised there: by itself it gets no passes and no machine code."""

    class codegen:
        """What gives machine code the objects that it refers to."""

        @staticmethod
        def set_env(*_: Any) -> None:
            """There is none that would look for them."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0


class _Entry(CPUDispatcher):
    """A compiled function that Python calls: of all that is compiled for it, it alone becomes machine code."""

    __slots__ = ()

    def compile(self, sig: Any) -> Any:
        own, context = self.py_func.__qualname__, cast(Any, self.targetctx)
        codegen = context.codegen()

        def library(codegen: Any, name: str) -> Any:
            return (JITCodeLibrary if name == own else _Linked)(codegen, name)

        cast(Any, library)._unserialize = JITCodeLibrary._unserialize  # of what is kept
        with global_compiler_lock, cast(Any, self)._cache.alone(sig, codegen):
            before, codegen._library_class = codegen._library_class, library
            try:
                return super().compile(sig)
            finally:
                codegen._library_class = before


class _Part(CPUDispatcher):
    """A compiled function without the wrapper for calls from Python, without which Numba calls address 0."""

    __slots__ = ()

    def __call__(self, *_: Any, **__: Any) -> Any:
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}"
        raise TypeError(
            f"{name} is a part of compiled code: call it from a function under numba.njit"
        )


def compiled(
    function: Any, signature: Any = None, source: str | None = None, **options: Any
) -> Any:
    """`numba.njit` with our cache; with a `signature` it is compiled, or loaded, at once and for no other."""
    dispatcher = numba.njit(**options)(function)
    if isinstance(dispatcher, CPUDispatcher):  # else compiling is switched off
        dispatcher.__class__ = _Entry
        cast(Any, dispatcher)._cache = _Kernels(function, source)
        if signature is not None:
            dispatcher.compile(signature)
            dispatcher.disable_compile()
    return dispatcher


# No `nnan`/`ninf`: a nan must surface. No `contract`: fused multiply-adds follow the borders of inlining, so merging two
# functions would move last digits, and processors would differ.
# `nsz` lets LLVM turn the equations' selections into vector minimum and maximum.
FASTMATH = {"nsz"}
_OPTIONS: Any = {"error_model": "numpy", "fastmath": FASTMATH, "no_cfunc_wrapper": True}
# Without reference counting (`_nrt`): every field that compiled code takes from a record of arrays would be counted up and
# down again, atomically, which costs ten times the arithmetic of a small train. Nothing compiled here allocates or keeps
# an array, so nothing has to be counted; Numba refuses to compile what would.
_COMPILED: Any = _OPTIONS | {"nogil": True, "_nrt": False}
_NO_WRAPPER: Any = {"no_cpython_wrapper": True}
INLINED: Any = _OPTIONS | _NO_WRAPPER | {"forceinline": True}
"""Options of what is inlined where it is called: a law is a few instructions, a call would cost more than they do."""

equation = register_jitable(**INLINED)
"""Decorator of a law that NumPy, Numba and CasADi evaluate from one text."""

called: Any = register_jitable(**_OPTIONS, **_NO_WRAPPER)
"""Decorator of a law that is called, not inlined: one so long that the call costs little and inlining costs much."""


def jit(function: Any, source: str | None = None) -> Any:
    """Decorator of every compiled entry point; `source`: module that decides what it does, if not the function's own."""
    return compiled(function, source=source, **_COMPILED)


def inlined_jit(function: Any) -> Any:
    """Decorator of a part of a compiled loop that is called from one or two places.

    The compiler then sees the whole of a step, and keeps in registers what its parts share. No wrapper for calls from Python
    is made, for nobody makes any: such a call raises `TypeError`.
    """
    part = numba.njit(**(INLINED | _COMPILED))(function)
    if isinstance(part, CPUDispatcher):
        part.__class__ = _Part
    return part
