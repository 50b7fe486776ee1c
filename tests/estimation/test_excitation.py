"""A weight that a run cannot teach is named, with the reason."""

import numpy as np
import pytest

from alloc.errors import EstimationError
from alloc.estimation.running_resistance import LEARNED, NOT_LEARNABLE, judge_excitation
from alloc.onboard.line_memory import EXTENDED_WEIGHTS, WEIGHTS, Motion, regressor

TRUE = np.array([12.0, 20.0, 250e3, 3e3, 140.0])
N = 400


def judged(motion: Motion, weights: int = 3, noise: float = 100.0):
    z = regressor(motion, weights)
    force = z @ TRUE[:weights] + noise * np.random.default_rng(0).standard_normal(N)
    return judge_excitation(z, force, EXTENDED_WEIGHTS[:weights])


def statuses(found):
    return {one.name: (one.status, one.reason) for one in found.weights}


def steady(value: float) -> np.ndarray:
    return np.full(N, value)


def test_constant_speed_on_level_track_teaches_air_resistance_only():
    found = statuses(judged(Motion(steady(20.0), steady(0.0), steady(0.0), steady(0.0))))
    assert found["W1"] == (LEARNED, "")
    assert found["W2"] == found["W3"] == (NOT_LEARNABLE, "its regressor is zero throughout")


def test_constant_speed_on_one_gradient_tells_neither():
    found = judged(Motion(steady(20.0), steady(0.0), steady(0.2), steady(0.0)))
    assert statuses(found)["W1"] == (NOT_LEARNABLE, "cannot be told apart from W3")
    assert statuses(found)["W3"] == (NOT_LEARNABLE, "cannot be told apart from W1")
    assert found.condition > 1e9


def test_a_gradient_that_changes_excites_the_mass():
    slope = np.where(np.arange(N) < N // 2, 0.0, 0.2)
    found = judged(Motion(steady(20.0), steady(0.0), slope, steady(0.0)))
    assert found.learned("W1")
    assert found.learned("W3")
    assert found.weights[2].value == pytest.approx(TRUE[2], rel=0.01)
    assert 0.0 < found.smallest_eigenvalue < 1.0 < found.condition < 20.0


def test_a_tunnel_with_the_mass_known_from_outside_teaches_its_weight():
    k = np.arange(N)
    found = judged(Motion(steady(20.0), np.where(k < 100, 0.3, 0.0), steady(0.0), k > 250))
    assert all(found.learned(name) for name in WEIGHTS)


def test_at_one_speed_a_constant_and_a_linear_part_hide_in_the_square():
    k = np.arange(N)
    found = judged(Motion(steady(20.0), np.where(k < 100, 0.3, 0.0), steady(0.0), steady(0.0)), 5)
    assert not any(found.learned(name) for name in ("W1", "A", "B"))
    assert found.learned("W3")
    speed = 1.0 + 30.0 * np.abs(np.sin(k / 40.0))
    wide = judged(Motion(speed, np.cos(k / 7.0), steady(0.0), k % 2), 5, noise=5.0)
    assert all(wide.learned(name) for name in EXTENDED_WEIGHTS)


def test_what_drowns_in_noise_or_has_few_samples_is_not_learned():
    slope = np.where(np.arange(N) < N // 2, 0.0, 0.01)
    motion = Motion(steady(20.0), steady(0.0), slope, steady(0.0))
    found = statuses(judged(motion, noise=10e3))
    assert found["W3"][0] == NOT_LEARNABLE
    assert "too little" in found["W3"][1]
    few = np.where(np.arange(N) < 5, 0.3, 0.0)
    found = statuses(judged(Motion(steady(20.0), few, steady(0.0), steady(0.0)), noise=1.0))
    assert found["W3"] == (NOT_LEARNABLE, "5 samples only")


def test_residuals_that_follow_each_other_count_less():
    z = regressor(Motion(20.0 + np.sin(np.arange(N)), steady(0.1), steady(0.0), steady(0.0)))
    white = 500.0 * np.random.default_rng(1).standard_normal(N)
    slow = np.convolve(white, np.ones(50) / np.sqrt(50.0), mode="same")
    deviations = [
        judge_excitation(z, z @ TRUE[:3] + noise, WEIGHTS).weights[0].deviation
        for noise in (white, slow)
    ]
    assert deviations[1] > 3.0 * deviations[0]


@pytest.mark.parametrize(
    ("z", "f"),
    [
        (np.ones((4, 2)), np.ones(4)),
        (np.ones((4, 3)), np.ones(3)),
        (np.full((4, 3), np.nan), np.ones(4)),
    ],
)
def test_data_that_are_none_are_refused(z, f):
    with pytest.raises(EstimationError, match="excitation"):
        judge_excitation(z, f, WEIGHTS)


def by_hand(size=1.0):
    """40 samples of 3 z1 + 5 z2 and a residual ++++---- orthogonal to both: z1 is 1, z2 is 1 in the first 16."""
    z = np.column_stack([np.ones(40), np.arange(40) < 16])
    residual = size * np.where(np.arange(40) % 8 < 4, 1.0, -1.0)
    return judge_excitation(z, z @ [3.0, 5.0] + residual, ("one", "other"))


def test_numbers_of_a_judgement_by_hand():
    found = by_hand()
    # cosine of the regressors: 16 / sqrt(40 x 16); part apart: 1 - 0.4; eigenvalues 1 +- sqrt(0.4)
    assert [weight.part for weight in found.weights] == pytest.approx([0.6, 0.6])
    assert [weight.value for weight in found.weights] == pytest.approx([3.0, 5.0])
    assert found.smallest_eigenvalue == pytest.approx(1.0 - np.sqrt(0.4))
    assert found.condition == pytest.approx((1.0 + np.sqrt(0.4)) / (1.0 - np.sqrt(0.4)))
    assert found.residual == pytest.approx(1.0)
    # from one residual to the next: 30 pairs alike, 9 opposite, over 40; 40 samples less two weights
    r = 21 / 40
    variance = 40 / 38 * (1 + r) / (1 - r)
    assert [weight.deviation for weight in found.weights] == pytest.approx(
        [np.sqrt(variance / 0.6 / 40), np.sqrt(variance / 0.6 / 16)]
    )


def test_a_weight_may_be_uncertain_by_a_twentieth():
    unit = by_hand().weights[0].deviation / 3.0
    for uncertain, learnt in ((0.049, True), (0.051, False)):
        found = by_hand(uncertain / unit)
        assert found.learned("one") == learnt
        said = "excited too little against what the weights leave: uncertain by 5.1 %"
        assert found.weights[0].reason == ("" if learnt else said)


@pytest.mark.parametrize(("square", "told_apart"), [(0.00095, False), (0.00106, True)])
def test_a_thousandth_of_the_regressor_must_be_its_own(square, told_apart):
    alternating = np.where(np.arange(400) % 2, 1.0, -1.0)
    third = np.where(np.arange(400) % 4 < 2, 1.0, -1.0)  # resembles neither
    against = np.column_stack([np.ones(400), -1.0 - np.sqrt(square) * alternating, third])
    found = judge_excitation(against, against @ [1.0, 2.0, 3.0], ("one", "other", "third"))
    reasons = [weight.reason for weight in found.weights[:2]]
    if told_apart:
        assert reasons == ["", ""]
    else:
        assert reasons == ["cannot be told apart from other", "cannot be told apart from one"]


@pytest.mark.parametrize(("count", "learnt"), [(19, False), (20, True)])
def test_twenty_samples_are_needed(count, learnt):
    z = np.column_stack([np.ones(100), np.arange(100) < count])
    assert judge_excitation(z, z @ [1.0, 2.0], ("one", "few")).learned("few") == learnt
