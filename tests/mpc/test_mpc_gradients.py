"""What every predictive controller expects of the train's speed on a gradient is what the plant then does."""

import numpy as np
import pytest

from alloc.onboard.host import HostedController, each_unit
from alloc.onboard.parameters import Belief, Braking, Onboard
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import find_set
from alloc.simulation import DriverCommand, Event, simulate
from mpc.hosted import MPC_CAR, MPC_TRAIN, MPC_TRAIN_IDEAL
from mpc.period import RealTimeIteration
from mpc.train import JointProblem
from mpc.unit import MpcController

EACH = HostedController("each", "mpc in Python", each_unit(lambda one: MpcController(one)))
KINDS = {
    "mpc": EACH,
    "mpc-car": MPC_CAR,
    "mpc-train": MPC_TRAIN,
    "mpc-train-ideal": MPC_TRAIN_IDEAL,
}
PERIOD, HORIZON, SETTLED = 0.01, 20, 2.5


@pytest.fixture
def predictions(monkeypatch):
    """Filled by a run: instant, first state's delay [s], speeds over the horizon and torques of each problem solved."""
    found, begin = [], [0.0]
    solve, joint = RealTimeIteration.solve, JointProblem.solve

    def watched(self, problem):
        solution = solve(self, problem)
        states, _ = self.course(solution.torques)
        found.append((begin[0], states[:, 0], solution.torques.reshape(HORIZON, -1)))
        return solution

    def watched_joint(self, reports, commands, leader=0):
        # from the instant on at which its orders act
        begin[0] = reports[leader].time + PERIOD * commands[leader].size
        answer = joint(self, reports, commands, leader)
        begin[0] = 0.0
        return answer

    monkeypatch.setattr(RealTimeIteration, "solve", watched)
    monkeypatch.setattr(JointProblem, "solve", watched_joint)
    return found


def _event(grade, acceleration, failures=None):
    model = build(
        find_set("commuter-8car"), Rail(0.3), Line(grades=(grade,)), failures=failures or {}
    )
    onboard = Onboard(belief=Belief(), braking=Braking(blended=False))
    command = DriverCommand((0.0,), (acceleration,))
    return Event("gradient", model, command, onboard, duration=SETTLED + 0.6, initial_speed=18.0)


def _largest_error(event, controller, predictions):
    """Of the speed at the end of the horizon [m/s], of the problems solved once beliefs have settled."""
    predictions.clear()
    run = simulate(event, "alone", controller)
    assert run.attrs["controller_failures"] == 0
    time, speed = run["time"].values, run["speed"].values
    command = np.abs(run["torque_command"].values)
    found = [one for one in predictions if one[0] > SETTLED][:1]  # of the train's joint problem
    if not found:
        each = len(predictions) // (time.size - 1)
        first = round(SETTLED / PERIOD) * each
        found = [(SETTLED, *one[1:]) for one in predictions[first : first + each]]
    errors = []
    for begin, expected, torques in found:
        k = round(begin / PERIOD)
        # the plant's torques are those of the prediction: nothing but the forces is compared
        total = command[k : k + HORIZON].mean(axis=0).sum() * torques.shape[1] / command.shape[1]
        np.testing.assert_allclose(torques.mean(axis=0).sum(), total, rtol=0.01)
        errors.append(abs(abs(expected[-1]) - speed[k + HORIZON]))
    return max(errors)


@pytest.mark.parametrize("name", KINDS)
def test_the_predicted_speed_is_the_plants(predictions, name):
    """20 per mille are 0.04 m/s over the horizon, and twice as much with the delay of telegrams."""
    for acceleration in (0.3, -0.5):
        for grade in (-0.02, 0.0, 0.02):
            error = _largest_error(_event(grade, acceleration), KINDS[name], predictions)
            assert error < 2e-3, (acceleration, grade)


@pytest.mark.parametrize("name", ["mpc-train", "mpc-train-ideal"])
def test_a_unit_without_motors_is_no_drag_on_the_train(predictions, name):
    """Its part of the train's mass holds every other unit back, and the joint problem moves it itself."""
    for grade in (-0.02, 0.02):
        error = _largest_error(_event(grade, 0.3, {1: 0.5}), KINDS[name], predictions)
        assert error < 2e-3, grade
