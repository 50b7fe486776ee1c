"""Every metric of the run made by hand, by plain sums over its instants, and bounds inside metrics from both sides."""

import math

import numpy as np
import pytest

from alloc.errors import UnsoundRun
from alloc.metrics import METRICS, evaluate
from alloc.metrics.registry import record_period
from alloc.metrics.search import (
    episodes,
    searches,
    shortage,
    unit_shares,
)
from alloc.metrics.use import JERK_CUT_OFF, LOCK_SPEED, STANDING_SPEED, jerk
from tests.cases import looped
from tests.metrics.recorded_by_hand import course, recorded

# Rail force in the driver's direction: axles 0 and 1; axles 3 to 5; then all six under brakes.
FORCE_UNIT_0 = 2 * 15200 + 2 * 8000 + 4 * 15200 + 3 * 12000 + 5 * 8000 + 14 * 11000


FORCE_UNIT_1 = 27 * 36000 + 3 * 30000


FORCE_BRAKED = 10 * (3000 + 2000 + 4000 + 6000 + 7000 + 9000)


# What rail and load offer: 0.10 x 70 kN = 7000 N at axle 0 until instant 11, 5600 N from 12 on; and so on.
OFFERED_UNIT_0 = 8 * (7000 + 12600) + 22 * (5600 + 12600)


OFFERED_UNIT_1 = 16 * (14400 + 20000 + 23400) + 14 * (14400 + 12000 + 23400)


OFFERED_BRAKED = 10 * (5600 + 12600 + 15000 + 14400 + 20000 + 23400)


ASKED = 30 * 0.8 + 10 * 0.5


REACHED = 29 * 0.6 - 0.2 + 10 * 0.4


# Torque of the plan: mean coefficient x load x radius / (gear x axles)
PLAN = (29 * 0.16 + 0.09 + 10 * 0.10) / 40


PLAN_0, PLAN_1 = PLAN * 1.5e5 * 0.5 / (6 * 2), PLAN * 3e5 * 0.4 / (7 * 3)


# Room, from 2 s after the demand has grown: instants 20 to 43. The plan is 0.16 and once, at 33, 0.09 of 450 kN; under
# brakes it is 0.10 of these and of the trailer's 52 kN.
ROOM_PLAN = 13 * 72000 + 40500 + 10 * (45000 + 5200)


# Unit 0 is bound by the rail, 2 x 5600, then by its motors, 400 x 24 less 900 kg x 0.6; unit 1 by its motors, 640 x 52.5
# less 2100 kg x 0.6. Under brakes air makes up for the motors: 2 x 5600 and 3 x 14400 N exceed the plan together.
MOST_0, MOST_0_LATE, MOST_1 = 11200, 9600 - 540, 33600 - 1260


BOUND = 10 * (MOST_0 + MOST_1) + 3 * (MOST_0_LATE + MOST_1) + 40500 + 10 * (45000 + 5200)


# what unit 1 could deliver beyond its own part of the plan
HEADROOM = 40500 - (MOST_0_LATE + 27000) + 10 * (45000 - 11200 - 30000)


EXPECTED = {
    # attributes; times in ms
    "detections": 4, "unit_detections": 7, "telegrams": 90, "telegrams_lost": 3, "fallbacks": 2, "blinded": 1,
    "locks": 6, "time_outs": 5, "rule_calls": 11, "rule_failures": 8, "rule_time": 250, "controller_failures": 9,
    "controller_median": 2, "controller_p99": 7.5,
    # motion
    "acceleration": REACHED / 40,
    "acceleration_ratio": REACHED / ASKED,
    "effort_ratio": (FORCE_UNIT_0 + FORCE_UNIT_1 + FORCE_BRAKED) / (60e3 * ASKED),
    "utilisation": (FORCE_UNIT_0 + FORCE_UNIT_1 + FORCE_BRAKED)
    / (OFFERED_UNIT_0 + OFFERED_UNIT_1 + OFFERED_BRAKED),
    # unit 0 signals at 11, 12, 13, 16 and 28, unit 1 at 25 and 35; what is signalled while coasting is left out
    "utilisation_slipping": (15200 + 2 * 12000 + 8000 + 11000 + 36000 + 22000)
    / ((7000 + 12600) + 4 * (5600 + 12600) + (14400 + 12000 + 23400) + (14400 + 20000 + 23400)),
    # from 20 to 30 it delivers 47000 N, which is more than its bound
    "bound_use": (10 * (MOST_0 + MOST_1) + MOST_0_LATE + MOST_1 + 2 * 41000 + 40500 + 10 * (27000 + 4000)) / BOUND,
    "equal_torque_use": (10 * (MOST_0 + MOST_1) + MOST_0_LATE + MOST_1 + 2 * 41000 + 40500 + 10 * (27000 + 4000)) / BOUND,
    # unit 0 is limited while the train delivers more than its bound, and at 34 and 35: there it brakes with 5000 N of
    # 11200; unit 1 from 38 to 43, with 22000 N of 43200: more than the train lacks
    # T gamma: the work of half an axle from 0 to 1 over 1/8 m, and from 42 to 43 over 85/8 m, of 231.125 m
    "wear_number": 3725.0 / (231.125 * 6),
    "severe_work": (400.0 + 350.0 + 2000.0) / 3725.0,
    "wheel_wear": 2e-3 * (
        0.125 * ((1.19 * 3200.0 - 154.0) / 1e3 + (1.19 * 2800.0 - 154.0) / 1e3 + (1.19 * 16e3 - 154.0) / 800.0)
        + 0.25 * (600.0 / 1e3 + 375.0 / 800.0)
    ),
    "held_back": (2 * (11200 - 5000) + 6 * (50200 - 31000)) / BOUND,
    "headroom": HEADROOM / ROOM_PLAN,
    "over_delivery": (41000 - 40500) / ROOM_PLAN,
    # beyond twice the peak: 2 of axle 0, 2 of axle 1, 1 of axle 2, 1 + 4 of axle 3, 1 of axle 4
    "slip_time": 11 * 0.125,
    "slip_peak": 0.7,
    "damage": (2000 + 700 + 0 + 4000 + 0 + 750) / 1000,
    "distance": 20**2 / 8,
    "time_to_speed": (20 - 4) * 0.125,
    # car 0 changes by 0.25 and back over two periods, and by 0.05 at the end; car 1 by -0.5
    "jerk_rms": math.sqrt(2 * (0.5 / 0.25) ** 2 / 40),
    "jerk_peak": 0.5 / 0.25,
    "coupler_peak": 45,
    "energy": 3.5,
    "torsion_peak": 8960 / (640 * 7),
    # detection: unit 0 slips from 8 (seen at 11) and 31 (not seen), unit 1 from 20 (at 25) and 36 (at 35)
    "estimate_error": ((0.15 - 0.12) + (0.11 - 0.12) + (0.13 - 0.11) + (0.12 - 0.11)) / 4,
    "detection_delay": (3 + 5 - 1) * 0.125 / 3,
    "missed_slips": 1,
    "false_alarms": 1,
    # episodes: unit 0 from 4 (lost 6 and 7), from 12 (lost from 15 to its end at 20); unit 1 from 20 (lost too late)
    "search_time": (2 + 5 + 0) * 0.125 / 3,
    "unfinished_searches": 1 / 3,
    # unit 0 is short from 4 to 19, unit 1 from 20 to 23, 27 to 33 and 38 to 43
    "utilisation_short": (2 * 15200 + 2 * 8000 + 4 * 15200 + 3 * 12000 + 5 * 8000 + 8 * 36000 + 3 * 30000 + 6 * 22000)
    / (8 * (7000 + 12600) + 8 * (5600 + 12600) + 11 * (14400 + 12000 + 23400) + 6 * (14400 + 20000 + 23400)),
    # a mean over 8 instants, from 4 before to 3 after: a spike inside loses 1/8 and leaves it at 7 others; one at the
    # last instant, which repeats itself beyond the end, stands 1/2 above its mean and is in 3 others by 3/8, 2/8, 1/8
    "torque_fluctuation": math.sqrt((
        (90.625 / PLAN_0) ** 2 * ((7 / 8) ** 2 + 7 * (1 / 8) ** 2)
        + (165.0 / PLAN_1) ** 2 * ((1 / 2) ** 2 + (3 / 8) ** 2 + (2 / 8) ** 2 + (1 / 8) ** 2)
    ) / 80),
    # axle 0 once, axle 2 from 35 on while the train is faster than 5 km/h, axle 4 twice
    "locked_time": (1 + 4 + 2) * 0.125,
    "air_consumption": 1000 * (0.01 * (2e5 + 2e5) + 0.02 * 0.5e5) / 101325,
}  # fmt: skip


def test_every_metric_of_this_package_has_a_value_by_hand():
    own = {
        name
        for name, metric in METRICS.items()
        if metric.function.__module__.startswith("alloc.metrics.")
    }
    # the least of a program: a solver of its own in test_least_damage.py
    assert own - {"excess_damage"} == set(EXPECTED)


@looped("name", EXPECTED)
def test_metric_is_the_value_by_hand(name):
    assert METRICS[name].function(recorded()) == pytest.approx(EXPECTED[name], rel=1e-12, abs=0.0)


@looped("name", EXPECTED)
def test_direction_of_better_and_unit_are_those_of_the_quantity(name):
    metric = METRICS[name]
    less = {
        "slip_time", "slip_peak", "damage", "time_to_speed", "jerk_rms", "jerk_peak", "coupler_peak", "detection_delay",
        "missed_slips", "false_alarms", "search_time", "unfinished_searches", "torque_fluctuation", "locked_time",
        "air_consumption", "detections", "unit_detections", "locks", "time_outs", "rule_failures", "controller_failures",
        "over_delivery", "held_back", "wear_number", "severe_work", "wheel_wear", "torsion_peak",
    }  # fmt: skip
    more = {
        "acceleration", "acceleration_ratio", "effort_ratio", "utilisation", "utilisation_slipping", "utilisation_short",
        "bound_use", "equal_torque_use",
    }  # fmt: skip
    units = {
        "acceleration": "m/s2", "slip_time": "s", "slip_peak": "m/s", "damage": "kJ", "distance": "m",
        "time_to_speed": "s", "jerk_rms": "m/s3", "jerk_peak": "m/s3", "coupler_peak": "kN", "energy": "MJ",
        "detection_delay": "s", "search_time": "s", "locked_time": "s", "air_consumption": "l", "rule_time": "ms",
        "controller_median": "ms", "controller_p99": "ms", "wear_number": "N", "wheel_wear": "mm2",
    }  # fmt: skip
    assert metric.better == (name in more) - (name in less)
    assert metric.unit == units.get(name, "1")


def nan_of(run):
    return {name for name, value in evaluate(run).items() if np.isnan(value)}


OF_UNITS = {
    "estimate_error", "utilisation_slipping", "utilisation_short", "torque_fluctuation", "detection_delay",
    "search_time", "unfinished_searches",
}  # fmt: skip


OF_ROOM = {"bound_use", "equal_torque_use", "held_back", "headroom", "over_delivery"}


def test_without_demand_what_counts_under_demand_is_nan():
    run = recorded()
    run["driver_command"] = 0.0 * run["driver_command"]
    assert nan_of(run) == OF_UNITS - {"estimate_error"} | {
        "acceleration", "acceleration_ratio", "effort_ratio", "utilisation", "time_to_speed", "jerk_rms", "jerk_peak",
        "excess_damage", *OF_ROOM,
    }  # fmt: skip
    result = evaluate(run)
    assert result["missed_slips"] == result["false_alarms"] == 0.0
    assert result["slip_time"] == EXPECTED["slip_time"]
    assert result["distance"] == EXPECTED["distance"]


def test_a_train_without_units_couplers_and_brake_groups_has_none_of_theirs():
    run = recorded(blended_brakes=0).isel(unit=slice(0), coupler=slice(0), brake_group=slice(0))
    run["axle_unit"] = ("axle", [-1] * 6)
    assert nan_of(run) == OF_UNITS | OF_ROOM | {
        "utilisation", "coupler_peak", "air_consumption", "torsion_peak", "excess_damage",
    }  # fmt: skip
    result = evaluate(run)
    assert result["effort_ratio"] == result["missed_slips"] == result["false_alarms"] == 0.0


def test_without_slips_nothing_is_detected_missed_or_estimated():
    run = recorded()
    run["slipping"] = 0 * run["slipping"]
    run["slip_velocity"] = 0.0 * run["slip_velocity"]
    result = evaluate(run)
    assert nan_of(run) == {"estimate_error", "utilisation_slipping", "detection_delay"}
    assert result["missed_slips"] == result["false_alarms"] == result["slip_time"] == 0.0


def test_with_motors_alone_unpowered_axles_do_not_brake():
    result = evaluate(recorded(blended_brakes=0))
    force = FORCE_UNIT_0 + FORCE_UNIT_1 + FORCE_BRAKED - 10 * 4000
    offered = OFFERED_UNIT_0 + OFFERED_UNIT_1 + OFFERED_BRAKED - 10 * 15000
    assert result["effort_ratio"] == pytest.approx(force / (60e3 * ASKED), rel=1e-12)
    assert result["utilisation"] == pytest.approx(force / offered, rel=1e-12)


@looped(
    ("target", "speed", "time", "distance"),
    [
        (math.nan, "as it is", math.nan, 43**2 / 8),  # none set: until the end
        (30.0, "as it is", math.nan, math.nan),  # not reached
        (9.0, "falls", 1.0, 12**2 / 8),  # 10 - k / 12 from above
        (0.0, "stops", 3.0, 28**2 / 8),  # nears 0 but does not pass it
        (
            12.0,
            "leaps",
            math.nan,
            1 / 8,
        ),  # from below at the first instant, beyond it before anything is asked for
        (0.0, "stands", math.nan, 0.0),  # there already, half a second before it is asked to move
    ],
)
def test_the_target_speed_ends_time_and_distance(target, speed, time, distance):
    run, k = recorded(target_speed=target), np.arange(44)
    courses = {
        "falls": 10.0 - k / 12.0,
        "stops": np.where(k < 28, 0.011, 0.0099),
        "leaps": np.where(k < 1, 10.0, 13.0),
        "stands": 0.0 * k,
    }
    if speed in courses:
        run["speed"] = ("time", courses[speed])
    found = [METRICS[name].function(run) for name in ("time_to_speed", "distance")]
    assert found == pytest.approx([time, distance], rel=1e-12, nan_ok=True)


# An axle is past the peak at instants 10, 11 and 12. A detection belongs to it from 0.1 s (1 instant) before the first
# until 0.3 s (2 instants) after the last.
@looped(
    ("onset", "delay", "alarms"),
    [(8, None, 1), (9, -1, 0), (10, 0, 0), (12, 2, 0), (14, 4, 0), (15, None, 1)],
)
def test_a_detection_belongs_to_a_slip_just_before_until_some_time_after(onset, delay, alarms):
    run = recorded()
    run["slip_velocity"] = 0.0 * run["slip_velocity"]
    run["slipping"] = 0 * run["slipping"]
    run["slip_velocity"].values[10:13, 4] = -0.3
    run["slipping"].values[onset, 1] = 1
    result = evaluate(run)
    found = result["detection_delay"], result["missed_slips"], result["false_alarms"]
    assert found == pytest.approx(
        (math.nan if delay is None else delay * 0.125, float(delay is None), alarms),
        rel=1e-12,
        nan_ok=True,
    )


def test_the_record_period_is_the_mean_distance_of_instants():
    run = recorded()
    assert record_period(run.isel(time=[0, 1, 4])) == 0.25
    assert np.isnan(record_period(run.isel(time=[0])))


@looped("hertz", [2.0, 5.0, 12.0])
def test_jerk_is_filtered_twice_by_butterworth_of_second_order(hertz):
    # forth and back: 1 / (1 + (f / f_c)^4), with frequencies as the bilinear transform of 10 ms warps them; differences
    # over two periods: sin(w T) / T in the place of w
    time, period = 0.01 * np.arange(2001), 0.01
    run = recorded().isel(time=[0] * time.size).assign_coords(time=time)
    wave = 2.0 * math.pi * hertz * time
    run["car_acceleration"] = (
        ("time", "car"),
        np.stack([np.sin(wave), 0.0 * wave, 3.0 * np.sin(wave)], axis=1),
    )
    warped = math.tan(math.pi * hertz * period) / math.tan(math.pi * 5.0 * period)
    size = math.sin(2.0 * math.pi * hertz * period) / period / (1.0 + warped**4)
    found = jerk(run)[500:1501]
    expected = np.stack([size * np.cos(wave), 0.0 * wave, 3.0 * size * np.cos(wave)], axis=1)[
        500:1501
    ]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * size)
    assert JERK_CUT_OFF == 5.0


@looped(("instants", "filtered"), [(30, False), (31, True)])
def test_jerk_of_few_instants_is_not_filtered(instants, filtered):
    run = recorded().isel(time=[0] * instants).assign_coords(time=0.01 * np.arange(instants))
    wave = np.arange(instants) ** 2 % 7.0
    run["car_acceleration"] = (("time", "car"), np.stack([wave] * 3, axis=1))
    differences = (wave[2:] - wave[:-2]) / 0.02
    assert np.allclose(jerk(run)[1:-1, 2], differences, rtol=1e-12) != filtered


def test_what_vibrates_at_the_end_of_a_run_is_no_step():
    time = 0.01 * np.arange(1001)
    run = recorded().isel(time=[0] * time.size).assign_coords(time=time)
    wave = np.cos(2.0 * math.pi * 25.0 * time)  # at its crest at both ends
    run["car_acceleration"] = (("time", "car"), np.stack([wave] * 3, axis=1))
    assert np.abs(jerk(run)).max() < 0.02 * 2.0 * math.pi * 25.0


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


@looped(("asked", "short"), [(0.1049, False), (0.1051, True)])
def test_a_twentieth_beyond_the_rail_is_no_shortage(asked, short):
    assert shortage(short_run(asked))[:, 0].all() == short
    assert not shortage(short_run(asked))[:, 1].any()


@looped(("after", "starts"), [(0.0901, [0]), (0.0899, [0, 20])])
def test_a_fall_by_a_tenth_starts_a_search_anew(after, starts):
    run = short_run(available=course(0.10, (20, 43, after)))
    assert [episode.start for episode in episodes(run)] == starts


def test_a_fall_that_takes_half_a_second_is_one_and_a_slower_one_is_none():
    # by 0.003 an instant: 12 % in four instants, and 9 % in three; half a second is four
    quick = short_run(available=0.10 - 0.003 * np.clip(np.arange(44) - 20, 0, 4))
    slow = short_run(available=0.10 - 0.002 * np.clip(np.arange(44) - 20, 0, 10))
    assert [episode.start for episode in episodes(quick)] == [0, 24]
    assert [episode.start for episode in episodes(slow)] == [0]


@looped(("used", "ticks"), [(0.0901, 0), (0.0899, 4)])
def test_nine_tenths_of_the_rail_count_as_found(used, ticks):
    run = short_run(used=course(0.10, (10, 13, used)))
    assert [search.time for search in searches(run)] == [ticks * 0.125]


@looped(
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


@looped(("rim", "speed", "locked"), [(0.099, 1.39, 1), (0.101, 1.39, 0), (0.0, 1.388, 0)])
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
