"""Own Kalman filters and smoothers against a library's, where the library has the same model."""

import numpy as np
import pytest

from alloc.onboard.controllers.cubature import correct, prediction
from studies.logs.logged_computers import FilterTrace
from studies.logs.random_slope import STARTS, smoothed
from studies.logs.speed_smoother import smooth

filterpy = pytest.importorskip("filterpy.kalman")


def shape_and_drift(seed, count=60):
    """Uneven instants, a shape, and readings of it with a drift, some of them missing."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.05, 0.4, count))
    shape = 20.0 + 3.0 * np.sin(time)
    value = 1.01 * shape + 0.02 * time + rng.normal(0.0, 0.02, count)
    value[rng.random(count) < 0.3] = np.nan
    value[0] = 1.01 * shape[0]
    return time, shape, value


@pytest.mark.parametrize("start", list(STARTS.values()), ids=list(STARTS))
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_shape_with_a_drift_is_smoothed_as_by_a_library(start, seed):
    time, shape, value = shape_and_drift(seed)
    noise, drift = 0.02, 0.01
    step = np.append(np.diff(time), 0.0)
    moves = np.tile(np.eye(3), (time.size, 1, 1))
    moves[:, 0, 1] = step
    walks = np.zeros((time.size, 3, 3))
    walks[:, 0, 0], walks[:, 1, 1] = drift**2 * step**3 / 3.0, drift**2 * step
    walks[:, 0, 1] = walks[:, 1, 0] = drift**2 * step**2 / 2.0
    known = filterpy.KalmanFilter(3, 1)
    known.x, known.P = np.array([[0.0], [0.0], [1.0]]), np.diag(start)
    known.R = np.array([[noise**2]])
    states, covariances = np.empty((time.size, 3, 1)), np.empty((time.size, 3, 3))
    for k in range(time.size):
        if not np.isnan(value[k]):
            known.update(value[k], H=np.array([[1.0, 0.0, shape[k]]]))
        states[k], covariances[k] = known.x, known.P
        known.predict(F=moves[k], Q=walks[k])
    found, spread, *_ = filterpy.rts_smoother(states, covariances, moves, walks)
    of_speed = np.column_stack([np.ones(time.size), np.zeros(time.size), shape])
    speed, variance = smoothed(time, shape, value, noise, drift, start)
    np.testing.assert_allclose(speed, np.einsum("ta,ta->t", of_speed, found[:, :, 0]), atol=1e-8)
    expected = np.einsum("ta,tab,tb->t", of_speed, spread, of_speed)
    np.testing.assert_allclose(variance, expected, rtol=1e-5)


def test_the_reference_speed_is_smoothed_as_by_a_library():
    rng, count, noise = np.random.default_rng(6), 80, 0.5
    step, acting = rng.uniform(0.5, 1.5, count), rng.normal(0.0, 1.0, count)
    moves = np.tile(np.eye(4), (count, 1, 1))
    moves[:, 0, 1], moves[:, 0, 3] = step, step * acting
    walk = np.diag([0.1, 0.3, 1e-3, 1e-3])
    known = filterpy.KalmanFilter(4, 1)
    known.P, known.Q, known.R = np.diag([4.0, 1.0, 0.5, 0.2]), walk, np.array([[noise**2]])
    known.H = np.array([[1.0, 0.0, 0.0, 0.0]])
    trace = FilterTrace(
        np.zeros((count, 4)), np.zeros((count, 4, 4)), np.zeros((count, 4)), np.zeros((count, 4, 4)),
        acting, np.zeros(count), np.zeros(count, dtype=bool),
    )  # fmt: skip
    for k in range(count):
        if k > 0:
            known.predict(F=moves[k])
        trace.predicted[k], trace.predicted_covariance[k] = known.x[:, 0], known.P
        known.update(rng.normal(0.0, 2.0))
        trace.state[k], trace.covariance[k] = known.x[:, 0], known.P
    later = np.concatenate([moves[1:], moves[:1]])  # the library's matrix leads to the next instant
    found, spread, *_ = filterpy.rts_smoother(
        trace.state, trace.covariance, later, np.tile(walk, (count, 1, 1))
    )
    state, covariance = smooth(step, trace)
    np.testing.assert_allclose(state, found, atol=1e-9)
    np.testing.assert_allclose(covariance, spread, atol=1e-9)


def bent(points, i, inputs):
    """A model that is not linear, one period on."""
    a, b, c = points[i].copy()
    points[i] = a + 0.1 * b + inputs[0], 0.9 * b + 0.2 * np.sin(c), c + 0.05 * a * b


def moved(x, dt):
    points = np.array(x, dtype=float).reshape(1, 3).copy()
    bent(points, 0, np.array([0.1]))
    return points[0]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_cubature_points_carry_a_bent_model_as_those_of_a_library(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3))
    state, covariance = rng.normal(size=3), 0.05 * root @ root.T + 0.1 * np.eye(3)
    walk = np.array([0.01, 0.02, 0.03])
    known = filterpy.CubatureKalmanFilter(3, 1, 1.0, hx=lambda x: x[:1], fx=moved)
    known.x, known.P, known.Q = state.copy(), covariance.copy(), np.diag(walk)
    known.predict()
    prediction(bent)(state, covariance, np.empty((3, 3)), np.empty((6, 3)), walk, np.array([0.1]))
    np.testing.assert_allclose(state, np.ravel(known.x), atol=1e-12)
    np.testing.assert_allclose(covariance, known.P, atol=1e-12)
    # its correction draws no new points, which only a bent measurement needs: the linear one is the same
    linear = filterpy.KalmanFilter(3, 1)
    linear.x, linear.P, linear.H = state[:, np.newaxis].copy(), covariance.copy(), np.eye(3)[[1]]
    linear.update(0.7, R=0.05)
    correct(state, covariance, np.empty((3, 3)), 1, 0.7, 0.05)
    np.testing.assert_allclose(state, linear.x[:, 0], atol=1e-12)
    np.testing.assert_allclose(covariance, linear.P, atol=1e-12)
