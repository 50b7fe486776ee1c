"""Learning from a log: exact weights leave nothing of a log that obeys the law, whatever line and speed it has."""

import numpy as np
import pytest
import xarray as xr

from alloc.errors import EstimationError
from alloc.estimation.running_resistance import Learner, RunLog, learn_from_log
from alloc.onboard.line_memory import LineMemory
from alloc.plant.laws import GRAVITY

TRUE = np.array([12.0, 20.0, 250e3, 3e3, 140.0])
ROTATING = 20e3
PERIOD = 0.5
MEMORY = LineMemory(stations=(0.0, 300.0), gradients=(0.0, 2.0), tunnels=((500.0, 800.0),))


class Witness(Learner):
    """Learns nothing and keeps what it was asked to learn."""

    def _learn(self, regressor, error, acceleration):
        self.seen = [*getattr(self, "seen", []), (regressor, error, acceleration)]


def log(**changes):
    """A log of 60 s that obeys F = (W1 or W2) V^2 + W3 (a + g sin) + A + B V + M_r a over every interval, written out."""
    time = PERIOD * np.arange(121)
    speed = 15.0 + 4.0 * np.sin(time / 7.0)
    position = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * PERIOD)])
    force = np.zeros(time.size)
    for k in range(time.size - 1):
        v, a = (speed[k] + speed[k + 1]) / 2, (speed[k + 1] - speed[k]) / PERIOD
        x = (position[k] + position[k + 1]) / 2
        air = 20.0 if 500.0 <= x < 800.0 else 12.0
        slope = GRAVITY * 0.02 / np.sqrt(1.0 + 0.02**2) if x >= 300.0 else 0.0
        force[k] = air * v**2 + 250e3 * (a + slope) + 3e3 + 140.0 * v + 20e3 * a
    return RunLog(**{"time": time, "position": position, "speed": speed, "force": force} | changes)


def test_exact_weights_leave_nothing():
    learner = Witness(TRUE)
    found = learn_from_log(log(), MEMORY, learner, ROTATING)
    np.testing.assert_allclose(found.error, 0.0, atol=1e-6)
    assert found.weights.shape == (120, 5)
    assert len(learner.seen) == 120
    # what was learnt from, of the first interval
    regressor, _, acceleration = learner.seen[0]
    v, w = 15.0, 15.0 + 4.0 * np.sin(0.5 / 7.0)
    mean, a = (v + w) / 2, (w - v) / 0.5
    np.testing.assert_allclose(regressor, [mean**2, 0.0, a, 1.0, mean], rtol=1e-12)
    assert acceleration == pytest.approx(a)
    for weight, status in zip(TRUE, found.excitation.weights, strict=True):
        assert status.value == pytest.approx(weight, rel=1e-6)


def test_weights_of_every_instant_are_kept():
    class Counting(Learner):
        def _learn(self, regressor, error, acceleration):
            self.weights = self.weights + 1.0

    found = learn_from_log(log(), MEMORY, Counting(TRUE[:3]))
    np.testing.assert_allclose(found.weights[:, 0], 12.0 + 1.0 + np.arange(120))
    np.testing.assert_array_equal(found.time, PERIOD * np.arange(120))


def test_samples_over_a_change_of_the_line_and_those_not_kept_are_left_out():
    whole = log()
    middle = 0.5 * (whole.position[1:] + whole.position[:-1])
    under = np.zeros(120, dtype=bool)
    for change in (300.0, 500.0, 800.0):  # the train is 40 m long
        under |= (middle >= change) & (middle < change + 40.0)
    assert 0 < under.sum() < 20
    late = whole.time[:-1] >= 10.0
    found = learn_from_log(
        whole, MEMORY, Witness(TRUE), ROTATING, train_length=40.0, keep=lambda time: time >= 10.0
    )
    np.testing.assert_array_equal(np.isfinite(found.error), late & ~under)
    with pytest.raises(EstimationError, match="no sample is left"):
        learn_from_log(whole, MEMORY, Witness(TRUE), keep=lambda time: time > 1e3)


def test_a_filter_takes_samples_once_it_has_settled_and_starts_anew_in_a_tunnel():
    whole = log()
    found = learn_from_log(whole, MEMORY, Witness(TRUE), ROTATING, filter_time=1.0)
    middle = 0.5 * (whole.position[1:] + whole.position[:-1])
    inside = (middle >= 500.0) & (middle < 800.0)
    taken = np.isfinite(found.error)
    np.testing.assert_allclose(found.error[taken], 0.0, atol=1e-5)
    starts = [0, *(np.flatnonzero(np.diff(inside.astype(int))) + 1)]
    # three time constants of 1 s are 6 samples of 0.5 s: the seventh is the first
    expected = np.ones(120, dtype=bool)
    for start in starts:
        expected[start : start + 6] = False
    np.testing.assert_array_equal(taken, expected)
    with pytest.raises(EstimationError, match="no section is long enough"):
        learn_from_log(whole, MEMORY, Witness(TRUE), filter_time=100.0)


def test_a_filter_starts_anew_after_samples_that_were_left_out():
    found = learn_from_log(
        log(),
        LineMemory(),
        Witness(TRUE),
        filter_time=1.0,
        keep=lambda time: abs(time - 25.0) > 2.0,
    )
    # samples at 23.0 to 27.0 s are left out, that is 46 to 54; each stretch gives its seventh first
    k = np.arange(120)
    expected = ((k >= 6) & (k < 46)) | (k >= 55 + 6)
    np.testing.assert_array_equal(np.isfinite(found.error), expected)


def test_commanded_speed_and_acceleration_stand_in_for_the_measured_ones():
    whole = log()
    rate = np.append(np.diff(whole.speed) / PERIOD, 0.0)
    told = log(speed=0.0 * whole.speed, commanded_speed=whole.speed, commanded_acceleration=rate)
    found = learn_from_log(told, MEMORY, Witness(TRUE), ROTATING, source="commanded")
    np.testing.assert_allclose(found.error, 0.0, atol=1e-6)
    with pytest.raises(EstimationError, match="no commanded speed"):
        learn_from_log(whole, MEMORY, Witness(TRUE), source="commanded")
    with pytest.raises(EstimationError, match="source = 'guessed'"):
        learn_from_log(whole, MEMORY, Witness(TRUE), source="guessed")


def recorded(pressure=0.0):
    """Two units of two and one axles, and one axle without motor."""
    return xr.Dataset(
        {
            "axle_unit": ("axle", [0, 0, -1, 1]),
            "unit_gear": ("unit", [6.0, 7.0]),
            "unit_radius": ("unit", [0.5, 0.4]),
            "motor_torque": (("time", "unit"), [[0.0, 0.0], [100.0, 200.0], [300.0, 500.0]]),
            "position": ("time", [5.0, 6.0, 8.0]),
            "car_speed": (("time", "car"), [[1.0, 9.0], [2.0, 9.0], [4.0, 9.0]]),
            "cylinder_pressure": (("time", "brake_group"), np.full((3, 1), pressure)),
        },
        coords={"time": [0.0, 1.0, 2.0]},
    )


def test_a_recorded_run_is_a_log_of_the_foremost_car_and_of_all_motors():
    # 24 N per N m of unit 0 (2 x 6 / 0.5), 17.5 of unit 1; what acts in an interval is recorded at its end
    told = RunLog.of_run(recorded(0.9e3))  # 0.01 bar is no braking
    one, two = 100.0 * 24.0 + 200.0 * 17.5, 300.0 * 24.0 + 500.0 * 17.5
    assert told.force == pytest.approx([one, two, two])
    assert told.speed.tolist() == [1.0, 2.0, 4.0]
    assert told.position.tolist() == [5.0, 6.0, 8.0]
    assert told.period == 1.0
    noise = RunLog.of_run(recorded(), 0.5, seed=3).speed - told.speed
    np.testing.assert_allclose(noise, 0.5 * np.random.default_rng(3).standard_normal(3))


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: RunLog.of_run(recorded(1.1e3)), "air brakes acted"),
        (lambda: log(time=0.5 * np.arange(121) ** 1.01), "even steps"),
        (lambda: log(time=-0.5 * np.arange(121)), "must grow"),
        (lambda: log(speed=np.zeros(3)), "speed has shape"),
        (lambda: RunLog(*np.zeros((4, 2))), "3 samples"),
    ],
)
def test_logs_that_cannot_be_learnt_from_are_refused(make, named):
    with pytest.raises(EstimationError, match=named):
        make()
