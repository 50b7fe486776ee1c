"""Verdicts follow from the numbers: a table made so that a claim holds, fails, or holds in part says so."""

import json
import math
from functools import cache

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest, bootstrap, ttest_rel

from studies.core.claims import quantity
from studies.core.drawn_events import Arm, complete
from studies.core.statement import (
    CONDITIONS,
    FAILS,
    HOLDS,
    LEAST_EVENTS,
    TOO_FEW,
    UNDECIDED,
    VERDICTS,
    mean_interval,
    share_interval,
)
from studies.patent.claims_study import CLAIM_STUDY, PARTS
from tests.studies.sweep_tables import claim_table


@pytest.fixture(autouse=True)
def _one_arm(monkeypatch):
    """Most of these ask what the numbers of one rule under one controller say."""
    monkeypatch.setattr("studies.patent.claims_study.ARMS", (Arm("greedy", "cut-and-ramp"),))


def verdicts(change=lambda row: row, events=120):
    return {s.name: s for s in CLAIM_STUDY.statements(claim_table(events, change))}


@cache
def good():
    """Statements of a table on which all holds."""
    return verdicts()


def only(rule, condition=lambda row: True, **values):
    """A change of the rows of one rule where `condition` holds."""
    return lambda row: row | values if row["rule"] == rule and condition(row) else row


BROKEN = {
    "a": {"held_effort": 0.95},
    "b": {"unit_use_low": 0.8},
    "c": {"use_over": 0.85},
    "d": {"jerk_rms": 0.5},
    "e": {"held_effort": 0.5},
}
"""What greedy must do for a claim to fail."""


def test_a_table_on_which_all_holds_says_so():
    found = good()
    assert list(found) == list("abcde")
    assert {s.verdict for s in found.values()} == {HOLDS}
    assert all(s.conditions == () for s in found.values())
    assert all(s.numbers and s.method for s in found.values())


@pytest.mark.parametrize("claim", BROKEN)
def test_a_claim_that_is_broken_everywhere_does_not_hold(claim):
    found = verdicts(only("greedy", **BROKEN[claim]))
    assert found[claim].verdict == FAILS
    untouched = {"a", "b", "c", "d", "e"} - {claim} - ({"a", "e"} if claim in "ae" else set())
    assert {found[name].verdict for name in untouched} == {HOLDS}


@pytest.mark.parametrize("claim", ["b", "c", "d", "e"])
def test_a_claim_that_is_broken_in_winter_holds_with_that_condition(claim):
    change = only("greedy", lambda row: row["season"] == "winter", **BROKEN[claim])
    found = verdicts(change)[claim]
    assert found.verdict == CONDITIONS
    assert any(c.startswith("not with winter:") for c in found.conditions)
    assert not any("not with summer" in c for c in found.conditions)


def test_more_effort_for_more_slip_is_a_condition():
    found = verdicts(only("greedy", slip_time=9.0))["e"]
    assert found.verdict == CONDITIONS
    assert any(c.startswith("not besides, slip") for c in found.conditions)


def test_less_jerk_with_higher_peaks_is_a_condition():
    found = verdicts(only("greedy", jerk_peak=3.0))["d"]
    assert found.verdict == CONDITIONS
    assert any(c.startswith("not besides, jerk peak") for c in found.conditions)


def test_claim_a_looks_at_events_in_reach_that_alone_does_not_master():
    alone = verdicts(only("alone", held_effort=1.0))["a"]
    out_of_reach = verdicts(lambda row: row | {"reach_low": 0.9})["a"]
    assert alone.verdict == out_of_reach.verdict == TOO_FEW
    assert good()["a"].numbers["effort over plan, greedy (at most 1)"].count == 60


def test_few_events_say_nothing():
    found = verdicts(events=LEAST_EVENTS - 2)
    assert {s.verdict for s in found.values()} == {TOO_FEW}


def test_an_event_that_failed_under_one_rule_is_left_out_for_all():
    table = claim_table(20)
    table.loc[
        (table["scenario"] == table["scenario"][0]) & (table["rule"] == "exact"), "status"
    ] = "failed"
    assert complete(table)["scenario"].nunique() == 19


def test_statements_are_plain_values():
    content = good()["d"].content()
    assert content["verdict"] in VERDICTS
    text = content["numbers"]["jerk rms [m/s3], greedy less sharing"]
    assert set(text) == {"value", "low", "high", "count"}
    json.dumps(content, allow_nan=False)


def test_json_has_what_decides_each_claim():
    for statement in good().values():
        content = statement.content()
        test = content["test"]
        assert {"threshold", "direction", "p", "p_holm", "level"} <= set(test)
        for kind in ("estimate", "adjusted"):
            assert test[kind]["low"] <= test[kind]["value"] <= test[kind]["high"]
        assert test["adjusted"]["value"] == pytest.approx(test["estimate"]["value"], rel=1e-12)
        assert test["p"] <= test["p_holm"] < 0.05
        assert content["agreement"] == 1.0
        assert content["fragile"] is False


def test_the_claims_are_one_family():
    noise = np.random.default_rng(2)
    found = verdicts(lambda row: row | {"unit_use_low": 0.9 + 0.01 * noise.normal()})
    levels = sorted(s.test.level for s in good().values())
    np.testing.assert_allclose(levels, [1.0 - 0.05 / m for m in (1, 2, 3, 4, 5)])
    assert found["b"].verdict == UNDECIDED
    assert not found["b"].fragile


def test_each_arm_is_judged_by_each_claim(monkeypatch):
    both = (Arm("greedy", "cut-and-ramp"), Arm("exact", "cut-and-ramp"))
    monkeypatch.setattr("studies.patent.claims_study.ARMS", both)
    found = verdicts()
    assert list(found) == [f"{c}: {' under '.join(arm)}" for arm in both for c in "abcde"]
    assert max(s.test.level for s in found.values()) == pytest.approx(1.0 - 0.05 / 10)
    broken = verdicts(only("exact", unit_use_low=0.8))
    assert [name for name, s in broken.items() if s.verdict == FAILS] == [
        "b: exact under cut-and-ramp"
    ]


def test_the_interval_of_pairs_is_that_of_paired_comparison():
    generator = np.random.default_rng(3)
    first = generator.normal(1.0, 1.0, 40)
    second = first + generator.normal(0.2, 0.1, 40)
    found = mean_interval(pd.Series(second - first))
    reference = ttest_rel(second, first).confidence_interval(0.95)
    np.testing.assert_allclose([found.low, found.high], reference, atol=0.005)
    drawn = {"n_resamples": 1999, "paired": True, "vectorized": True}
    resampled = bootstrap(
        (second, first), lambda x, y, axis: np.mean(x - y, axis=axis),
        rng=np.random.default_rng(0), **drawn,
    ).confidence_interval  # fmt: skip
    np.testing.assert_allclose([found.low, found.high], resampled, atol=0.005)


def test_the_interval_of_a_share_is_wilsons():
    found = share_interval(pd.Series([True] * 8 + [False] * 2))
    # Wilson's interval of 8 in 10 at 95 %, as printed in tables
    np.testing.assert_allclose([found.low, found.high], [0.490, 0.943], atol=5e-4)
    for true, false in ((0, 7), (3, 4), (90, 11), (1, 299), (12, 0)):
        found = share_interval(pd.Series([True] * true + [False] * false), 0.99)
        reference = binomtest(true, true + false).proportion_ci(0.99, "wilson")
        np.testing.assert_allclose([found.low, found.high], reference, atol=1e-12)
    assert share_interval(pd.Series([True] * 10)).high == 1.0
    assert math.isnan(share_interval(pd.Series([], dtype=bool)).value)


def test_one_value_has_no_interval_and_missing_ones_do_not_count():
    assert mean_interval(pd.Series([1.0, np.nan])).count == 1
    assert math.isnan(mean_interval(pd.Series([1.0])).low)
    assert mean_interval(pd.Series([], dtype=float)).count == 0


def test_parts_cover_every_event():
    table = claim_table(60)
    for names in (("summer", "winter"), ("uniform rail", "a patch"), ("level line", "a gradient")):
        assert sum(quantity(table, PARTS[name]).astype(int) for name in names).eq(1).all()
