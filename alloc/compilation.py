"""How this project compiles: one set of Numba options and a cache that cannot go stale.

Numba keys its cache on the file of the compiled function alone, so a change to an equation in another
file would go unnoticed. The cache folder therefore carries a hash of every source in `alloc`.
"""

import hashlib
import os
import tempfile
from pathlib import Path
from typing import Any

import numba
from numba.extending import register_jitable

# No `nnan`/`ninf`: a nan must surface. `contract` allows fused multiply-add; `nsz` lets LLVM turn the
# equations' selections into vector minimum and maximum.
FASTMATH = {"contract", "nsz"}


def _source_hash() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> Path:
    root = os.environ.get("READHESION_CACHE") or os.environ.get("XDG_CACHE_HOME")
    base = Path(root) if root else Path.home() / ".cache"
    folder = base / "readhesion" / f"numba-{_source_hash()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:  # a read-only home must not stop a study
        folder = Path(tempfile.gettempdir()) / f"readhesion-{os.getuid()}" / folder.name
        folder.mkdir(parents=True, exist_ok=True)
    return folder


if "NUMBA_CACHE_DIR" not in os.environ:
    numba.config.CACHE_DIR = str(_cache_folder())  # type: ignore[attr-defined]

# Without reference counting (`_nrt`): every field that compiled code takes from a record of arrays would be counted up and
# down again, atomically, which costs ten times the arithmetic of a small train. Nothing compiled here allocates or keeps
# an array, so nothing has to be counted; Numba refuses to compile what would.
_COMPILED: Any = {
    "cache": True,
    "error_model": "numpy",
    "fastmath": FASTMATH,
    "nogil": True,
    "_nrt": False,
    "no_cfunc_wrapper": True,
}
_INLINED_PART: Any = {**_COMPILED, "forceinline": True, "no_cpython_wrapper": True}

jit = numba.njit(**_COMPILED)
"""Decorator of every compiled entry point."""

inlined_jit = numba.njit(**_INLINED_PART)
"""Decorator of a part of a compiled loop that is called from one or two places.

A call hands over every array of its records, field by field; that costs more than the work on a short train. It has no
wrapper for calls from Python: unpacking its records would take longer to compile than the part itself.
"""

# (`Any`: Numba's own annotation of such options is private.)
INLINED: Any = {
    "error_model": "numpy",
    "fastmath": FASTMATH,
    "forceinline": True,
    "no_cfunc_wrapper": True,
}
"""Options of what is inlined where it is called.

LLVM vectorises a loop over lanes only if no call is left in it, and would not inline the longer laws by itself.
"""

equation = register_jitable(**INLINED)
"""Decorator of a law that NumPy, Numba and CasADi evaluate from one text."""
