"""The speed control, period by period, against a second transcription; parts of it where a number decides."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.onboard.line_memory import LineMemory, PositionDetector, Regression, RegressionFilter
from alloc.onboard.speed_controller import (
    LEARN,
    LOGGED,
    USE,
    Feedback,
    Learning,
    LearnThenUse,
    SpeedCommand,
    SpeedControl,
    Traction,
)
from alloc.plant.sets import find_set

PERIOD, PER_FORCE, MOST, OWN = 0.1, 1e-3, 60.0, 9e3
COMMAND = SpeedCommand((0.5, 4.0), (9.0, 6.0), 0.6, 5.0)
MEMORY = LineMemory((0.0, 30.0), (0.4, -0.9), ((12.0, 20.0),))
FIVE = np.array([9.0, 15.0, 180e3, 2e3, 90.0])


class Motors:
    """Two units that give at most `MOST` amperes together."""

    current_per_force = PER_FORCE

    def torques(self, current, speed):
        supplied = float(np.clip(current, -MOST, MOST))
        return np.array([0.4, 0.6]) * supplied, supplied


class Notes:
    """A learner that notes, and moves its weights a little."""

    def __init__(self, weights):
        self.weights, self.heard = weights.copy(), []

    def update(self, regressor, error, acceleration=None):
        self.heard.append([*regressor, error, acceleration])
        self.weights = self.weights * 1.001


def force(weights, speed, change, slope, tunnel):
    """The law, of three or five weights."""
    total = (weights[0] * (1.0 - tunnel) + weights[1] * tunnel) * speed**2 + weights[2] * (
        change + slope
    )
    return total + (weights[3] + weights[4] * speed if weights.size == 5 else 0.0)


def z(n, speed, change, slope, tunnel):
    return np.array([force(row, speed, change, slope, tunnel) for row in np.eye(n)])


class Twin:
    """The speed control once more."""

    def __init__(self, mode, weights, learner, error, switch, time, length, integral):
        self.mode, self.learner, self.error, self.switch, self.length = (
            mode,
            learner,
            error,
            switch,
            length,
        )
        self.fixed, self.integral, self.state = weights, integral, 0.0
        self.time, self.samples, self.tunnel, self.last, self.rows = time, [], None, None, []

    @property
    def weights(self):
        return self.learner.weights if self.learner else self.fixed

    @property
    def using(self):
        return self.mode != "learn-then-use" or self.switch.signal == USE

    def filtered(self):
        share = 1.0 - math.exp(-PERIOD / self.time) if self.time else 1.0
        out = 0.0
        for sample in self.samples:
            out = out + share * (sample - out)
        return None if len(self.samples) <= math.ceil(3.0 * self.time / PERIOD) else out

    def learn(self, speed, x):
        if self.last is None:
            return None
        v, at, supplied, back, bounded = self.last
        middle, change = (x + at) / 2.0, (speed - v) / PERIOD
        tunnel, slope = map(float, MEMORY.read(middle))
        under = self.length and any(middle - self.length < c <= middle for c in (12.0, 20.0, 30.0))
        if bounded or under:
            self.samples = []
            return None
        if self.tunnel != (tunnel > 0.5):
            self.samples, self.tunnel = [], tunnel > 0.5
        n = self.weights.size
        self.samples.append(
            np.array(
                [
                    *z(n, (speed + v) / 2.0, change, slope, tunnel),
                    supplied / PER_FORCE - OWN * change,
                    back / PER_FORCE,
                    change,
                ]
            )
        )
        out = self.filtered()
        if out is None:
            return None
        left = out[n] - out[:n] @ self.weights
        if self.mode == "learn-then-use" and self.using:
            return out[n + 1]
        if self.learner:
            model = self.error == "model" or self.mode == "learn-then-use"
            self.learner.update(out[:n], left if model else out[n + 1], out[n + 2])
        return left

    def drive(self, time, speed, x):
        wanted, rate = map(float, COMMAND.at(time))
        tunnel, slope = map(float, MEMORY.read(x))
        error = self.learn(speed, x)
        ahead = {
            "feedback": lambda: 0.0,
            "compensation": lambda: force(self.weights, speed, 0.0, slope, tunnel),
        }.get(
            self.mode, lambda: force(self.weights, wanted, rate, slope, tunnel) + OWN * rate
        )() * PER_FORCE
        if self.switch and error is not None and self.switch.update(error, PERIOD):
            if self.integral:
                self.state -= ahead if self.using else -ahead
            self.samples = []
        back = 30.0 * (wanted - speed) + self.state
        current = back + ahead
        if self.mode == "learn-then-use":
            current = back if not self.using else current if self.switch.feedback else ahead
        supplied = min(max(current, -MOST), MOST)
        bounded = supplied != current
        if not bounded or (current - supplied) * (wanted - speed) <= 0.0:
            self.state += self.integral * (wanted - speed) * PERIOD
        self.last = speed, x, supplied, back, bounded
        self.rows.append([wanted, rate, speed, x, back, ahead if self.using else 0.0, supplied, supplied / PER_FORCE,
                          self.switch.signal if self.switch else math.nan])  # fmt: skip


def _switch(feedback=True):
    return LearnThenUse(30e3, 40e3, 0.4, feedback)


CASES = {
    "feedback": ("feedback", None, False, "feedback", None, 0.0, 0.0),
    "compensation": ("compensation", FIVE, False, "feedback", None, 0.0, 0.0),
    "feedforward": ("feedforward", FIVE[:3], True, "feedback", None, 0.25, 0.0),
    "on the model": ("feedforward", FIVE, True, "model", None, 0.0, 3.0),
    "learn on the feedback": ("feedback", FIVE, True, "feedback", None, 0.0, 0.0),
    "learn, then use": ("learn-then-use", FIVE, True, "feedback", _switch, 0.1, 0.0),
    "as printed": ("learn-then-use", FIVE[:3], True, "feedback", lambda: _switch(False), 0.0, 0.0),
}


@pytest.mark.parametrize("integral", [0.0, 6.0])
@pytest.mark.parametrize("case", CASES)
def test_currents_and_what_is_learnt_equal_the_second_transcription(case, integral):
    mode, weights, learns, error, switch, time, length = CASES[case]
    learners = [Notes(weights) if learns else None for _ in range(2)]
    switches = [switch() if switch else None for _ in range(2)]
    control = SpeedControl(
        COMMAND, Feedback(30.0, integral), Motors(), PERIOD, mode, MEMORY, weights,
        Learning(learners[0], error, switches[0], time, length), OWN,
    )  # fmt: skip
    twin = Twin(
        mode,
        np.zeros(3) if weights is None else weights,
        learners[1],
        error,
        switches[1],
        time,
        length,
        integral,
    )
    controls = SimpleNamespace(torque=np.zeros(2))
    x, speed, signals, rng = 0.0, 5.0, set(), np.random.default_rng(3)
    for k in range(150):
        wanted = float(COMMAND.at(k * PERIOD)[0])
        # most of the time near the command; now and then so far off that the motors are at their limit
        speed = (
            wanted
            + 0.003 * rng.standard_normal()
            + (2.5 if k in (25, 26) else 0.0)
            - 3.0 * (k == 40)
        )
        speed += 1.7 * (110 <= k < 120)
        x += speed * PERIOD
        sense = SimpleNamespace(time=k * PERIOD, speed=speed, position=x, wheel_speed=np.zeros(0))
        assert control(sense, controls) is True
        twin.drive(k * PERIOD, speed, x)
        np.testing.assert_allclose(controls.torque.sum(), twin.rows[-1][6], rtol=1e-9, atol=1e-9)
        signals.add(twin.rows[-1][-1])
    log = control.log()
    found = np.stack([log[name].values for name in LOGGED], axis=1)
    np.testing.assert_allclose(found, twin.rows, rtol=1e-9, atol=1e-7)
    np.testing.assert_array_equal(log["time"], np.arange(150) * PERIOD)
    assert log["weights"].shape == (150, twin.weights.size)
    np.testing.assert_allclose(log["weights"][-1], twin.weights, rtol=1e-12)
    assert not switch or signals == {LEARN, USE}
    if learns:
        assert len(learners[0].heard) > 5
        np.testing.assert_allclose(learners[0].heard, learners[1].heard, rtol=1e-8, atol=1e-6)


def test_the_measured_speed_is_noisy_as_drawn():
    control = SpeedControl(
        COMMAND,
        Feedback(30.0),
        Motors(),
        PERIOD,
        detector=PositionDetector(speed_noise=0.2, seed=4),
    )
    controls = SimpleNamespace(torque=np.zeros(2))
    for k in range(3):
        sense = SimpleNamespace(time=k * PERIOD, speed=5.0, position=0.0, wheel_speed=np.zeros(0))
        control(sense, controls)
    expected = 5.0 + 0.2 * np.random.default_rng(4).standard_normal(3)
    np.testing.assert_allclose(control.log()["measured_speed"], expected)


def test_the_switch_takes_the_mean_square_over_its_window():
    switch = LearnThenUse(10.0, 20.0, window=0.5)
    assert not switch.update(8.0, 0.1)
    assert switch.mean_square == 64.0
    assert not switch.update(13.0, 0.1)
    assert switch.mean_square == pytest.approx(64.0 + 0.2 * (169.0 - 64.0))
    assert [switch.update(9.0, 0.1) for _ in range(3)] == [False, False, True]
    assert (switch.signal, switch.since) == (USE, 0.0)
    assert math.isnan(switch.mean_square)
    assert [switch.update(21.0, 0.1) for _ in range(5)] == [False] * 4 + [True]
    assert switch.signal == LEARN
    at_once = LearnThenUse(10.0, 10.0, window=0.1)
    assert at_once.update(9.9, 0.3)
    assert not at_once.update(10.0, 0.3)
    assert at_once.mean_square == 100.0
    at_once.mean_square = 0.0
    assert not at_once.update(10.0, 0.3)
    assert at_once.mean_square == pytest.approx(100.0)


def test_gains_for_a_train():
    feedback = Feedback.for_train(200e3, 1e-3, 8.0, 20.0)
    assert (feedback.proportional, feedback.integral) == (25.0, 1.25)
    assert Feedback.for_train(200e3, 1e-3, 8.0).integral == 0.0
    feedback.shift(3.0)
    assert feedback.state == -3.0
    only = Feedback(25.0)
    only.shift(3.0)
    assert only.state == 0.0


def test_the_command_holds_what_it_has_reached():
    command = SpeedCommand((1.0, 3.0, 10.0), (2.0, 2.0, 1.0), 0.5, 1.0)
    speed, rate = command.at([0.0, 1.0, 2.0, 3.0, 5.0, 10.0, 11.0, 12.0, 13.0])
    np.testing.assert_allclose(speed, [1.0, 1.0, 1.5, 2.0, 2.0, 2.0, 1.5, 1.0, 1.0])
    np.testing.assert_allclose(rate, [0.0, 0.5, 0.5, 0.0, 0.0, -0.5, -0.5, 0.0, 0.0])
    np.testing.assert_allclose(command.at(1.0 - 5e-10)[0], 1.0)


def test_a_train_is_over_a_change_from_its_front_to_its_rear():
    memory = LineMemory((0.0, 100.0, 200.0), (0.0, 2.5, 2.5))
    assert memory.changes == (100.0,)
    over = memory.straddled([99.9, 100.0, 119.9, 120.0], 20.0)
    assert over.tolist() == [False, True, True, False]
    assert memory.read(-5.0)[1] == 0.0
    assert memory.read(100.0)[1] > 0.0


def test_a_filter_of_no_time_lets_everything_through_and_one_restarted_waits_again():
    sample = Regression(np.array([1.0, 2.0, 3.0]), 4.0, 5.0, 6.0)
    found = RegressionFilter(0.0, 0.1).add(sample, 0)
    assert (found.target, found.feedback, found.acceleration) == (4.0, 5.0, 6.0)
    assert found.regressor.tolist() == [1.0, 2.0, 3.0]
    slow = RegressionFilter(0.25, 0.125)
    outputs = [slow.add(sample, 0) for _ in range(7)]
    assert [one is None for one in outputs] == [True] * 6 + [False]
    assert outputs[6].target == pytest.approx(4.0 * (1.0 - math.exp(-3.5)))
    slow.restart()
    assert slow.add(sample, 0) is None
    with pytest.raises(OnboardError, match="period"):
        RegressionFilter(0.0, 0.0)


def test_limits_are_interpolated_at_the_speed_whatever_its_direction():
    traction = Traction.of(find_set("commuter-8car"))
    step = 1.0 / 3.6
    for speed in (30.3 * step, -30.3 * step):
        expected = 0.7 * traction.drive_limit[:, 30] + 0.3 * traction.drive_limit[:, 31]
        np.testing.assert_allclose(traction.limit(speed, False), expected)
        expected = 0.7 * traction.brake_limit[:, 30] + 0.3 * traction.brake_limit[:, 31]
        np.testing.assert_allclose(traction.limit(speed, True), expected)
    np.testing.assert_allclose(traction.limit(1e4, False), traction.drive_limit[:, -1], rtol=1e-4)
    assert traction.torques(1e9, 5.0)[0] == pytest.approx(traction.limit(5.0, False))


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: SpeedCommand((), (), 0.5), "0 times"),
        (lambda: SpeedCommand((0.0,), (1.0,), math.inf), "acceleration"),
        (lambda: SpeedCommand((0.0,), (1.0,), 0.5, -1.0), "initial"),
        (lambda: LineMemory((), ()), "0 stations"),
        (lambda: LineMemory((0.0,), (math.nan,)), "gradients"),
        (lambda: LineMemory(tunnels=((5.0, 4.0),)), "end later"),
        (lambda: Learning(train_length=-1.0), "train_length"),
        (lambda: Learning(error="force"), "error"),
        (lambda: SpeedControl(COMMAND, Feedback(1.0), Motors(), 0.1, rotating_mass=-1.0), "rotating_mass"),
        (lambda: SpeedControl(COMMAND, Feedback(1.0), Motors(), 0.1, weights=np.full(3, np.nan)), "weights"),
        (lambda: SpeedControl(COMMAND, Feedback(1.0), Motors(), 0.1, "learn-then-use",
                              learning=Learning(Notes(FIVE))), "a switch"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(make, named):
    with pytest.raises(OnboardError, match=named):
        make()
