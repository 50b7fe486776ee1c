"""Verdicts are decided in one place; studies state what is met."""

import ast
from itertools import product
from pathlib import Path

import pytest

import studies
from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW, VERDICTS
from studies.core.verdict import decide, decided, over_cases, with_and_without

ROOT = Path(studies.__file__).parent
CHOSEN = {"HOLDS", "FAILS", "CONDITIONS", "TOO_FEW", "VERDICTS"}
OUTSIDE = sorted(path for path in ROOT.rglob("*.py") if path.parent != ROOT / "core")


@pytest.mark.parametrize("path", OUTSIDE, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_study_chooses_a_verdict(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert not CHOSEN & {alias.name for alias in node.names}
        elif isinstance(node, ast.Name | ast.Attribute):
            assert (node.id if isinstance(node, ast.Name) else node.attr) not in CHOSEN
        elif isinstance(node, ast.Constant):
            assert node.value not in VERDICTS


@pytest.mark.parametrize(("essential", "further", "partly"), list(product([True, False], repeat=3)))
def test_a_verdict_follows_from_what_is_met(essential, further, partly):
    expected = (
        (HOLDS if further else CONDITIONS) if essential else (CONDITIONS if partly else FAILS)
    )
    assert decide([True, essential], [further], partly) == expected
    assert decide([essential], [further], partly, enough=False) == TOO_FEW


def test_what_is_not_met_is_a_condition_in_its_words():
    found = decided("x", "all", {"": True, "not a": False}, {"n": 2}, further={"not b": False})
    assert (found.verdict, found.conditions) == (FAILS, ("not a", "not b"))
    assert found.numbers["n"].value == 2.0


@pytest.mark.parametrize(
    ("met", "verdict"),
    [((True, True), HOLDS), ((True, False), CONDITIONS), ((False, False), FAILS), ((), HOLDS)],
)
def test_cases_count_alike(met, verdict):
    cases = {f"case {k}": one for k, one in enumerate(met)}
    found = over_cases("x", "all", cases, {})
    assert found.verdict == verdict
    assert found.conditions == tuple(case for case, one in cases.items() if not one)


def test_cases_are_said_with_and_without():
    assert with_and_without({"a": False, "b": True}) == ("with b", "not with a")
