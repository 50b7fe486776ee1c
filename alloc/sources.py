"""Which code decides a result, as one hash of what its files say; and files that are written whole.

Rows of studies carry the hash, so none is taken for the work of other code.
"""

import ast
import hashlib
import os
import sys
import tomllib
import uuid
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path

from alloc.compilation import ROOT

BELOW = ("alloc", "mpc")
"""Packages that count whole: a run goes through most of their modules."""
LIBRARIES = ("numpy", "numba", "llvmlite", "casadi", "osqp", "cvxpy")
"""Installed packages whose versions count."""


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Make or replace `path` by `write(file to fill)`: other processes see all of it or nothing.

    The file beside it has a name of its own, so writers do not meet; a `write` that raises leaves nothing behind. Raises
    `OSError` with the name of `path`, such as for a full disk.
    """
    aside = path.with_name(f".{uuid.uuid4().hex}.part{path.suffix}")
    try:
        write(aside)
        os.replace(aside, path)
    except OSError as error:  # libraries do not say which file
        reason = os.strerror(error.errno) if error.errno else " ".join(str(error).split())
        raise OSError(error.errno, reason, str(path)) from error
    finally:
        aside.unlink(missing_ok=True)


@cache
def code_hash() -> str:
    """Hash of the versions of the libraries and of what the modules and TOML files of `BELOW` say."""
    said = ["{}.{}".format(*sys.version_info), *map(version, LIBRARIES)]
    for path in sorted(one for name in BELOW for one in (ROOT / name).rglob("*.*")):
        if path.suffix == ".py":
            said += [path.name, ast.dump(tree_of(path.read_bytes()))]
        elif path.suffix == ".toml":
            said += [path.name, repr(tomllib.loads(path.read_text("utf-8")))]
    return hashlib.sha256("\n".join(said).encode()).hexdigest()[:16]


class _Bare(ast.NodeTransformer):
    """Takes away strings that stand alone, which are docstrings."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node


def tree_of(text: str | bytes) -> ast.Module:
    """Syntax of a module without its docstrings: what decides its results."""
    found: ast.Module = _Bare().visit(ast.parse(text))
    return found
