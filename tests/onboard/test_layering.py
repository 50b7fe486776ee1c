"""Imports run one way, and nothing on board reads the plant's state."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LAYERS = ("alloc", "mpc", "studies", "paper_figs")


def _imports(path):
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize("layer", LAYERS)
def test_no_layer_imports_upward(layer):
    above = set(LAYERS[LAYERS.index(layer) + 1 :])
    for path in (ROOT / layer).rglob("*.py"):
        for name in _imports(path):
            assert name.split(".")[0] not in above, f"{path.relative_to(ROOT)} imports {name}"


def test_plant_knows_nothing_of_what_runs_on_board():
    for path in (ROOT / "alloc" / "plant").rglob("*.py"):
        for name in _imports(path):
            if name.startswith("alloc."):
                below = ("alloc.plant", "alloc.compilation", "alloc.errors", "alloc.registry")
                assert name.startswith(below), f"{path.name}: {name}"


@pytest.mark.parametrize(
    "module", ["plant.compiled", "plant.array_model", "plant.field", "plant.rail"]
)
def test_onboard_computers_cannot_reach_the_truth(module):
    for path in (ROOT / "alloc" / "onboard").rglob("*.py"):
        assert f"alloc.{module}" not in set(_imports(path)), path.name
