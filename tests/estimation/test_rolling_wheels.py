"""Wheels that roll freely tell their radius and their delay, and slips in between change neither."""

import numpy as np
import pytest

from studies.logs.rolling_wheels import rolling_wheel

TIME = np.arange(0.0, 30.0, 0.01)
SPEED = 20.0 + 4.0 * np.sin(2.0 * np.pi * TIME / 10.0)
FREE, UNSURE = np.zeros(TIME.size), np.full(TIME.size, 0.005)


def of_wheel(error: float, late: float, noise: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(5)
    own = (1.0 + error) * np.interp(TIME - late, TIME, SPEED)
    return own + noise * rng.standard_normal(TIME.size)


@pytest.mark.parametrize("error", [-0.04, -0.003, 0.0, 0.015])
@pytest.mark.parametrize("late", [-0.2, 0.0, 0.3])
def test_radius_and_delay_are_found_apart(error, late):
    found = rolling_wheel(TIME, SPEED, of_wheel(error, late), FREE, UNSURE, 0.0)
    assert found.error == pytest.approx(error, abs=3e-4)
    assert found.late == pytest.approx(late, abs=0.015)


def test_the_error_is_within_its_stated_deviation():
    found = [
        rolling_wheel(TIME, SPEED, of_wheel(0.01, 0.0, noise), FREE, UNSURE, noise)
        for noise in (0.0, 0.01, 0.05, 0.2)
    ]
    assert all(abs(one.error - 0.01) < 2.0 * one.deviation for one in found)


def test_noise_that_nobody_stated_widens_the_deviation():
    found = rolling_wheel(TIME, SPEED, of_wheel(0.01, 0.0, 0.05), FREE, UNSURE, 0.0)
    assert found.deviation > 1.5e-4
    assert abs(found.error - 0.01) < 3.0 * found.deviation


def test_slides_of_a_tenth_of_the_time_do_not_count():
    own = of_wheel(0.01, 0.0)
    own[1000:1300] *= 0.7
    found = rolling_wheel(TIME, SPEED, own, FREE, UNSURE, 0.0)
    assert found.error == pytest.approx(0.01, abs=3e-4)


def test_a_wheel_that_is_pulled_or_stands_tells_nothing():
    assert rolling_wheel(TIME, SPEED, of_wheel(0.01, 0.0), FREE + 0.05, UNSURE, 0.0) is None
    assert rolling_wheel(TIME, 0.1 * SPEED, 0.1 * of_wheel(0.01, 0.0), FREE, UNSURE, 0.0) is None


def test_a_wheel_that_turns_as_no_train_runs_tells_nothing():
    own = np.random.default_rng(3).uniform(0.0, 30.0, TIME.size)
    assert rolling_wheel(TIME, SPEED, own, FREE, UNSURE, 0.0) is None
    few = np.where(TIME % 1.0 < 0.3, 0.0, 0.05)  # never half a second at a stretch
    assert rolling_wheel(TIME, SPEED, of_wheel(0.01, 0.0), few, UNSURE, 0.0) is None


def test_instants_at_which_the_trains_speed_is_unknown_are_left_out():
    lost = (TIME > 9.0) & (TIME < 12.0)
    found = rolling_wheel(
        TIME, np.where(lost, np.nan, SPEED), of_wheel(0.01, 0.0), FREE, UNSURE, 0.0
    )
    assert found.error == pytest.approx(0.01, abs=3e-4)
    only = np.where(TIME % 0.02 < 0.01, SPEED, np.nan)
    assert rolling_wheel(TIME, only, of_wheel(0.01, 0.0), FREE, UNSURE, 0.0) is None
