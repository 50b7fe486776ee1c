"""Laws of intervals and verdicts: coverage, Wilson's and Holm's numbers, what a verdict may say."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from studies.statistics import (
    CONDITIONS,
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
    Claim,
    holm,
    judge,
    mean,
    share,
    shorten_statements,
    statement_table,
)


def draws(seed, events=30, centre=1.0):
    return pd.Series(np.random.default_rng(seed).normal(centre, 1.0, events))


@pytest.mark.parametrize(
    "make", [lambda g, n: g.normal(1.0, 1.0, n), lambda g, n: g.exponential(1.0, n)]
)
@pytest.mark.parametrize("events", [6, 12, 40])
def test_an_interval_covers_the_mean_in_about_nineteen_of_twenty_samples(make, events):
    generator = np.random.default_rng(3)
    covered = [found.low < 1.0 < found.high
               for found in (mean(make(generator, events)) for _ in range(200))]  # fmt: skip
    assert 0.87 < np.mean(covered) <= 0.99


def test_an_interval_scales_and_shifts_with_its_values():
    x = draws(0)
    a, b = mean(x), mean(-3.0 * x + 2.0)
    np.testing.assert_allclose(
        b[:3], [-3 * a.value + 2, -3 * a.high + 2, -3 * a.low + 2], atol=0.06
    )


@pytest.mark.parametrize(("values", "text"), [
    ([], "–"), ([np.nan], "–"), ([2.0], "2.00"), ([2.0] * 9, "2.00"), ([1.0, 3.0], "2.00"), ([-0.001] * 9, "0.00"),
])  # fmt: skip
def test_texts_without_an_interval(values, text):
    assert mean(values).text() == text


def test_a_share_has_the_interval_of_wilson():
    assert share([True] * 9 + [False]).low == pytest.approx(0.5958, abs=1e-4)  # Wilson 1927


def test_holm_tests_the_smallest_at_the_strictest_level():
    np.testing.assert_allclose(holm(np.array([0.01, 0.2, np.nan, 0.02])) * 60, [1.0, 3.0, 3.0, 1.5])
    np.testing.assert_allclose(holm(np.array([0.5, 0.001, 0.04])), [0.025, 0.05 / 3, 0.025])


def test_one_family_is_rarely_wrong_at_all():
    wrong = 0
    for seed in range(60):
        claims = [
            Claim(str(k), "", draws(1000 * seed + k, centre=0.0), least=0.0) for k in range(20)
        ]
        wrong += any(one.verdict != UNDECIDED for one in judge(claims))
    assert wrong <= 8  # 5 % of 60 would be 3; without Holm about 38


def test_verdicts():
    x = draws(4)
    wet = x > x.median()
    for claim, verdict in (
        (Claim("a", "", x, least=0.0), HOLDS),
        (Claim("b", "", x, least=2.0), FAILS),
        (Claim("c", "", x, least=x.mean()), UNDECIDED),
        (Claim("d", "", x[:9], least=0.0), TOO_FEW),
        (Claim("e", "", x, most=2.0), HOLDS),
        (Claim("f", "", x, least=0.0, parts={"dry": ~wet, "wet": wet}), CONDITIONS if x[~wet].mean() < -0.3 else HOLDS),
        (Claim("g", "", x, least=1.2, parts={"wet": wet}), CONDITIONS),
        (Claim("h", "", x, least=0.0, besides=[Claim("", "cost", x, most=0.0)]), CONDITIONS),
    ):  # fmt: skip
        (found,) = judge([claim])
        assert found.verdict == verdict, claim.name
    table = statement_table(judge([Claim("e", "words", 100 * x, most=200.0, digits=1)]))
    assert list(table.iloc[0][["bound", "verdict", "events"]]) == ["< 200.0", HOLDS, 30]


def test_people_read_each_claim_once():
    x = draws(3)
    low = Claim("low", "stays low [1]", x, most=-5.0, parts={"wet": x < -9.0})
    made = judge([low, Claim("high", "is high", x, most=-5.0), low._replace(name="again")])
    table = shorten_statements(statement_table(made))
    assert list(table["claim"]) == ["stays low [1]: < −5.000", "", "is high: < −5.000"]
    assert list(table["name"]) == ["low", "again", "high"]
    assert list(table["verdict"]) == [FAILS] * 3
    conditions = made[0]._replace(conditions=("with wet: 1 [0, 2]", "besides, slip [axle s]: 2"))
    assert (
        shorten_statements(statement_table([conditions]))["verdict"].item()
        == f"{FAILS}: with wet: 1; besides, slip [axle s]: 2"
    )


def test_a_verdict_agrees_with_students_t():
    for seed in range(20):
        x = draws(seed, events=15, centre=0.4)
        (found,) = judge([Claim("", "", x, least=0.0)])
        assert (found.verdict == HOLDS) == (
            stats.ttest_1samp(x, 0.0, alternative="greater").pvalue < 0.025
        )
