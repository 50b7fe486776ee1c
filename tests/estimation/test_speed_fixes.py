"""The delay of a measured speed is found by shapes that are wrong in scale, hill or offset, and open where none tells it."""

import math

import numpy as np
import pytest

from studies.logs.own_samples import Samples
from studies.logs.random_slope import STARTS, Work, likelihood, smoothed
from studies.logs.speed_fixes import find_delay, follow

TIME = 0.01 * np.arange(3000)
SPEED = 25.0 - 0.8 * np.clip(TIME - 4.0, 0.0, 12.0) - 0.3 * np.sin(0.7 * TIME)
WHOLE = np.zeros(TIME.size, dtype=np.int64)


@pytest.mark.parametrize("late", [-0.2, 0.0, 0.5, 1.3])
def test_a_delay_is_found_by_a_shape_of_another_scale(late):
    shape = 1.02 * SPEED + 0.05 * TIME
    at = np.arange(2.0, 29.0)
    fixes = Samples(at, np.interp(at - late, TIME, SPEED), "sampled", 1.0, 0.0)
    part = np.zeros(TIME.size, dtype=np.int64)
    delay = find_delay(TIME, part, shape, fixes, TIME)
    assert delay.value == pytest.approx(late, abs=3.0 * delay.deviation)
    found = follow(TIME, part, shape, fixes, delay, TIME)
    inside = slice(300, 2700)
    assert np.abs(found.speed - SPEED)[inside].max() < 0.02


@pytest.mark.parametrize("late", [0.02, 0.22, 0.41])
def test_noise_and_drift_are_those_of_the_delay_that_is_found(late):
    """Beside it, by half a step of the grid, a dense speed looks as if it had noise or a drift."""
    hill = SPEED + 0.15 * TIME
    fixes = Samples(TIME, np.interp(TIME - late, TIME, SPEED), "sampled", 0.01, 0.0)
    delay = find_delay(TIME, np.zeros(TIME.size, dtype=np.int64), hill, fixes, TIME)
    assert delay.value == pytest.approx(late, abs=0.002)
    assert (delay.noise, delay.drift, delay.start) == (0.0003, 0.0003, "hill")


def test_smoother_and_likelihood_agree_with_linear_regression():
    """Without drift and with a vague start, v = s p + b + c t is ordinary least squares."""
    rng = np.random.default_rng(3)
    time, noise = np.linspace(0.0, 10.0, 40), 0.1
    shape = np.sin(time)
    value = 0.9 * shape + 2.0 + 0.1 * time + rng.normal(0.0, noise, time.size)
    vague = np.array([1e6, 1e6, 1e6])
    speed, variance = smoothed(time, shape, value, noise, 0.0, vague)
    columns = np.stack([shape, np.ones_like(time), time], axis=1)
    best = columns @ np.linalg.lstsq(columns, value, rcond=None)[0]
    np.testing.assert_allclose(speed, best, atol=1e-3)
    expected = noise**2 * np.einsum(
        "ij,jk,ik->i", columns, np.linalg.inv(columns.T @ columns), columns
    )
    np.testing.assert_allclose(variance, expected, rtol=1e-2)
    part = np.zeros(time.size, dtype=np.int64)
    scores = [
        likelihood(time, shape, value, part, n**2, 0.0, vague, *Work.allocate())
        for n in (0.02, 0.1, 0.5)
    ]
    assert scores[1] == min(scores)
    assert STARTS["level"][1] < STARTS["hill"][1]
    assert math.isfinite(scores[0])


def started(since: float = 0.0) -> np.ndarray:
    """Speed of a train whose effort grows for a second and then stays: its acceleration changes nowhere else."""
    grown = np.clip(TIME - since, 0.0, None)
    return 0.6 * np.where(grown < 1.0, 0.5 * grown**2, grown - 0.5)


@pytest.mark.parametrize("since", [0.0, 0.3])
def test_a_train_at_rest_was_so_before_its_log(since):
    """Without it, a delay that leaves the start out would fit a straight line as well as the right one does."""
    speed = started(since)
    rests = speed < 0.01
    under_way = np.cumsum(0.01 * ~rests)
    # a shape that is poor while the train is slow, as by pulses
    shape = speed + 0.03 * np.sin(9.0 * TIME) * (TIME < 1.5)
    fixes = Samples(TIME, speed, "sampled", 0.01, 0.0)
    assert abs(find_delay(TIME, WHOLE, shape, fixes, under_way).value) < 0.25
    assert abs(find_delay(TIME, WHOLE, shape, fixes, under_way, ("rolling",)).value) < 0.02


@pytest.mark.parametrize("late", [0.0, 0.37, 0.8])
@pytest.mark.parametrize("scale", [0.985, 1.01])
def test_wheels_that_roll_tell_the_delay_without_a_change_of_the_acceleration(late, scale):
    """Their shape is the speed itself but for a scale: its level tells what a shape without one cannot."""
    speed = 3.0 + 0.6 * TIME
    at = np.arange(2.0, 29.0)
    fixes = Samples(at, np.interp(at - late, TIME, speed), "sampled", 1.0, 0.0)
    of_wheels = find_delay(TIME, WHOLE, scale * speed, fixes, TIME, ("rolling",))
    assert of_wheels.value == pytest.approx(late, abs=0.01)
    assert of_wheels.deviation < 0.01
    assert find_delay(TIME, WHOLE, speed, fixes, TIME).deviation > 0.3


def test_no_less_noise_is_found_than_a_shape_is_known_to_have():
    fixes = Samples(TIME, SPEED, "sampled", 0.01, 0.0)
    for least in (0.0, 0.002, 0.02):
        found = find_delay(TIME, WHOLE, SPEED, fixes, TIME, least_noise=least)
        assert found.noise == max(least, 0.0003)
        assert abs(found.value) < 4.0 * found.deviation


def test_the_start_of_rolling_wheels_is_the_surest():
    for name in ("level", "hill", "unsure"):
        assert np.all(STARTS["rolling"] <= STARTS[name])
