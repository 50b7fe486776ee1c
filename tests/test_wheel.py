"""A wheel holds every module, and every file that the program reads, by what `pyproject.toml` says."""

import re
import tomllib
from fnmatch import fnmatch
from pathlib import Path

from alloc.onboard.controllers.collection import BUILT_IN

ROOT = Path(__file__).parents[1]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
LAYERS = ("alloc", "mpc", "studies", "paper_figs")
NOT_SHIPPED = "paper_figs/gallery/*"
"""Pictures of the README, which the program does not read."""
FILES = [
    path.relative_to(ROOT)
    for layer in LAYERS
    for path in sorted((ROOT / layer).rglob("*"))
    if path.is_file() and not {"__pycache__", "kernels"} & set(path.parts)
]
MADE_FOR_WHEELS = "alloc/kernels/*"
"""What `make wheel` compiles; a clone has none of it."""
DATA = {
    f"{package.replace('.', '/')}/{pattern}"
    for package, patterns in SETUPTOOLS["package-data"].items()
    for pattern in patterns
}


def test_every_module_stands_in_a_package_that_is_found():
    for path in FILES:
        if path.suffix == ".py":
            assert all((ROOT / folder / "__init__.py").exists() for folder in path.parents[:-1])
            package = ".".join(path.parent.parts)
            assert any(fnmatch(package, one) for one in SETUPTOOLS["packages"]["find"]["include"])


def test_every_other_file_is_package_data_and_nothing_else_is():
    others = [str(path) for path in FILES if path.suffix != ".py"]
    read = [name for name in others if not fnmatch(name, NOT_SHIPPED)]
    assert len(read) > 10
    assert not [name for name in read if not any(fnmatch(name, pattern) for pattern in DATA)]
    unused = {one for one in DATA if not any(fnmatch(name, one) for name in read)}
    assert unused == {MADE_FOR_WHEELS}


def test_the_runs_that_are_compiled_for_a_wheel_have_every_built_in_controller():
    """Each is compiled by itself."""
    (runs,) = re.findall(r"^RUNS .*--controllers (.*)$", (ROOT / "Makefile").read_text(), re.M)
    assert set(BUILT_IN) | {"mpc", "mpc-train"} == set(runs.split())


def test_no_module_that_ships_imports_the_tests():
    for path in FILES:
        if path.suffix == ".py":
            text = (ROOT / path).read_text()
            assert "from tests" not in text, path
            assert "import tests" not in text, path


def test_every_layer_says_that_it_has_types():
    assert {f"{layer}/py.typed" for layer in LAYERS} <= {str(path) for path in FILES}
