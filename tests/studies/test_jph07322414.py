"""JP H07-322414: its map, its learners, and what compensation and learning do on one route."""

import numpy as np
import pytest

from studies.jph07322414 import (
    LineMemory,
    Route,
    drive_case,
    gradient,
    learn_alone,
    least_squares,
    measured,
    regressors,
    route,
)

WRONG = np.array([1.3, 0.7, 0.7])


@pytest.fixture(scope="module")
def commuter() -> Route:
    return route("commuter", tunnel_factor=2.0, load=0.5, gradient=0.02, cruise=18.0)


def test_the_map_says_tunnels_and_gradients_as_printed_and_for_every_car(commuter: Route) -> None:
    start, end = commuter.line.tunnels[0]
    point, cars = LineMemory(commuter, "front"), LineMemory(commuter, "cars")
    assert [point.read(x)[0] for x in (start - 1.0, start + 1.0, end + 1.0)] == [0.0, 1.0, 0.0]
    assert cars.read(start + 0.5 * commuter.length)[0] == pytest.approx(0.5)
    climbing = point.read(commuter.line.stations[1] + 1.0)[1]
    assert climbing == pytest.approx(9.80665 * 0.02 / np.sqrt(1.0 + 0.02**2), rel=1e-12)  # (1)
    assert point.changing(start + 1.0)
    assert not point.changing(start - 1.0)


def test_the_gradient_step_overshoots_beyond_its_bound_and_its_misprint_forgets_gradients() -> None:
    z, weights = regressors(20.0, 0.2, 0.0, 3), np.zeros(3)
    for share, better in ((0.5, True), (1.5, True), (2.5, False)):
        moved = gradient(share / float(z @ z))(weights, z, 100.0, 0.0)
        assert (abs(100.0 - moved @ z) < 100.0) is better  # (5)
    assert gradient(1e-6)(weights, z, 100.0, 0.0)[2] > 0.0
    assert gradient(1e-6, as_printed=True)(weights, z, 100.0, 0.0)[2] == 0.0  # a = 0 on a climb


@pytest.mark.parametrize("count", [3, 5])
def test_least_squares_find_the_weights_of_exact_samples(count: int) -> None:
    g, true = np.random.default_rng(0), np.array([12.0, 24.0, 3e5, 6e3, 300.0])[:count]
    learn, weights = least_squares(true, noise=1.0), 0.5 * true
    for k in range(400):
        z = regressors(g.uniform(5.0, 20.0), g.uniform(-0.5, 0.5), float(k % 2), count)
        before = weights
        weights = learn(weights, z, float(true @ z - weights @ z), 0.0)
        assert weights[1 - k % 2] == before[1 - k % 2]  # W1 in the open only, W2 in tunnels only
    np.testing.assert_allclose(weights, true, rtol=1e-3)


def test_under_p_control_the_speed_falls_short_by_the_resistance_over_the_gain(
    commuter: Route,
) -> None:
    run = drive_case(commuter, "feedback", integral=False, wrong=WRONG)
    k = int(np.searchsorted(run["position"].values, commuter.line.tunnels[0][0])) - 1
    (a, b, c), v = commuter.train.resistance, float(run["speed"][k])
    assert float(run["feedback"][k]) == pytest.approx(a + b * v + c * v * v, rel=2e-2)


def test_compensation_steadies_the_speed_and_true_weights_leave_nothing_to_the_feedback(
    commuter: Route,
) -> None:
    cases = ("feedback", "compensation", "cars", "wrong", "learned", "exact")
    runs = {case: drive_case(commuter, case, integral=True, wrong=WRONG, seed=1) for case in cases}
    found = {case: measured(commuter, run) for case, run in runs.items()}
    for place in ("mouth", "gradient"):
        peak = {case: numbers[f"speed_peak_{place}"] for case, numbers in found.items()}
        assert peak["cars"] < peak["compensation"] < peak["wrong"] < peak["feedback"]
        assert peak["learned"] < 1.25 * peak["compensation"]
    assert found["exact"]["feedback"] < 0.05
    assert found["learned"]["W3"] == pytest.approx(1.0, abs=0.05)
    true = commuter.weights()
    alone = learn_alone(commuter, runs["feedback"], least_squares(0.5 * true), WRONG * true, seed=1)
    assert alone[2] == pytest.approx(true[2], rel=0.05)
