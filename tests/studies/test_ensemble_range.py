"""An ensemble gives a statement's numbers their range, and takes the certainty from a verdict that few members share."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.core.ensemble_range import median_of, over_members, range_of
from studies.core.statement import CONDITIONS, FAILS, HOLDS, Statement, single


def said(verdict, value):
    return Statement("name", "claim", verdict, {"number": single(value)})


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50))
def test_a_range_lies_within_the_members_and_holds_most_of_them(values):
    found = range_of(values[0], values)
    assert min(values) <= found.low <= found.high <= max(values)
    inside = np.mean([found.low - 1e-6 <= one <= found.high + 1e-6 for one in values])
    assert inside >= 0.9 - 2.0 / len(values)
    assert found.low <= median_of(values).value <= found.high


def test_numbers_that_are_not_known_do_not_count():
    assert range_of(1.0, [math.nan, 2.0, 4.0]).count == 2
    assert range_of(1.0, []).count == median_of([math.nan]).count == 0


@pytest.mark.parametrize(
    ("own", "members", "verdict"),
    [
        (HOLDS, [HOLDS] * 20, HOLDS),
        (HOLDS, [HOLDS] * 19 + [FAILS], HOLDS),
        (HOLDS, [HOLDS] * 18 + [FAILS] * 2, CONDITIONS),
        (CONDITIONS, [HOLDS] * 20, CONDITIONS),
        (FAILS, [HOLDS] * 20, FAILS),
    ],
)
def test_a_verdict_needs_most_of_the_members(own, members, verdict):
    found = over_members(said(own, 1.0), [said(one, float(k)) for k, one in enumerate(members)])
    assert found.verdict == verdict
    share = found.numbers["share of the members with the same verdict"]
    assert share.value == np.mean([one == own for one in members])
    assert bool(found.conditions) == (share.value < 0.95)
    number = found.numbers["number"]
    assert (number.value, number.count) == (1.0, 20)
    assert 0.0 < number.low < number.high < 19.0


def test_without_members_a_statement_stays_as_it_is():
    own = said(HOLDS, 1.0)
    assert over_members(own, []) is own
