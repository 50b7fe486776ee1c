"""Which code made a result: a hash of every source that decides it, found by following imports."""

import ast
import hashlib
import sys
from functools import lru_cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("alloc", "mpc", "studies")
"""Packages whose sources count. Of installed packages the versions do, see `alloc.recording.provenance`; a plug-in counts as
the one module that it is."""


PLUGIN_PREFIX = "readhesion_plugin_"
"""Beginning of the names of modules that plug-in files become."""


@lru_cache(maxsize=256)
def code_hash(*modules: str) -> str:
    """Hash of the sources of `modules` and of all that they import, however indirectly.

    Sources count by their syntax: comments, docstrings and layout may change, and the hash stays.
    """
    digest = hashlib.sha256()
    for name in sorted(_closure(modules)):
        digest.update(name.encode() + _syntax(name))
    return digest.hexdigest()[:16]


def _closure(modules: tuple[str, ...]) -> set[str]:
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name in found or _path(name) is None:
            continue
        found.add(name)
        waiting += _imports(name)
    return found


@lru_cache(maxsize=1024)
def _path(module: str) -> Path | None:
    """File of a module of this project, or of a plug-in; None for others."""
    if module.partition(".")[0] in PACKAGES:
        base = ROOT.joinpath(*module.split("."))
        files = (base.with_suffix(".py"), base / "__init__.py")
        return next((path for path in files if path.exists()), None)
    if module.startswith(PLUGIN_PREFIX):
        return Path(str(sys.modules[module].__file__))
    return None


@lru_cache(maxsize=1024)
def _tree(module: str) -> ast.Module:
    path = _path(module)
    assert path is not None
    source = path.read_bytes()
    return ast.parse(source if path.suffix == ".py" else f"content = {source!r}")


def _imports(module: str) -> list[str]:
    """Modules that a module names in import statements, wherever they stand, and the packages around them."""
    named: list[str] = []
    for node in ast.walk(_tree(module)):
        if isinstance(node, ast.Import):
            named += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            named += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Registry":
            named += _registered(node)
    parts = [name.split(".") for name in named]
    return [".".join(part[:k]) for part in parts for k in range(1, len(part) + 1)]


def _registered(registry: ast.Call) -> list[str]:
    """Modules of the package that a registry is told to import when a part is asked for."""
    values = [*registry.args, *(keyword.value for keyword in registry.keywords)]
    words = [str(value.value) for value in values if isinstance(value, ast.Constant)]
    return [
        f"{word}.{path.stem}"
        for word in words
        if word.partition(".")[0] in PACKAGES
        for path in ROOT.joinpath(*word.split(".")).glob("*.py")
    ]


@lru_cache(maxsize=1024)
def _syntax(module: str) -> bytes:
    tree = _tree(module)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):  # strings that stand alone are docstrings
            node.body = [  # type: ignore[attr-defined]
                item
                for item in body
                if not (isinstance(item, ast.Expr) and isinstance(item.value, ast.Constant))
            ]
    return hashlib.sha256(ast.dump(tree).encode()).digest()
