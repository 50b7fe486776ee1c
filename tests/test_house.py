"""Rules of the house that a reader would otherwise have to check by hand."""

import ast
from collections import defaultdict
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAYERS = ("alloc", "mpc", "studies", "paper_figs")
"""A layer imports those before it, never those behind it."""
MOST_ARGUMENTS = 12
MOST_LINES = 330
NO_NAMES = {"utils", "helpers", "misc", "common", "tools"}
SHARED_NAMES = {
    "__init__", "study", "statements", "events", "measures",  # of a topic, one each
    "findings", "arms", "calibration", "members",
    "registry", "collection", "dispatch", "parameters", "settings", "state",  # of a kind of part, one each
}  # fmt: skip
"""Names of files that stand in several folders, with one meaning."""

TREES = {
    path.relative_to(ROOT).with_suffix("").as_posix().replace("/", "."): ast.parse(path.read_text())
    for layer in LAYERS
    for path in sorted((ROOT / layer).rglob("*.py"))
}
"""Module -> syntax."""
FILES = {
    name: (ROOT / name.replace(".", "/")).with_suffix(".py").read_text().count("\n")
    for name in TREES
}
"""Module -> lines."""


def imports(name):
    """Modules that a module names in import statements, lazy ones included."""
    for node in ast.walk(TREES[name]):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name} imports by dots"
            yield str(node.module)


def room(name):
    """Folder of a module, or the module where it stands in a layer's own folder."""
    return ".".join(name.split(".")[:2])


def test_no_layer_imports_upward_not_even_lazily():
    for name in TREES:
        above = LAYERS[LAYERS.index(name.split(".")[0]) + 1 :]
        assert not [other for other in imports(name) if other.split(".")[0] in above], name


def test_rooms_do_not_import_each_other_in_a_circle():
    arrows = defaultdict(set)
    for name in TREES:
        for other in imports(name):
            if other.split(".")[0] in LAYERS[:3] and room(other) != room(name):
                arrows[room(name)].add(room(other))
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_plant_knows_nothing_of_what_runs_on_board():
    below = (
        "alloc.plant",
        "alloc.by_reference",
        "alloc.compilation",
        "alloc.display",
        "alloc.errors",
        "alloc.registry",
    )
    for name in TREES:
        if name.startswith("alloc.plant."):
            assert all(
                other.startswith(below) for other in imports(name) if other.startswith("alloc")
            )


@pytest.mark.parametrize("module", ["compiled", "array_model", "field", "rail"])
def test_onboard_computers_cannot_reach_the_truth(module):
    for name in TREES:
        if name.startswith("alloc.onboard."):
            assert f"alloc.plant.{module}" not in set(imports(name)), name


def test_packages_import_no_modules_of_their_own():
    for name, tree in TREES.items():
        if name.endswith(".__init__"):
            package = name.removesuffix("__init__")
            for node in tree.body:  # what stands below TYPE_CHECKING is not imported
                other = getattr(node, "module", None) or ""
                outside = other == "alloc.lazy" or not f"{other}.".startswith(package)
                assert outside or package == "alloc.", name  # it chooses Numba's cache folder first


def test_no_function_takes_more_arguments_than_a_reader_can_hold():
    for name, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                a = node.args
                count = len(a.posonlyargs) + len(a.args) + len(a.kwonlyargs)
                count += sum(item is not None for item in (a.vararg, a.kwarg))
                assert count <= MOST_ARGUMENTS, f"{name}: {node.name} takes {count}"


def test_files_are_one_idea_of_a_size_that_can_be_read():
    long = {name: lines for name, lines in FILES.items() if lines > MOST_LINES}
    assert not long
    assert not [name for name in TREES if name.split(".")[-1] in NO_NAMES]


def test_a_basename_means_one_thing():
    folders = defaultdict(list)
    for name in TREES:
        if not name.startswith("paper_figs."):  # a file of figures has its topic's name
            folders[name.split(".")[-1]].append(name)
    several = {base: names for base, names in folders.items() if len(names) > 1}
    assert set(several) <= SHARED_NAMES, {b: n for b, n in several.items() if b not in SHARED_NAMES}
