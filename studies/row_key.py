"""What decides the rows of a cell: its arguments, and the sources behind the function that makes them.

A study is one file, and its table, its figure and its words change more often than what it computes. So of a module of
`studies` only those definitions count that the function names, and those that these name, wherever they stand. `alloc`
and `mpc` count whole. Of a user's own file its whole folder counts: what helps it lies beside it.
"""

import ast
import hashlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from alloc.compilation import ROOT
from alloc.errors import InputError
from alloc.sources import BELOW, code_hash, tree_of

OWN = "studies"
"""The package whose definitions are followed one by one; those of `BELOW` count whole."""
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
    left: list[Name] = [(function.__module__, function.__qualname__.partition(".")[0])]
    while left:
        module, name = left.pop()
        if module.partition(".")[0] == OWN and (module, name) not in seen:
            nodes = _definitions(module).get(name, [])
            seen[module, name] = "".join(map(ast.dump, nodes))
            left += [one for node in nodes for one in _named_in(node, module)]
        elif module.partition(".")[0] != OWN:
            modules = (*modules, module)
    others = {one for one in modules if one.partition(".")[0] not in BELOW}
    files = sorted(one if os.sep in one else _file(one) for one in others)
    parts = [seen[one] for one in sorted(seen)] + [folder_hash(one) for one in files]
    return _hash("\n".join([*parts, code_hash()]))


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


def path_of(module: str) -> Path:
    """File of a module of this package."""
    base = ROOT.joinpath(*module.split("."))
    return base / "__init__.py" if base.is_dir() else base.with_suffix(".py")


@cache
def _tree(module: str) -> ast.Module:
    path = path_of(module)
    return tree_of(path.read_bytes() if path.exists() else "")


@cache
def _definitions(module: str) -> dict[str, list[ast.stmt]]:
    """Top-level statements of a module by the names that they bind."""
    found: dict[str, list[ast.stmt]] = {}
    for node in _tree(module).body:
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
    for node in ast.walk(_tree(module)):
        if isinstance(node, ast.Import):
            found |= {one.asname or one.name: (one.name, "") for one in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {one.asname or one.name: (str(node.module), one.name) for one in node.names}
    return {name: one for name, one in found.items() if one[0].partition(".")[0] in (OWN, *BELOW)}


def _named_in(node: ast.stmt, module: str) -> Iterator[Name]:
    """Definitions and data files that a statement of a module names."""
    own, imports = _definitions(module), _imports(module)
    for one in ast.walk(node):
        if isinstance(one, ast.Name):
            if one.id in own:
                yield module, one.id
            elif one.id in imports:
                yield imports[one.id]
        elif isinstance(one, ast.Attribute) and getattr(one.value, "id", "") in imports:
            target, name = imports[one.value.id]  # type: ignore[attr-defined]
            yield f"{target}.{name}".strip("."), one.attr  # of a module
        elif isinstance(one, ast.Constant) and str(one.value).endswith(DATA):
            file = path_of(module).with_name(str(one.value))
            if file.is_file():
                yield str(file), ""


# files of users, and data


def _file(module: str) -> str:
    return str(getattr(sys.modules.get(module), "__file__", None) or "")


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
