"""Learning of increments: the laws (16), (17) and the Gaussian posterior, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.onboard.equipment import equipment
from alloc.onboard.increment_learning import (
    IncrementLearning,
    LearntIncrements,
    gaussian_posterior,
    running_mean,
)
from alloc.onboard.parameters import Belief, Onboard
from alloc.plant.model import build
from alloc.plant.rail import Rail
from tests.onboard.uneven import uneven_train

LEARNT = LearntIncrements(*(tuple(0.01 * (k + j) for j in range(4)) for k in range(6)))


def test_running_mean_is_16_and_17_by_hand():
    # (16): 0.02; (17): (0.010 x 20 + 0.02 x 4) / 24
    assert running_mean(0.010, 20.0, 0.02 + 0.03 + 0.02 + 0.01, 4.0) == pytest.approx(0.28 / 24)
    assert running_mean(0.28 / 24, 24.0, 0.0, 2.0) == pytest.approx(0.28 / 26)


def test_running_mean_is_the_mean_of_all_data_however_they_are_parted():
    data = 0.02 + 0.01 * np.random.default_rng(2).standard_normal(60)
    increment, count = 0.5, 0.0  # with nothing behind it, what is stored does not count
    for part in np.split(data, [10, 15, 16, 40]):
        increment = running_mean(increment, count, part.sum(), part.size)
        count += part.size
    assert increment == pytest.approx(data.mean(), rel=1e-12)


def test_data_that_tell_what_is_stored_change_nothing():
    assert running_mean(0.013, 7.0, 5 * 0.013, 5.0) == pytest.approx(0.013, rel=1e-14)
    assert gaussian_posterior(0.013, 0.01, 0.013, 0.012, 1e-6)[0] == 0.013


def test_posterior_is_the_precision_weighted_mean():
    prior, spread, noise = 0.005, 0.01, 0.012
    data = np.array([0.02, 0.03, 0.01])
    increment, deviation = prior, spread
    for value in data:
        increment, deviation = gaussian_posterior(increment, deviation, value, noise, 0.0)
    precision = 1 / spread**2 + data.size / noise**2
    assert increment == pytest.approx((prior / spread**2 + data.sum() / noise**2) / precision)
    assert deviation == pytest.approx(precision**-0.5)


def test_posterior_states_its_own_error():
    # true increments drawn from the prior: the posterior's z-scores are standard normal
    generator = np.random.default_rng(4)
    spread, noise, n = 0.01, 0.012, 4000
    truth = spread * generator.standard_normal(n)
    increment, deviation = np.zeros(n), np.full(n, spread)
    for _ in range(5):
        data = truth + noise * generator.standard_normal(n)
        increment, deviation = gaussian_posterior(increment, deviation, data, noise, 0.0)
    z = (increment - truth) / deviation
    assert z.std() == pytest.approx(1.0, abs=0.04)
    assert abs(z.mean()) < 0.06


def test_posterior_with_a_vague_prior_is_the_running_mean():
    data = [0.01, 0.02, 0.04, 0.01]
    increment, deviation = 0.5, 1e3
    for value in data:
        increment, deviation = gaussian_posterior(increment, deviation, value, 0.01, 0.0)
    assert increment == pytest.approx(running_mean(0.5, 0.0, sum(data), 4.0), rel=1e-6)


def test_posterior_with_drift_by_hand():
    # prior 4e-4 grows by 1e-4 to 5e-4 against noise 5e-4: half of the difference is taken, half of the variance left
    increment, deviation = gaussian_posterior(0.010, 0.02, 0.030, np.sqrt(5e-4), 1e-4)
    assert increment == pytest.approx(0.020)
    assert deviation == pytest.approx(np.sqrt(2.5e-4))


def test_drift_lets_the_posterior_follow_the_seasons():
    found = {}
    for drift in (0.0, 1e-6):
        increment, deviation = 0.0, 0.01
        for value in [0.0] * 500 + [0.02] * 50:
            increment, deviation = gaussian_posterior(increment, deviation, value, 0.012, drift)
        found[drift] = increment
    assert found[1e-6] > 2 * found[0.0]


def believed(belief, learning):
    return equipment(build(uneven_train(), Rail(0.15)), Onboard(belief=belief, learning=learning))


def test_a_train_begins_with_what_it_has_learnt_else_with_what_it_believes():
    stored = Belief(unit_increments=(0.02, 0.03, 0.02, 0.05))
    plain = believed(stored, IncrementLearning()).learnt
    assert plain.increment.tolist() == [0.02, 0.03, 0.02, 0.05]
    mean = believed(stored, IncrementLearning("running-mean", stored=7.0)).learnt
    np.testing.assert_allclose(mean.increment, [0.0, 0.01, 0.0, 0.03], atol=1e-15)
    assert mean.behind.tolist() == [7.0] * 4
    assert not any(values.any() for values in mean[3:])
    gauss = believed(stored, IncrementLearning("gaussian", deviation=0.02)).learnt
    assert gauss.deviation.tolist() == [0.0, 0.02, 0.02, 0.02]
    known = replace(stored, unit_deviation=(0.0, 0.1, 0.2, 0.3))
    assert believed(known, IncrementLearning("gaussian")).learnt.deviation[3] == 0.3
    for kind in ("none", "running-mean", "gaussian"):
        found = believed(replace(known, learnt=LEARNT), IncrementLearning(kind)).learnt
        np.testing.assert_array_equal(found, [[0.01 * (k + j) for j in range(4)] for k in range(6)])


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"kind": "magic"}, "kind = 'magic' must be one of none, running-mean, gaussian"),
        ({"reference": "latest"}, "reference = 'latest' must be one of received, held"),
        ({"first": 0}, "first = 0 must be a whole number, 1 or greater"),
        ({"further": 2.5}, r"further = 2.5 must be a whole number"),
        ({"noise": 0.0}, "noise = 0.0 must be"),
        ({"noise": float("inf")}, "noise = inf must be a finite number"),
        ({"stored": -1.0}, "stored = -1.0 must be"),
        ({"deviation": float("nan")}, "deviation = nan must be"),
        ({"drift": -1e-9}, "drift = -1e-09 must be"),
    ],
)
def test_bad_settings_are_refused(values, message):
    with pytest.raises(OnboardError, match=message):
        IncrementLearning(**values)


def test_bad_experience_is_refused():
    with pytest.raises(OnboardError, match="must have a number per traction unit each"):
        replace(LEARNT, behind=(1.0,))
    with pytest.raises(OnboardError, match=r"behind\[1\] = -1.0"):
        replace(LEARNT, behind=(1.0, -1.0, 0.0, 0.0))
    with pytest.raises(OnboardError, match="every number must be finite"):
        replace(LEARNT, increment=(float("inf"), 0.0, 0.0, 0.0))
    short = LearntIncrements(*(((0.0,) * 3,) * 6))
    with pytest.raises(OnboardError, match="increments of 3 traction units for 4"):
        believed(Belief(learnt=short), IncrementLearning())
