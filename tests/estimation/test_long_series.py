"""A long series is judged by pieces of it, a short one by the whole."""

import numpy as np

from alloc.estimation.series import PIECE, PIECES, excerpt, usual_period


def test_a_short_series_is_its_own_excerpt():
    values = np.arange(PIECES * PIECE, dtype=float)
    assert excerpt(values) is values


def test_pieces_come_from_all_over_and_tell_the_same():
    rng = np.random.default_rng(1)
    values = np.cumsum(rng.standard_normal(1_000_000))
    some = excerpt(values)
    assert some.size == PIECES * PIECE
    assert (some[0], some[-1]) == (values[0], values[-1])
    usual = [np.median(np.abs(np.diff(series))) for series in (some, values)]
    np.testing.assert_allclose(*usual, rtol=0.02)


def test_the_usual_period_is_that_of_most_rows_however_many():
    time = np.cumsum(np.where(np.arange(1_000_000) % 10 == 0, 0.05, 0.01))
    assert np.isclose(usual_period(time), 0.01)
    assert np.isclose(usual_period(time[:1000]), 0.01)
