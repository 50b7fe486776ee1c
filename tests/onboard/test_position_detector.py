"""The detector of position and speed: laws of its odometer, its stations and its delay."""

import math

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.onboard.line_memory import Detection, LineMemory, Odometer, PositionDetector
from alloc.plant.laws import gradient_force

PERIOD = 0.05


def ride(detector, start=0.0, seconds=60.0, creep=(0.0, 0.0)):
    """True and detected positions and speeds of a train that speeds up from 10 m/s; its wheels creep by these shares."""
    time = np.arange(0.0, seconds, PERIOD)
    speed = 10.0 + 0.2 * time
    position = start + 10.0 * time + 0.1 * time**2
    detection = Detection(detector, PERIOD)
    found = [
        detection.read(t, x, v, v * (1.0 + np.array(creep)))
        for t, x, v in zip(time.tolist(), position.tolist(), speed.tolist(), strict=True)
    ]
    return position, speed, *np.array(found).T


def test_without_errors_position_and_speed_are_the_trains():
    position, speed, found, read = ride(PositionDetector())
    assert found.tolist() == position.tolist()
    assert read.tolist() == speed.tolist()


@pytest.mark.parametrize("seed", range(5))
def test_the_error_grows_with_the_way_since_the_last_station_alone(seed):
    g = np.random.default_rng(seed)
    scale = float(g.uniform(-0.05, 0.05))
    stations = tuple(np.sort(g.uniform(-300.0, 900.0, 5)).tolist())
    residuals = tuple(g.normal(0.0, 3.0, 5).tolist())
    position, speed, found, read = ride(PositionDetector(Odometer(scale, stations, residuals)))
    last = np.searchsorted(stations, position, side="right") - 1
    come = np.where(last >= 0, position - np.array(stations)[last], position)
    expected = np.where(last >= 0, np.array(residuals)[last], 0.0) + scale * come
    np.testing.assert_allclose(found - position, expected, atol=1e-6)
    np.testing.assert_allclose(read, (1.0 + scale) * speed)


def test_between_stations_creep_of_the_counted_axles_is_counted_as_way():
    mean = PositionDetector(Odometer(stations=(0.0,)))
    second = PositionDetector(Odometer(stations=(0.0,), axles=(1,)))
    for detector, share in ((mean, 0.005), (second, 0.01)):
        position, _, found, _ = ride(detector, creep=(0.0, 0.01))
        np.testing.assert_allclose(found, (1.0 + share) * position, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("periods", [0.3, 1.0, 4.0, 9.7])
def test_a_delay_shows_what_was_and_at_first_what_was_first(periods):
    delay = periods * PERIOD
    position, speed, found, read = ride(PositionDetector(delay=delay))
    first = math.ceil(periods)
    np.testing.assert_allclose(read[first:], speed[first:] - 0.2 * delay, rtol=1e-12)
    np.testing.assert_allclose(
        found[first:], np.interp(PERIOD * np.arange(first, 1200) - delay, PERIOD * np.arange(1200), position)
    )  # fmt: skip
    assert set(found[:first]) == {position[0]}


def test_car_by_car_the_memory_has_the_sum_over_the_cars():
    lengths, masses = np.array([12.0, 30.0, 18.0]), np.array([90e3, 20e3, 50e3])
    middles = 0.5 * lengths - np.cumsum(lengths)
    memory = LineMemory(
        (0.0, 100.0, 130.0), (0.5, 3.0, -3.0), ((90.0, 120.0),), tuple(middles.tolist()),
        tuple((lengths / 60.0).tolist()), tuple((masses / 160e3).tolist()),
    )  # fmt: skip
    for x in np.linspace(60.0, 240.0, 91):
        cars = x + middles
        rise = np.where(cars < 100.0, 0.005, np.where(cars < 130.0, 0.03, -0.03))
        tunnel, slope = memory.read(x)
        assert 160e3 * slope == pytest.approx(gradient_force(masses, rise).sum())
        assert 60.0 * tunnel == pytest.approx(lengths[(cars >= 90.0) & (cars < 120.0)].sum())


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Odometer(scale_error=math.nan), "scale_error"),
        (lambda: Odometer(scale_error=-0.6), "scale_error"),
        (lambda: Odometer(stations=(0.0, 0.0)), "grow"),
        (lambda: Odometer(stations=(math.inf,)), "stations"),
        (lambda: Odometer(stations=(0.0, 9.0), residuals=(1.0,)), "1 residuals"),
        (lambda: Odometer(axles=(-1,)), "axles"),
        (lambda: PositionDetector(delay=-0.1), "delay"),
        (lambda: PositionDetector(delay=math.inf), "delay"),
        (lambda: PositionDetector(speed_noise=math.nan), "speed_noise"),
        (lambda: ride(PositionDetector(Odometer(axles=(2,)))), "number of axles"),
        (lambda: LineMemory(offsets=(0.0, -9.0), mass_shares=(1.0,)), "mass_shares"),
        (lambda: LineMemory(offsets=(0.0, -9.0), air_shares=(0.7, 0.7)), "air_shares"),
    ],
)
def test_what_cannot_be_is_refused(make, named):
    with pytest.raises(OnboardError, match=named):
        make()
