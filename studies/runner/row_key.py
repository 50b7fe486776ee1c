"""What decides the rows of a cell: its arguments, and the sources behind the function that makes them.

A study is one file, and its table, its figure and its words change more often than what it computes. So of a module of
`studies` only those definitions count that the function names, and those that these name, wherever they stand. Of `alloc`
and `mpc` the whole package counts. Comments, docstrings, names of local variables and looks count nowhere in the project. Of
a user's own file its whole folder counts: what helps it lies beside it.

Of the project the sources count that this process has loaded. Files of users are read anew for each study.
"""

import ast
import hashlib
import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, is_dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np

from alloc.compilation import FOLDER, ROOT
from alloc.files import write_whole
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from alloc.schema.errors import InputError
from studies import SourcesChanged

STUDIES, BELOW = "studies", ("alloc", "mpc")
"""The package whose definitions are followed one by one, and those that count as they are."""
APART = (
    "alloc.evaluation.brake_force",
    "alloc.evaluation.wheel_damage",
    "alloc.evaluation.measured_series",
    "alloc.conformance",
    "alloc.rules.conformance",
    "mpc.optimum",
    "mpc.plant",
)
"""What of `alloc` and `mpc` no run uses: it counts where a function names it."""
LIBRARIES = ("numpy", "numba", "llvmlite", "casadi", "osqp", "cvxpy")
"""Installed packages whose versions count, beside that of Python."""
TEXTS = (".csv", ".toml", ".json", ".txt", ".yaml", ".yml", ".ini", ".xml", ".dat")
DATA = (*TEXTS, ".npy", ".npz", ".mat", ".xlsx", ".parquet", ".h5", ".hdf5", ".pkl")
"""Files in the folder of a user's own that it may read; a study's own count where it names them."""
PASSED_OVER = {"__pycache__", "site-packages", "node_modules", "results", "figures"}
"""Folders that hold no source of a plug-in: of libraries, and of what the command writes."""
MOST_FILES = 500
"""Files of a user's folder; beyond, it is no folder of one plug-in, and reading it all would take long."""

ROWS = "rows.jsonl"
"""File of a study's folder: a line for each cell that was run, with its key and its rows; it is only added to."""

Name = tuple[str, str]
"""A module, and a name in it; or a data file."""


def hash_cell(run: Callable[..., Any], args: tuple[Any, ...], sources: tuple[str, ...] = ()) -> str:
    """Hash of what decides the rows that `run(*args)` gives: rules and controllers among `args` too, which no name reaches.

    `sources`: modules of other parts that `args` name.
    """
    parts = {*sources}
    for registry in (RULES, CONTROLLERS):
        parts |= {registry.origin(arg) for arg in args if isinstance(arg, str) and arg in registry}
    code = hash_sources(run, tuple(sorted(parts)))
    text = json.dumps([_plain_value(run), args, code], default=_plain_value)
    return _hash_text(text)


def hash_sources(function: Callable[..., Any], modules: tuple[str, ...] = ()) -> str:
    """Hash of the sources behind `function` and of `modules`, which are beside it.

    Raises `SourcesChanged` where the project is not what this process has loaded.
    """
    _check_project()
    code, files = _follow_names(function, modules)
    return _hash_text("\n".join([code, *map(folder_hash, files)]))


@cache
def _follow_names(function: Callable[..., Any], modules: tuple[str, ...]) -> tuple[str, list[str]]:
    """Hash of what counts of the project, which is kept beside compiled code, and the files that count beside it."""
    module, name = function.__module__, function.__qualname__.partition(".")[0]
    users = {
        str(getattr(sys.modules.get(origin), "__file__", None) or "")
        for origin in {*modules, module}
        if origin.partition(".")[0] not in (STUDIES, *BELOW)
    }
    shipped = sorted(origin for origin in modules if origin.partition(".")[0] in (STUDIES, *BELOW))
    state = json.dumps([_LOADED, *_list_versions(), str(ROOT), module, name, shipped, bool(users)])
    path = Path(FOLDER or os.devnull, f"key-{_hash_text(state)}")
    try:
        code, data = json.loads(path.read_text())
    except (OSError, ValueError):
        code, data = _read_names(module, name, shipped, bool(users))
        with suppress(OSError):
            write_whole(path, partial(Path.write_text, data=json.dumps([code, data])))
    return code, sorted(users.union(data))


def _read_names(module: str, name: str, modules: list[str], of_user: bool) -> tuple[str, list[str]]:
    """As `_follow_names`, from the text of the project; `of_user`: files of users count beside it."""
    seen: dict[Name, str] = {}
    of_project = module.partition(".")[0] in (STUDIES, *BELOW)
    whole = set(modules)
    left: list[Name] = [(module, name)]
    while left:
        module, name = left.pop()
        if module.partition(".")[0] != STUDIES:
            whole.add(module)
        elif (module, name) not in seen:
            seen[module, name], below = _read_definition(module, name)
            left += below
    files = [module for module in whole if os.sep in module]
    files += [str(module_path(module)) for module in whole if module.partition(".")[0] == STUDIES]
    packages = {
        part
        for part in (*BELOW, *APART)
        if any(f"{module}.".startswith(f"{part}.") for module in whole)
    }
    if files or of_user:
        packages.update(APART)
    if of_user:  # a user's file may import any
        packages.update(BELOW)
    if not of_project:
        packages.add(STUDIES)
    parts = [seen[name] for name in sorted(seen)]
    return _hash_text("\n".join([*parts, *map(_hash_package, sorted(packages))])), files


@cache
def _hash_package(name: str) -> str:
    """Hash of all that a package says, without what stands `APART` in it, and of the libraries below it."""
    apart = [module_path(part) for part in APART if part != name]
    folders = {path.parent if path.stem == "__init__" else path for path in apart}
    files = [path for path in _source_files(name) if not folders & {path, *path.parents}]
    texts = [
        computed_text(*_read_syntax(path).body) if path.suffix == ".py" else path.read_bytes().hex()
        for path in files
    ]
    return _hash_text("\n".join([*_list_versions(), *texts]))


@cache
def _list_versions() -> list[str]:
    return ["{}.{}".format(*sys.version_info), *map(version, LIBRARIES)]


def module_path(module: str) -> Path:
    """File of a module of the project."""
    path = ROOT.joinpath(*module.split("."))
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def _source_files(name: str) -> list[Path]:
    path = module_path(name)
    files = path.parent.rglob("*") if path.stem == "__init__" else [path]
    return sorted(path for path in files if path.suffix in (".py", *DATA))


def _hash_project() -> str:
    """Hash of the project's files as they are now."""
    files = [path for name in (STUDIES, *BELOW) for path in _source_files(name)]
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


_LOADED, _prompt = _hash_project(), ""


def read_anew() -> None:
    """A study begins: files of users count as they are now, and what was typed at a prompt is new."""
    global _prompt
    _prompt = os.urandom(8).hex()
    folder_hash.cache_clear()
    _check_project.cache_clear()


@cache
def _check_project() -> None:
    """Raise `SourcesChanged` where the project's files are others than when they were loaded; looked at once a study."""
    if _hash_project() != _LOADED:
        advice = "start this process again, and of a cluster its workers"
        raise SourcesChanged(f"{ROOT}: the project was edited since it was loaded; {advice}")


def _hash_text(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _plain_value(value: Any) -> Any:
    """What JSON can say of an argument."""
    if callable(value):
        return f"{value.__module__}.{value.__qualname__} {hash_sources(value)}"
    if hasattr(value, "text"):  # a scenario
        return value.text
    if is_dataclass(value):
        return asdict(value)  # type: ignore[arg-type]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{value!r:.80} in the arguments of a cell has no text that identifies it")


# modules of this package, read as text


LOOKS = {"colour", "marker", "description"}
"""Keywords that say how a part is shown."""
WORDS = {
    "Belief": (2,),
    "Column": (2,),
    "Rule": (1,),
    "convex_rule": (),
    "metric": (2,),
    "register": (2,),
}
"""What makes a part, and the places of arguments that say how the part is shown."""


@cache
def _read_syntax(path: Path) -> ast.Module:
    """The tree of a file, without strings that stand alone, which are docstrings, and without looks."""
    tree = ast.parse(path.read_bytes() if path.is_file() else b"")
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list) and any(map(_is_docstring, body)):
            statements = [statement for statement in body if not _is_docstring(statement)]
            node.body = statements or [ast.copy_location(ast.Pass(), body[0])]  # type: ignore[attr-defined]
        part = getattr(getattr(node, "func", None), "id", "")
        if isinstance(node, ast.Call) and part in WORDS:
            node.args = [x for k, x in enumerate(node.args) if k not in WORDS[part]]
            node.keywords = [x for x in node.keywords if x.arg not in LOOKS]
    return tree


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def computed_text(*nodes: ast.stmt) -> str:
    """What statements compute, as text: their bytecode, which has numbers in place of the names of local variables."""
    return _code_text(compile(ast.Module(list(nodes), []), "", "exec", dont_inherit=True))


def _code_text(code: CodeType) -> str:
    constants = [
        _code_text(x)
        if isinstance(x, CodeType)
        else repr(sorted(map(repr, x)) if isinstance(x, frozenset) else x)
        for x in code.co_consts
    ]
    # a caller may use the names of parameters, though not of a lambda's
    named = 0 if code.co_name == "<lambda>" else code.co_argcount + code.co_kwonlyargcount
    head = code.co_name, code.co_flags, code.co_names, code.co_varnames[:named]
    return repr((*head, code.co_code, code.co_exceptiontable, constants))


@cache
def _definitions_of(module: str) -> dict[str, list[ast.stmt]]:
    """Top-level statements of a module by the names that they bind."""
    statements: dict[str, list[ast.stmt]] = {}
    for node in _read_syntax(module_path(module)).body:
        bound = [getattr(node, "name", "")]
        if not isinstance(node, ast.FunctionDef | ast.ClassDef):
            names = [inner for inner in ast.walk(node) if isinstance(inner, ast.Name)]
            bound = [name.id for name in names if isinstance(name.ctx, ast.Store)]
        for name in bound:
            statements.setdefault(name, []).append(node)
    return statements


@cache
def _read_definition(module: str, name: str) -> tuple[str, list[Name]]:
    """What a definition computes, as text, and what it names."""
    nodes = _definitions_of(module).get(name, [])
    return computed_text(*nodes), [used for node in nodes for used in _names_used_in(node, module)]


@cache
def _imports_of(module: str) -> dict[str, Name]:
    """What names of a module are imported, wherever: the module that they are of, and the name there."""
    targets: dict[str, Name] = {}
    for node in ast.walk(_read_syntax(module_path(module))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            source = getattr(node, "module", "")
            for alias in node.names:
                target = (source, alias.name) if source else (alias.name, "")
                if target[0].partition(".")[0] in (STUDIES, *BELOW):
                    targets[alias.asname or alias.name] = target
    return targets


def _names_used_in(node: ast.stmt, module: str) -> Iterator[Name]:
    """Definitions and data files that a statement of a module names."""
    definitions, imports = _definitions_of(module), _imports_of(module)
    for part in ast.walk(node):
        if isinstance(part, ast.Name) and part.id in definitions:
            yield module, part.id
        elif isinstance(part, ast.Name) and part.id in imports:
            yield imports[part.id]
        elif isinstance(part, ast.Attribute) and getattr(part.value, "id", "") in imports:
            target, name = imports[part.value.id]  # type: ignore[attr-defined]
            yield f"{target}.{name}".strip("."), part.attr  # of a module
        elif isinstance(part, ast.Constant) and str(part.value).endswith(DATA):
            file = module_path(module).with_name(str(part.value))
            if file.is_file():
                yield str(file), ""


# files of users, and data


@cache
def folder_hash(file: str) -> str:
    """Hash of a data file; of a Python file that of all `files_beside` it.

    An interactive session has no file, and its rows are never found again. Raises `InputError` for a folder of too many,
    `SourcesChanged` in a worker that has no such module.
    """
    if not file and multiprocessing.parent_process():
        raise SourcesChanged(
            "a worker does not know a part that has no file, or whose file is no plug-in; give jobs = 1"
        )
    if not file:
        return _prompt
    files = [Path(file)] if file.endswith(DATA) else files_beside(file)
    return _hash_text("".join(f"{path} {path.read_bytes().hex()}" for path in files))


def files_beside(file: str) -> list[Path]:
    """What decides the rows of a user's Python file: Python files and data of its folder, at any depth.

    Not what this process prints into, and no folder of rows. Raises `InputError` for a folder of too many.
    """
    printed = [os.fstat(number) for number in (1, 2)]
    folder, files = Path(file).parent, list[Path]()
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if name not in PASSED_OVER and name[0] != "."]
        if ROWS not in names or Path(place) == folder:
            files += [Path(place, name) for name in names if name.endswith((".py", *DATA))]
        if len(files) > MOST_FILES:
            raise InputError(
                f"{file}: its folder has more than {MOST_FILES} Python and data files, and each may decide its rows; "
                "move it to a folder of its own"
            )
    sources = []
    for path in files:
        if not any(os.path.samestat(path.stat(), output) for output in printed):
            sources.append(path)
    return sorted(sources)
