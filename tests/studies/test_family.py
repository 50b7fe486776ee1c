"""Claims on random events: intervals that cover, Holm's procedure, four verdicts, and the share of resamples that agree."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_1samp

from studies.core.claims import AT_LEAST, AT_MOST, RESAMPLES, Claim, family, holm, resampled
from studies.core.statement import (
    CONDITIONS,
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
    Statement,
    share_interval,
    side,
)

ABOVE, BELOW = AT_LEAST, AT_MOST
SHOWN = "{:.0f}"


def claim(values, side=ABOVE, name="x", **more):
    """Events of which `values` are columns, or the column "x", and a claim about the mean of x."""
    events = pd.DataFrame(values if isinstance(values, dict) else {"x": values})
    more = {"show": lambda i: SHOWN.format(i.value)} | more
    return events, [Claim(name, mean="x", side=side, **more)]


def compared(groups, **how):
    return family(*groups, **how)


def judged(values, *how, **more):
    return compared([claim(values, *how, **more)])[0]


def normal(seed, *shape, mean=0.0):
    return np.random.default_rng(seed).normal(mean, 1.0, shape)


@pytest.fixture
def verdicts_alone(monkeypatch):
    """Few resamples, where only verdicts as drawn are looked at, many times."""
    monkeypatch.setattr("studies.core.claims.RESAMPLES", 10)


# what the intervals are


def test_means_of_the_events_as_drawn_are_those_of_the_table():
    values = pd.Series(normal(1, 30)).where(lambda x: x > -1.0)
    truths = values.dropna() > 0.0
    found = resampled([values, truths])
    test, share = ttest_1samp(values.dropna(), 0.3), share_interval(truths)
    low, high = found.limits(0.05)
    np.testing.assert_allclose(found.mean[0], [values.mean(), share.value], rtol=1e-12)
    assert found.count[0].tolist() == [values.count(), share.count]
    students = test.confidence_interval(0.95)
    np.testing.assert_allclose(low[0], [students.low, share.low], rtol=1e-12)
    np.testing.assert_allclose(high[0], [students.high, share.high], rtol=1e-12)
    assert found.p_value(np.array([0.3, 0.3]))[0, 0] == pytest.approx(test.pvalue, rel=1e-10)


def test_an_event_is_drawn_with_all_its_quantities():
    first = pd.Series(normal(3, 40))
    second = (2.0 - first).sample(
        frac=1.0, random_state=0
    )  # the index tells events apart, not the order
    found = resampled([first, second, first[first > 0.0]])
    np.testing.assert_allclose(found.mean[:, 0] + found.mean[:, 1], 2.0)
    assert (found.count[:, 0] == 40).all()
    assert np.ptp(found.count[1:, 2]) > 0
    assert found.mean.shape == (1 + RESAMPLES, 3)


# Holm


def test_holm_by_hand():
    # 4 x 0.005, 3 x 0.01, 2 x 0.03, then 1 x 0.04 raised to what stands before it
    adjusted, level = holm(np.array([0.01, 0.04, 0.03, 0.005]))
    np.testing.assert_allclose(adjusted, [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(level, [0.05 / 3, 0.05 / 2, 0.05 / 2, 0.05 / 4])


def test_holm_of_one_claim_changes_nothing_and_what_is_not_tested_does_not_count():
    for p in (0.001, 0.2, 1.0):
        np.testing.assert_allclose(holm(np.array([p])), [[p], [0.05]])
    adjusted, level = holm(np.array([0.02, np.nan, 0.03]))
    np.testing.assert_allclose(adjusted, [0.04, np.nan, 0.04])
    np.testing.assert_allclose(level, [0.05 / 2, np.nan, 0.05])


def test_holm_lies_between_bonferroni_and_nothing_row_by_row():
    p = np.random.default_rng(5).random((50, 6)) ** 3
    adjusted, _ = holm(p)
    assert (adjusted >= p).all()
    assert (adjusted <= np.minimum(6.0 * p, 1.0) + 1e-15).all()
    np.testing.assert_allclose(adjusted[7], holm(p[7])[0])
    order = np.argsort(p, axis=1)
    assert (np.diff(np.take_along_axis(adjusted, order, axis=1), axis=1) >= 0.0).all()


def test_the_adjusted_interval_contains_the_threshold_where_the_adjusted_p_is_not_small(
    verdicts_alone,
):
    for seed in range(20):
        effects = np.linspace(-0.6, 0.6, 7)
        found = compared([claim(normal((seed, k), 25, mean=m), name=str(k)) for k, m in enumerate(effects)])  # fmt: skip
        for statement in found:
            test = statement.test
            assert (test.p_holm < 0.05) == (side(test.adjusted.low, test.adjusted.high, 0.0) != 0)
            assert test.estimate.high - test.estimate.low <= test.adjusted.high - test.adjusted.low
            assert (statement.verdict == UNDECIDED) == (test.p_holm >= 0.05)


def test_among_many_claims_at_their_threshold_one_is_decided_in_five_per_cent(verdicts_alone):
    decided = []
    for seed in range(150):
        found = compared([claim(normal((6, seed, k), 15), name=str(k)) for k in range(8)])
        decided.append(any(s.verdict != UNDECIDED for s in found))
    assert 0.0 < np.mean(decided) < 0.11  # uncorrected it would be a third


# verdicts


@pytest.mark.parametrize(
    ("mean", "test", "verdict"),
    [(1.0, ABOVE, HOLDS), (-1.0, ABOVE, FAILS), (0.02, ABOVE, UNDECIDED),
     (1.0, BELOW, FAILS), (-1.0, BELOW, HOLDS), (0.02, BELOW, UNDECIDED)],
)  # fmt: skip
def test_the_side_that_a_claim_wants_counts(mean, test, verdict):
    values = normal(7, 40)
    found = judged(values - values.mean() + mean, test)
    assert found.verdict == verdict
    assert found.test.direction == ("at least" if test is ABOVE else "at most")


def test_an_effect_at_its_threshold_is_undecided_in_95_per_cent(verdicts_alone):
    found = [judged(normal((8, seed), 30)).verdict for seed in range(400)]
    assert np.mean([v == UNDECIDED for v in found]) == pytest.approx(0.95, abs=0.035)
    assert {HOLDS, FAILS} <= set(found)


def test_equal_values_at_the_threshold_are_undecided_and_beyond_it_decided():
    assert judged(np.zeros(20)).verdict == UNDECIDED
    assert judged(np.zeros(20)).test.p == 1.0
    assert judged(np.full(20, 0.5)).verdict == HOLDS
    assert judged(np.full(20, -0.5)).verdict == FAILS


def test_what_is_infinite_decides_nothing():
    values = normal(14, 30, mean=5.0)
    values[3] = np.inf
    found = judged(values)
    assert found.verdict == UNDECIDED
    assert found.content()["test"]["estimate"]["low"] is None
    clear = compared([claim(values), claim(normal(14, 30, mean=5.0), name="y")])[1]
    assert (clear.verdict, clear.agreement) == (HOLDS, 1.0)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_a_verdict_does_not_depend_on_the_unit(scale):
    values = normal(15, 30, mean=0.45)
    one, other = judged(values), judged(scale * values)
    assert (one.verdict, one.agreement) == (other.verdict, other.agreement)
    assert other.test.p == pytest.approx(one.test.p)
    moved = judged(values + 1e6, value=1e6)  # far from zero nothing is lost
    assert moved.test.p == pytest.approx(one.test.p, rel=1e-6)


def test_more_events_do_not_make_a_clear_effect_undecided(verdicts_alone):
    undecided = [
        np.mean([judged(normal((9, seed), n, mean=0.5)).verdict == UNDECIDED for seed in range(80)])
        for n in (12, 24, 48, 96)
    ]
    assert undecided == sorted(undecided, reverse=True)
    assert undecided[0] > 0.3
    assert undecided[-1] < 0.05


def test_a_whole_that_is_undecided_but_for_a_part_holds_with_it():
    value = np.repeat([1.0, -1.0], 20) + 0.01 * normal(0, 40)
    events = {"x": value, "good": [True] * 20 + [False] * 20}
    parts = {"good": "good == 1", "bad": "good == 0"}
    found = judged(events, parts=parts)
    assert found.verdict == CONDITIONS
    assert found.conditions == ("with good: 1", "not with bad: -1")
    assert judged(events).verdict == UNDECIDED


def test_few_events_say_nothing():
    found = judged(np.ones(9))
    assert (found.verdict, found.conditions) == (TOO_FEW, ())
    assert found.content()["agreement"] is None
    assert judged(np.ones(0)).verdict == TOO_FEW
    several = compared([claim(np.ones(9)), claim(normal(10, 20, mean=0.8))])
    assert several[1].test.level == pytest.approx(0.95)  # it is the only one tested


# resamples


def test_a_clear_verdict_is_given_again_and_one_at_the_edge_is_fragile():
    noise = normal(11, 100)
    noise = (noise - noise.mean()) / noise.std(ddof=1)
    clear, edge = (judged(noise + shift) for shift in (0.6, 0.21))
    assert clear.agreement == 1.0
    assert not clear.fragile
    # 2.1 standard errors from the threshold, of which 1.98 are needed
    assert (edge.verdict, edge.fragile) == (HOLDS, True)
    assert edge.agreement == pytest.approx(0.54, abs=0.08)
    at = judged(noise)
    assert at.agreement == pytest.approx(0.95, abs=0.03)
    assert not at.fragile  # it says nothing that could break


def test_resamples_go_through_holm_too():
    noise = normal(12, 60)
    noise = (noise - noise.mean()) / noise.std(ddof=1)
    near = noise + 0.32  # p 0.016: one in five needs 0.01
    others = [claim(normal((13, k), 60), name=str(k)) for k in range(4)]
    alone, among = compared([claim(near)])[0], compared([claim(near), *others])[0]
    assert alone.verdict == HOLDS
    assert among.verdict == UNDECIDED
    assert among.test.p == pytest.approx(alone.test.p)
    assert among.agreement < 0.9


def test_a_fragile_verdict_is_not_a_matter_of_undecided_ones():
    assert Statement("x", "", HOLDS, agreement=0.94).fragile
    assert not Statement("x", "", HOLDS, agreement=0.95).fragile
    assert not Statement("x", "", HOLDS).fragile
    assert not Statement("x", "", UNDECIDED, agreement=0.5).fragile


# parts, and what a claim implies besides


def test_parts_share_the_level_of_their_claim():
    values = normal(16, 60, mean=1.0)
    part = np.arange(60) % 3 == 0
    parts = {"these": "part == 1", **{f"none {k}": "part == 2" for k in range(4)}}
    shown = {}
    one = claim(
        {"x": values - 5.0 * ~part, "part": part}, parts=parts,
        show=lambda i: shown.setdefault(i.count, i) and "",
    )  # fmt: skip
    others = [claim(normal((17, k), 60), name=str(k)) for k in range(3)]
    (found, *_) = compared([one, *others])
    # four claims, of which this has the smallest p; five parts
    expected = ttest_1samp(values[part], 0.0).confidence_interval(1.0 - 0.05 / 4 / 5)
    assert shown[20].low == pytest.approx(expected.low)
    assert shown[20].high == pytest.approx(expected.high)
    assert (found.verdict, found.conditions) == (CONDITIONS, ("with these: ",))


def test_what_a_claim_implies_besides_is_tested_at_95_per_cent():
    noise = normal(18, 40)
    noise = (noise - noise.mean()) / noise.std(ddof=1)
    besides = (Claim("y", mean="y"),)
    rest = [claim(normal((19, k), 40), name=str(k)) for k in range(9)]
    for shift, verdict in ((-0.35, CONDITIONS), (-0.25, HOLDS)):  # p 0.03 and 0.12
        one = claim({"x": noise + 2.0, "y": noise + shift}, besides=besides)
        assert compared([one, *rest])[0].verdict == verdict
