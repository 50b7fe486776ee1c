"""Verdicts are decided in one place; studies state what is met."""

import ast
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

import studies
from studies.core.claims import ABOUT, AT_LEAST, AT_MOST, Claim, conjunction, meets
from studies.core.statement import (
    CONDITIONS,
    FAILS,
    HOLDS,
    LEAST_EVENTS,
    TOO_FEW,
    UNDECIDED,
    VERDICTS,
    decide,
    side,
)
from studies.core.study import all_studies

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


def test_every_study_freezes_what_it_claims():
    for name, study in all_studies().items():
        assert study.claimed(), name


SIDES = [
    (0.1, 0.3, 0.0, np.inf, 1), (-0.3, -0.1, 0.0, np.inf, -1), (-0.1, 0.1, 0.0, np.inf, 0), (0.0, 0.1, 0.0, np.inf, 0),
    (-0.1, 0.0, 0.0, np.inf, 0), (-0.3, -0.1, -np.inf, 0.0, 1), (0.1, 0.3, -np.inf, 0.0, -1), (-0.1, 0.1, -0.2, 0.2, 1),
    (0.1, 0.3, -0.2, 0.2, 0), (0.3, 0.4, -0.2, 0.2, -1), (-0.4, 0.4, -0.2, 0.2, 0), (np.nan, np.nan, 0.0, np.inf, 0),
]  # fmt: skip
"""Limits of an interval, thresholds, and the side on which it lies."""


def test_an_interval_that_contains_a_threshold_decides_nothing():
    for *how, expected in SIDES:
        assert side(*how) == expected, how
        low, high, least, most = how
        assert side([low, 1.0], [high, 2.0], least, most)[0] == expected


def test_a_verdict_follows_from_what_is_met():
    for essential, further, partly in product([True, False], repeat=3):
        expected = (
            (HOLDS if further else CONDITIONS) if essential else (CONDITIONS if partly else FAILS)
        )
        assert decide([True, essential], [further], partly) == expected
        assert decide([essential], [further], partly, enough=False) == TOO_FEW


def test_what_is_undecided_neither_holds_nor_fails():
    cases = {
        (True, None): UNDECIDED,
        (None, None): UNDECIDED,
        (None, False): FAILS,
        (np.True_, None): UNDECIDED,
    }
    for essential, verdict in cases.items():
        assert decide(essential) == decide(essential, [False]) == verdict
        assert decide(essential, partly=True) == CONDITIONS
        assert decide([True], [None]) == CONDITIONS
        assert decide(essential, enough=False) == TOO_FEW


def test_a_bound_is_decided_by_its_interval_and_judged_again_on_resamples():
    noise = np.random.default_rng(0).normal(size=60)
    noise -= noise.mean()
    bound = Claim("x", cases=(Claim("so", mean="a"),))
    for shift, verdict in {1.0: HOLDS, 0.0: UNDECIDED, -1.0: FAILS}.items():
        found = conjunction(pd.DataFrame({"a": noise + shift}), bound)
        assert found.verdict == verdict
        assert found.agreement > 0.9
    assert found.conditions == ("not so",)
    events = pd.DataFrame({"a": noise + 1.0, "b": noise})
    claim = Claim("x", cases=(Claim("a", mean="a"),), besides=(Claim("b", mean="b"),))
    both = conjunction(events, claim)
    assert (both.verdict, both.conditions) == (CONDITIONS, ("not shown b",))
    twice = replace(claim, besides=(Claim("b", mean="b"), Claim("b", mean="a", side=AT_MOST)))
    found = conjunction(events, twice)
    assert found.conditions == ("not shown b", "not b")  # equal words, two bounds
    few = events.iloc[: LEAST_EVENTS - 1]
    assert conjunction(few, bound).verdict == TOO_FEW
    share = pd.DataFrame(
        {"a": [True] * 57 + [False] * 3}
    )  # Wilson's interval of 0.95 is [0.863, 0.983]
    for least, verdict in ((0.86, HOLDS), (0.87, UNDECIDED), (0.98, UNDECIDED), (0.99, FAILS)):
        assert conjunction(share, Claim("x", mean="a", value=least)).verdict == verdict


def test_what_is_not_met_is_a_condition_in_its_words():
    found = conjunction(pd.DataFrame(), Claim("x"), {"": True, "a": False}, {"b": False}, {"n": 2})
    assert (found.verdict, found.conditions) == (FAILS, ("not a", "not b"))
    assert found.numbers["n"].value == 2.0


def test_a_number_that_is_not_random_meets_its_bounds_ends_included():
    values = (0.4, 0.5, 1.0, 1.5, 1.6, np.nan)
    for side_claimed, expected in (
        (AT_LEAST, (False, False, True, True, True, False)),
        (AT_MOST, (True, True, True, False, False, False)),
        (ABOUT, (False, True, True, True, False, False)),
    ):
        claim = Claim("x", side=side_claimed, value=1.0, tolerance=0.5 * (side_claimed == ABOUT))
        assert tuple(meets(claim, one) for one in values) == expected, side_claimed


def test_rows_that_are_cases_count_alike_and_those_that_miss_are_named():
    verdicts = {(1, 1): HOLDS, (1, 3): CONDITIONS, (3, 3): FAILS, (): HOLDS, (np.nan,): FAILS}
    for values, verdict in verdicts.items():
        rows = pd.DataFrame({"row": [f"case {k}" for k in range(len(values))], "x": values})
        for how in (
            {"side": AT_MOST, "value": 2.0},
            {"side": ABOUT, "value": 1.0, "tolerance": 0.5},
        ):
            claim = Claim("x", mean="x", each="row", some=True, exact=True, **how)
            found = conjunction(rows, claim)
            assert found.verdict == verdict
            assert found.conditions == tuple(
                f"not case {k}" for k, one in enumerate(values) if one != 1
            )
            all_needed = conjunction(rows, replace(claim, some=False)).verdict
            assert all_needed == (FAILS if verdict == CONDITIONS else verdict)


def test_cases_that_are_to_be_alike_follow_the_first_whichever_side_it_is_on():
    noise = np.random.default_rng(0).normal(size=40)
    noise -= noise.mean()
    claim = Claim("x", mean="a", alike=True, cases=(Claim("b", mean="b"), Claim("c", mean="c")))
    opposite = "not b: the other way round"
    sides = {
        (1, 1, 1): (HOLDS, ()), (-1, -1, -1): (HOLDS, ()), (1, -1, 1): (FAILS, (opposite,)),
        (-1, 1, -1): (FAILS, (opposite,)), (1, 0, 1): (CONDITIONS, ("not b: neither more nor less",)),
        (0, 1, 0): (UNDECIDED, ("not b: more",)), (0, -1, 0): (UNDECIDED, ("not b: less",)),
    }  # fmt: skip
    for shifts, expected in sides.items():
        events = pd.DataFrame(
            {name: noise + shift for name, shift in zip("abc", shifts, strict=True)}
        )
        found = conjunction(events, claim)
        assert (found.verdict, found.conditions) == expected, shifts
