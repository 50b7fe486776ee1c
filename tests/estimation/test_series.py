"""Series of a log: own samples, slips, wheel damage, speeds of cars, and what a measured run comes to."""

import numpy as np
import pytest
import xarray as xr

from alloc.errors import EstimationError
from alloc.estimation.series import PIECE, PIECES, excerpt, usual_period
from alloc.estimation.slip_events import SlipCriterion, SlipEvent, find_slips
from alloc.estimation.wheel_damage import tangential_force, wheel_damage
from alloc.plant.model import structure_of
from alloc.plant.sets import find_set
from studies.logs.aligned_log import FORGOTTEN, speeds_against_train
from studies.logs.measured_run import (
    Findings,
    MeasuredRun,
    MeasuredTrain,
    analyse_run,
    applied_force,
    parts,
    train_acceleration,
)
from studies.logs.own_samples import ALIASED, BRIDGED, at, noise_of, own_samples, pulse_step
from tests.cases import looped

ROWS = 0.01 * np.arange(3000)


BRAKED = 25.0 - 0.8 * np.clip(ROWS - 4.0, 0.0, 12.0) - 0.3 * np.sin(0.7 * ROWS)


@looped("every", [5, 20, 100, 137])
def test_held_and_interpolated_channels_have_their_own_samples(every):
    own = np.arange(0, ROWS.size, every)
    held = own_samples(ROWS, BRAKED[own][np.arange(ROWS.size) // every])
    assert held.kind == "held"
    np.testing.assert_array_equal(held.value, BRAKED[own][: held.value.size])
    np.testing.assert_allclose(held.time, ROWS[own], atol=1e-9)
    lines = own_samples(ROWS, np.interp(ROWS, ROWS[own], BRAKED[own]), speed=True)
    if every * 0.01 >= 0.5:
        assert lines.kind == "interpolated"
        np.testing.assert_allclose(
            np.interp(lines.time, ROWS[own], BRAKED[own]), lines.value, atol=1e-9
        )


@looped("period", [0.023, 0.045, 0.061, 0.136])
def test_a_held_channel_whose_period_is_no_multiple_of_the_rows(period):
    tick = np.floor(ROWS / period + 1e-9).astype(int)
    first = np.searchsorted(tick, np.arange(tick[-1] + 1))
    held = own_samples(ROWS, BRAKED[first][tick])
    assert held.kind == "held"
    known = np.interp(held.time, ROWS, BRAKED)
    # all but a few are found where they are, the others a row beside
    assert np.mean(np.abs(held.value - known) < 1e-9) > 0.9
    assert np.abs(held.value - known).max() < 0.02


@looped("every", [50, 100])
def test_lines_stay_lines_where_values_are_missing_or_single(every):
    own = np.arange(0, ROWS.size, every)
    lines = np.interp(ROWS, ROWS[own], BRAKED[own])
    some = np.random.default_rng(2).random(ROWS.size) < 0.01
    for values in (np.where(some, np.nan, lines), lines.astype(np.float32).astype(float)):
        found = own_samples(ROWS, values, speed=True)
        assert found.kind == "interpolated"
        assert found.period == pytest.approx(0.01 * every)
        np.testing.assert_allclose(np.interp(found.time, ROWS, lines), found.value, atol=1e-5)


def test_what_is_measured_in_every_row_stays_as_it_is():
    rng = np.random.default_rng(0)
    for values in (BRAKED, BRAKED + rng.normal(0.0, 0.05, ROWS.size), np.zeros(ROWS.size)):
        found = own_samples(ROWS, values)
        assert found.kind == "sampled"
        np.testing.assert_array_equal(found.value, values)


def test_noise_and_rounding_are_told():
    rng = np.random.default_rng(1)
    assert noise_of(BRAKED + rng.normal(0.0, 0.05, ROWS.size)) == pytest.approx(0.05, rel=0.1)
    slowing = 25.0 - 0.8 * ROWS + 0.005 * ROWS**2
    rounded = own_samples(ROWS, np.round(slowing), speed=True)
    assert rounded.kind == "quantised"
    # as the value changes the true one is in the middle
    np.testing.assert_allclose(rounded.value, np.interp(rounded.time, ROWS, slowing), atol=0.01)


@looped("period", [0.005, 0.01, 0.02])
def test_pulses_give_the_speed_within_the_stated_error(period):
    time = np.arange(0.0, 20.0, period)
    speed = np.interp(time, ROWS, BRAKED)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * period)])
    pulse = 0.0338
    counts = np.diff(np.floor(way / pulse), prepend=0.0)
    counts[0] = counts[1]
    counted = counts * pulse / period
    assert pulse_step(counted) == pytest.approx(pulse / period, rel=1e-6)
    found = own_samples(time, counted, speed=True)
    assert found.kind == "counted"
    error = (found.value - speed)[20:-20]
    assert np.sqrt(np.mean(error**2)) < found.noise == pytest.approx(ALIASED * pulse / found.span)
    assert np.abs(error).max() < 5.0 * found.noise
    assert pulse_step(speed) == 0.0
    assert pulse_step(np.round(speed)) == 0.0


def test_a_wheel_that_stands_has_no_speed():
    counted = np.concatenate([np.tile([1.0, 0.0], 200), np.zeros(300)]) * 3.4
    time = 0.01 * np.arange(counted.size)
    assert np.all(own_samples(time, counted, speed=True).value[-200:] == 0.0)


@looped("period", [0.1, 0.2])
def test_a_speed_that_is_held_and_rounded_changed_between_two_samples(period):
    """Not as it was written: that is half a period later, on average."""
    tick = np.floor(ROWS / period + 1e-9) * period
    whole = np.round(np.interp(tick, ROWS, BRAKED) / (1.0 / 3.6)) / 3.6
    found = own_samples(ROWS, whole, speed=True)
    assert found.kind == "quantised"
    brakes = (found.time > 4.5) & (found.time < 15.5)
    late = (np.interp(found.time, ROWS, BRAKED) - found.value)[brakes] / 0.8
    assert abs(np.mean(late)) < 0.2 * period


def test_straight_lines_reach_over_short_distances_alone():
    time = np.concatenate([np.arange(0.0, 1.0, 0.05), np.arange(1.5, 3.0, 0.05)])
    when = np.arange(0.0, 2.9, 0.01)
    value = at(when, own_samples(time, time**2), BRIDGED)
    known = np.isfinite(value)
    assert np.all(known == ((when <= 0.95 + 1e-9) | (when >= 1.5 - 1e-9)))
    np.testing.assert_allclose(value[known], when[known] ** 2, atol=1e-3)


TEN_SECONDS = np.arange(1000) * 0.01


def humps(*where, height=1.0, width=1.0):
    """Slip velocity with humps sin^2 that begin at these times [s]."""
    inside = [np.clip((TEN_SECONDS - begin) / width, 0.0, 1.0) for begin in where]
    return height * sum(np.sin(np.pi * x) ** 2 for x in inside)


def find(slip, coefficient=None, **criterion):
    speed = np.full(TEN_SECONDS.size, 10.0)
    damage = None if coefficient is None else 100.0 * TEN_SECONDS
    return find_slips(
        3, TEN_SECONDS, speed, speed + slip, coefficient, damage, SlipCriterion(**criterion)
    )


def test_slips_and_slides_are_found_in_order():
    events = find(humps(1.0) - humps(4.0) + humps(7.0, height=0.3))
    assert [(event.kind, round(event.largest_slip, 3)) for event in events] == [
        ("slip", 1.0), ("slide", -1.0)
    ]  # fmt: skip
    first = events[0]
    assert first.slip_ratio == pytest.approx(1.0 / 11.0, rel=0.01)
    assert (first.axle, first.cut) == (3, False)
    half = 0.5 * 0.05 * 10.0
    assert first.start == pytest.approx(1.0 + np.arcsin(np.sqrt(half)) / np.pi, abs=0.02)
    assert len(find(humps(7.0, height=0.3), ratio=0.01)) == 1  # by another criterion it is one


def test_a_slip_at_the_ends_of_the_series_is_cut():
    events = find(humps(-0.5) + humps(9.5))
    assert [event.cut for event in events] == [True, True]


def test_a_slip_that_seems_over_for_a_moment_is_one():
    slip = humps(1.0, width=2.0)
    slip[200:205] = 0.0
    assert len(find(slip)) == 1
    slip[190:215] = 0.0
    assert len(find(slip)) == 2


def test_the_adhesion_is_read_as_the_slip_begins():
    """Neither from the better rail before nor from the better rail after."""
    mu = np.full(TEN_SECONDS.size, 0.1)
    mu[:150], mu[250:] = 0.2, 0.3
    (event,) = find(humps(1.0, width=4.0), mu)
    assert event.onset_coefficient == 0.1
    assert event.utilisation > 1.5  # the better rail after
    assert event.damage == pytest.approx(100.0 * (event.end - event.start + 0.01), rel=1e-6)
    (slide,) = find(-humps(1.0, width=4.0), -mu)
    assert slide.onset_coefficient == 0.1


def test_an_onset_that_was_not_seen_tells_nothing():
    (event,) = find(humps(-0.5), np.full(TEN_SECONDS.size, 0.1))
    assert np.isnan([event.onset_coefficient, event.utilisation]).all()
    assert np.isfinite(event.damage)


def test_parts_end_at_gaps_and_at_missing_values():
    valid = np.ones(40, dtype=bool)
    valid[[5, 33]] = False
    part = np.repeat([0, 1, 2], [20, 2, 18])
    found = [(inside.start, inside.stop) for inside in parts(valid, part)]
    assert found == [(0, 5), (6, 20), (22, 33), (34, 40)]  # two instants are too short


def test_events_are_in_the_order_of_time():
    assert [event.kind for event in find(humps(4.0) - humps(1.0))] == ["slide", "slip"]


def test_the_bound_is_a_share_of_the_larger_speed():
    bound = SlipCriterion().bound(
        np.array([10.0, 20.0, -20.0, 3.0]), np.array([20.0, 10.0, 0.0, 3.9])
    )
    assert bound.tolist() == [1.0, 1.0, 1.0, 0.2]


def test_slip_at_the_bound_itself_is_none():
    still = np.zeros(TEN_SECONDS.size)
    for rim, count in ((0.2, 0), (0.21, 1)):
        found = find_slips(0, TEN_SECONDS, still, still + rim, None, None, SlipCriterion())
        assert len(found) == count


def test_onset_is_sought_from_half_of_its_time_after_the_start_until_that_time_after_the_bound():
    # slip t - 1 against 0.05 (9 + t): past half of it at 1.26 s, past it at 1.53 s; so between 1.31 and 1.63 s
    mu = np.full(TEN_SECONDS.size, 0.1)
    mu[[130, 160, 164]] = 0.4, 0.3, 0.5
    (event,) = find(np.clip(TEN_SECONDS - 1.0, 0.0, 1.0) * (TEN_SECONDS < 3.0), mu)
    assert event.start == pytest.approx(1.26)
    assert (event.onset_coefficient, event.onset_time) == (0.3, pytest.approx(1.60))
    mu[[131, 163]] = 0.35, 0.34
    (event,) = find(np.clip(TEN_SECONDS - 1.0, 0.0, 1.0) * (TEN_SECONDS < 3.0), mu)
    assert event.onset_time == pytest.approx(1.31)
    # mean of 174 instants over the largest: all 0.1 but 0.4, 0.35, 0.3, 0.34, 0.5
    assert event.utilisation == pytest.approx((169 * 0.1 + 1.89) / 174 / 0.35)


@looped(("gap", "events"), [(8, 1), (9, 2)])
def test_less_than_a_tenth_of_a_second_is_bridged(gap, events):
    slip = np.where((TEN_SECONDS >= 1.0) & (TEN_SECONDS < 3.0), 1.0, 0.0)
    slip[150 : 150 + gap] = (
        0.0  # from the last instant before to the first after it is one period more
    )
    assert len(find(slip)) == events


@looped(("instants", "found"), [(3, 0), (4, 1)])
def test_a_part_has_more_than_three_instants(instants, found):
    valid = np.arange(10) < instants
    assert len(list(parts(valid, np.zeros(10, dtype=int)))) == found


@looped("name", ["velocity", "ratio"])
@looped("value", [0.0, -1.0, float("nan")])
def test_an_impossible_criterion_is_refused(name, value):
    with pytest.raises(EstimationError, match=name):
        SlipCriterion(**{name: value})


FOUR_SECONDS = np.linspace(0.0, 4.0, 401)


RADIUS, INERTIA = 0.43, 120.0


def sliding(time=FOUR_SECONDS, sign=1.0):
    """Constant tangential force 5 kN, slip velocity sign * sin^2: applied force, omega and speed that belong to it."""
    speed = 20.0 + sign * 0.8 * time
    slip = sign * 2.0 * np.sin(np.pi * time / 4.0) ** 2
    omega = (speed + slip) / RADIUS
    rate = (sign * 0.8 + sign * 0.5 * np.pi * np.sin(np.pi * time / 2.0)) / RADIUS
    applied = sign * 5000.0 + INERTIA / RADIUS * rate
    return applied[:, None], omega[:, None], speed


@looped("sign", [1.0, -1.0])
def test_damage_is_force_times_distance_slipped(sign):
    applied, omega, speed = sliding(sign=sign)
    damage = wheel_damage(FOUR_SECONDS, applied, omega, speed, INERTIA, RADIUS)
    distance = FOUR_SECONDS - 2.0 / np.pi * np.sin(np.pi * FOUR_SECONDS / 2.0)
    np.testing.assert_allclose(damage[:, 0], 5000.0 * distance, atol=1e-4 * 20e3)


def test_the_error_falls_with_the_square_of_the_sampling():
    errors = []
    for count in (21, 41, 81):
        time = np.linspace(
            0.0, 3.0, count
        )  # no whole period, of which the ends' errors would cancel
        applied, omega, speed = sliding(time)
        found = wheel_damage(time, applied, omega, speed, INERTIA, RADIUS)[-1, 0]
        errors.append(abs(found - 5e3 * (3.0 + 2.0 / np.pi)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 1.8), orders


def test_lines_between_instants_are_integrated_exactly():
    """Few instants of straight lines give what a thousand of them give."""
    rng = np.random.default_rng(3)
    knots = np.array([0.0, 0.3, 0.5, 1.1, 1.2])
    fine = np.unique(np.concatenate([knots, np.linspace(0.0, 1.2, 1001)]))
    applied, omega, speed = rng.uniform(1.0, 2.0, (3, knots.size)) * [[4e3], [50.0], [20.0]]
    coarse = wheel_damage(knots, applied[:, None], omega[:, None], speed, INERTIA, RADIUS)
    lines = [np.interp(fine, knots, values) for values in (applied, omega, speed)]
    many = wheel_damage(fine, lines[0][:, None], lines[1][:, None], lines[2], INERTIA, RADIUS)
    assert coarse[-1, 0] == pytest.approx(many[-1, 0], rel=1e-9)


def test_noise_of_the_speeds_does_not_bias_the_damage():
    applied, omega, speed = sliding()
    rng = np.random.default_rng(5)
    found = []
    for _ in range(400):
        noisy = omega + rng.normal(0.0, 0.05 / RADIUS, omega.shape)
        measured = speed + rng.normal(0.0, 0.05, speed.shape)
        found.append(wheel_damage(FOUR_SECONDS, applied, noisy, measured, INERTIA, RADIUS)[-1, 0])
    error = np.mean(found) - 20e3
    assert abs(error) < 3.0 * np.std(found) / np.sqrt(len(found)) + 2.0


def test_rolling_costs_nothing():
    speed = 20.0 - FOUR_SECONDS
    damage = wheel_damage(
        FOUR_SECONDS, np.full((FOUR_SECONDS.size, 2), -9e3), np.stack([speed / RADIUS] * 2, axis=1), speed, INERTIA, RADIUS
    )  # fmt: skip
    np.testing.assert_allclose(damage, 0.0, atol=1e-8)


@looped("sign", [1.0, -1.0])
def test_the_window_gives_the_mean_force(sign):
    applied, omega, _ = sliding(sign=sign)
    force = tangential_force(FOUR_SECONDS, applied, omega, INERTIA, RADIUS, 0.1)
    np.testing.assert_allclose(force, sign * 5000.0, rtol=2e-3)
    np.testing.assert_allclose(force[20:-20], sign * 5000.0, rtol=1e-4)


def test_noise_passes_into_the_force_as_documented():
    rng = np.random.default_rng(1)
    time = np.arange(20000) * 0.01
    omega = 40.0 + rng.normal(0.0, 0.01 / RADIUS, (time.size, 1))
    force = tangential_force(time, np.zeros_like(omega), omega, INERTIA, RADIUS, 0.1)
    assert force.std() == pytest.approx(np.sqrt(2.0) * INERTIA * 0.01 / (RADIUS**2 * 0.1), rel=0.03)


@looped(
    ("changes", "named"),
    [
        ({"time": FOUR_SECONDS[::-1]}, "time must grow"),
        ({"time": FOUR_SECONDS[:1]}, "two instants"),
        ({"applied_force": np.zeros((5, 2))}, "applied_force has shape"),
        ({"angular_speed": np.zeros((FOUR_SECONDS.size, 3))}, "angular_speed has shape"),
        (
            {"speed": np.where(FOUR_SECONDS[7] == FOUR_SECONDS, np.nan, 1.0)},
            r"speed holds nan at \(7,\)",
        ),
        ({"speed": np.zeros(3)}, "speed has shape"),
        ({"inertia": 0.0}, "inertia"),
        ({"radius": np.array([0.4, np.nan])}, "radius"),
        ({"radius": np.array([0.4, 0.4, 0.4])}, "radius has shape"),
    ],
)
def test_impossible_series_are_refused(changes, named):
    arguments = {
        "time": FOUR_SECONDS,
        "applied_force": np.zeros((FOUR_SECONDS.size, 2)),
        "angular_speed": np.full((FOUR_SECONDS.size, 2), 40.0),
        "speed": np.full(FOUR_SECONDS.size, 17.0),
        "inertia": INERTIA,
        "radius": RADIUS,
    }
    with pytest.raises(EstimationError, match=named):
        wheel_damage(**arguments | changes)


def test_a_window_shorter_than_the_sampling_is_refused():
    with pytest.raises(EstimationError, match="window"):
        tangential_force(FOUR_SECONDS, np.zeros((401, 1)), np.zeros((401, 1)), 1.0, 1.0, 1e-3)


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


FIFTEEN = 0.01 * np.arange(1500)


WHOLE = np.zeros(FIFTEEN.size, dtype=np.int64)


THREE_MASSES = np.array([80e3, 20e3, 30e3])


def run_out() -> np.ndarray:
    """Speed of each car against the first by slack that it runs out, one after another."""
    return np.stack(
        [0.1 * np.exp(-0.5 * ((FIFTEEN - t) / 0.3) ** 2) for t in (1.0, 2.0, 3.0)], axis=1
    )


def against_mean(speed: np.ndarray) -> np.ndarray:
    return speed - (speed @ THREE_MASSES / THREE_MASSES.sum())[:, None]


def test_the_speeds_have_no_momentum():
    rate = np.random.default_rng(1).normal(0.0, 0.3, (FIFTEEN.size, 3))
    found = speeds_against_train(FIFTEEN, WHOLE, rate, THREE_MASSES)
    np.testing.assert_allclose(found @ THREE_MASSES, 0.0, atol=1e-6 * THREE_MASSES.sum())


def test_slack_that_runs_out_is_found_and_offsets_are_not():
    speed = run_out()
    rate = np.gradient(speed + 0.5 * FIFTEEN[:, None], FIFTEEN, axis=0)
    rate += np.array([0.1, -0.2, 0.05])
    found = speeds_against_train(FIFTEEN, WHOLE, rate, THREE_MASSES)
    np.testing.assert_allclose(found, against_mean(speed), atol=0.1 * FIFTEEN[-1] / FORGOTTEN * 0.1)


def test_an_error_is_forgotten():
    """A step of one sensor's offset in the middle of a long log does not leave the cars apart for ever."""
    time = 0.05 * np.arange(24_000)
    rate = np.zeros((time.size, 3))
    rate[12_000:12_200, 0] = 0.01
    found = speeds_against_train(time, np.zeros(time.size, dtype=np.int64), rate, THREE_MASSES)
    assert np.abs(found).max() > 0.03
    assert np.abs(found[12_200 + int(100.0 * FORGOTTEN) :]).max() < 0.005


def test_a_part_in_which_an_acceleration_lacks_is_unknown():
    rate = np.gradient(run_out(), FIFTEEN, axis=0)
    rate[1200, 1] = np.nan
    part = (FIFTEEN > 8.0).astype(np.int64)
    found = speeds_against_train(FIFTEEN, part, rate, THREE_MASSES)
    assert np.isnan(found[part == 1]).all()
    np.testing.assert_allclose(found[part == 0], against_mean(run_out())[part == 0], atol=2e-3)


@looped("count", [1, 0])
def test_a_part_of_one_instant_is_unknown(count):
    part = np.zeros(FIFTEEN.size, dtype=np.int64)
    part[-1:] = count
    found = speeds_against_train(
        FIFTEEN, part, np.gradient(run_out(), FIFTEEN, axis=0), THREE_MASSES
    )
    assert np.isnan(found[-1]).all() == (count == 1)


def test_accelerations_that_miss_the_impacts_tell_nothing():
    rare = slice(None, None, 8)
    found = speeds_against_train(
        FIFTEEN[rare], WHOLE[rare], np.gradient(run_out(), FIFTEEN, axis=0)[rare], THREE_MASSES
    )
    assert np.isnan(found).all()


WITH_GAP = np.concatenate([0.1 * np.arange(21), 3.0 + 0.1 * np.arange(11)])


PART = np.repeat([0, 1], [21, 11])


TRAIN = MeasuredTrain(
    name="two axles",
    car_mass=np.array([20e3, 30e3]),
    axle_car=np.array([0, 1]),
    axle_load=np.array([50e3, 60e3]),
    radius=np.array([0.5, 0.4]),
    inertia=np.array([100.0, 80.0]),
    driven=np.array([True, False]),
)


def run(**changes):
    """Both cars gain 1 m/s2. Axle 0 gains 2 m/s2 at its rim and slips by 1 m/s more every second; axle 1 rolls.

    The rail pulls axle 0 by 5000 N: its wheelset takes 100 / 0.5^2 x 2 = 800 N of what is applied. It holds axle 1 back by
    3000 N: the wheelset takes 80 / 0.4^2 x 1 = 500 N. What is applied to axle 1 was not recorded after the gap.
    """
    applied = np.column_stack(
        [np.full(WITH_GAP.size, 5800.0), np.where(PART == 0, -2500.0, np.nan)]
    )
    series = {
        "time": WITH_GAP, "part": PART, "speed": 10.0 + WITH_GAP, "applied_force": applied,
        "rim_speed": np.column_stack([10.0 + 2.0 * WITH_GAP, 10.0 + WITH_GAP]),
        "coupler_force": np.full((WITH_GAP.size, 1), 4e3),
    }  # fmt: skip
    return MeasuredRun(**series | changes)


def test_coefficients_are_forces_over_loads():
    found = analyse_run(run(), TRAIN)
    np.testing.assert_allclose(found.coefficient[:, 0], 5000.0 / 50e3, rtol=1e-9)
    np.testing.assert_allclose(found.coefficient[:21, 1], -3000.0 / 60e3, rtol=1e-9)
    assert np.isnan(found.coefficient[21:, 1]).all()
    np.testing.assert_allclose(found.slip_velocity[:, 0], WITH_GAP, atol=1e-12)
    assert found.covered == pytest.approx([3.0, 2.0])  # 2 s and 1 s; 2 s
    assert found.window == pytest.approx(0.2)  # two samplings, for 0.1 s would be but one


def test_forces_are_averaged_over_a_tenth_of_a_second_where_sampling_allows():
    time = 0.01 * np.arange(50)
    fine = MeasuredRun(
        time, np.zeros(50, dtype=int), 10.0 + time, np.full((50, 2), 10.0), np.zeros((50, 2))
    )
    assert analyse_run(fine, TRAIN).window == 0.1


def test_damage_is_force_times_slip_and_stands_still_over_the_gap():
    found = analyse_run(run(), TRAIN)
    before, after = 5000.0 * 2.0**2 / 2, 5000.0 * (4.0**2 - 3.0**2) / 2
    assert found.damage[20:22, 0] == pytest.approx(before, rel=1e-9)
    assert found.axle_damage == pytest.approx([before + after, 0.0], abs=1e-6)
    assert found.total_damage == pytest.approx(before + after)
    never = analyse_run(run(applied_force=np.full((WITH_GAP.size, 2), np.nan)), TRAIN)
    assert np.isnan(never.damage).all()
    assert never.total_damage == 0.0


def test_slips_are_found_part_by_part():
    # axle 0 passes half of 5 % of its rim speed where t = 0.025 (10 + 2 t): at 0.26 s, seen at 0.3 s
    found = analyse_run(run(), TRAIN)
    first, second = found.events
    assert (first.axle, first.start, first.end, first.cut) == (
        0, pytest.approx(0.3), pytest.approx(2.0), True
    )  # fmt: skip
    assert (second.start, second.end, second.cut) == (3.0, pytest.approx(4.0), True)
    assert first.onset_coefficient == pytest.approx(0.1)
    assert first.damage == pytest.approx(5000.0 * (2.0**2 - 0.2**2) / 2)
    assert np.isnan(second.onset_coefficient)
    assert second.largest_slip == pytest.approx(4.0)
    assert found.slipping_time == pytest.approx([1.7 + 1.0, 0.0])
    assert found.utilisation == pytest.approx(1.0)


def test_slips_without_forces_are_found_too():
    rim = np.column_stack([10.0 + WITH_GAP, 10.0 + 2.0 * WITH_GAP])
    found = analyse_run(run(rim_speed=rim), TRAIN)
    assert [(e.axle, e.start, np.isfinite(e.damage)) for e in found.events] == [
        (1, pytest.approx(0.3), True),
        (1, 3.0, False),
    ]


def test_use_in_slips_is_weighted_with_their_time():
    def slip(start, end, onset, share):
        return SlipEvent(0, start, end, False, 1.0, 0.1, onset, start, share, 0.0)

    nothing = np.zeros(1)
    events = [slip(0.0, 2.0, 0.1, 0.8), slip(5.0, 6.0, 0.2, 0.5), slip(7.0, 9.0, 0.3, np.nan)]
    found = Findings(events, nothing, nothing, nothing, nothing, nothing, None, 0.1)
    assert found.utilisation == pytest.approx(
        (0.1 * 0.8 * 2.0 + 0.2 * 0.5 * 1.0) / (0.1 * 2.0 + 0.2)
    )
    assert np.isnan(
        Findings([], nothing, nothing, nothing, nothing, nothing, None, 0.1).utilisation
    )


def test_brake_force_of_cars_is_by_the_coupler_and_the_acceleration():
    force = analyse_run(run(), TRAIN).car_force
    np.testing.assert_allclose(
        force, np.tile([-20e3 * 1.0 - 4e3, -30e3 * 1.0 + 4e3], (WITH_GAP.size, 1)), rtol=1e-9
    )
    own = np.tile([1.1, 0.8], (WITH_GAP.size, 1))
    own[7, 1] = np.nan
    couplers = np.full((WITH_GAP.size, 1), 4e3)
    couplers[3] = np.nan
    force = analyse_run(run(car_acceleration=own, coupler_force=couplers), TRAIN).car_force
    missing = np.isin(np.arange(WITH_GAP.size), [3, 7])
    np.testing.assert_allclose(
        force[~missing],
        np.tile([-20e3 * 1.1 - 4e3, -30e3 * 0.8 + 4e3], (WITH_GAP.size - 2, 1)),
        rtol=1e-9,
    )
    assert np.isnan(force[missing]).all()
    assert analyse_run(run(coupler_force=None), TRAIN).car_force is None


def test_acceleration_is_not_taken_over_a_gap():
    jump = 10.0 + WITH_GAP + 5.0 * PART
    np.testing.assert_allclose(train_acceleration(run(speed=jump), 0.4), 1.0, rtol=1e-9)


def test_series_of_another_train_are_refused():
    with pytest.raises(EstimationError, match=r"rim_speed: shape \(32, 1\) must be \(32, 2\)"):
        analyse_run(run(rim_speed=np.zeros((WITH_GAP.size, 1))), TRAIN)


def test_applied_force_is_torque_at_the_rim_less_the_shoes():
    train = find_set("commuter-8car")
    structure, layout = structure_of(train)
    torque = 100.0 * (1.0 + np.arange(layout.units)) * np.ones((2, 1))
    shoes = 10.0 * np.arange(layout.axles) * np.ones((2, 1))
    logged = xr.Dataset(
        {
            "rail_force": (("time", "axle"), np.zeros((2, layout.axles))),
            "brake_force": (("time", "axle"), shoes),
            "motor_torque": (("time", "unit"), torque),
            "axle_unit": (("axle",), structure.axle_unit),
            "unit_gear": (("unit",), structure.unit_gear),
        }
    )
    found = applied_force(logged, train)
    for i, unit in enumerate(structure.axle_unit):
        motor = 100.0 * (1 + unit) * structure.gear[i] / structure.radius[i] if unit >= 0 else 0.0
        assert found[:, i] == pytest.approx(motor - 10.0 * i)
    measured = MeasuredTrain.of(train)
    np.testing.assert_array_equal(applied_force(logged, measured), found)
    np.testing.assert_array_equal(measured.driven, structure.axle_unit >= 0)
    np.testing.assert_array_equal(measured.axle_load, structure.static_load)
    assert measured.car_mass.sum() == pytest.approx(train.mass)
    with pytest.raises(EstimationError, match="run of 3 axles"):
        applied_force(logged.isel(axle=slice(3)), train)
