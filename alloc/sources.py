"""Which sources decide a result, as a hash of their syntax; and files that are written whole.

In: names of modules. Out: one hash, which rows of studies carry, so none is taken for the work of other code.
"""

import ast
import hashlib
import os
import sys
import tomllib
import uuid
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any

from alloc.compilation import ROOT

PACKAGES = ("alloc", "mpc", "studies", "paper_figs")
"""Packages whose sources count, beside those of the modules that are asked about."""
LIBRARIES = ("numpy", "numba", "llvmlite", "casadi", "osqp", "cvxpy")
"""Installed packages whose versions count."""
PLUGIN_PREFIX = "readhesion_plugin_"
"""Beginning of the names of modules that plug-in files become."""
DATA = (".toml", ".csv")
"""Data files; all that lie beside a module of `PACKAGES` count with it."""


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


@lru_cache(maxsize=1024)
def code_hash(*modules: str) -> str:
    """Hash of the versions of the libraries and of all files in the `closure` of `modules`."""
    files = sorted((path.name, _digest(path)) for path in closure(*modules))
    return hashlib.sha256(f"{library_versions()} {files}".encode()).hexdigest()[:16]


@lru_cache(maxsize=1)
def library_versions() -> dict[str, str]:
    """Versions of Python and of the libraries that results depend on."""
    return {"python": "{}.{}".format(*sys.version_info), **{one: version(one) for one in LIBRARIES}}


@lru_cache(maxsize=256)
def closure(*modules: str) -> frozenset[Path]:
    """Files that decide what `modules` do: their own, those of all that they import, wherever, and data beside these.

    A module is named as Python does, or by its file.
    """
    packages = {*PACKAGES, *(name.partition(".")[0] for name in modules)}
    seen: set[str] = set()
    found: set[Path] = set()
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        top = name.partition(".")[0]
        counts = os.sep in name or top in packages or name.startswith(PLUGIN_PREFIX)
        path = path_of(name) if counts and name not in seen else None
        seen.add(name)
        if path is None:
            continue
        found.add(path)
        if path.suffix == ".py":
            package = name if path.name == "__init__.py" else name.rpartition(".")[0]
            waiting += [
                resolve_name(one, package) if one[0] == "." else one for one in _imports(path)
            ]
        if os.sep not in name:
            waiting.append(name.rpartition(".")[0])
        if top in PACKAGES:
            found.update(one for one in path.parent.iterdir() if one.suffix in DATA)
    return frozenset(found)


@lru_cache(maxsize=4096)
def path_of(module: str) -> Path | None:
    """File of a module; None if it has none that can be read as text."""
    if os.sep in module:
        return Path(module)
    top, *rest = module.split(".")
    if top in PACKAGES:
        path = ROOT / top / "__init__.py"
    else:
        found: Any = (sys.modules.get(top) or find_spec(top)) if top else None
        path = Path(getattr(found, "__file__", None) or getattr(found, "origin", None) or "")
    files = [path]
    if rest:  # of a plug-in, or a module of one file, it is a name
        base = path.parent.joinpath(*rest)
        files = [base.with_suffix(".py"), base / "__init__.py"] * (path.name == "__init__.py")
    return next((one for one in files if one.suffix in (".py", ".toml") and one.exists()), None)


class _Bare(ast.NodeTransformer):
    """Takes away strings that stand alone, which are docstrings."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node


@lru_cache(maxsize=4096)
def syntax(path: Path) -> ast.Module:
    """What a file of Python says, without docstrings."""
    return _Bare().visit(ast.parse(path.read_text("utf-8-sig", errors="replace")))


@lru_cache(maxsize=4096)
def _digest(path: Path) -> str:
    """Hash of what a file says: of its syntax without docstrings, or of its values."""
    content = path.read_bytes()
    if path.suffix == ".py":
        content = ast.dump(syntax(path)).encode()
    elif path.suffix == ".toml":
        with suppress(ValueError):  # a broken one counts as it stands
            content = repr(tomllib.loads(content.decode())).encode()
    return hashlib.sha256(content).hexdigest()


def _imports(path: Path) -> Iterator[str]:
    """Modules and names in import statements, wherever these stand; relative ones begin with their dots."""
    for node in ast.walk(syntax(path)):
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            yield module
            dot = "." if module.strip(".") else ""
            yield from (f"{module}{dot}{one.name}" for one in node.names)
