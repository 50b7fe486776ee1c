"""The smoother of brake forces: exact where it must be, better than no smoother, and honest about its error."""

import numpy as np
import pytest

from alloc.errors import EstimationError
from alloc.estimation.brake_force import car_brake_forces, smooth_brake_forces

MASS = np.array([96e3, 59e3, 62e3, 55e3, 59e3])
PERIOD, A_NOISE, R_NOISE, WALK = 0.02, 0.02, 1e3, 0.1


def wandering(seed, samples=400, walk=WALK):
    """Forces whose rates wander as the smoother believes, and noisy measurements of a train that oscillates anyhow."""
    draw = np.random.default_rng(seed)
    bends = walk * PERIOD**1.5 * draw.standard_normal((samples, MASS.size))
    force = MASS * (0.6 + np.cumsum(np.cumsum(bends, axis=0), axis=0))
    couplers = 5e4 * np.sin(np.arange(samples)[:, None] * 0.1 + np.arange(MASS.size - 1))
    between = np.pad(couplers, ((0, 0), (1, 1)))
    a = (-force + between[:, :-1] - between[:, 1:]) / MASS
    return (
        force,
        a + A_NOISE * draw.standard_normal(a.shape),
        couplers + R_NOISE * draw.standard_normal(couplers.shape),
    )


def smoothed(a, couplers, walk=WALK):
    return smooth_brake_forces(a, couplers, MASS, PERIOD, A_NOISE, R_NOISE, walk)


def dense_smoother(a, couplers):
    """All forces at once by weighted least squares, (time, cars) and covariance: what the recursion must give."""
    y = car_brake_forces(a, couplers, MASS)
    n, samples = MASS.size, y.shape[0]
    d = np.eye(n, n - 1, -1) - np.eye(n, n - 1)
    noise = np.diag((A_NOISE * MASS) ** 2) + R_NOISE**2 * d @ d.T
    step = np.diag(MASS**2) * WALK**2 * PERIOD**3
    change = np.diff(np.eye(samples), 2, axis=0)
    information = np.kron(np.eye(samples), np.linalg.inv(noise)) + np.kron(
        change.T @ change, np.linalg.inv(step)
    )
    covariance = np.linalg.inv(information)
    mean = covariance @ np.kron(np.eye(samples), np.linalg.inv(noise)) @ y.ravel()
    return mean.reshape(y.shape), covariance


def test_the_recursion_is_the_least_squares_solution():
    _, a, couplers = wandering(0, 30)
    found = smoothed(a, couplers)
    mean, covariance = dense_smoother(a, couplers)
    np.testing.assert_allclose(found.force, mean, rtol=1e-7)
    np.testing.assert_allclose(found.deviation.ravel(), np.sqrt(np.diag(covariance)), rtol=1e-8)
    wagons = np.kron(np.eye(30), np.array([0.0, 1.0, 1.0, 1.0, 1.0]))
    force, deviation = found.total(slice(1, None))
    np.testing.assert_allclose(force, found.force[:, 1:].sum(axis=1))
    np.testing.assert_allclose(
        deviation, np.sqrt(np.diag(wagons @ covariance @ wagons.T)), rtol=1e-8
    )


def test_deviation_is_that_of_the_errors():
    normalised = []
    for seed in range(20):
        force, a, couplers = wandering(seed)
        found = smoothed(a, couplers)
        normalised.append((found.force - force) / found.deviation)
    assert np.mean(np.square(normalised)) == pytest.approx(1.0, abs=0.1)
    assert np.mean(np.abs(normalised) < 1.96) == pytest.approx(0.95, abs=0.02)


def test_smoothing_reduces_the_error_of_every_car():
    force, a, couplers = wandering(3)
    raw = car_brake_forces(a, couplers, MASS) - force
    error = smoothed(a, couplers).force - force
    assert np.all(error.std(axis=0) < 0.55 * raw.std(axis=0))


@pytest.mark.parametrize("build_up", [1.0, 3.0])
def test_a_smooth_force_lies_within_the_intervals_as_often_as_they_say(build_up):
    """A cylinder fills, friction rises: no walk at all. A force that is one made the stated variance twice the errors'."""
    time = PERIOD * np.arange(600)[:, None]
    force = MASS * (0.4 + 0.02 * time) * -np.expm1(-np.maximum(time - 2.0, 0.0) / build_up)
    normalised, covered = [], []
    for seed in range(12):
        _, a, couplers = wandering(seed, 600, walk=0.0)
        found = smoothed(a - (force - 0.6 * MASS) / MASS, couplers, walk=None)
        error = (found.force - force)[150:]
        normalised.append(np.mean(np.square(error / found.deviation[150:])))
        covered.append(np.mean(np.abs(error) < 1.96 * found.deviation[150:]))
    assert 0.65 < np.mean(normalised) < 1.15
    assert 0.93 < np.mean(covered) < 0.985


def test_a_steady_force_is_met_by_the_line():
    """Without a walk all samples lie on a line: in its middle the deviation tends to 1/sqrt(n), as that of a mean."""
    _, a, couplers = wandering(4, 301, walk=0.0)
    found = smoothed(a, couplers, walk=3e-4)
    mean = car_brake_forces(a, couplers, MASS).mean(axis=0)
    np.testing.assert_allclose(found.force[150], mean, rtol=1e-3)
    own = np.sqrt((A_NOISE * MASS[2]) ** 2 + 2.0 * R_NOISE**2) / np.sqrt(301)
    assert found.deviation[150, 2] == pytest.approx(own, rel=1e-2)


@pytest.mark.parametrize("true", [0.03, 0.1, 0.6])
def test_the_walk_is_found(true):
    _, a, couplers = wandering(6, 1500, walk=true)
    found = smoothed(a, couplers, walk=None)
    assert found.walk == pytest.approx(true, rel=0.15)
    assert found.log_likelihood >= smoothed(a, couplers, walk=true).log_likelihood - 0.1


def test_the_walk_is_sought_up_to_a_full_brake_within_a_sample():
    jumping = 5e3 * np.where(np.arange(60)[:, None] % 2, 1.0, -1.0)
    found = smooth_brake_forces(jumping, np.zeros((60, 0)), [10e3], PERIOD, A_NOISE, R_NOISE)
    assert found.walk == pytest.approx(1e3, rel=0.03)


def test_impossible_options_are_refused():
    _, a, couplers = wandering(0, 5)
    with pytest.raises(EstimationError, match=r"acceleration has shape \(5,\)"):
        smoothed(a[:, 0], couplers)
    with pytest.raises(EstimationError, match="walk = 0"):
        smoothed(a, couplers, walk=0.0)
    with pytest.raises(EstimationError, match="walk = 1e-09 is too slow"):
        smoothed(a, couplers, walk=1e-9)
    with pytest.raises(EstimationError, match="2 samples have no second difference"):
        smoothed(a[:2], couplers[:2])
    with pytest.raises(EstimationError, match="period = nan"):
        smooth_brake_forces(a, couplers, MASS, float("nan"), A_NOISE, R_NOISE)
    a[2, 1] = np.nan
    with pytest.raises(EstimationError, match=r"acceleration holds nan at \(2, 1\)"):
        smoothed(a, couplers)


def test_likelihood_of_three_measurements_by_hand():
    """One car: the second difference, 0.5, has the walk's variance 100^2 x 0.02^3 and six times the noise's 0.02^2."""
    found = smooth_brake_forces(
        np.array([[-1.0], [-1.2], [-0.9]]),
        np.zeros((3, 0)),
        [10e3],
        PERIOD,
        A_NOISE,
        R_NOISE,
        100.0,
    )
    variance = 0.08 + 6.0 * 4e-4
    expected = -0.5 * (np.log(2 * np.pi * variance) + 0.5**2 / variance)
    assert found.log_likelihood == pytest.approx(expected, rel=1e-9)
