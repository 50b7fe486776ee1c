"""JP H07-322414: its map, its learners, and what compensation and learning do on one route."""

import numpy as np
import pytest

from studies import jph07322414 as study

WRONG = np.array([1.3, 0.7, 0.7])
COMMUTER = study.make_route("commuter", tunnel_factor=2.0, load=0.5, gradient=0.02, cruise=18.0)
START, END = COMMUTER.line.tunnels[0]


def test_the_map_is_read_at_a_point_as_printed_or_car_by_car() -> None:
    point, cars = study.LineMemory(COMMUTER), study.LineMemory(COMMUTER, by_car=True)
    half = 0.5 * COMMUTER.train.length
    inside = [point.read(half + x)[0] for x in (START - 1.0, START + 1.0, END + 1.0)]
    assert inside == [0.0, 1.0, 0.0]
    assert cars.read(START + half)[0] == pytest.approx(0.5)
    climbing = point.read(COMMUTER.line.stations[1] + half + 1.0)[1]
    assert climbing == pytest.approx(9.80665 * 0.02 / np.sqrt(1.0 + 0.02**2), rel=1e-12)  # (1)
    assert [point.is_changing(START + x) for x in (-1.0, 1.0)] == [False, True]


def test_the_gradient_step_overshoots_beyond_its_bound() -> None:
    z = study.regressors(20.0, 0.2, 0.0, 3)
    for share, better in ((0.5, True), (1.5, True), (2.5, False)):
        step = study.gradient(share / float(z @ z))(z, 100.0)  # (5)
        assert (abs(100.0 - float(step @ z)) < 100.0) is better


@pytest.mark.parametrize("count", [3, 5])
def test_least_squares_find_the_weights_of_exact_samples(count: int) -> None:
    g, true = np.random.default_rng(0), np.array([12.0, 24.0, 3e5, 6e3, 300.0])[:count]
    learn, weights = study.least_squares(true), 0.5 * true
    for k in range(2000):
        z = study.regressors(g.uniform(5.0, 20.0), g.uniform(-0.5, 0.5), float(k % 2), count)
        before, weights = weights, weights + learn(z, float(true @ z - weights @ z))
        assert weights[1 - k % 2] == before[1 - k % 2]  # W1 in the open only, W2 in tunnels only
    np.testing.assert_allclose(weights, true, rtol=1e-2)


def test_under_p_control_the_feedback_gives_the_running_resistance() -> None:
    run = study.drive_case(COMMUTER, "feedback", False, WRONG, seed=None)
    k = int(np.searchsorted(run["position"].values, START)) - 1
    (a, b, c), v = COMMUTER.train.resistance, float(run["speed"][k])
    assert float(run["feedback"][k]) == pytest.approx(a + b * v + c * v * v, rel=2e-2)


def test_compensation_and_learning_steady_the_speed_and_find_the_mass() -> None:
    cases = ("feedback", "compensation", "cars", "wrong", "learned", "exact")
    runs = {case: study.drive_case(COMMUTER, case, True, WRONG, seed=1) for case in cases}
    found = {case: study.measure_run(COMMUTER, run) for case, run in runs.items()}
    for place in study.PLACES:
        peak = {case: numbers[f"speed_peak_{place}"] for case, numbers in found.items()}
        assert peak["cars"] < peak["compensation"] < peak["wrong"] < peak["feedback"]
        assert peak["learned"] < 1.25 * peak["compensation"]
    assert found["exact"]["feedback"] < 0.05  # true weights leave nothing to it
    assert found["learned"]["W3"] == pytest.approx(1.0, abs=0.05)
    true = COMMUTER.weights()
    learner = study.least_squares(0.5 * true)
    alone = study.learn_alone(COMMUTER, runs["feedback"], learner, WRONG * true, seed=1)
    assert alone[2] == pytest.approx(true[2], rel=0.05)
