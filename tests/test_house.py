"""Rules of the house that a reader would otherwise have to check by hand."""

import ast
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
LAYERS = ("alloc", "mpc", "studies", "paper_figs")
"""A layer imports itself and those before it."""
ABOVE_ALL = {"studies.command.command_line", "readhesion"}
"""They import all, and nobody imports them."""
BROUGHT_ALONG = {"llvmlite": "numba", "markupsafe": "jinja2"}
"""What another distribution brings with it, in the one version that fits."""


def _trees(*folders):
    paths = [path for one in folders for path in sorted((ROOT / one).rglob("*.py"))]
    named = {path: ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in paths}
    return {name: ast.parse(path.read_text()) for path, name in named.items()}


TREES = _trees(*LAYERS) | {"readhesion": ast.parse((ROOT / "readhesion.py").read_text())}
"""Module -> syntax."""


def imported(tree, own, at_top=False):
    """Modules of this project (`own`) or others that import statements name; `at_top`: as the module is imported."""
    nodes = set(ast.walk(tree))
    if at_top:
        functions = [node for node in nodes if isinstance(node, ast.FunctionDef)]
        nodes -= {inner for one in functions for inner in ast.walk(one)}
    names = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    names |= {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
    return {one for one in names if (one.split(".")[0] in (*LAYERS, "readhesion", "tests")) == own}


def test_layers_import_one_way():
    for name, tree in TREES.items():
        if name not in ABOVE_ALL:
            below = LAYERS[: LAYERS.index(name.split(".")[0]) + 1]
            found = imported(tree, own=True)
            assert {one.split(".")[0] for one in found} <= set(below), name
            assert not found & ABOVE_ALL, name


ROOMS = {
    "alloc.schema": set(),
    "alloc.plant": {"schema"},
    "alloc.onboard": {"schema"},
    "alloc.rules": {"schema", "onboard"},
    "alloc.run": {"schema", "plant", "onboard", "rules"},
    "alloc.evaluation": {"schema", "plant"},
}
"""Rooms of `alloc`, and those that each imports."""
PRONOUNS = {
    "one", "ones", "other", "others", "found", "own", "told", "said", "given", "made", "words", "meant", "known", "asked",
    "taken", "kept", "stated", "done", "here", "there", "about", "what", "several",
}  # fmt: skip
"""They name nothing; a variable is named by what it is."""
ALLOWED = {"studies.gymnasium_environment": {"others"}}  # a public argument


def test_the_wings_meet_in_the_run_alone():
    for name, tree in TREES.items():
        if (room := ".".join(name.split(".")[:2])) in ROOMS:
            parts = (module.split(".")[1:2] for module in imported(tree, own=True))
            rooms = {part[0] for part in parts if part} & {room.split(".")[1] for room in ROOMS}
            assert rooms - {room.split(".")[1]} <= ROOMS[room], name


def bindings(tree):
    """Names of functions, arguments and variables that a module binds."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id


def test_no_pronoun_is_a_name():
    for name, tree in TREES.items():
        pronouns = {word for word in bindings(tree) if word.strip("_") in PRONOUNS}
        assert pronouns <= ALLOWED.get(name, set()), name


def test_no_private_name_is_imported():
    for name, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] in LAYERS:
                assert not [one.name for one in node.names if one.name.startswith("_")], name


def test_what_is_imported_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    required, *extras = ({re.match(r"[\w-]+", one)[0].replace("-", "_").lower() for one in several}
                         for several in (project["dependencies"], *project["optional-dependencies"].values()))  # fmt: skip
    of_an_extra = set()
    for name, tree in (TREES | _trees("tests")).items():
        for at_top in (True, False):
            names = {one.split(".")[0] for one in imported(tree, own=False, at_top=at_top)}
            names = {BROUGHT_ALONG.get(one, one) for one in names - sys.stdlib_module_names}
            missing = {one.lower() for one in names} - required
            assert missing <= set().union(*extras), name
            of_an_extra |= {name} if at_top and missing else set()
    # an extra that is not installed is in nobody's way
    needed = set().union(*(imported(tree, own=True, at_top=True) for tree in TREES.values()))
    assert not needed & of_an_extra
