"""Searches for the best slip: creep control, its searches, swarms, and extremum seeking on a cubature filter."""

import math

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.errors import OnboardError
from alloc.onboard.controllers.creep import hold_slip
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
from alloc.onboard.controllers.particle_swarm import (
    PARTICLES,
    POINTS,
    SwarmSlip,
    SwarmTracking,
    curve,
    fit_models,
    misfit,
    try_particles,
)
from alloc.onboard.controllers.search import (
    PerturbObserve,
    SteepestGradient,
    gradient_step,
    perturbed_step,
)
from alloc.onboard.controllers.swarm import MODULUS, drawn, seeded, swarm_speed
from tests.cases import looped

P, I, TICK = 0.4, 8.0, 0.01  # noqa: E741 (the controller's own letters)


COEFFICIENT = st.floats(0, 0.4)


SLIP = st.floats(-2, 20)


@given(COEFFICIENT, SLIP, st.floats(0.01, 1), COEFFICIENT)
def test_what_creep_control_allows_lies_between_nothing_and_the_target(
    allowed, slip, reference, ceiling
):
    integral, coefficient = hold_slip(allowed, slip, reference, ceiling, P, I, TICK)
    assert 0.0 <= integral <= ceiling
    assert 0.0 <= coefficient <= ceiling


@given(st.floats(0.01, 1), COEFFICIENT)
def test_at_the_reference_nothing_changes(reference, ceiling):
    allowed = 0.7 * ceiling
    found = hold_slip(allowed, reference, reference, ceiling, P, I, TICK)
    assert found == (allowed, allowed)


@given(st.integers(1, 2000), st.floats(0.05, 0.3), st.floats(0.01, 2))
def test_adhesion_however_long_does_not_wind_up(ticks, ceiling, excess):
    allowed = 0.0
    for _ in range(ticks):
        allowed, _ = hold_slip(allowed, 0.0, 0.1, ceiling, P, I, TICK)
    _, coefficient = hold_slip(allowed, 0.1 + excess, 0.1, ceiling, P, I, TICK)
    assert coefficient < ceiling  # the first slip beyond the reference takes torque away


@given(SLIP, SLIP, st.floats(0.01, 1))
def test_more_slip_never_gives_more_torque(one, other, reference):
    low, high = sorted((one, other))
    after = [hold_slip(0.1, slip, reference, 0.2, P, I, TICK)[1] for slip in (low, high)]
    assert after[1] <= after[0]


@given(st.sampled_from([-0.01, 0.01]), st.floats(-0.1, 0.1))
def test_a_perturbation_turns_where_the_coefficient_fell(last, change):
    step = perturbed_step(last, change, 0.01)
    assert abs(step) == 0.01
    assert (math.copysign(1, step) == math.copysign(1, last)) == (change >= 0.0)


@given(
    st.floats(-0.03, 0.03),
    st.floats(-0.1, 0.1),
    st.floats(-0.1, 0.1),
    st.floats(1e-3, 10),
)
def test_a_gradient_step_is_bounded_and_points_up_the_slope(last, rise, way, gain):
    least, largest = 0.003, 0.03
    step = gradient_step(last, rise, way, gain, least, largest)
    assert least <= abs(step) <= largest
    if abs(way) >= 0.3 * least and rise != 0.0 and gain * rise / way != 0.0:
        assert math.copysign(1, step) == math.copysign(1, rise) * math.copysign(1, way)


def test_a_quotient_of_next_to_nothing_is_not_believed():
    assert gradient_step(-0.02, 0.1, 1e-6, 1.0, 0.003, 0.03) == -0.003


def concave(slip, top=0.23):
    return 0.12 - 0.3 * (slip - top) ** 2


@looped("start", [0.03, 0.23, 0.45])
def test_perturbation_climbs_and_stays_within_a_step_of_the_nearest_one_to_the_peak(start):
    slip, step, size = start, 0.01, 0.01
    before, course = concave(slip), []
    for _ in range(100):
        slip += step
        step = perturbed_step(step, concave(slip) - before, size)
        before = concave(slip)
        course.append(slip)
    # half a step to the place nearest to the peak, one step past it to see that the coefficient falls
    assert max(abs(s - 0.23) for s in course[50:]) <= 1.5 * size + 1e-9


@looped("start", [0.03, 0.23, 0.45])
def test_the_gradient_climbs_and_stays_within_a_least_step_of_the_peak(start):
    slip, step, least = start, 0.003, 0.003
    before, course = (concave(slip), slip), []
    for _ in range(100):
        slip += step
        step = gradient_step(step, concave(slip) - before[0], slip - before[1], 0.15, least, 0.03)
        before = concave(slip), slip
        course.append(slip)
    assert max(abs(s - 0.23) for s in course[50:]) <= 1.5 * least + 1e-9


def test_bounds_in_the_wrong_order_are_refused():
    with pytest.raises(OnboardError, match=r"lowest = 0\.6 must be below highest"):
        PerturbObserve(lowest=0.6)
    with pytest.raises(OnboardError, match=r"least = 0\.1 must not exceed largest"):
        SteepestGradient(least=0.1)


BOUNDS = PerturbObserve()


def draws(seed, j=0, count=2000):
    generator = np.zeros(j + 1, dtype=np.int64)
    generator[j] = seeded(seed, j)
    return [drawn(generator, j) for _ in range(count)]


def test_the_generator_is_the_minimal_standard():
    # Park and Miller (1988) check theirs by the state after 10 000 draws from 1; of the multiplier 48271 it is 399268537
    state = np.ones(1, dtype=np.int64)
    for _ in range(10_000):
        drawn(state, 0)
    assert state[0] == 399268537


@given(st.integers(0, 1_000_000), st.integers(0, 300))
def test_a_seed_gives_every_unit_a_state_that_can_go_on(seed, j):
    assert 1 <= seeded(seed, j) < MODULUS


def test_draws_repeat_and_differ_between_seeds_and_units():
    assert draws(1) == draws(1)
    for other in (draws(2), draws(1, j=1)):
        assert abs(np.corrcoef(draws(1), other)[0, 1]) < 0.1
    assert np.mean(draws(1)) == pytest.approx(0.5, abs=0.03)
    assert np.var(draws(1)) == pytest.approx(1 / 12, rel=0.1)


@given(st.floats(-1, 1), st.floats(0, 1), st.floats(0, 1))
def test_a_particle_at_both_bests_only_loses_speed(speed, own, common):
    assert abs(swarm_speed(0.2, speed, 0.2, 0.2, own, common)) <= 0.6 * abs(speed) + 1e-15


def test_both_bests_pull_by_their_own_draws():
    assert swarm_speed(0.2, 0.0, 0.4, 0.2, 0.5, 0.0) == pytest.approx(0.12)
    assert swarm_speed(0.2, 0.0, 0.2, 0.1, 0.0, 0.5) == pytest.approx(-0.06)


def tracked(coefficient, start, rounds=60, j=0):
    """Course of the slip that a swarm asks for, on a rail of this curve."""
    k, p = SwarmTracking.memory(j + 1), SwarmTracking()
    held, last, course = start, math.nan, []
    for n in range(rounds * PARTICLES):
        found = coefficient(held, n)
        held, last = try_particles(k, j, p, BOUNDS, held, found, last), found
        course.append(held)
    return np.array(course)


@looped("start", [0.05, 0.1, 0.2, 0.4])
def test_a_swarm_stays_within_bounds_and_rests_higher_than_it_began(start):
    def curve_of(slip, _):
        return 0.12 - 0.3 * (slip - 0.23) ** 2

    course = tracked(curve_of, start)
    assert course.min() >= BOUNDS.lowest
    assert course.max() <= BOUNDS.highest
    assert np.ptp(course[-30:]) == 0.0
    assert abs(course[-1] - 0.23) < max(0.55 * abs(start - 0.23), 0.02)


def test_a_resting_swarm_starts_again_where_the_coefficient_changes():
    course = tracked(lambda slip, n: (0.12 if n < 120 else 0.08) - 0.3 * (slip - 0.23) ** 2, 0.2)
    assert np.ptp(course[100:120]) == 0.0
    assert np.ptp(course[121:127]) > 0.5 * SwarmTracking().spread


def test_equal_runs_of_a_swarm_are_equal_and_units_differ():
    def bumpy(slip, n):
        return 0.12 - 0.3 * (slip - 0.23) ** 2 + 0.002 * math.sin(7.0 * n)

    assert tracked(bumpy, 0.1).tolist() == tracked(bumpy, 0.1).tolist()
    assert tracked(bumpy, 0.1).tolist() != tracked(bumpy, 0.1, j=1).tolist()


@given(st.floats(0.01, 0.5), st.floats(0.02, 0.5), st.floats(0.0, 3.0))
def test_a_curve_has_its_peak_at_its_optimum(peak, optimum, slip):
    assert curve(slip, peak, optimum) <= curve(optimum, peak, optimum) + 1e-15
    assert curve(optimum, peak, optimum) == pytest.approx(peak)
    assert curve(-slip, peak, optimum) == -curve(slip, peak, optimum)


@looped(("peak", "optimum"), [(0.12, 0.08), (0.16, 0.2), (0.10, 0.35)])
def test_the_swarm_of_curves_finds_the_one_that_was_measured(peak, optimum):
    k, p = SwarmSlip.memory(1), SwarmSlip()
    for n in range(60):
        slip = 0.5 * optimum * (1.0 + n % 4)
        found = fit_models(k, 0, p, BOUNDS, curve(slip, peak, optimum), slip)
    assert found == pytest.approx(optimum, rel=0.12)
    assert misfit(k, 0, peak, optimum) == 0.0  # the ring holds what was measured, and nothing else
    assert k.optimum.min() >= BOUNDS.lowest
    assert k.optimum.max() <= BOUNDS.highest


def test_the_ring_holds_the_last_points():
    k, p = SwarmSlip.memory(1), SwarmSlip()
    for n in range(POINTS + 3):
        fit_models(k, 0, p, BOUNDS, 0.1, 0.01 * (n + 1))
    assert sorted(k.point_slip[0]) == pytest.approx([0.01 * (n + 4) for n in range(POINTS)])


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


@hypothesis.settings(deadline=None)
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


@looped("start", [0.05, 0.23, 0.45])
def test_seeking_climbs_to_the_peak_of_a_concave_curve_and_stays(start):
    course = sought(lambda slip: 0.12 - 0.3 * (slip - 0.23) ** 2, start)
    assert np.abs(course[-500:] - 0.23).max() < 0.02


@looped("slope", [-1.0, 1.0])
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
