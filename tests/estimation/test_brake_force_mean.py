"""Averaging over a stop: the report's window, an unbiased mean, and a deviation that counts correlation."""

import numpy as np
import pytest
from scipy.signal import lfilter

from alloc.errors import EstimationError
from alloc.estimation.brake_force import braking_window, stop_mean

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


POLES = {
    "white": (0.0,),
    "correlated": (0.9,),
    "oscillating": (0.96 * np.exp(0.2j), 0.96 * np.exp(-0.2j)),
}


@pytest.mark.parametrize(
    ("kind", "batch"), [("white", 1), ("correlated", 150), ("oscillating", 100)]
)
def test_mean_is_unbiased_and_its_interval_is_that_of_repeated_stops(kind, batch):
    series = correlated(np.random.default_rng(5), 600, 3000, POLES[kind])
    means = stop_mean(3.0 + series, batch=batch)
    assert abs(means.mean.mean() - 3.0) < 4.0 * means.mean.std() / np.sqrt(600)
    assert means.deviation.mean() == pytest.approx(means.mean.std(), rel=0.12)
    low, high = means.interval(0.95)
    assert 0.92 < ((low < 3.0) & (high > 3.0)).mean() < 0.975


def test_a_force_that_changes_is_not_uncertain_for_that():
    """Second differences see the noise, whatever the force does slowly: builds up, and rises with falling speed."""
    noise = np.random.default_rng(8).standard_normal((1500, 400))
    time = np.linspace(0.0, 1.0, 1500)[:, None]
    force = 100.0 * (1.0 - np.exp(-8.0 * time)) + 20.0 * time**2
    assert stop_mean(noise + force).deviation == pytest.approx(stop_mean(noise).deviation, rel=1e-2)


def test_relative_motion_cancels_in_the_mean_and_is_not_counted_as_scatter():
    """Of a stretch with another car's acceleration the error is a change of momentum: it falls with 1/T, not its root."""
    draw = np.random.default_rng(9)
    momentum = correlated(draw, 500, 4001, (0.97 * np.exp(0.15j), 0.97 * np.exp(-0.15j), 0.9, 0.9))
    force = 50.0 * (1.0 + np.linspace(0.0, 1.0, 4000)[:, None]) ** 3
    for samples in (1000, 4000):
        series = force[:samples] + np.diff(momentum, axis=0)[:samples]
        means = stop_mean(series, moving=True)
        error = means.mean - force[:samples].mean()
        assert means.deviation.mean() == pytest.approx(error.std(), rel=0.15)
        # few swings tell their own size: the interval is a little narrow where that varies within the window
        low, high = means.interval()
        assert (
            0.88 < ((low < force[:samples].mean()) & (force[:samples].mean() < high)).mean() < 0.98
        )
        # what is independent from sample to sample would say far more
        assert series.std() / np.sqrt(samples) > 1.5 * means.deviation.mean()
    assert stop_mean(series).motion.tolist() == [0.0] * 500


def test_what_is_constant_over_the_stop_widens_the_interval_and_is_known():
    x = np.random.default_rng(2).standard_normal(400)
    means = stop_mean(x)
    low, high = means.interval(0.95, constant=10.0 * float(means.deviation))
    assert float(high - low) / 2.0 == pytest.approx(
        np.sqrt(101.0) * 1.96 * float(means.deviation), rel=1e-3
    )


def test_too_short_series_are_refused():
    with pytest.raises(EstimationError, match="2 samples are not 3 batches of 1"):
        stop_mean(np.zeros(2))
    with pytest.raises(EstimationError, match="6 samples are not 7 batches"):
        stop_mean(np.zeros(6), moving=True)
    with pytest.raises(EstimationError, match="batch = 0"):
        stop_mean(np.zeros(9), batch=0)
    with pytest.raises(EstimationError, match="values holds nan"):
        stop_mean(np.array([0.0, np.nan]))


def test_steady_pressure_is_that_of_the_last_quarter():
    # 63.2 % of 300 kPa are 189.6 kPa, which the second quarter has; of the 200 kPa before it would be the first
    pressure = np.repeat([150e3, 200e3, 200e3, 300e3], 10)
    speed = np.where(np.arange(41) < 40, 10.0, 0.0)
    assert braking_window(np.append(pressure, 0.0), speed) == slice(10, 40)


def test_noise_by_hand():
    # of two samples each the first is left: means 2, 8, 3, second difference -11, of it 121 / 6, of the mean a third
    means = stop_mean([9.0, 1.0, 3.0, 5.0, 11.0, 4.0, 2.0], batch=2)
    assert [float(means.mean), float(means.deviation)] == pytest.approx(
        [5.0, np.sqrt(121.0 / 18.0)], rel=1e-12
    )
    assert means.freedom == 1.0
    # Student's t of one degree of freedom: 12.706 at 95 %
    half = 12.7062 * np.sqrt(121.0 / 18.0)
    assert np.array(means.interval()) == pytest.approx([5.0 - half, 5.0 + half], rel=1e-5)
