"""Averaging over a stop: the report's window, an unbiased mean, and a deviation that counts correlation."""

import numpy as np
import pytest
from scipy.signal import lfilter

from alloc.errors import EstimationError
from alloc.estimation.brake_force_mean import batch_mean, braking_window

TIME = np.arange(0.0, 30.0, 0.02)
PRESSURE = 350e3 * -np.expm1(-np.maximum(TIME - 1.0, 0.0) / 1.5)
SPEED = np.maximum(15.0 - 0.6 * TIME, 0.0)


def correlated(rng, runs, samples, poles):
    """Autoregressive series (samples, runs) of unit variance after its start-up, with mean 0."""
    coefficients = np.real(np.poly(poles))
    x = lfilter([1.0], coefficients, rng.standard_normal((samples + 2000, runs)), axis=0)[2000:]
    return x / x.std()


def test_the_window_runs_from_one_time_constant_to_standstill():
    window = braking_window(PRESSURE, SPEED)
    assert TIME[window.start] == pytest.approx(1.0 + 1.5, abs=0.02)
    assert SPEED[window.stop] <= 0.5 < SPEED[window.stop - 1]
    assert braking_window(PRESSURE, SPEED, steady=300e3).start < window.start
    assert braking_window(PRESSURE, SPEED, standstill=5.0).stop < window.stop


@pytest.mark.parametrize(
    ("pressure", "speed", "options", "named"),
    [
        (PRESSURE, SPEED + 1.0, {}, "speed stays above 0.5"),
        (0.0 * PRESSURE, SPEED, {}, "is it braked"),
        (PRESSURE, 0.0 * SPEED, {}, "stands at the first sample"),
        (PRESSURE, SPEED, {"steady": 1e6}, "does not reach 63.2%"),
        (PRESSURE[:5], SPEED, {}, "speed has shape"),
        (PRESSURE, SPEED * np.nan, {}, "speed holds nan"),
    ],
)
def test_a_stop_without_a_window_is_refused(pressure, speed, options, named):
    with pytest.raises(EstimationError, match=named):
        braking_window(pressure, speed, **options)


@pytest.mark.parametrize(
    "poles",
    [(0.0,), (0.9,), (0.96 * np.exp(0.2j), 0.96 * np.exp(-0.2j))],
    ids=["white", "correlated", "oscillating"],
)
def test_mean_is_unbiased_and_its_deviation_is_that_of_repeated_stops(poles):
    series = correlated(np.random.default_rng(5), 600, 1500, poles)
    means = batch_mean(3.0 + series)
    assert abs(means.mean.mean() - 3.0) < 4.0 * means.mean.std() / np.sqrt(600)
    assert means.deviation.mean() == pytest.approx(means.mean.std(), rel=0.12)
    low, high = means.interval(0.95)
    covered = ((low - 3.0) * (high - 3.0) < 0.0).mean()
    assert 0.92 < covered < 0.98


def test_a_force_that_grows_is_not_uncertain_for_that():
    """With the trend taken out the deviation is that of the noise, whatever the force does slowly."""
    noise = correlated(np.random.default_rng(8), 400, 1500, (0.9,))
    growing = noise + 20.0 * np.linspace(0.0, 1.0, 1500)[:, None] ** 2
    plain, fitted = batch_mean(growing), batch_mean(growing, trend=2)
    np.testing.assert_allclose(fitted.deviation, batch_mean(noise, trend=2).deviation, rtol=1e-2)
    assert fitted.deviation.mean() == pytest.approx(fitted.mean.std(), rel=0.12)
    assert plain.deviation.mean() > 3.0 * fitted.deviation.mean()
    assert fitted.freedom == 7


def test_samples_that_repeat_add_nothing():
    x = np.random.default_rng(1).standard_normal(200)
    once, often = batch_mean(x), batch_mean(np.repeat(x, 7))
    assert often.mean == pytest.approx(once.mean)
    assert often.deviation == pytest.approx(once.deviation)


def test_too_short_series_are_refused():
    with pytest.raises(EstimationError, match="9 samples do not fill 10 batches"):
        batch_mean(np.zeros(9))
    with pytest.raises(EstimationError, match="batches = 1 must exceed"):
        batch_mean(np.zeros(9), 1)
    with pytest.raises(EstimationError, match="trend = 9"):
        batch_mean(np.zeros(90), 10, trend=9)
    with pytest.raises(EstimationError, match="values holds nan"):
        batch_mean(np.array([0.0, np.nan]))


def test_steady_pressure_is_that_of_the_last_quarter():
    # 63.2 % of 300 kPa are 189.6 kPa, which the second quarter has; of the 200 kPa before it would be the first
    pressure = np.repeat([150e3, 200e3, 200e3, 300e3], 10)
    speed = np.where(np.arange(41) < 40, 10.0, 0.0)
    assert braking_window(np.append(pressure, 0.0), speed) == slice(10, 40)


def test_batches_by_hand():
    # of two batches of two the first sample is left: means 2 and 8, scatter 3^2 + 3^2, of the mean half of it
    means = batch_mean([9.0, 1.0, 3.0, 5.0, 11.0], batches=2)
    assert [float(means.mean), float(means.deviation)] == pytest.approx([5.8, 3.0], rel=1e-12)
    assert means.freedom == 1
    # Student's t of one degree of freedom: 12.706 at 95 %
    assert np.array(means.interval()) == pytest.approx(
        [5.8 - 3 * 12.7062, 5.8 + 3 * 12.7062], rel=1e-5
    )
