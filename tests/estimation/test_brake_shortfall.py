"""Which car fell short: found where it exceeds the uncertainty, and nobody accused more often than stated."""

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student

from alloc.errors import EstimationError
from alloc.estimation.brake_force import (
    CalibrationErrors,
    car_brake_forces,
    find_shortfalls,
    sliding_cars,
)

CARS, SAMPLES = 8, 500
MASS = np.full(CARS, 30e3)
ERRORS = CalibrationErrors(0.005, 300.0, 0.005, 0.01)


def stop(seed, short=0.0, car=3):
    """A stop at 0.8 m/s2 with calibration errors and noise; returns what `find_shortfalls` says."""
    draw = np.random.default_rng(seed)
    allocated = np.full((SAMPLES, CARS), 24e3)
    force = allocated.copy()
    force[:, car] -= short
    a = -force.sum(axis=1) / MASS.sum()
    couplers = np.cumsum(-MASS * a[:, None] - force, axis=1)[:, :-1]
    measured = couplers * (1.0 + ERRORS.coupler_gain * draw.standard_normal(CARS - 1))
    measured += ERRORS.coupler_offset * draw.standard_normal(CARS - 1)
    measured += 1e3 * draw.standard_normal(couplers.shape)
    seen = a[:, None] + ERRORS.acceleration_offset * draw.standard_normal(CARS)
    seen = seen + 0.02 * draw.standard_normal((SAMPLES, CARS))
    mass = MASS * (1.0 + ERRORS.mass * draw.standard_normal(CARS))
    found = car_brake_forces(seen, measured, mass)
    constant = ERRORS.deviation(mass, seen.mean(axis=0), measured.mean(axis=0))
    return find_shortfalls(allocated, found, constant)


def test_a_car_without_brake_is_the_only_one_accused():
    found = stop(0, short=24e3)
    assert found.accused.tolist() == [3]
    assert found.shortfall[3] == pytest.approx(24e3, rel=0.1)


def test_deviation_is_that_of_repeated_stops():
    found = [stop(seed) for seed in range(200)]
    spread = np.std([one.shortfall for one in found])
    assert np.mean([one.deviation for one in found]) == pytest.approx(spread, rel=0.1)


def test_a_sound_train_is_rarely_accused():
    accused = sum(stop(seed).accused.size > 0 for seed in range(300))
    assert accused <= 7  # stated: 1 % of trains


def test_the_surest_is_named_first():
    draw = np.random.default_rng(0)
    allocated = np.full((SAMPLES, 3), 1e4) + draw.normal(0.0, 100.0, (SAMPLES, 3))
    found = find_shortfalls(allocated, allocated - [2e3, 0.0, 5e3], 100.0)
    assert found.accused.tolist() == [2, 0]


def test_the_threshold_is_normal_where_all_is_known_and_students_where_nothing_is():
    draw = np.random.default_rng(0)
    allocated, noise = np.full((SAMPLES, 2), 1e4), draw.normal(0.0, 100.0, (SAMPLES, 2))
    known, unknown = (find_shortfalls(allocated, allocated + noise, c) for c in (1e4, 0.0))
    ratio = [(one.threshold / one.deviation)[0] for one in (known, unknown)]
    np.testing.assert_allclose(
        ratio, [norm.ppf(1.0 - 0.005), student.ppf(1.0 - 0.005, 498 * 18 / 35)], rtol=1e-4
    )
    nothing = find_shortfalls(allocated, allocated)
    assert nothing.threshold.tolist() == [0.0, 0.0]
    assert nothing.accused.size == 0


def test_each_constant_error_adds_its_share():
    couplers = np.array([-10e3, 20e3])
    mass, a = np.array([30e3, 40e3, 50e3]), np.full(3, -0.8)

    def alone(**errors):
        return CalibrationErrors(**errors).deviation(mass, a, couplers)

    np.testing.assert_allclose(alone(acceleration_offset=0.01), 0.01 * mass)
    np.testing.assert_allclose(alone(mass=0.02), 0.02 * 0.8 * mass)
    np.testing.assert_allclose(alone(coupler_offset=500.0), [500.0, 500.0 * np.sqrt(2.0), 500.0])
    np.testing.assert_allclose(alone(coupler_gain=0.01), [100.0, np.hypot(100.0, 200.0), 200.0])
    np.testing.assert_allclose(alone(), 0.0)


def test_bad_input_is_refused():
    with pytest.raises(EstimationError, match="confidence = 1"):
        find_shortfalls(np.zeros((20, 2)), np.zeros((20, 2)), confidence=1.0)
    with pytest.raises(EstimationError, match="estimated has shape"):
        find_shortfalls(np.zeros((20, 2)), np.zeros((20, 3)))
    with pytest.raises(EstimationError, match="allocated holds nan"):
        find_shortfalls(np.full((20, 2), np.nan), np.zeros((20, 2)))


def test_degrees_of_freedom_grow_with_what_is_known():
    draw = np.random.default_rng(0)
    allocated, noise = np.full((SAMPLES, 1), 1e4), draw.normal(0.0, 100.0, (SAMPLES, 1))
    alone = find_shortfalls(allocated, allocated + noise)
    # as much again that is known: the variance is twice, and Welch's degrees of freedom 2^2 times as many
    both = find_shortfalls(allocated, allocated + noise, alone.deviation)
    assert both.deviation[0] == pytest.approx(np.sqrt(2.0) * alone.deviation[0])
    assert both.threshold[0] / both.deviation[0] == pytest.approx(
        student.ppf(0.99, 4 * 498 * 18 / 35)
    )


def test_the_surest_is_not_the_largest():
    allocated = np.full((SAMPLES, 2), 1e4)
    found = find_shortfalls(allocated, allocated - [5e3, 2e3], [1e3, 10.0])
    assert found.accused.tolist() == [1, 0]


def test_a_car_is_judged_by_the_rest_of_the_stop():
    draw = np.random.default_rng(0)
    allocated = np.full((SAMPLES, 3), 1e4)
    found = allocated + draw.normal(0.0, 100.0, allocated.shape)
    sliding = np.zeros(allocated.shape, dtype=bool)
    sliding[100:400, 1] = True
    found[sliding] = 2e3  # the rail carries no more
    found[:, 2] -= 500.0
    assert find_shortfalls(allocated, found, 50.0).accused.tolist() == [1, 2]
    judged = find_shortfalls(allocated, found, 50.0, sliding=sliding)
    assert judged.accused.tolist() == [2]
    assert abs(judged.shortfall[1]) < 30.0
    short = sliding.copy()
    short[:, 1] = True
    never = find_shortfalls(allocated, found, 50.0, sliding=short)
    assert never.accused.tolist() == [2]
    assert np.isnan(never.shortfall[1])
    with pytest.raises(EstimationError, match="sliding has shape"):
        find_shortfalls(allocated, found, sliding=sliding[:, :2])


def test_a_car_slides_from_where_a_wheel_falls_behind_until_its_cylinders_are_full_again():
    speed = np.full((200, 4), 10.0)
    speed[50:60, 2] = 9.0
    speed[100:110, 0] = 9.7  # within the criterion's 5 %
    slides = sliding_cars(speed, [0, 0, 1, 1], 0.1, refilled=2.0)
    assert not slides[:, 0].any()
    assert np.flatnonzero(slides[:, 1]).tolist() == list(range(50, 80))
    assert not sliding_cars(speed[:, :1], [0], 0.1).any()


def test_deviation_at_each_instant_is_that_of_its_values():
    draw = np.random.default_rng(3)
    a, couplers = draw.normal(size=(5, CARS)), 1e4 * draw.normal(size=(5, CARS - 1))
    each = [ERRORS.deviation(MASS, *one) for one in zip(a, couplers, strict=True)]
    np.testing.assert_allclose(ERRORS.deviation(MASS, a, couplers), each)
