"""A weight that a run cannot teach is named, with the reason."""

import numpy as np
import pytest

from alloc.errors import EstimationError
from alloc.estimation.excitation import LEARNED, NOT_LEARNABLE, judge_excitation
from alloc.onboard.speed_control.resistance import EXTENDED_WEIGHTS, WEIGHTS, Motion, regressor

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
