"""Learners of running resistance: what a step does to the error, what it leaves alone, and what it amounts to."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.errors import EstimationError
from alloc.estimation.running_resistance import (
    GradientLearner,
    LeastSquaresLearner,
    NormalisedGradientLearner,
    gradient_step,
)
from alloc.onboard.line_memory import Motion, regressor

TRUE = np.array([12.0, 20.0, 250e3])
WRONG = TRUE * np.array([1.3, 0.7, 0.7])
TYPICAL = np.array([400.0, 400.0, 0.5])
LEARNERS = (
    lambda w: GradientLearner(w, 1e-7),
    lambda w: NormalisedGradientLearner(w, 0.1),
    lambda w: LeastSquaresLearner(w, TRUE),
    lambda w: LeastSquaresLearner(w, TRUE, forgetting=0.99),
)


def motions(seed: int, count: int, tunnel: float | None = None) -> np.ndarray:
    """Regressors of random motions."""
    g = np.random.default_rng(seed)
    inside = g.integers(0, 2, count).astype(float) if tunnel is None else np.full(count, tunnel)
    return regressor(
        Motion(g.uniform(5, 20, count), g.uniform(-0.5, 0.5, count), g.uniform(-0.3, 0.3, count), inside)
    )  # fmt: skip


@pytest.mark.parametrize("make", LEARNERS)
def test_exact_weights_stay(make):
    learner = make(TRUE)
    for z in motions(0, 50):
        learner.update(z, float(TRUE @ z - learner.weights @ z))
    np.testing.assert_allclose(learner.weights, TRUE, rtol=1e-12)


@given(st.integers(0, 1000), st.floats(0.01, 3.0))
@settings(max_examples=60, deadline=None)
def test_a_gradient_step_lessens_its_samples_error_below_the_bound_and_enlarges_it_above(
    seed, share
):
    z = motions(seed, 1)[0]
    error = float((TRUE - WRONG) @ z)
    stepped = gradient_step(WRONG, z, error, share * 2.0 / float(z @ z))
    left = float((TRUE - stepped) @ z)
    assert left == pytest.approx((1.0 - 2.0 * share) * error, rel=1e-6, abs=1e-6)
    assert (abs(left) <= abs(error) * (1.0 + 1e-9)) == (share <= 1.0) or abs(error) < 1e-6


def test_the_gradient_diverges_beyond_its_bound():
    z = motions(1, 1, 0.0)[0]
    learner = GradientLearner(WRONG, 2.1 / float(z @ z))
    for _ in range(100):
        learner.update(z, float((TRUE - learner.weights) @ z))
    assert abs((TRUE - learner.weights) @ z) > 1e3 * abs((TRUE - WRONG) @ z)


@given(
    st.integers(0, 1000),
    st.lists(st.floats(0.01, 100.0), min_size=3, max_size=3),
    st.floats(0.1, 10),
)
@settings(max_examples=40, deadline=None)
def test_the_normalised_gradient_does_not_depend_on_units(seed, units, force_unit):
    z, c = motions(seed, 1)[0], np.array(units)
    error = float((TRUE - WRONG) @ z)
    one = NormalisedGradientLearner(WRONG, 0.3, TYPICAL)
    one.update(z, error)
    # weights in other units: z in units of c, forces in force_unit
    other = NormalisedGradientLearner(WRONG * force_unit / c, 0.3, TYPICAL * c)
    other.update(z * c, error * force_unit)
    plain, scaled = one.weights, other.weights
    np.testing.assert_allclose(scaled * c / force_unit, plain, rtol=1e-9)
    assert float((TRUE - plain) @ z) == pytest.approx(0.7 * error, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("joint", [True, False])
def test_recursive_least_squares_is_batch_least_squares(joint):
    z = motions(2, 200, None if joint else 0.0)
    force = z @ TRUE + 500.0 * np.random.default_rng(3).standard_normal(200)
    learner = LeastSquaresLearner(WRONG, TRUE, noise=500.0, joint=joint)
    for row, f in zip(z, force, strict=True):
        learner.update(row, float(f - learner.weights @ row))
    prior = np.diag(1.0 / TRUE**2)
    information = z.T @ z / 500.0**2 + prior
    batch = np.linalg.solve(information, z.T @ force / 500.0**2 + prior @ WRONG)
    np.testing.assert_allclose(learner.weights, batch, rtol=1e-6)
    np.testing.assert_allclose(
        learner.posterior(), np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-6
    )


@pytest.mark.parametrize("make", LEARNERS)
@pytest.mark.parametrize(("tunnel", "kept"), [(1.0, 0), (0.0, 1)])
def test_a_section_moves_its_own_weight_only(make, tunnel, kept):
    learner = make(WRONG)
    for z in motions(4, 100):  # correlations between the weights come to be
        learner.update(z, float((TRUE - learner.weights) @ z))
    before = learner.weights.copy()
    for z in motions(5, 50, tunnel):
        learner.update(z, float((1.2 * TRUE - learner.weights) @ z))
    assert learner.weights[kept] == before[kept]
    assert learner.weights[1 - kept] != before[1 - kept]


def test_joint_least_squares_moves_both_sections():
    learner = LeastSquaresLearner(WRONG, TRUE, joint=True)
    for z in motions(4, 100):
        learner.update(z, float((TRUE - learner.weights) @ z))
    before = learner.weights[0]
    learner.update(motions(5, 1, 1.0)[0], 5e3)
    assert learner.weights[0] != before


def test_forgetting_follows_a_mass_that_changes_and_does_not_run_off_unexcited():
    heavier = TRUE * np.array([1.0, 1.0, 1.3])
    errors = []
    for forgetting in (1.0, 0.98):
        learner = LeastSquaresLearner(TRUE, TRUE, forgetting=forgetting)
        for weights, seed in ((TRUE, 6), (heavier, 7)):
            for z in motions(seed, 300):
                learner.update(z, float((weights - learner.weights) @ z))
        errors.append(abs(learner.weights[2] / heavier[2] - 1.0))
    assert errors[1] < 0.01 < errors[0]
    cruise = regressor(Motion(20.0, 0.0, 0.0, 0.0))
    for _ in range(5000):
        learner.update(cruise, 0.0)
    assert np.all(learner.posterior() <= TRUE * (1.0 + 1e-9))


def test_forgetting_weighs_old_samples_less_by_its_share():
    """At one speed on level track only W1 is excited: its information is a sum, of which the old part fades."""
    learner = LeastSquaresLearner(WRONG, TRUE, noise=500.0, forgetting=0.9)
    for _ in range(3):
        learner.update(regressor(Motion(20.0, 0.0, 0.0, 0.0)), 100.0)
    sample, prior = 400.0**2 / 500.0**2, 1.0 / 12.0**2
    information = 0.9 * (0.9 * (prior + sample) + sample) + sample
    assert learner.posterior()[0] == pytest.approx(information**-0.5, rel=1e-9)
    assert learner.posterior()[1:] == pytest.approx(TRUE[1:], rel=1e-12)


def test_a_weight_that_is_hardly_excited_is_not_forgotten_beyond_its_prior():
    learner = LeastSquaresLearner(TRUE, TRUE, forgetting=0.98)
    creeping = regressor(Motion(0.1, 0.0, 0.0, 0.0))  # V^2 = 0.01 against a noise of 500 N
    for _ in range(2000):
        learner.update(creeping, 0.0)
    np.testing.assert_allclose(learner.posterior(), TRUE, rtol=1e-2)
    assert np.all(learner.posterior() <= TRUE * (1.0 + 1e-2))


def test_the_misprint_goes_the_wrong_way_where_a_train_slows_down_uphill():
    z = regressor(Motion(10.0, -0.1, 0.25, 0.0))
    error = float((TRUE - np.array([12.0, 20.0, 175e3])) @ z)
    start = np.array([12.0, 20.0, 175e3])
    meant, printed = (GradientLearner(start, 1e-6, as_printed=p) for p in (False, True))
    for learner in (meant, printed):
        learner.update(z, error, -0.1)
    assert meant.weights[2] > start[2] > printed.weights[2]
    with pytest.raises(EstimationError, match="acceleration"):
        printed.update(z, error)


def test_from_a_gradient_at_constant_speed_the_misprint_learns_no_mass():
    learner = GradientLearner(WRONG, 1e-6, as_printed=True)
    learner.update(regressor(Motion(10.0, 0.0, 0.25, 0.0)), 1e4, 0.0)
    assert learner.weights[2] == WRONG[2]


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: GradientLearner(np.array([1.0, np.nan, 1.0]), 1.0), "weights"),
        (lambda: GradientLearner(np.ones(4), 1.0), "weights"),
        (lambda: GradientLearner(TRUE, 0.0), "gain"),
        (lambda: NormalisedGradientLearner(TRUE, -1.0), "rate"),
        (lambda: LeastSquaresLearner(TRUE, np.ones(2)), "deviation"),
        (lambda: LeastSquaresLearner(TRUE, TRUE, forgetting=1.5), "forgetting"),
        (lambda: LeastSquaresLearner(TRUE, TRUE, noise=0.0), "noise"),
        (lambda: GradientLearner(TRUE, 1.0).update(np.ones(5), 1.0), "regressor"),
        (lambda: GradientLearner(TRUE, 1.0).update(np.ones(3), float("nan")), "error"),
    ],
)
def test_impossible_learners_and_samples_are_refused(make, named):
    with pytest.raises(EstimationError, match=named):
        make()
