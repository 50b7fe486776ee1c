"""The torque table of the readhesion paper and the filter behind it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.errors import OnboardError
from alloc.onboard.controllers.simple import TorqueTable, asymmetric_lag, lag_share, torque_factor

DEVIATION = st.floats(-50, 50)
MARGIN, WIDTH = st.floats(0, 5), st.floats(1e-3, 5)
PERIOD, RISE, FALL = 0.01, 1.8, 0.25


@given(DEVIATION, MARGIN, WIDTH)
def test_the_factor_lies_between_nothing_and_all(deviation, margin, width):
    assert 0.0 <= torque_factor(deviation, margin, width) <= 1.0


@given(DEVIATION, DEVIATION, MARGIN, WIDTH)
def test_more_deviation_never_gives_more_torque(one, other, margin, width):
    low, high = sorted((one, other))
    assert torque_factor(high, margin, width) <= torque_factor(low, margin, width)


@given(DEVIATION, st.floats(0, 1), MARGIN, WIDTH)
def test_the_factor_is_continuous(deviation, step, margin, width):
    # Lipschitz with the slope of the line between the corners
    change = torque_factor(deviation + step, margin, width) - torque_factor(
        deviation, margin, width
    )
    assert abs(change) <= step / width * (1 + 1e-9) + 1e-12


@pytest.mark.parametrize(
    ("deviation", "factor"), [(-1.0, 1.0), (0.25, 1.0), (0.375, 0.5), (0.5, 0.0), (3.0, 0.0)]
)
def test_corners_of_figure_5(deviation, factor):
    # a_0 = a_w = 0.25 m/s2, exact in binary
    assert torque_factor(deviation, 0.25, 0.25) == factor


@pytest.mark.parametrize(("start", "wanted", "lag"), [(0.0, 1.0, RISE), (1.0, 0.2, FALL)])
def test_the_lag_is_exact_at_its_instants(start, wanted, lag):
    # T y' = u - y with constant u: y = u + (y0 - u) exp(-t / T)
    value = start
    for k in range(1, 300):
        value = asymmetric_lag(value, wanted, lag_share(RISE, PERIOD), lag_share(FALL, PERIOD))
        exact = wanted + (start - wanted) * math.exp(-k * PERIOD / lag)
        assert value == pytest.approx(exact, abs=1e-12)


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(1e-4, 1e2), st.floats(1e-4, 1e2))
def test_the_lag_never_overshoots(value, wanted, rise, fall):
    after = asymmetric_lag(value, wanted, lag_share(rise, PERIOD), lag_share(fall, PERIOD))
    rounding = 1e-12 * max(abs(value), abs(wanted))
    assert min(value, wanted) - rounding <= after <= max(value, wanted) + rounding


def test_torque_falls_faster_than_it_rises():
    shares = lag_share(RISE, PERIOD), lag_share(FALL, PERIOD)
    assert 0.5 - asymmetric_lag(0.5, 0.0, *shares) > asymmetric_lag(0.5, 1.0, *shares) - 0.5


def test_a_table_without_a_slope_is_refused():
    with pytest.raises(OnboardError, match=r"width = 0\.0"):
        TorqueTable(width=0.0)
