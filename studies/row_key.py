"""What decides the rows of a cell: its arguments, and the sources behind the function that makes them.

A study is one file, and its table, its figure and its words change more often than what it computes. So of a module of
`studies` only those definitions count that the function names, and those that these name, wherever they stand. Of `alloc`
and `mpc` the whole package counts. Of a user's own file its whole folder counts: what helps it lies beside it.
"""

import ast
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, is_dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from alloc.compilation import ROOT
from alloc.errors import InputError

OWN, BELOW = "studies", ("alloc", "mpc")
"""The package whose definitions are followed one by one, and those that count as they are."""
LIBRARIES = ("numpy", "numba", "llvmlite", "casadi", "osqp", "cvxpy")
"""Installed packages whose versions count, beside that of Python."""
DATA = (".csv", ".toml", ".npy", ".npz", ".mat", ".dat")
"""Files that lie beside a user's own and that it may read; a study's own count where it names them."""
PASSED_OVER = {"__pycache__", "site-packages", "node_modules"}
MOST_FILES = 500
"""Files of a user's folder; beyond, it is no folder of one plug-in, and reading it all would take long."""

Name = tuple[str, str]
"""A module, and a name in it; or a data file."""


def key_of(run: Callable[..., Any], args: tuple[Any, ...], sources: tuple[str, ...] = ()) -> str:
    """Hash of what decides the rows that `run(*args)` gives; `sources`: modules of parts that `args` name."""
    text = json.dumps([_plain(run), args, decides(run, sources)], default=_plain)
    return _hash(text)


@cache
def decides(function: Callable[..., Any], modules: tuple[str, ...] = ()) -> str:
    """Hash of the sources behind `function` and of `modules`, which are beside it."""
    seen: dict[Name, str] = {}
    others = set(modules)
    left: list[Name] = [(function.__module__, function.__qualname__.partition(".")[0])]
    while left:
        module, name = left.pop()
        if module.partition(".")[0] != OWN:
            others.add(module)
        elif (module, name) not in seen:
            nodes = _definitions(module).get(name, [])
            seen[module, name] = "".join(map(ast.dump, nodes))
            left += [one for node in nodes for one in _named_in(node, module)]
    packages = {top for one in others if (top := one.partition(".")[0]) in BELOW}
    files = {one if os.sep in one else str(getattr(sys.modules.get(one), "__file__", None) or "")
             for one in others if one.partition(".")[0] not in BELOW}  # fmt: skip
    parts = [seen[one] for one in sorted(seen)] + [folder_hash(one) for one in sorted(files)]
    return _hash("\n".join([*parts, *map(_package_hash, sorted(packages))]))


@cache
def _package_hash(name: str) -> str:
    """Hash of all that a package says, and of the libraries below it."""
    files = sorted(one for one in (ROOT / name).rglob("*") if one.suffix in (".py", *DATA))
    said = [
        ast.dump(_syntax(one)) if one.suffix == ".py" else one.read_bytes().hex() for one in files
    ]
    versions = ["{}.{}".format(*sys.version_info), *map(version, LIBRARIES)]
    return _hash("\n".join([*versions, *said]))


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _plain(value: Any) -> Any:
    """What JSON can say of an argument."""
    if callable(value):
        return f"{value.__module__}.{value.__qualname__} {decides(value)}"
    if hasattr(value, "text"):  # a scenario
        return value.text
    if is_dataclass(value):
        return asdict(value)  # type: ignore[arg-type]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{value!r:.80} in the arguments of a cell has no text that identifies it")


# modules of this package, read as text


class _Bare(ast.NodeTransformer):
    """Takes away strings that stand alone, which are docstrings."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node


@cache
def _syntax(path: Path) -> ast.Module:
    return _Bare().visit(ast.parse(path.read_bytes() if path.is_file() else b""))


def path_of(module: str) -> Path:
    """File of a module of the project."""
    path = ROOT.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


@cache
def _definitions(module: str) -> dict[str, list[ast.stmt]]:
    """Top-level statements of a module by the names that they bind."""
    found: dict[str, list[ast.stmt]] = {}
    for node in _syntax(path_of(module)).body:
        bound = [getattr(node, "name", "")]
        if not isinstance(node, ast.FunctionDef | ast.ClassDef):
            bound = [one.id for one in ast.walk(node)
                     if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store)]  # fmt: skip
        for name in bound:
            found.setdefault(name, []).append(node)
    return found


@cache
def _imports(module: str) -> dict[str, Name]:
    """What names of a module are imported, wherever: the module that they are of, and the name there."""
    found: dict[str, Name] = {}
    for node in ast.walk(_syntax(path_of(module))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            of = getattr(node, "module", "")
            found |= {
                one.asname or one.name: (of, one.name) if of else (one.name, "")
                for one in node.names
            }
    return {name: one for name, one in found.items() if one[0].partition(".")[0] in (OWN, *BELOW)}


def _named_in(node: ast.stmt, module: str) -> Iterator[Name]:
    """Definitions and data files that a statement of a module names."""
    own, imports = _definitions(module), _imports(module)
    for one in ast.walk(node):
        if isinstance(one, ast.Name) and one.id in own:
            yield module, one.id
        elif isinstance(one, ast.Name) and one.id in imports:
            yield imports[one.id]
        elif isinstance(one, ast.Attribute) and getattr(one.value, "id", "") in imports:
            target, name = imports[one.value.id]  # type: ignore[attr-defined]
            yield f"{target}.{name}".strip("."), one.attr  # of a module
        elif isinstance(one, ast.Constant) and str(one.value).endswith(DATA):
            file = path_of(module).with_name(str(one.value))
            if file.is_file():
                yield str(file), ""


# files of users, and data


@cache
def folder_hash(file: str) -> str:
    """Hash of a data file; of a Python file that of its folder: Python files at any depth, and data beside it.

    An interactive session has no file, and its rows are never found again. Raises `InputError` for a folder of too many.
    """
    if not file:
        return os.urandom(8).hex()
    if file.endswith(DATA):
        return _hash(Path(file).read_bytes().hex())
    folder, files = Path(file).parent, []
    for place, folders, names in os.walk(folder):
        folders[:] = [one for one in folders if one not in PASSED_OVER and one[0] != "."]
        endings = (".py", *DATA) if Path(place) == folder else (".py",)
        files += [Path(place, one) for one in names if one.endswith(endings)]
        if len(files) > MOST_FILES:
            raise InputError(
                f"{file}: its folder has more than {MOST_FILES} Python files, and each may decide its rows; "
                "move it to a folder of its own"
            )
    return _hash("".join(f"{one} {one.read_bytes().hex()}" for one in sorted(files)))
