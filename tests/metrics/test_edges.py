"""Bounds inside metrics, each from both of its sides; what is shared by several metrics."""

import itertools

import numpy as np
import pytest

from alloc.errors import UnsoundRun
from alloc.metrics import METRICS, evaluate
from alloc.metrics.search import (
    Signals,
    episodes,
    limit_cycle,
    readhesion_possible,
    searches,
    shortage,
    unit_shares,
    used_coefficient,
)
from alloc.metrics.use import LOCK_SPEED, STANDING_SPEED
from tests.metrics.recorded_by_hand import course, recorded


def test_shares_of_units_by_hand():
    asked, used, available = unit_shares(recorded())
    # 1000 N m x 6 / 0.5 m at 2 axles over 150 kN; 2000 N m x 7 / 0.4 m and 500 N of air at 3 axles over 300 kN
    assert asked[10, 0] == pytest.approx(2 * 12000 / 1.5e5, rel=1e-12)
    assert asked[40, 1] == pytest.approx(3 * (35000 + 500) / 3e5, rel=1e-12)
    # sums of forces over sums of loads, in the driver's direction
    assert used[10] == pytest.approx([15200 / 16e4, 36000 / 32e4], rel=1e-12)
    assert used[40] == pytest.approx([5000 / 16e4, 22000 / 32e4], rel=1e-12)
    assert available[[10, 20, 40]].tolist() == [[0.10, 0.16], [0.08, 0.12], [0.08, 0.16]]


def short_run(asked=0.16, available=0.10, used=0.10):
    """Unit 0 asks, has and uses these coefficients at all instants; unit 1 asks for nothing."""
    run = recorded()
    run["driver_command"] = ("time", course(0.8))
    run["torque_target"].values[:] = np.stack(
        [asked * 1.5e5 / 24.0 * np.ones(44), np.zeros(44)], axis=1
    )
    run["air_brake_force"].values[:] = 0.0
    run["adhesion_limit"].values[:] = np.stack([available * np.ones(44)] * 6, axis=1)
    run["rail_force"].values[:] = np.stack(
        [used * 8e4 * np.ones(44)] * 2 + [np.zeros(44)] * 4, axis=1
    )
    return run


@pytest.mark.parametrize(("asked", "short"), [(0.1049, False), (0.1051, True)])
def test_a_twentieth_beyond_the_rail_is_no_shortage(asked, short):
    assert shortage(short_run(asked))[:, 0].all() == short
    assert not shortage(short_run(asked))[:, 1].any()


@pytest.mark.parametrize(("after", "starts"), [(0.0901, [0]), (0.0899, [0, 20])])
def test_a_fall_by_a_tenth_starts_a_search_anew(after, starts):
    run = short_run(available=course(0.10, (20, 43, after)))
    assert [episode.start for episode in episodes(run)] == starts


def test_a_fall_that_takes_half_a_second_is_one_and_a_slower_one_is_none():
    # by 0.003 an instant: 12 % in four instants, and 9 % in three; half a second is four
    quick = short_run(available=0.10 - 0.003 * np.clip(np.arange(44) - 20, 0, 4))
    slow = short_run(available=0.10 - 0.002 * np.clip(np.arange(44) - 20, 0, 10))
    assert [episode.start for episode in episodes(quick)] == [0, 24]
    assert [episode.start for episode in episodes(slow)] == [0]


@pytest.mark.parametrize(("used", "ticks"), [(0.0901, 0), (0.0899, 4)])
def test_nine_tenths_of_the_rail_count_as_found(used, ticks):
    run = short_run(used=course(0.10, (10, 13, used)))
    assert [search.time for search in searches(run)] == [ticks * 0.125]


@pytest.mark.parametrize(
    ("lost", "ticks", "finished"),
    [
        ([(10, 12), (15, 15)], 6, True),  # back for two instants only, then for good
        ([(10, 12), (17, 17)], 3, True),  # back for four: that is half a second
        ([(38, 39)], 2, True),  # back for the last four instants
        ([(38, 40)], 6, False),  # back for three, and the run ends
        ([(40, 43)], 0, True),  # lost where half a second is not left
        ([(39, 43)], 5, False),
    ],
)
def test_adhesion_is_found_where_it_stays_for_half_a_second(lost, ticks, finished):
    run = short_run(used=course(0.10, *((first, last, 0.05) for first, last in lost)))
    assert searches(run) == [(ticks * 0.125, finished)]


@pytest.mark.parametrize(
    ("rim", "speed", "locked"), [(0.099, 1.39, 1), (0.101, 1.39, 0), (0.0, 1.388, 0)]
)
def test_a_wheel_that_stands_is_locked_above_walking_pace(rim, speed, locked):
    run = recorded()
    run["rim_speed"].values[:] = 9.0
    run["rim_speed"].values[5, 3] = rim
    run["speed"].values[:] = speed
    assert METRICS["locked_time"].function(run) == locked * 0.125
    assert (LOCK_SPEED, STANDING_SPEED) == (5.0 / 3.6, 0.1)


def test_slip_at_the_peak_itself_is_not_past_it():
    run = recorded()
    run["slip_velocity"].values[:] = 0.0
    run["slip_velocity"].values[10:20, 0] = 0.10
    run["slip_velocity"].values[30:32, 0] = 0.20  # twice the peak is no slip either, but past it
    run["slipping"].values[:] = 0
    run["slipping"].values[[12, 30], 0] = 1
    found = [METRICS[name].function(run) for name in ("false_alarms", "missed_slips", "slip_time")]
    assert found == [1.0, 0.0, 0.0]
    run["slip_velocity"].values[12, 0] = (
        0.30  # a slip starts where the peak is passed, at the detection here
    )
    assert METRICS["detection_delay"].function(run) == 0.0


TIME = 0.125 * np.arange(128)


def saw(*minima):
    """Torque that is 700 at these instants, and rises by 10 for each instant away from the nearest."""
    return 700.0 + 10.0 * np.abs(np.arange(128)[:, None] - np.array(minima)).min(axis=1)


def signals(torque, slip):
    return Signals(
        TIME,
        torque[:, None],
        slip[:, None],
        np.full((128, 1), 0.05),
        np.full((128, 1), 0.1),
        1000.0,
    )


@pytest.mark.parametrize(
    ("slips", "high", "possible"),
    [
        ((112, 114), 0.051, True),  # in the cycle from 14 s on, which contains 14 s
        ((112, 114), 0.05, True),  # the peak itself is macro slip
        ((112, 114), 0.049, True),  # never macro: nothing to readhere from
        ((104, 111), 0.051, False),  # in the cycle before
        ((120, 122), 0.051, False),  # in the one behind
        ((112, 119), 0.051, False),  # from its first to its last instant
        ((112, 118), 0.051, True),
    ],
)
def test_the_cycle_that_contains_the_instant_must_cross_the_peak(slips, high, possible):
    slip = np.full(128, 0.01)
    slip[slips[0] : slips[1] + 1] = high
    found = readhesion_possible(signals(saw(96, 104, 112, 120), slip))
    assert found.tolist() == [possible]


@pytest.mark.parametrize(("first", "possible"), [(47, True), (48, False)])
def test_slip_before_the_drop_of_adhesion_is_none_to_readhere_from(first, possible):
    slip = np.full(128, 0.01)
    slip[first] = 0.3
    assert readhesion_possible(signals(saw(96, 104, 112, 120), slip)).tolist() == [possible]


def test_used_coefficient_by_hand():
    # 0.1 at 6.0 s, 0.3 at 6.5 s, 0.2 at 7.5 s by straight lines: (0.2 x 0.5 + 0.25 x 1.0) / 1.5
    time = np.array([5.0, 6.0, 6.5, 7.5, 9.0])
    coefficient = np.array([9.0, 0.1, 0.3, 0.2, 9.0])
    assert used_coefficient(time, coefficient, 6.0, 8.0) == pytest.approx(0.35 / 1.5, rel=1e-12)


def test_limit_cycle_by_hand():
    """Torque cycles of 10, 12, 8, 8, 8 instants; slip swings 0.5, 0.2, 0.1, 0.1, 0.1 in them."""
    starts = (50, 60, 72, 80, 88, 96)
    torque, slip = saw(*starts), np.full(128, 0.01)
    for (begin, end), swing in zip(
        itertools.pairwise(starts), (0.5, 0.2, 0.1, 0.1, 0.1), strict=True
    ):
        slip[begin + 1 : end - 1] += swing
    found = limit_cycle(signals(torque, slip), 0)
    assert found.period == pytest.approx(8 * 0.125, rel=1e-12)
    assert found.slip_swing == pytest.approx(0.1, rel=1e-12)
    assert found.torque_swing == pytest.approx(40.0, rel=1e-12)
    assert (
        found.slips_before == 3
    )  # one ahead of the first cycle, and those of the two that are larger
    # only what lies between the drop and the end of the search counts
    assert limit_cycle(signals(torque, slip), 0, drop=72 * 0.125).slips_before == 1
    until = limit_cycle(signals(torque, slip), 0, cycles=2, until=72 * 0.125)
    assert until.period == pytest.approx(11 * 0.125, rel=1e-12)
    assert until.slip_swing == pytest.approx(0.35, rel=1e-12)
    assert not limit_cycle(signals(torque, slip), 0, cycles=6).exists


def test_records_further_apart_than_half_a_second_count_one_by_one():
    coarse = {"time": 2.0 * np.arange(44)}
    run = short_run(used=course(0.10, (10, 12, 0.05), (14, 14, 0.05))).assign_coords(coarse)
    assert searches(run) == [(6.0, True)]
    apart = short_run(asked=course(0.16, (20, 20, 0.0))).assign_coords(coarse)
    assert [(e.start, e.stop) for e in episodes(apart)] == [(0, 20), (21, 44)]


def test_a_run_of_any_length_has_metrics_in_their_ranges():
    whole = recorded()
    for count in (1, 2, 3, 10, whole.sizes["time"]):
        for first in range(0, whole.sizes["time"] - count + 1, 3):
            found = evaluate(whole.isel(time=slice(first, first + count)))
            if count == 1:  # nothing lasts in an instant
                rates = ("slip_time", "locked_time", "jerk_peak", "search_time", "detection_delay")
                assert all(np.isnan(found[name]) for name in rates)


def test_a_detection_may_be_a_tenth_of_a_second_early_and_no_more():
    run = recorded().assign_coords(time=0.04 * np.arange(44))
    run["slip_velocity"].values[:], run["slipping"].values[:] = 0.0, 0
    run["slip_velocity"].values[20:25, 0] = 1.0
    for early, delay in ((2, -0.08), (3, np.nan)):
        run["slipping"].values[:] = 0
        run["slipping"].values[20 - early, 0] = 1
        found = METRICS["detection_delay"].function(run)
        np.testing.assert_allclose(found, delay)


def test_a_target_reached_before_anything_is_asked_for_takes_no_time():
    run = recorded()
    run.attrs["target_speed"] = float(run["speed"].values[0])
    run["driver_command"].values[:] = course(0.0, (5, 43, 0.8))
    assert np.isnan(METRICS["time_to_speed"].function(run))


@pytest.mark.parametrize("value", [1.01, -0.01, np.inf])
def test_a_metric_outside_its_range_is_said_by_its_name(monkeypatch, value):
    odd = METRICS["held_back"]._replace(function=lambda run: value)
    monkeypatch.setitem(METRICS._parts, "held_back", odd)
    with pytest.raises(UnsoundRun, match=r"metric 'held_back' = .* is outside its range, 0 to 1"):
        evaluate(recorded())
