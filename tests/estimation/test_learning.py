"""Learning of increments: (16), (17), and the Gaussian posterior."""

import numpy as np
import pytest

from alloc.errors import EstimationError
from alloc.estimation.learning import (
    GaussianPosterior,
    RunningMean,
    load_learning,
    save_learning,
)


def test_running_mean_is_16_and_17_by_hand():
    learning = RunningMean([0.0, 0.010], [0, 20], first=4, further=2)
    for value in (0.02, 0.03, 0.02):
        assert not learning.add(1, value)
    assert learning.increment[1] == 0.010  # fewer than N_min data
    assert learning.add(1, 0.01)
    # (16): 0.02; (17): (0.010 x 20 + 0.02 x 4) / 24
    assert learning.increment[1] == pytest.approx(0.28 / 24)
    assert learning.count[1] == 24
    assert not learning.add(1, 0.0)
    assert learning.add(1, 0.0)  # from then on every N_arg data
    assert learning.increment[1] == pytest.approx(0.28 / 26)
    assert learning.increment[0] == 0.0


def test_ten_data_are_waited_for_at_first_and_five_from_then_on():
    learning = RunningMean([0.0], [0])
    changed = [k for k in range(1, 31) if learning.add(0, 0.01)]
    assert changed == [10, 15, 20, 25, 30]
    assert learning.updates.tolist() == [5]


def test_running_mean_is_the_mean_of_all_data():
    generator = np.random.default_rng(2)
    data = 0.02 + 0.01 * generator.standard_normal(60)
    learning = RunningMean([0.0], [0], first=10, further=5)
    for value in data:
        learning.add(0, value)
    assert learning.increment[0] == pytest.approx(data.mean())
    assert learning.deviation(0.01)[0] == pytest.approx(0.01 / np.sqrt(60))


def test_posterior_is_the_precision_weighted_mean():
    prior, spread, noise = 0.005, 0.01, 0.012
    data = np.array([0.02, 0.03, 0.01])
    learning = GaussianPosterior([prior], [spread**2], noise)
    for value in data:
        learning.add(0, value)
    precision = 1 / spread**2 + data.size / noise**2
    assert learning.increment[0] == pytest.approx(
        (prior / spread**2 + data.sum() / noise**2) / precision
    )
    assert learning.deviation()[0] == pytest.approx(precision**-0.5)


def test_posterior_states_its_own_error():
    # true increments drawn from the prior: the posterior's z-scores are standard normal
    generator = np.random.default_rng(4)
    spread, noise, n = 0.01, 0.012, 4000
    truth = spread * generator.standard_normal(n)
    learning = GaussianPosterior(np.zeros(n), np.full(n, spread**2), noise)
    for unit in range(n):
        for _ in range(5):
            learning.add(unit, truth[unit] + noise * generator.standard_normal())
    z = (learning.increment - truth) / learning.deviation()
    assert z.std() == pytest.approx(1.0, abs=0.04)
    assert abs(z.mean()) < 0.06


def test_posterior_with_a_vague_prior_is_the_running_mean():
    data = [0.01, 0.02, 0.04, 0.01]
    mean = RunningMean([0.5], [0], first=1, further=1)
    posterior = GaussianPosterior([0.5], [1e6], 0.01)
    for value in data:
        mean.add(0, value)
        posterior.add(0, value)
    assert posterior.increment[0] == pytest.approx(mean.increment[0], rel=1e-6)


def test_drift_lets_the_posterior_follow_the_seasons():
    fixed, drifting = (GaussianPosterior([0.0], [1e-4], 0.012, drift) for drift in (0.0, 1e-6))
    for learning in (fixed, drifting):
        for value in [0.0] * 500 + [0.02] * 50:
            learning.add(0, value)
    assert drifting.increment[0] > 2 * fixed.increment[0]


@pytest.mark.parametrize("step", [0, 3, 11])
def test_a_file_keeps_everything(tmp_path, step):
    path = tmp_path / "learnt.json"
    mean, gauss = (
        RunningMean([0.0, 0.01], [3, 4], 4, 2),
        GaussianPosterior([0.0], [1e-4], 0.01, 1e-7),
    )
    for _ in range(step):
        mean.add(1, 0.02)
        gauss.add(0, 0.02)
    save_learning(path, "train", {"forward": mean, "backward": gauss})
    again = load_learning(path, "train")
    assert again["forward"].state() == mean.state()
    assert again["backward"].state() == gauss.state()
    # and goes on as if it had never been away
    assert again["forward"].add(1, 0.05) == mean.add(1, 0.05)
    assert again["forward"].state() == mean.state()


def test_no_file_is_no_experience(tmp_path):
    assert load_learning(tmp_path / "none.json", "train") == {}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "damaged"),
        ('{"train": "train", "directions": {"up": {"kind": "gaussian"}}}', "damaged.*up"),
        ('{"train": "train", "directions": {"forward": {"kind": "magic"}}}', "damaged.*magic"),
        ('{"train": "other", "directions": {}}', "belongs to train 'other'"),
    ],
)
def test_bad_files_are_refused(tmp_path, content, message):
    path = tmp_path / "learnt.json"
    path.write_text(content)
    with pytest.raises(EstimationError, match=message):
        load_learning(path, "train")


def test_bad_values_are_refused(tmp_path):
    with pytest.raises(EstimationError, match="no unit 2"):
        RunningMean([0.0, 0.0], [0, 0]).add(2, 0.01)
    with pytest.raises(EstimationError, match="increment = nan"):
        GaussianPosterior([0.0], [1e-4], 0.01).add(0, float("nan"))
    with pytest.raises(EstimationError, match="noise = 0"):
        GaussianPosterior([0.0], [1e-4], 0.0)
    with pytest.raises(EstimationError, match="first = 0"):
        RunningMean([0.0], [0], first=0)
    with pytest.raises(EstimationError, match="cannot be written"):
        save_learning(tmp_path / "no" / "learnt.json", "train", {})


def test_posterior_with_drift_by_hand():
    # prior 4e-4 grows by 1e-4 to 5e-4 against noise 5e-4: half of the difference is taken, half of the variance left
    learning = GaussianPosterior([0.010, 0.5], [4e-4, 1.0], np.sqrt(5e-4), drift=1e-4)
    assert learning.add(0, 0.030)
    assert learning.increment.tolist() == [pytest.approx(0.020), 0.5]
    assert learning.variance.tolist() == [pytest.approx(2.5e-4), 1.0]
