"""Speeds of cars against their coupled train have no momentum and no sensor's offset; slack that runs out is in them."""

import numpy as np
import pytest

from studies.logs.aligned_log import FORGOTTEN, speeds_against_train

TIME = 0.01 * np.arange(1500)
WHOLE = np.zeros(TIME.size, dtype=np.int64)
MASS = np.array([80e3, 20e3, 30e3])


def run_out() -> np.ndarray:
    """Speed of each car against the first by slack that it runs out, one after another."""
    return np.stack([0.1 * np.exp(-0.5 * ((TIME - t) / 0.3) ** 2) for t in (1.0, 2.0, 3.0)], axis=1)


def against_mean(speed: np.ndarray) -> np.ndarray:
    return speed - (speed @ MASS / MASS.sum())[:, None]


def test_the_speeds_have_no_momentum():
    rate = np.random.default_rng(1).normal(0.0, 0.3, (TIME.size, 3))
    found = speeds_against_train(TIME, WHOLE, rate, MASS)
    np.testing.assert_allclose(found @ MASS, 0.0, atol=1e-6 * MASS.sum())


def test_slack_that_runs_out_is_found_and_offsets_are_not():
    speed = run_out()
    rate = np.gradient(speed + 0.5 * TIME[:, None], TIME, axis=0)
    rate += np.array([0.1, -0.2, 0.05])
    found = speeds_against_train(TIME, WHOLE, rate, MASS)
    np.testing.assert_allclose(found, against_mean(speed), atol=0.1 * TIME[-1] / FORGOTTEN * 0.1)


def test_an_error_is_forgotten():
    """A step of one sensor's offset in the middle of a long log does not leave the cars apart for ever."""
    time = 0.05 * np.arange(24_000)
    rate = np.zeros((time.size, 3))
    rate[12_000:12_200, 0] = 0.01
    found = speeds_against_train(time, np.zeros(time.size, dtype=np.int64), rate, MASS)
    assert np.abs(found).max() > 0.03
    assert np.abs(found[12_200 + int(100.0 * FORGOTTEN) :]).max() < 0.005


def test_a_part_in_which_an_acceleration_lacks_is_unknown():
    rate = np.gradient(run_out(), TIME, axis=0)
    rate[1200, 1] = np.nan
    part = (TIME > 8.0).astype(np.int64)
    found = speeds_against_train(TIME, part, rate, MASS)
    assert np.isnan(found[part == 1]).all()
    np.testing.assert_allclose(found[part == 0], against_mean(run_out())[part == 0], atol=2e-3)


@pytest.mark.parametrize("count", [1, 0])
def test_a_part_of_one_instant_is_unknown(count):
    part = np.zeros(TIME.size, dtype=np.int64)
    part[-1:] = count
    found = speeds_against_train(TIME, part, np.gradient(run_out(), TIME, axis=0), MASS)
    assert np.isnan(found[-1]).all() == (count == 1)


def test_accelerations_that_miss_the_impacts_tell_nothing():
    rare = slice(None, None, 8)
    found = speeds_against_train(
        TIME[rare], WHOLE[rare], np.gradient(run_out(), TIME, axis=0)[rare], MASS
    )
    assert np.isnan(found).all()
