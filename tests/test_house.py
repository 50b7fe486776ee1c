"""Rules of the house that a reader would otherwise have to check by hand."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MOST_ARGUMENTS = 12

TO_SPLIT = {
    "mpc/belief.py:_update",
    "mpc/curve_belief.py:_update",
    "mpc/shooting.py:linearise",
    "mpc/shooting.py:second_order",
    "studies/readhesion_paper/lanes.py:_run",
}
"""Functions that still take more."""


def _arguments(function):
    a = function.args
    several = sum(item is not None for item in (a.vararg, a.kwarg))
    return len(a.posonlyargs) + len(a.args) + len(a.kwonlyargs) + several


@pytest.mark.parametrize("package", ["alloc", "mpc", "studies", "paper_figs"])
def test_no_function_takes_more_arguments_than_a_reader_can_hold(package):
    for path in sorted((ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                name = f"{path.relative_to(ROOT)}:{node.name}"
                assert _arguments(node) <= MOST_ARGUMENTS or name in TO_SPLIT, name
