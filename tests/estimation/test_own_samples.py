"""What a channel really measured is found again, whatever the logger filled in; pulses give back the way that made them."""

import numpy as np
import pytest

from studies.logs.own_samples import (
    ALIASED,
    BRIDGED,
    at,
    noise_of,
    own_samples,
    pulse_step,
)

TIME = 0.01 * np.arange(3000)
SPEED = 25.0 - 0.8 * np.clip(TIME - 4.0, 0.0, 12.0) - 0.3 * np.sin(0.7 * TIME)


@pytest.mark.parametrize("every", [5, 20, 100, 137])
def test_held_and_interpolated_channels_have_their_own_samples(every):
    own = np.arange(0, TIME.size, every)
    held = own_samples(TIME, SPEED[own][np.arange(TIME.size) // every])
    assert held.kind == "held"
    np.testing.assert_array_equal(held.value, SPEED[own][: held.value.size])
    np.testing.assert_allclose(held.time, TIME[own], atol=1e-9)
    lines = own_samples(TIME, np.interp(TIME, TIME[own], SPEED[own]), speed=True)
    if every * 0.01 >= 0.5:
        assert lines.kind == "interpolated"
        np.testing.assert_allclose(
            np.interp(lines.time, TIME[own], SPEED[own]), lines.value, atol=1e-9
        )


@pytest.mark.parametrize("period", [0.023, 0.045, 0.061, 0.136])
def test_a_held_channel_whose_period_is_no_multiple_of_the_rows(period):
    tick = np.floor(TIME / period + 1e-9).astype(int)
    first = np.searchsorted(tick, np.arange(tick[-1] + 1))
    held = own_samples(TIME, SPEED[first][tick])
    assert held.kind == "held"
    known = np.interp(held.time, TIME, SPEED)
    # all but a few are found where they are, the others a row beside
    assert np.mean(np.abs(held.value - known) < 1e-9) > 0.9
    assert np.abs(held.value - known).max() < 0.02


@pytest.mark.parametrize("every", [50, 100])
def test_lines_stay_lines_where_values_are_missing_or_single(every):
    own = np.arange(0, TIME.size, every)
    lines = np.interp(TIME, TIME[own], SPEED[own])
    some = np.random.default_rng(2).random(TIME.size) < 0.01
    for values in (np.where(some, np.nan, lines), lines.astype(np.float32).astype(float)):
        found = own_samples(TIME, values, speed=True)
        assert found.kind == "interpolated"
        assert found.period == pytest.approx(0.01 * every)
        np.testing.assert_allclose(np.interp(found.time, TIME, lines), found.value, atol=1e-5)


def test_what_is_measured_in_every_row_stays_as_it_is():
    rng = np.random.default_rng(0)
    for values in (SPEED, SPEED + rng.normal(0.0, 0.05, TIME.size), np.zeros(TIME.size)):
        found = own_samples(TIME, values)
        assert found.kind == "sampled"
        np.testing.assert_array_equal(found.value, values)


def test_noise_and_rounding_are_told():
    rng = np.random.default_rng(1)
    assert noise_of(SPEED + rng.normal(0.0, 0.05, TIME.size)) == pytest.approx(0.05, rel=0.1)
    slowing = 25.0 - 0.8 * TIME + 0.005 * TIME**2
    rounded = own_samples(TIME, np.round(slowing), speed=True)
    assert rounded.kind == "quantised"
    # as the value changes the true one is in the middle
    np.testing.assert_allclose(rounded.value, np.interp(rounded.time, TIME, slowing), atol=0.01)


@pytest.mark.parametrize("period", [0.005, 0.01, 0.02])
def test_pulses_give_the_speed_within_the_stated_error(period):
    time = np.arange(0.0, 20.0, period)
    speed = np.interp(time, TIME, SPEED)
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


@pytest.mark.parametrize("period", [0.1, 0.2])
def test_a_speed_that_is_held_and_rounded_changed_between_two_samples(period):
    """Not as it was written: that is half a period later, on average."""
    tick = np.floor(TIME / period + 1e-9) * period
    whole = np.round(np.interp(tick, TIME, SPEED) / (1.0 / 3.6)) / 3.6
    found = own_samples(TIME, whole, speed=True)
    assert found.kind == "quantised"
    brakes = (found.time > 4.5) & (found.time < 15.5)
    late = (np.interp(found.time, TIME, SPEED) - found.value)[brakes] / 0.8
    assert abs(np.mean(late)) < 0.2 * period


def test_straight_lines_reach_over_short_distances_alone():
    time = np.concatenate([np.arange(0.0, 1.0, 0.05), np.arange(1.5, 3.0, 0.05)])
    when = np.arange(0.0, 2.9, 0.01)
    value = at(when, own_samples(time, time**2), BRIDGED)
    known = np.isfinite(value)
    assert np.all(known == ((when <= 0.95 + 1e-9) | (when >= 1.5 - 1e-9)))
    np.testing.assert_allclose(value[known], when[known] ** 2, atol=1e-3)
