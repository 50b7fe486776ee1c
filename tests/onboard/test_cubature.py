"""The cubature filter is the linear one where the model is linear, and the seeking climbs what it senses."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.onboard.controllers.cubature import (
    CubatureSeeking,
    adapted,
    correct,
    curve_at,
    lower_root,
    predict,
    prediction,
    seek,
)

STEP = np.array([[1.0, 0.1, 0.0], [0.0, 0.9, 0.2], [0.0, 0.0, 1.0]])


def linear(points, i, inputs):
    points[i] = STEP @ points[i] + inputs


predict_linear = prediction(linear)


def covariances(seed):
    a = np.random.default_rng(seed).normal(size=(3, 3))
    return a @ a.T + 0.1 * np.eye(3)


@given(st.integers(0, 1000))
def test_the_root_is_lower_and_its_square_is_the_covariance(seed):
    covariance, root = covariances(seed), np.full((3, 3), np.nan)
    lower_root(covariance, root)
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-10, atol=1e-12)
    assert np.all(root[np.triu_indices(3, 1)] == 0.0)


def test_what_is_known_for_certain_has_a_root_too():
    root = np.empty((3, 3))
    lower_root(np.zeros((3, 3)), root)
    assert np.all(np.isfinite(root))


@settings(deadline=None)
@given(st.integers(0, 1000))
def test_on_a_linear_model_it_is_the_linear_kalman_filter(seed):
    generator = np.random.default_rng(seed)
    state, covariance = generator.normal(size=3), covariances(seed)
    mean, cov = state.copy(), covariance.copy()
    walk, drive = np.array([0.01, 0.02, 0.03]), np.array([0.1, -0.2, 0.0])
    root, points = np.empty((3, 3)), np.empty((6, 3))
    for _ in range(10):
        predict_linear(state, covariance, root, points, walk, drive)
        mean, cov = STEP @ mean + drive, STEP @ cov @ STEP.T + np.diag(walk)
        for a in (0, 1):
            measured, variance = generator.normal(), 0.05 * (a + 1)
            told = correct(state, covariance, root, a, measured, variance)
            assert told == pytest.approx(measured - mean[a], abs=1e-9)
            gain = cov[:, a] / (cov[a, a] + variance)
            mean, cov = mean + gain * (measured - mean[a]), cov - np.outer(gain, cov[a])
        np.testing.assert_allclose(state, mean, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(covariance, cov, rtol=1e-8, atol=1e-10)


@given(st.floats(-2.0, 2.0), st.floats(0.02, 1.0))
def test_the_slope_is_that_of_the_curve(slip, scale):
    value, slope = curve_at(slip, scale)
    d = 1e-6 * scale
    difference = (curve_at(slip + d, scale)[0] - curve_at(slip - d, scale)[0]) / (2.0 * d)
    assert slope == pytest.approx(difference, rel=1e-4, abs=1e-4 / scale)
    assert abs(value) <= curve_at(scale, scale)[0] == 1.0


def test_the_filter_finds_slip_and_coefficient_of_a_wheelset_it_hears_through_noise():
    response, period, scale, height, torque, speed = 60.0, 0.01, 0.2, 0.15, 0.12, 10.0
    slip = 0.1  # 0.12 = 0.15 * 2 x / (1 + x^2) at x = 0.5
    state, covariance = np.array([speed, speed, 0.1]), np.diag([1e-4, 1e-4, 1e-2])
    root, points, generator = np.empty((3, 3)), np.empty((6, 3)), np.random.default_rng(1)
    walk, found = (1e-4, 1e-5, 4e-4), []
    for _ in range(600):
        predict(state, covariance, root, points, walk, (torque, response, period, scale))
        correct(state, covariance, root, 0, speed + slip + 0.01 * generator.normal(), 1e-4)
        correct(state, covariance, root, 1, speed + 0.01 * generator.normal(), 1e-4)
        value = curve_at(state[0] - state[1], scale)[0]
        found.append((state[0] - state[1], state[2] * value))
    assert np.mean(found[300:], axis=0) == pytest.approx([slip, torque], rel=0.06)
    assert height == pytest.approx(
        np.mean(found[300:], axis=0)[1] / curve_at(slip, scale)[0], rel=0.1
    )
    assert np.std(np.array(found[300:])[:, 0]) < 0.7 * math.hypot(
        0.01, 0.01
    )  # less than what is heard


@given(st.floats(1e-6, 1e-2), st.floats(-1, 1), st.floats(0, 1e-2))
def test_a_variance_follows_its_innovations_and_has_a_floor(variance, told, expected):
    found = adapted(variance, told, expected, 0.1, 1e-6)
    assert found >= 1e-6
    if told * told > expected + variance:
        assert found > variance
    assert adapted(variance, 0.0, expected, 0.1, 1e-6) <= variance


def sought(coefficient, start, time=30.0, lag=0.0):
    k, p, course = CubatureSeeking.memory(1), CubatureSeeking(lag=lag), []
    k.centre[0] = slip = start
    for _ in range(round(time / 0.01)):
        slip = seek(k, 0, p, coefficient(slip), 0.01)
        course.append(k.centre[0])
    return np.array(course)


@pytest.mark.parametrize("start", [0.05, 0.23, 0.45])
def test_seeking_climbs_to_the_peak_of_a_concave_curve_and_stays(start):
    course = sought(lambda slip: 0.12 - 0.3 * (slip - 0.23) ** 2, start)
    assert np.abs(course[-500:] - 0.23).max() < 0.02


@pytest.mark.parametrize("slope", [-1.0, 1.0])
def test_seeking_stops_at_its_bounds(slope):
    course, p = sought(lambda slip: 0.1 + 0.1 * slope * slip, 0.2, time=60.0), CubatureSeeking()
    assert course.min() >= p.lowest
    assert course.max() <= p.highest
    assert course[-1] == (p.highest if slope > 0.0 else p.lowest)


def test_a_cycle_moves_the_centre_by_the_gain_times_the_slope():
    p = CubatureSeeking(lag=0.0, cycle=0.5, gain=0.02)
    k = CubatureSeeking.memory(1)
    k.centre[0] = slip = 0.2
    for _ in range(51):
        slip = seek(k, 0, p, 0.1 + 0.3 * (slip - 0.2), 0.01)
    assert k.centre[0] - 0.2 == pytest.approx(0.02 * 0.3, rel=0.05)


def bent(points, i, inputs):
    """A model that is not linear, one period on."""
    a, b, c = points[i].copy()
    points[i] = a + 0.1 * b + inputs[0], 0.9 * b + 0.2 * np.sin(c), c + 0.05 * a * b


def test_cubature_points_carry_a_bent_model_as_those_of_a_library():
    filterpy = pytest.importorskip("filterpy.kalman")

    def moved(x, dt):
        points = np.array(x, dtype=float).reshape(1, 3).copy()
        bent(points, 0, np.array([0.1]))
        return points[0]

    for seed in (1, 2, 3):
        rng = np.random.default_rng(seed)
        root = rng.normal(size=(3, 3))
        state, covariance = rng.normal(size=3), 0.05 * root @ root.T + 0.1 * np.eye(3)
        walk, work = np.array([0.01, 0.02, 0.03]), np.empty((3, 3))
        known = filterpy.CubatureKalmanFilter(3, 1, 1.0, hx=lambda x: x[:1], fx=moved)
        known.x, known.P, known.Q = state.copy(), covariance.copy(), np.diag(walk)
        known.predict()
        prediction(bent)(state, covariance, work, np.empty((6, 3)), walk, np.array([0.1]))
        np.testing.assert_allclose(state, np.ravel(known.x), atol=1e-12)
        np.testing.assert_allclose(covariance, known.P, atol=1e-12)
        # its correction draws no new points, which only a bent measurement needs: the linear one is the same
        linear = filterpy.KalmanFilter(3, 1)
        linear.x, linear.P, linear.H = (
            state[:, np.newaxis].copy(),
            covariance.copy(),
            np.eye(3)[[1]],
        )
        linear.update(0.7, R=0.05)
        correct(state, covariance, work, 1, 0.7, 0.05)
        np.testing.assert_allclose(state, linear.x[:, 0], atol=1e-12)
        np.testing.assert_allclose(covariance, linear.P, atol=1e-12)
