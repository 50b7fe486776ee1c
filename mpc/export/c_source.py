"""The Python source of a compiled function, and the meaning of its names."""

import ast
import inspect
import textwrap
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from alloc.sources import ROOT
from mpc.export.c_kinds import Known, TranslationError, Value


class Source(NamedTuple):
    """A compiled function as it is written."""

    tree: ast.FunctionDef
    space: dict[str, Any]
    """Objects of its names."""
    file: str
    module: str
    defaults: tuple[Any, ...]
    unsized: frozenset[str]
    """Arguments of which, if they are vectors, it does not ask for the size."""


@lru_cache(maxsize=1024)
def source_of(function: Any) -> Source:
    """The source of a compiled function, or of a law that is compiled where it is called."""
    plain = inspect.unwrap(getattr(function, "py_func", function))
    lines, first = inspect.getsourcelines(plain)
    tree = ast.parse(textwrap.dedent("".join(lines)))
    ast.increment_lineno(tree, first - 1)
    node = tree.body[0]
    file = Path(inspect.getfile(plain))
    shown = file.relative_to(ROOT).as_posix() if file.is_relative_to(ROOT) else file.name
    if not isinstance(node, ast.FunctionDef):
        raise TranslationError(f"{shown}, line {first}: no function")
    rest = plain.__module__, plain.__defaults__ or (), _unsized(node)
    return Source(node, plain.__globals__, shown, *rest)


def _unsized(tree: ast.FunctionDef) -> frozenset[str]:
    """Names that occur as what an index or `load` and `store` are applied to, and in no other place."""
    plain: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript) and not isinstance(node.slice, ast.Slice):
            plain.add(id(node.value))
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("load", "store"):
            plain.add(id(node.args[0]))
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    others = {node.id for node in names if id(node) not in plain}
    return frozenset({node.id for node in names} - others)


def names_of(tree: ast.FunctionDef) -> list[str]:
    """Names of the arguments."""
    return [one.arg for one in tree.args.args]


def arguments_of(source: Source, arguments: list[Value]) -> dict[str, Value] | None:
    """Arguments by name, with those that are left out; None: they do not fit."""
    names = names_of(source.tree)
    missing = len(names) - len(arguments)
    if not 0 <= missing <= len(source.defaults):
        return None
    left_out = source.defaults[len(source.defaults) - missing :]
    return dict(zip(names, [*arguments, *(Value(Known(one)) for one in left_out)], strict=True))


def summary_of(tree: ast.FunctionDef) -> str:
    """The first paragraph of its docstring."""
    told = " ".join((ast.get_docstring(tree) or tree.name).split("\n\n")[0].split())
    return told.replace("*/", "* /")
