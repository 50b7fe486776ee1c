"""The speed control: its parts, its detector of position, and period by period against a second transcription."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.onboard.line_memory import (
    CoilCounter,
    Detection,
    LineMemory,
    Motion,
    Odometer,
    PositionDetector,
    Regression,
    RegressionFilter,
    compensation_force,
    feedforward_force,
    regressor,
)
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
from alloc.plant.laws import GRAVITY, gradient_force
from alloc.plant.sets import find_set
from tests.cases import looped


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


TEN, HUNDRED = SpeedCommand((0.0,), (10.0,), 0.5), Feedback(100.0)


TRACTION = Traction.of(find_set("commuter-8car"))


@looped(("make", "named"), [
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
        (lambda: SpeedControl(TEN, HUNDRED, TRACTION, 0.0), "period"),
        (lambda: SpeedControl(TEN, HUNDRED, TRACTION, 0.1, "guess"), "mode"),
        (lambda: SpeedControl(TEN, HUNDRED, TRACTION, 0.1, "compensation"), "weights"),
        (lambda: SpeedControl(TEN, HUNDRED, TRACTION, 0.1, weights=np.ones(2)), "weights"),
        (lambda: SpeedControl(TEN, HUNDRED, TRACTION, 0.1, "learn-then-use", weights=np.ones(3)),
         "learner"),
    ])  # fmt: skip
def test_bad_input_is_refused(make, named):
    with pytest.raises(OnboardError, match=named):
        make()


TENTH, PER_FORCE, MOST, OWN = 0.1, 1e-3, 60.0, 9e3


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
        share = 1.0 - math.exp(-TENTH / self.time) if self.time else 1.0
        out = 0.0
        for sample in self.samples:
            out = out + share * (sample - out)
        return None if len(self.samples) <= math.ceil(3.0 * self.time / TENTH) else out

    def learn(self, speed, x):
        if self.last is None:
            return None
        v, at, supplied, back, bounded = self.last
        middle, change = (x + at) / 2.0, (speed - v) / TENTH
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
        if self.switch and error is not None and self.switch.update(error, TENTH):
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
            self.state += self.integral * (wanted - speed) * TENTH
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


@looped("integral", [0.0, 6.0])
@looped("case", CASES)
def test_currents_and_what_is_learnt_equal_the_second_transcription(case, integral):
    mode, weights, learns, error, switch, time, length = CASES[case]
    learners = [Notes(weights) if learns else None for _ in range(2)]
    switches = [switch() if switch else None for _ in range(2)]
    control = SpeedControl(
        COMMAND, Feedback(30.0, integral), Motors(), TENTH, mode, MEMORY, weights,
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
        wanted = float(COMMAND.at(k * TENTH)[0])
        # most of the time near the command; now and then so far off that the motors are at their limit
        speed = (
            wanted
            + 0.003 * rng.standard_normal()
            + (2.5 if k in (25, 26) else 0.0)
            - 3.0 * (k == 40)
        )
        speed += 1.7 * (110 <= k < 120)
        x += speed * TENTH
        sense = SimpleNamespace(time=k * TENTH, speed=speed, position=x, wheel_speed=np.zeros(0))
        assert control(sense, controls) is True
        twin.drive(k * TENTH, speed, x)
        np.testing.assert_allclose(controls.torque.sum(), twin.rows[-1][6], rtol=1e-9, atol=1e-9)
        signals.add(twin.rows[-1][-1])
    log = control.log()
    found = np.stack([log[name].values for name in LOGGED], axis=1)
    np.testing.assert_allclose(found, twin.rows, rtol=1e-9, atol=1e-7)
    np.testing.assert_array_equal(log["time"], np.arange(150) * TENTH)
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
        TENTH,
        detector=PositionDetector(speed_noise=0.2, seed=4),
    )
    controls = SimpleNamespace(torque=np.zeros(2))
    for k in range(3):
        sense = SimpleNamespace(time=k * TENTH, speed=5.0, position=0.0, wheel_speed=np.zeros(0))
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


@looped(("make", "named"), [
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
    ])  # fmt: skip
def test_what_no_control_can_be_is_refused(make, named):
    with pytest.raises(OnboardError, match=named):
        make()


PERIOD = 0.05


def ride(detector, start=0.0, seconds=60.0, creep=(0.0, 0.0)):
    """True and detected positions and speeds of a train that speeds up from 10 m/s; its wheels creep by these shares."""
    time = np.arange(0.0, seconds, PERIOD)
    speed = 10.0 + 0.2 * time
    position = start + 10.0 * time + 0.1 * time**2
    detection = Detection(detector, PERIOD)
    found = [
        detection.read(t, x, v, v * (1.0 + np.array(creep)))
        for t, x, v in zip(time.tolist(), position.tolist(), speed.tolist(), strict=True)
    ]
    return position, speed, *np.array(found).T


def test_without_errors_position_and_speed_are_the_trains():
    position, speed, found, read = ride(PositionDetector())
    assert found.tolist() == position.tolist()
    assert read.tolist() == speed.tolist()


@looped("seed", range(5))
def test_the_error_grows_with_the_way_since_the_last_station_alone(seed):
    g = np.random.default_rng(seed)
    scale = float(g.uniform(-0.05, 0.05))
    stations = tuple(np.sort(g.uniform(-300.0, 900.0, 5)).tolist())
    residuals = tuple(g.normal(0.0, 3.0, 5).tolist())
    position, speed, found, read = ride(PositionDetector(Odometer(scale, stations, residuals)))
    last = np.searchsorted(stations, position, side="right") - 1
    come = np.where(last >= 0, position - np.array(stations)[last], position)
    expected = np.where(last >= 0, np.array(residuals)[last], 0.0) + scale * come
    np.testing.assert_allclose(found - position, expected, atol=1e-6)
    np.testing.assert_allclose(read, (1.0 + scale) * speed)


def test_between_stations_creep_of_the_counted_axles_is_counted_as_way():
    mean = PositionDetector(Odometer(stations=(0.0,)))
    second = PositionDetector(Odometer(stations=(0.0,), axles=(1,)))
    for detector, share in ((mean, 0.005), (second, 0.01)):
        position, _, found, _ = ride(detector, creep=(0.0, 0.01))
        np.testing.assert_allclose(found, (1.0 + share) * position, rtol=1e-9, atol=1e-9)


@looped("spacing", [0.3, 1.7, 40.0])
def test_counted_coils_give_the_last_coils_place_and_the_mean_speed_between_coils(spacing):
    position, speed, found, read = ride(PositionDetector(CoilCounter(spacing)), start=3.0)
    np.testing.assert_allclose(found, spacing * np.floor(position / spacing), atol=1e-9)
    # instants at which the ride passes its coils, in closed form: 3 + 10 t + 0.1 t^2
    coils = spacing * np.arange(
        np.floor(3.0 / spacing) + 1.0, np.floor(position[-1] / spacing) + 1.0
    )
    passed = (-10.0 + np.sqrt(100.0 + 0.4 * (coils - 3.0))) / 0.2
    count = np.floor(position / spacing) - np.floor(3.0 / spacing)
    # where a period passes several, the last of them counts
    last = np.unique(count[count >= 1].astype(int)) - 1
    mean = np.diff(coils[last]) / np.diff(passed[last])
    at = np.searchsorted(last, count - 1, side="left")
    expected = np.append(speed[0], mean)[np.where(count < 1, 0, at)]
    np.testing.assert_allclose(read, expected, rtol=1e-3)
    # by what the speed gains since the middle between two coils
    behind = (speed - read)[count >= 2]
    assert np.all(np.abs(behind) <= 0.2 * (1.5 * spacing / 10.0 + 2 * PERIOD))


def test_where_no_coil_comes_any_more_the_counted_speed_dies_out():
    detection = Detection(PositionDetector(CoilCounter(2.0)), PERIOD)
    read = []
    for t in np.arange(0.0, 20.0, PERIOD).tolist():  # stops within 10 s, on 25 m
        gone = min(t, 10.0)
        read.append(
            detection.read(t, 5.0 * gone - 0.25 * gone**2, 5.0 - 0.5 * gone, np.zeros(1))[1]
        )
    assert np.all(np.diff(read) <= 1e-9)
    assert read[-1] == pytest.approx(2.0 / 11.0, rel=0.2)  # the last coil was at 24 m, at 8 s


@looped("periods", [0.3, 1.0, 4.0, 9.7])
def test_a_delay_shows_what_was_and_at_first_what_was_first(periods):
    delay = periods * PERIOD
    position, speed, found, read = ride(PositionDetector(delay=delay))
    first = math.ceil(periods)
    np.testing.assert_allclose(read[first:], speed[first:] - 0.2 * delay, rtol=1e-12)
    np.testing.assert_allclose(
        found[first:], np.interp(PERIOD * np.arange(first, 1200) - delay, PERIOD * np.arange(1200), position)
    )  # fmt: skip
    assert set(found[:first]) == {position[0]}


def test_car_by_car_the_memory_has_the_sum_over_the_cars():
    lengths, masses = np.array([12.0, 30.0, 18.0]), np.array([90e3, 20e3, 50e3])
    middles = 0.5 * lengths - np.cumsum(lengths)
    memory = LineMemory(
        (0.0, 100.0, 130.0), (0.5, 3.0, -3.0), ((90.0, 120.0),), tuple(middles.tolist()),
        tuple((lengths / 60.0).tolist()), tuple((masses / 160e3).tolist()),
    )  # fmt: skip
    for x in np.linspace(60.0, 240.0, 91):
        cars = x + middles
        rise = np.where(cars < 100.0, 0.005, np.where(cars < 130.0, 0.03, -0.03))
        tunnel, slope = memory.read(x)
        assert 160e3 * slope == pytest.approx(gradient_force(masses, rise).sum())
        assert 60.0 * tunnel == pytest.approx(lengths[(cars >= 90.0) & (cars < 120.0)].sum())


@looped(
    ("make", "named"),
    [
        (lambda: Odometer(scale_error=math.nan), "scale_error"),
        (lambda: Odometer(scale_error=-0.6), "scale_error"),
        (lambda: Odometer(stations=(0.0, 0.0)), "grow"),
        (lambda: Odometer(stations=(math.inf,)), "stations"),
        (lambda: Odometer(stations=(0.0, 9.0), residuals=(1.0,)), "1 residuals"),
        (lambda: Odometer(axles=(-1,)), "axles"),
        (lambda: CoilCounter(0.0), "spacing"),
        (lambda: CoilCounter(math.inf), "spacing"),
        (lambda: PositionDetector(delay=-0.1), "delay"),
        (lambda: PositionDetector(delay=math.inf), "delay"),
        (lambda: PositionDetector(speed_noise=math.nan), "speed_noise"),
        (lambda: ride(PositionDetector(Odometer(axles=(2,)))), "number of axles"),
        (lambda: LineMemory(offsets=(0.0, -9.0), mass_shares=(1.0,)), "mass_shares"),
        (lambda: LineMemory(offsets=(0.0, -9.0), air_shares=(0.7, 0.7)), "air_shares"),
    ],
)
def test_what_cannot_be_is_refused(make, named):
    with pytest.raises(OnboardError, match=named):
        make()
