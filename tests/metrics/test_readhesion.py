"""Indices of readhesion on signals whose answers are known."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.estimation.series import spans
from alloc.metrics import search as readhesion
from alloc.metrics.search import Signals
from tests.cases import looped

PLAN = 1000.0


PEAK = 0.05


TIME = np.arange(-1.0, 16.0, 1e-3)


def signals(*lanes):
    """Signals of lanes given as (torque, slip) over `TIME`."""
    torque, slip = (np.column_stack([lane[k] for lane in lanes]) for k in (0, 1))
    return Signals(TIME, torque, slip, np.full(slip.shape, PEAK), 0.1 + 0.0 * slip, PLAN)


def sawtooth(period, swing=300.0, first=6.0):
    """Torque that falls and rises by `swing` from `first` on, least at first, first + period and so on."""
    phase = (TIME - first) / period
    wave = np.abs((phase % 1.0) - 0.5) * 2.0  # 1 at the starts, 0 between
    return np.where(phase < -0.5, 800.0, 800.0 - swing * wave)


def pulses(period, low=0.5 * PEAK, high=3.0 * PEAK, first=6.0):
    """Slip that is `high` in the last third of every period from `first` on."""
    phase = (TIME - first) / period
    return np.where((phase >= 0.0) & (phase % 1.0 > 2.0 / 3.0), high, low)


@given(st.floats(0.2, 2.0), st.floats(20.0, 800.0))
@settings(max_examples=30, deadline=None)
def test_cycles_start_where_the_torque_is_least(period, swing):
    starts = TIME[readhesion.rise_starts(sawtooth(period, swing), PLAN)]
    inner = np.arange(1, int((16.0 - 6.0) / period) - 1) * period + 6.0
    found = starts[(starts > 6.0 + 0.5 * period)][: inner.size]
    np.testing.assert_allclose(found, inner, atol=2e-3)


def test_a_ripple_below_the_prominence_starts_no_cycle():
    ripple = 0.4 * readhesion.PROMINENCE * PLAN * np.sin(2.0 * np.pi * 20.0 * TIME)
    assert readhesion.rise_starts(800.0 + ripple, PLAN).size == 0
    assert readhesion.rise_starts(800.0 + 3.0 * ripple, PLAN).size > 100


def test_a_cycle_starts_where_the_torque_leaves_its_minimum():
    torque = np.interp(TIME, [6.0, 6.1, 6.4, 7.0], [800.0, 100.0, 100.0, 800.0])
    (start,) = readhesion.rise_starts(torque, PLAN)
    assert TIME[start] == pytest.approx(6.4, abs=2e-3)


@given(st.lists(st.booleans(), max_size=60))
def test_spans_hold_exactly_what_is_flagged(flags):
    flags = np.array(flags, dtype=bool)
    rebuilt = np.zeros(flags.size, dtype=bool)
    for begin, end in spans(flags):
        assert flags[begin:end].all()
        rebuilt[begin:end] = True
    np.testing.assert_array_equal(rebuilt, flags)


def test_readhesion_needs_a_cycle_that_crosses_the_peak():
    micro, macro = 0.5 * PEAK + 0.0 * TIME, np.where(TIME < 6.0, 0.0, 10.0 * PEAK)
    once = np.where((TIME > 6.0) & (TIME < 6.2), 3.0 * PEAK, 0.5 * PEAK)
    steady = np.full(TIME.shape, 600.0)
    cases = {
        "crosses": ((sawtooth(0.6), pulses(0.6)), True),
        "never slips": ((steady, micro), True),
        "slips and torque rests": ((steady, macro), False),
        "torque cycles, slip stays macro": ((sawtooth(0.6), macro), False),
        "torque cycles, slipped once": ((sawtooth(0.6), once), False),
        "cycle not complete at the end": ((sawtooth(5.0), pulses(5.0)), False),
        "first cycle starts after the instant": ((sawtooth(0.5, first=14.5), pulses(0.5)), False),
    }
    found = readhesion.readhesion_possible(signals(*(lane for lane, _ in cases.values())))
    assert dict(zip(cases, found.tolist(), strict=True)) == {k: v for k, (_, v) in cases.items()}


def test_a_rail_that_recovers_at_the_instant_hides_a_failure():
    """Why the rail must stay low until the cycle is complete."""
    slip = np.where((TIME > 6.0) & (TIME < 14.2), 10.0 * PEAK, 0.5 * PEAK)
    torque = np.interp(TIME, [6.0, 13.0, 13.5, 14.5, 15.0], [800, 600, 500, 800, 500])
    torque = np.where(TIME > 15.0, np.interp(TIME, [15.0, 16.0], [500, 800]), torque)
    assert readhesion.readhesion_possible(signals((torque, slip)))[0]


@given(st.floats(0.02, 0.2), st.floats(0.0, 0.05))
def test_used_coefficient_is_a_mean(level, swing):
    wave = level + swing * np.sin(2.0 * np.pi * TIME)  # whole periods in 6..14 s
    both = readhesion.used_coefficient(TIME, np.column_stack([wave, np.full(TIME.shape, level)]))
    np.testing.assert_allclose(both, level, rtol=1e-6)
    assert readhesion.utilisation(both, level) == pytest.approx(1.0)


def test_used_coefficient_weighs_only_its_window():
    step = np.where(TIME < 10.0, 0.10, 0.06)
    step = np.where((TIME < 6.0) | (TIME > 14.0), 9.0, step)
    assert readhesion.used_coefficient(TIME, step) == pytest.approx(0.08, abs=1e-5)
    with pytest.raises(ValueError, match="no two instants"):
        readhesion.used_coefficient(TIME, step, 20.0, 30.0)


@given(st.floats(0.3, 1.2), st.floats(50.0, 600.0))
@settings(max_examples=30, deadline=None)
def test_the_limit_cycle_is_the_one_constructed(period, swing):
    found = readhesion.limit_cycle(signals((sawtooth(period, swing), pulses(period))), 0)
    assert found.exists
    assert found.period == pytest.approx(period, abs=2e-3)
    assert found.torque_swing == pytest.approx(swing, rel=0.02)
    assert found.slip_swing == pytest.approx(2.5 * PEAK)
    assert found.slips_before == 1


@given(st.floats(0.5, 3.0), st.floats(0.01, 0.2))
def test_an_exponential_settles_when_it_is_near_its_end(time_constant, tolerance):
    time = np.arange(0.0, 60.0, 1e-3)
    found = readhesion.settled_at(time, np.exp(-time / time_constant), tolerance)
    assert found == pytest.approx(-time_constant * np.log(tolerance), abs=5e-3)
    assert readhesion.settled_at(time, 0.0 * time, tolerance) == time[0]


@given(
    st.lists(st.floats(0.021, 0.159), min_size=1, max_size=5),
    st.sampled_from([1, 3, 6]),
    st.floats(1e-4, 1e-2),
)
def test_the_limit_is_found_to_the_tolerance(limits, points, tolerance):
    truth = np.array(limits)
    found = readhesion.limit_coefficient(
        lambda k, mu: mu >= truth[k], truth.size, 0.02, 0.16, tolerance, points
    )
    assert np.all((found.limit >= truth) & (found.fails_at < truth))
    assert np.all(found.limit - found.fails_at <= tolerance * (1.0 + 1e-6))
    assert found.monotone.all()


def test_one_point_between_is_tried_unless_more_are_wanted():
    sizes = []

    def possible(search, mu):
        sizes.append(mu.size)
        return mu > 0.05

    readhesion.limit_coefficient(possible, 1, 0.02, 0.16, 0.01)
    assert sizes == [3, 1, 1, 1]  # from 0.07, halved until it is no more than 0.01


def test_a_limit_outside_of_the_bracket_is_said_to_be():
    found = readhesion.limit_coefficient(
        lambda k, mu: np.array([False, True])[k] & (mu > 0.0), 2, 0.02, 0.16, 1e-3
    )
    assert np.isnan(found.limit[0])
    assert np.isnan(found.fails_at).all()
    assert found.limit[1] == 0.02


def test_what_is_not_monotone_is_said_to_be():
    def possible(search, mu):
        return np.where(search == 0, (mu > 0.05) & (mu < 0.12), mu > 0.05)

    found = readhesion.limit_coefficient(possible, 2, 0.02, 0.16, 1e-3, points=13)
    assert found.monotone.tolist() == [False, True]
    np.testing.assert_allclose(found.limit, 0.05, atol=1e-3)


@looped("numbers", [(0.2, 0.1, 1e-3, 1), (0.0, 1.0, 0.0, 1), (0.0, 1.0, 1.0, 0)])
def test_a_search_without_sense_is_refused(numbers):
    with pytest.raises(ValueError, match="limit coefficient"):
        readhesion.limit_coefficient(lambda k, mu: mu > 0.5, 1, *numbers)


def test_a_recorded_run_gives_its_signals():
    torque, slip = sawtooth(0.6), pulses(0.6)

    def run(units):
        wide = np.ones((1, units))
        return xr.Dataset(
            {
                "time": ("time", TIME),
                "motor_torque": (("time", "unit"), torque[:, None] * wide),
                "torque_target": (("time", "unit"), PLAN * np.ones((TIME.size, units))),
                "slip_velocity": (("time", "axle"), slip[:, None] * wide),
                "peak_slip": (("time", "axle"), np.full((TIME.size, units), PEAK)),
                "coefficient": (("time", "axle"), np.full((TIME.size, units), 0.1)),
            }
        )

    found = readhesion.of_run(run(1))
    assert found.plan == PLAN
    assert readhesion.readhesion_possible(found).tolist() == [True]
    with pytest.raises(ValueError, match="2 units and 2 axles"):
        readhesion.of_run(run(2))
