"""Verdicts are decided in one place; studies state what is met."""

import ast
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import studies
from studies.core.claims import AT_MOST, Claim, conjunction
from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW, UNDECIDED, VERDICTS
from studies.core.verdict import (
    LEAST_EVENTS,
    Bound,
    decide,
    decided,
    over_cases,
    side,
    with_and_without,
)

ROOT = Path(studies.__file__).parent
CHOSEN = {"HOLDS", "FAILS", "CONDITIONS", "UNDECIDED", "TOO_FEW", "VERDICTS"}
LIMITS = {"low", "high"}
OUTSIDE = sorted(path for path in ROOT.rglob("*.py") if path.parent != ROOT / "core")


def test_no_study_chooses_a_verdict_or_compares_an_interval_with_a_threshold():
    for path in OUTSIDE:
        for node in ast.walk(ast.parse(path.read_text())):
            place = f"{path}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.ImportFrom):
                assert not CHOSEN & {alias.name for alias in node.names}, place
            elif isinstance(node, ast.Name | ast.Attribute):
                name = node.id if isinstance(node, ast.Name) else node.attr
                assert name not in CHOSEN, place
            elif isinstance(node, ast.Constant):
                assert node.value not in VERDICTS, place
            elif isinstance(node, ast.Compare) and path.stem == "statements":
                compared = {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}
                assert not LIMITS & compared, place


@pytest.mark.parametrize(
    ("low", "high", "least", "most", "expected"),
    [(0.1, 0.3, 0.0, np.inf, 1), (-0.3, -0.1, 0.0, np.inf, -1), (-0.1, 0.1, 0.0, np.inf, 0),
     (0.0, 0.1, 0.0, np.inf, 0), (-0.1, 0.0, 0.0, np.inf, 0), (-0.3, -0.1, -np.inf, 0.0, 1), (0.1, 0.3, -np.inf, 0.0, -1),
     (-0.1, 0.1, -0.2, 0.2, 1), (0.1, 0.3, -0.2, 0.2, 0), (0.3, 0.4, -0.2, 0.2, -1), (-0.4, 0.4, -0.2, 0.2, 0),
     (np.nan, np.nan, 0.0, np.inf, 0)],
)  # fmt: skip
def test_an_interval_that_contains_a_threshold_decides_nothing(low, high, least, most, expected):
    assert side(low, high, least, most) == expected
    assert side([low, 1.0], [high, 2.0], least, most)[0] == expected


@pytest.mark.parametrize(("essential", "further", "partly"), list(product([True, False], repeat=3)))
def test_a_verdict_follows_from_what_is_met(essential, further, partly):
    expected = (
        (HOLDS if further else CONDITIONS) if essential else (CONDITIONS if partly else FAILS)
    )
    assert decide([True, essential], [further], partly) == expected
    assert decide([essential], [further], partly, enough=False) == TOO_FEW


@pytest.mark.parametrize(
    ("essential", "verdict"),
    [((True, None), UNDECIDED), ((None, None), UNDECIDED), ((None, False), FAILS), ((np.True_, None), UNDECIDED)],
)  # fmt: skip
def test_what_is_undecided_neither_holds_nor_fails(essential, verdict):
    assert decide(essential) == decide(essential, [False]) == verdict
    assert decide(essential, partly=True) == CONDITIONS
    assert decide([True], [None]) == CONDITIONS
    assert decide(essential, enough=False) == TOO_FEW


def test_a_bound_is_decided_by_its_interval_and_judged_again_on_resamples():
    noise = np.random.default_rng(0).normal(size=60)
    noise -= noise.mean()
    shifts = {1.0: HOLDS, 0.0: UNDECIDED, -1.0: FAILS}
    for shift, verdict in shifts.items():
        found = decided("x", "", {"so": Bound("", pd.Series(noise + shift), least=0.0)}, {})
        assert found.verdict == verdict
        assert found.agreement > 0.9
    assert found.conditions == ("not so",)
    events = pd.DataFrame({"a": noise + 1.0, "b": noise})
    claim = Claim("x", cases=(Claim("a", mean="a"),), besides=(Claim("b", mean="b"),))
    both = conjunction(events, claim)
    assert (both.verdict, both.conditions) == (CONDITIONS, ("not shown b",))
    twice = replace(claim, besides=(Claim("b", mean="b"), Claim("b", mean="a", side=AT_MOST)))
    assert conjunction(events, twice).conditions == (
        "not shown b",
        "not b",
    )  # equal words, two bounds
    few = Bound("", pd.Series(noise[: LEAST_EVENTS - 1]), least=0.0)
    assert decided("x", "", {"": few}, {}).verdict == TOO_FEW
    share = pd.Series([True] * 57 + [False] * 3)  # Wilson's interval of 0.95 is [0.863, 0.983]
    for least, verdict in ((0.86, HOLDS), (0.87, UNDECIDED), (0.98, UNDECIDED), (0.99, FAILS)):
        assert decided("x", "", {"": Bound("", share, least=least)}, {}).verdict == verdict


def test_what_is_not_met_is_a_condition_in_its_words():
    found = decided("x", "all", {"": True, "a": False}, {"n": 2}, further={"b": False})
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
    assert found.conditions == tuple(f"not {case}" for case, one in cases.items() if not one)


def test_cases_are_said_with_and_without():
    assert with_and_without({"a": False, "b": True}) == ("with b", "not with a")
