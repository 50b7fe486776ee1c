"""Rules of the house that a reader would otherwise have to check by hand.

`python -m tests.test_house` lists the modules that are too small, and the functions that are called once and have no name of
the field: each of these belongs where it is called, unless a reader is better off with it.
"""

import ast
import re
from collections import Counter, defaultdict
from collections.abc import Iterator
from fnmatch import fnmatch
from graphlib import CycleError, TopologicalSorter
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LAYERS = ("alloc", "mpc", "studies", "paper_figs")
"""A layer imports those before it, never those behind it."""
MOST_ARGUMENTS = 12
LEAST_LINES, MOST_LINES = 80, 700
SMALL_FOR_A_REASON = {
    "names of a package": ("*.__init__",),
    "entry points": ("*.__main__", "studies.command_line.*", "*.study", "*_study"),
    "entries of parts": ("mpc.hosted",),
    "all that generated code imports": ("mpc.arrays",),
    "cited apart from what uses it": ("alloc.onboard.controllers.swarm",),
    "data": ("alloc.units",),
}  # fmt: skip
"""Why a module may have fewer than `LEAST_LINES` -> patterns of names of modules."""
STILL_SMALL = 5
"""Small modules without a reason, still to be merged: this number only falls."""
NO_NAMES = {"utils", "helpers", "misc", "common", "tools"}

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


def test_modules_below_the_studies_do_not_import_each_other_in_a_circle_not_even_for_types():
    modules = [name for name in TREES if name.split(".")[0] in LAYERS[:2]]
    arrows = {name: set(imports(name)) for name in modules if not name.endswith("__init__")}
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_plant_knows_nothing_of_what_runs_on_board():
    below = (
        "alloc.plant",
        "alloc.records",
        "alloc.compilation",
        "alloc.display",
        "alloc.errors",
        "alloc.registry",
        "alloc.units",
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
                outside = other == "alloc.registry" or not f"{other}.".startswith(package)
                assert outside, name


def test_no_function_takes_more_arguments_than_a_reader_can_hold():
    for name, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                a = node.args
                count = len(a.posonlyargs) + len(a.args) + len(a.kwonlyargs)
                count += sum(item is not None for item in (a.vararg, a.kwarg))
                assert count <= MOST_ARGUMENTS, f"{name}: {node.name} takes {count}"


def small_modules() -> list[str]:
    """Modules of fewer than `LEAST_LINES` lines for none of the reasons."""
    reasons = [pattern for patterns in SMALL_FOR_A_REASON.values() for pattern in patterns]
    return [
        name
        for name, lines in FILES.items()
        if lines < LEAST_LINES and not any(fnmatch(name, one) for one in reasons)
    ]


def test_a_module_is_one_idea_of_a_size_that_can_be_read():
    assert not {name: lines for name, lines in FILES.items() if lines > MOST_LINES}
    assert not [name for name in TREES if name.split(".")[-1] in NO_NAMES]
    small = small_modules()
    assert len(small) <= STILL_SMALL, f"one of these is new: join it to what it serves: {small}"


def test_every_reason_for_a_small_module_has_one():
    for pattern in (one for patterns in SMALL_FOR_A_REASON.values() for one in patterns):
        assert [name for name in TREES if fnmatch(name, pattern)], pattern


def test_everything_that_a_module_offers_is_there():
    offering = [
        name.removesuffix(".__init__") for name in TREES if "__all__" in assigned(TREES[name])
    ]
    missing = [
        f"{name}.{one}"
        for name, module in ((name, import_module(name)) for name in offering)
        for one in module.__all__
        if not hasattr(module, one)
    ]
    assert offering
    assert not missing


def assigned(tree: ast.Module) -> set[str]:
    """Names that a module assigns at its top."""
    targets = (
        target for node in tree.body if isinstance(node, ast.Assign) for target in node.targets
    )
    return {target.id for target in targets if isinstance(target, ast.Name)}


def called_once() -> Iterator[tuple[str, int, str]]:
    """Module, line and name of functions that are named once outside their definition, and by no term of the glossary."""
    nodes = [node for tree in TREES.values() for node in ast.walk(tree)]
    named = Counter(node.id for node in nodes if isinstance(node, ast.Name))
    named += Counter(node.attr for node in nodes if isinstance(node, ast.Attribute))
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    terms = {
        frozenset(re.findall("[a-z]+", term.lower()))
        for row in re.findall(r"^\| ([^|]+) \|", glossary, flags=re.MULTILINE)
        for term in row.split(",")
    } - {frozenset()}
    for module, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and not node.decorator_list:
                words = set(node.name.strip("_").split("_"))
                if named[node.name] == 1 and not any(term <= words for term in terms):
                    yield module, node.lineno, node.name


if __name__ == "__main__":
    for name in small_modules():
        print(f"small: {name}, {FILES[name]} lines")
    once = list(called_once())
    for name, line, function in once:
        print(f"called once: {name}:{line} {function}")
    print(f"{len(small_modules())} small modules, {len(once)} functions called once")


def test_files_of_tests_that_scripts_name_are_there():
    script = (ROOT / ".ci/versions").read_text()
    named = [
        f"{folder}/test_{one}.py"
        for folder, several in re.findall(r"(tests/\w+)/test_\{([\w,]+)\}\.py", script)
        for one in several.split(",")
    ]
    assert len(named) > 5
    assert not [name for name in named if not (ROOT / name).is_file()]
