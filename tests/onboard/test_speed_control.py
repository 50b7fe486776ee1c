"""Parts of the speed control: command, memory of the line, feedback, traction, switch."""

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.onboard.line_memory import (
    LineMemory,
    Motion,
    Regression,
    RegressionFilter,
    compensation_force,
    feedforward_force,
    regressor,
)
from alloc.onboard.speed_controller import (
    LEARN,
    USE,
    Feedback,
    LearnThenUse,
    SpeedCommand,
    SpeedControl,
    Traction,
)
from alloc.plant.laws import GRAVITY, gradient_force
from alloc.plant.sets import find_set


def test_the_command_is_continuous_and_its_acceleration_is_its_slope():
    command = SpeedCommand((1.0, 5.0, 40.0), (20.0, 10.0, 0.0), 0.5, 12.0)
    time = np.linspace(0.0, 80.0, 80001)
    speed, rate = command.at(time)
    assert np.abs(np.diff(speed)).max() <= 0.5 * 1e-3 + 1e-9
    np.testing.assert_allclose(np.diff(speed)[1:], 1e-3 * rate[1:-1], atol=6e-4 * 1e-0)
    assert set(np.unique(rate)) == {-0.5, 0.0, 0.5}
    assert speed[0] == 12.0
    assert speed[-1] == 0.0
    assert speed[5000] == pytest.approx(14.0)  # the new target came before the old one was reached


def test_the_memory_knows_section_and_sine_of_the_gradient():
    memory = LineMemory((0.0, 100.0), (0.0, 2.5), ((50.0, 80.0),))
    tunnel, slope = memory.read([0.0, 50.0, 79.9, 80.0, 100.0, 1e4])
    np.testing.assert_array_equal(tunnel, [0, 1, 1, 0, 0, 0])
    np.testing.assert_allclose(slope[-1], GRAVITY * 0.025 / np.hypot(1.0, 0.025))
    assert slope[3] == 0.0
    assert memory.changes == (50.0, 80.0, 100.0)
    np.testing.assert_array_equal(
        memory.straddled([49.0, 50.0, 95.0, 121.0], 20.0), [False, True, True, False]
    )


def test_a_memory_read_along_the_train_is_the_mean():
    memory = LineMemory((0.0, 100.0), (0.0, 2.0), ((50.0, 80.0),), offsets=(0.0, -20.0))
    tunnel, slope = memory.read(110.0)
    assert slope == pytest.approx(0.5 * gradient_force(1.0, 0.02))
    assert memory.read(60.0)[0] == 0.5
    assert tunnel == 0.0


def test_the_feedforward_is_the_law_and_the_compensation_leaves_acceleration_out():
    weights = np.array([12.0, 20.0, 250e3])
    motion = Motion(20.0, 0.3, 0.2, 1.0)
    assert feedforward_force(weights, motion) == pytest.approx(20.0 * 400.0 + 250e3 * 0.5)
    assert feedforward_force(weights, motion, 10e3) == pytest.approx(
        20.0 * 400.0 + 250e3 * 0.5 + 3e3
    )
    assert compensation_force(weights, motion) == pytest.approx(20.0 * 400.0 + 250e3 * 0.2)
    five = feedforward_force([12.0, 20.0, 250e3, 3e3, 140.0], motion)
    assert five == pytest.approx(20.0 * 400.0 + 250e3 * 0.5 + 3e3 + 2.8e3)
    with pytest.raises(OnboardError, match="3 or 5"):
        regressor(motion, 4)


def test_the_integrator_does_not_wind_up():
    held, wound = Feedback(100.0, 10.0), Feedback(100.0, 10.0)
    for _ in range(1000):  # a step that the motors cannot give
        held.integrate(5.0, held.current(5.0) - 300.0, 0.05)
        wound.integrate(5.0, 0.0, 0.05)
    assert held.state == 0.0
    assert wound.state == pytest.approx(2500.0)
    held.integrate(-1.0, 200.0, 0.05)  # back from the limit it moves at once
    assert held.state == pytest.approx(-0.5)
    assert Feedback(100.0).current(2.0) == 200.0


def test_every_motor_gives_the_same_share_of_the_force():
    train = find_set("commuter-8car")
    traction = Traction.of(train, 2e-3)
    torques, supplied = traction.torques(200.0, 10.0)
    assert supplied == pytest.approx(200.0)
    assert np.ptp(torques) == 0.0
    assert traction.rim_force @ torques == pytest.approx(100e3)
    torques, supplied = traction.torques(1e6, 10.0)
    np.testing.assert_allclose(torques, traction.limit(10.0, False))
    assert supplied < 1e6
    assert traction.torques(-1e6, 0.0)[0] == pytest.approx(0.0)  # the electric brake fades


def test_a_filter_leaves_the_weights_as_they_are_and_waits_until_it_has_settled():
    g = np.random.default_rng(0)
    weights, smooth = np.array([12.0, 20.0, 250e3]), RegressionFilter(1.0, 0.05)
    got = []
    for k in range(300):
        z = regressor(Motion(g.uniform(5, 20), g.normal(), 0.1, float(k >= 150)))
        got.append(smooth.add(Regression(z, float(z @ weights), 0.0, 0.0), k >= 150))
    assert [k for k, one in enumerate(got) if one is None] == [*range(60), *range(150, 210)]
    for one in (one for one in got if one is not None):
        assert one.target == pytest.approx(weights @ one.regressor)
        assert 0.0 in one.regressor[:2]  # of one section only


def test_the_switch_learns_until_the_error_is_small_and_comes_back_when_it_is_large():
    switch = LearnThenUse(1e3, 5e3, window=1.0)
    changes = [switch.update(error, 0.1) for error in [8e3] * 20 + [100.0] * 50]
    assert sum(changes) == 1
    assert switch.signal == USE
    assert any(switch.update(20e3, 0.1) for _ in range(20))
    assert switch.signal == LEARN


COMMAND, FEEDBACK = SpeedCommand((0.0,), (10.0,), 0.5), Feedback(100.0)
TRACTION = Traction.of(find_set("commuter-8car"))


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: SpeedCommand((0.0, 0.0), (1.0, 2.0), 0.5), "times"),
        (lambda: SpeedCommand((0.0,), (-1.0,), 0.5), "speeds"),
        (lambda: SpeedCommand((0.0,), (1.0,), 0.0), "acceleration"),
        (lambda: LineMemory((0.0,), (0.0, 1.0)), "stations"),
        (lambda: LineMemory((1.0, 0.0), (0.0, 1.0)), "fall"),
        (lambda: LineMemory(tunnels=((5.0, 5.0),)), "tunnel"),
        (lambda: LineMemory(offsets=()), "offsets"),
        (lambda: Feedback(0.0), "proportional"),
        (lambda: Feedback(1.0, -1.0), "integral"),
        (lambda: LearnThenUse(2.0, 1.0), "small"),
        (lambda: RegressionFilter(-1.0, 0.1), "time_constant"),
        (lambda: SpeedControl(COMMAND, FEEDBACK, TRACTION, 0.0), "period"),
        (lambda: SpeedControl(COMMAND, FEEDBACK, TRACTION, 0.1, "guess"), "mode"),
        (lambda: SpeedControl(COMMAND, FEEDBACK, TRACTION, 0.1, "compensation"), "weights"),
        (lambda: SpeedControl(COMMAND, FEEDBACK, TRACTION, 0.1, weights=np.ones(2)), "weights"),
        (lambda: SpeedControl(COMMAND, FEEDBACK, TRACTION, 0.1, "learn-then-use", weights=np.ones(3)),
         "learner"),
    ],
)  # fmt: skip
def test_bad_input_is_refused(make, named):
    with pytest.raises(OnboardError, match=named):
        make()
