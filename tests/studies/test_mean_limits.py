"""Intervals of means: within the events, alike in any unit, covering; and within what a quantity can be."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import bootstrap, ttest_1samp

from alloc.metrics.registry import METRICS
from studies.core.statement import (
    LEAST,
    MOST,
    RESAMPLES,
    Interval,
    column_interval,
    mean_interval,
    mean_limits,
)


def used(seed, *shape):
    """Shares that lie near 1 with a long tail below, like the adhesion that a good controller uses."""
    return np.random.default_rng(seed).beta(8.0, 0.3, shape)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=LEAST, max_size=30))
def test_limits_lie_about_the_mean_and_within_the_events(values):
    (mean,), (low,), (high,) = mean_limits(np.array([values]), 0.95)
    rounding = 1e-9 * max(map(abs, values))
    assert mean == pytest.approx(np.mean(values), abs=rounding)
    assert low <= mean <= high
    assert min(values) - rounding <= low
    assert high <= max(values) + rounding


@pytest.mark.parametrize("count", [5, 20, MOST + 1])
def test_limits_are_alike_in_any_unit_and_turned_with_their_sign(count):
    values = used(1, 3, count)
    _, low, high = mean_limits(values, 0.95)
    _, *scaled = mean_limits(100.0 * values + 7.0, 0.95)
    np.testing.assert_allclose(scaled, [100.0 * low + 7.0, 100.0 * high + 7.0], rtol=1e-9)
    _, *turned = mean_limits(-values, 0.95)
    np.testing.assert_allclose(turned, [-high, -low], rtol=0.01)  # quantiles of resamples


def test_a_quantity_has_the_same_limits_alone_and_among_others():
    values = used(2, 4, 15)
    _, low, high = mean_limits(values, 0.95)
    assert [mean_limits(one[np.newaxis], 0.95)[1][0] for one in values] == pytest.approx(
        low, rel=1e-12
    )
    _, lower, higher = mean_limits(values, 0.99)
    assert (lower < low).all()
    assert (higher > high).all()


def test_limits_of_many_events_are_those_of_the_library_and_of_students_t():
    values = np.random.default_rng(3).normal(2.0, 1.0, (1, 900))
    _, (low,), (high,) = mean_limits(values, 0.95)
    generator = np.random.default_rng(1)
    found = bootstrap((values[0],), np.mean, n_resamples=RESAMPLES, rng=generator)
    students = ttest_1samp(values[0], 0.0).confidence_interval()
    for other in (found.confidence_interval, students):
        np.testing.assert_allclose([low, high], other, atol=0.1 * (high - low))


def test_too_few_or_very_many_events_have_students_t():
    for count in (2, LEAST - 1, MOST + 1):
        values = used(4, 1, count)
        students = ttest_1samp(values[0], 0.0).confidence_interval()
        np.testing.assert_allclose(
            [i[0] for i in mean_limits(values, 0.95)[1:]], students, rtol=1e-12
        )
    assert np.isnan(mean_limits(np.ones((2, 1)), 0.95)[1:]).all()


def test_equal_events_leave_nothing_open_and_one_other_event_something():
    values = np.vstack([np.full(10, 0.1), np.r_[np.ones(9), 0.5]])
    _, low, high = mean_limits(values, 0.95)
    np.testing.assert_allclose([low[0], high[0]], 0.1, rtol=1e-15)
    assert 0.5 <= low[1] < 0.95 < high[1] <= 1.0


def test_what_is_infinite_has_no_interval_but_a_mean():
    found = mean_interval(pd.Series([1.0, 2.0, math.inf]))
    assert found.value == math.inf
    assert math.isnan(found.low)


@pytest.mark.parametrize("count", [11, 20])
def test_near_a_bound_more_intervals_cover_the_truth_than_by_students_t(count):
    samples, truth = used(5, 3000, count), 8.0 / 8.3
    _, low, high = mean_limits(samples, 0.95)
    covered = np.mean((low <= truth) & (truth <= high))
    students = ttest_1samp(samples, 0.0, axis=1).confidence_interval()
    assert covered > np.mean((students.low <= truth) & (truth <= students.high)) + 0.02
    assert (high <= 1.0).all()
    assert (students.high > 1.0).any()


def test_normal_events_are_covered_as_often_as_said():
    samples = np.random.default_rng(6).normal(size=(3000, 11))
    _, low, high = mean_limits(samples, 0.95)
    assert np.mean((low <= 0.0) & (high >= 0.0)) == pytest.approx(0.95, abs=0.015)


def test_an_interval_is_cut_at_the_range_but_never_loses_its_mean():
    assert Interval(0.9, 0.7, 1.1, 3).cut((0.0, 1.0)) == Interval(0.9, 0.7, 1.0, 3)
    assert Interval(1.1, 0.7, 1.5, 3).cut((0.0, 1.0)) == Interval(1.1, 0.7, 1.1, 3)
    assert math.isnan(Interval(0.9, math.nan, math.nan, 1).cut((0.0, 1.0)).high)


def test_a_column_of_paired_events_has_the_range_of_its_metric():
    few = pd.DataFrame({"bound_use@greedy": [0.92, 0.99, 0.995], "x@greedy": [0.92, 0.99, 0.995]})
    assert METRICS["bound_use"].within == (0.0, 1.0)
    assert column_interval(few, "bound_use@greedy").high == 1.0
    assert column_interval(few, "bound_use@greedy", 100.0).high == 100.0
    assert column_interval(few, "x@greedy").high > 1.0
