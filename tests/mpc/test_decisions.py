"""What the MPC's controllers ask and answer in each control period, whatever their solvers do."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import mpc.train as joint_problem
import mpc.train as train_controller
from alloc.onboard.host import TorqueDecision
from alloc.onboard.parameters import Telegrams
from alloc.plant.adhesion import RationalCurve
from alloc.plant.laws import GRAVITY
from mpc.belief import with_predicted_curve
from mpc.condensing import STEEPEST_SLOPE
from mpc.group import CarControllers, GroupController, GroupProblem, WheelsAndRail, even_split
from mpc.hosted import MPC, MPC_CAR, MPC_TRAIN, MPC_TRAIN_IDEAL
from mpc.model import air_place, parameters, torque_per_coefficient
from mpc.period import HorizonSolution, PredictiveController, RealTimeIteration, cost_of
from mpc.settings import GroupSettings, MpcSettings, PeakBelief
from mpc.train import NO_SLIP_LIMIT, JointProblem, Report, TrainMpc
from mpc.unit import STATUSES
from tests.cases import looped
from tests.mpc.made_problems import Telegraphy


class Solver:
    """Notes what it is told; answers `torques`."""

    def __init__(self, torques, status="ok"):
        self.calls, self.torques, self.status = [], np.asarray(torques, float), status

    def restart(self, torque):
        self.calls.append(("restart", np.asarray(torque).tolist()))

    def shift(self):
        self.calls.append("shift")

    def solve(self, problem):
        self.calls.append("solve")
        self.problem = problem
        return HorizonSolution(self.torques, 1.0, 0.25, 1, self.status)


class Controller(PredictiveController):
    """Notes what it is asked to believe and to solve."""

    def __init__(self, contexts, settings, solver):
        super().__init__(contexts, settings, solver)
        self.forgotten, self.believed, self.asked = 0, None, None
        self.belief = SimpleNamespace(forget_forces=self._forget)

    def _forget(self):
        self.forgotten += 1

    def _believe(self, *readings):
        self.believed = [np.asarray(value).tolist() for value in readings]

    def _problem(self, *readings):
        self.asked = [np.asarray(value).tolist() for value in readings]
        return "the problem"


@pytest.fixture
def pair(make_context):
    """Controller of two units of 1 and 2 axles, and its solver."""
    contexts = [make_context(axles=1), make_context(axles=2)]
    solver = Solver([10.0, 20.0, 30.0, 40.0])
    return Controller(contexts, MpcSettings(), solver), solver


def _senses(make_sense, targets=(500.0, 400.0), torques=(100.0, 200.0)):
    return [
        make_sense(target=targets[0], torque=torques[0], axles=1, drive_limit=1000.0, brake_limit=800.0, coefficient=0.05),
        make_sense(target=targets[1], torque=torques[1], axles=2, drive_limit=1100.0, brake_limit=900.0, coefficient=0.06),
    ]  # fmt: skip


def test_a_period_restarts_then_shifts_and_commands_the_first_torques(pair, make_sense):
    controller, solver = pair
    answers = controller._answer(_senses(make_sense))
    assert solver.calls == [("restart", [100.0, 200.0]), "solve"]
    assert [(a.torque, a.ok, a.status, a.residual) for a in answers] == [
        (10.0, True, "ok", 0.25), (20.0, True, "ok", 0.25),
    ]  # fmt: skip
    assert [a.solve_time for a in answers] == [1e-3] * 2
    speed, omega, torque, wanted, estimate = controller.believed
    assert (speed, torque, estimate) == ([10.0, 10.0], [100.0, 200.0], [0.05, 0.06])
    np.testing.assert_allclose(omega, 10.02 / 0.43)
    assert wanted == [500.0, 400.0]
    assert controller.asked == [speed, omega, torque, [500.0, 400.0], [1000.0, 1100.0]]
    assert solver.problem == "the problem"
    controller._answer(_senses(make_sense))
    assert solver.calls[2:] == ["shift", "solve"]
    assert controller.forgotten == 1
    assert controller._before.tolist() == [10.0, 20.0]
    solver.torques[:] = 0.0
    assert controller._before.tolist() == [10.0, 20.0]


def test_braking_is_mirrored_and_a_change_of_direction_starts_anew(pair, make_sense):
    controller, solver = pair
    controller._answer(_senses(make_sense))
    answers = controller._answer(_senses(make_sense, (-500.0, -400.0), (100.0, -200.0)))
    assert solver.calls[2:] == [("restart", [0.0, 200.0]), "solve"]
    assert [a.torque for a in answers] == [-10.0, -20.0]
    assert controller.asked[0] == [-10.0, -10.0]
    assert controller.asked[1][0] < 0.0
    assert controller.asked[2:] == [[-100.0, 200.0], [500.0, 400.0], [800.0, 900.0]]
    assert controller.believed[3] == [500.0, 400.0]
    # what the motors cannot give is not wanted of the rail
    controller._answer(_senses(make_sense, (-950.0, -850.0), (100.0, -200.0)))
    assert controller.believed[3] == [800.0, 850.0]
    assert controller.forgotten == 2


def test_without_demand_nothing_is_solved_and_the_direction_is_kept(pair, make_sense):
    controller, solver = pair
    controller._answer(_senses(make_sense, (-500.0, -400.0)))
    solver.calls.clear()
    answers = controller._answer(_senses(make_sense, (0.0, 0.0)))
    assert solver.calls == ["shift", ("restart", 0.0)]
    assert [(a.torque, a.ok, a.residual) for a in answers] == [(0.0, True, 0.0)] * 2
    assert controller.believed[0] == [-10.0, -10.0]
    assert controller._before.tolist() == [0.0, 0.0]
    controller._sign = 0.0
    controller._answer(_senses(make_sense, (0.0, 0.0)))
    assert controller.believed[0] == [10.0, 10.0]


def test_a_step_other_than_the_period_is_not_shifted(make_context, make_sense):
    solver = Solver([10.0, 20.0])
    contexts = [make_context(axles=1), make_context(axles=2)]
    controller = Controller(contexts, MpcSettings(step=0.02), solver)
    for _ in range(2):
        controller._answer(_senses(make_sense))
    assert solver.calls == [("restart", [100.0, 200.0]), "solve", "solve"]


def test_time_is_that_of_the_steps_and_late_is_what_none_fits_into(make_context, make_sense):
    contexts = [make_context(axles=1), make_context(axles=2)]
    for step_time, status in ((0.01, "ok"), (0.0101, "late")):
        settings = MpcSettings(step_time=step_time, deadline=4.0)
        controller = Controller(contexts, settings, Solver([10.0, 20.0]))
        answers = controller._answer(_senses(make_sense))
        assert [(a.status, a.ok) for a in answers] == [(status, status == "ok")] * 2
        assert answers[0].solve_time == step_time
        assert (controller._sign == 0.0) == (status == "late")


@pytest.mark.parametrize("status", ["not finite", "QP flag -1"])
def test_what_a_solver_says_reaches_the_unit_and_starts_anew(pair, make_sense, status):
    controller, solver = pair
    solver.status = status
    answers = controller._answer(_senses(make_sense))
    assert [(a.torque, a.ok, a.status, a.residual) for a in answers] == [
        (0.0, False, status, 0.25)
    ] * 2
    solver.calls.clear()
    controller._answer(_senses(make_sense))
    assert solver.calls[0] == ("restart", [100.0, 200.0])


# --- groups


def test_the_cost_is_made_of_the_units_values(make_context):
    units = [make_context(axles=2, mass=40e3), make_context(axles=4, mass=60e3, axle_load=70e3)]
    settings = MpcSettings()
    cost = cost_of(units, settings, 0.07)
    np.testing.assert_allclose(cost.unit.share, [0.4, 0.6])
    np.testing.assert_allclose(cost.axle.share, [0.2, 0.2, 0.15, 0.15, 0.15, 0.15])
    carried = [torque_per_coefficient(one) for one in units]
    np.testing.assert_allclose(cost.unit.scale, np.multiply(0.1, carried))
    w = settings.weights
    assert tuple(cost.weights) == (w.tracking, w.slip, w.rate, 0.07, w.slip_scale)
    assert cost_of(units, settings).weights.evenness == 0.0
    twisting = [units[0], replace(units[1], twisting=True)]
    assert cost_of(twisting, settings).weights.rate == w.twisting_rate > w.rate
    for values in (*cost.unit[:3], cost.axle.slip_limit):
        assert not values.any()
    slip = np.zeros((6, 9))  # speed, six axles, two torques
    slip[:, 0], slip[range(6), range(1, 7)] = -1.0, 0.43
    np.testing.assert_allclose(cost.slip_matrix, slip)


@pytest.fixture
def no_solver(monkeypatch):
    """In place of the real-time iteration, one that notes with what it was made."""
    made = []

    class Noted(Solver):
        def __init__(self, units, settings, evenness=0.0):
            super().__init__(np.arange(100.0))
            made.append((units, settings, evenness))

    for maker in (GroupProblem, GroupController):
        assert maker.__init__.__defaults__ == (None, RealTimeIteration)
        monkeypatch.setattr(maker.__init__, "__defaults__", (None, Noted))
    return made


SETTINGS = MpcSettings(headroom=0.2, belief=PeakBelief(initial=0.3), group=GroupSettings(steps=2))


def test_a_groups_problem_says_what_is_believed(make_context, no_solver):
    units = [make_context(axles=1, radius=0.42), make_context(axles=2, radius=0.44)]
    group = GroupProblem(units, SETTINGS, 2)
    predicted = tuple(map(with_predicted_curve, units))
    assert no_solver == [(predicted, replace(SETTINGS, iterations=2), SETTINGS.group.evenness)]
    GroupProblem(units, SETTINGS)
    assert no_solver[1][1] is SETTINGS
    assert group.unit.tolist() == [0, 1, 1]
    assert group.radius.tolist() == [0.42, 0.44, 0.44]
    np.testing.assert_array_equal(group._parameters, parameters(predicted, 0.3))
    omega, torque = np.array([20.0, 21.0, 22.0]), np.array([100.0, 200.0])
    peak, slip_limit, carried = (
        np.array([0.1, 0.2, 0.3]),
        np.array([0.1, 0.2, 0.3]),
        np.array([300.0, 500.0]),
    )
    target, before, limit = (
        np.array([400.0, 450.0]),
        np.array([90.0, 190.0]),
        np.array([350.0, 900.0]),
    )
    air = np.array([40.0, 60.0])
    drag = np.array([0.01, 0.02])
    rail, curve = WheelsAndRail(peak, slip_limit, carried, air, drag), RationalCurve(0.08, 2.2)
    problem = group.problem((9.0, omega, torque), rail, curve.q[:2], target, before, limit)
    assert problem.state.tolist() == [9.0, 20.0, 21.0, 22.0, 100.0, 200.0]
    believed = [replace(one, curve=curve) for one in units]
    expected = parameters(believed, peak, 0.015)
    expected[air_place(believed)] = air
    np.testing.assert_array_equal(problem.parameters, expected)
    np.testing.assert_array_equal(problem.slip_limit, slip_limit)
    assert (problem.target is target, problem.before is before) == (True, True)
    np.testing.assert_allclose(problem.upper, [350.0, 600.0])
    scale = np.array([0.1 * torque_per_coefficient(one) for one in units])
    np.testing.assert_allclose(
        problem.reference, even_split(target, carried, limit, scale, np.array([0.5, 0.5]))
    )
    # a curve of which the axle with the highest peak makes too steep a one is not predicted with
    steep = group.problem((9.0, omega, torque), rail, np.array([0.03, 2.2]), target, before, limit)
    assert RationalCurve(*steep.parameters[-6:-4]).steepest_slope(0.3) <= STEEPEST_SLOPE * (
        1 + 1e-9
    )


def test_the_curve_of_a_group_with_load_transfer_is_where_its_model_has_it(make_context, no_solver):
    units = [make_context(axles=2, unloading=(0.1, -0.1)), make_context(axles=1, unloading=(0.2,))]
    one, two = np.ones(2), np.ones(3)
    rail = WheelsAndRail(0.1 * two, 0.05 * two, one, 0.0 * one, 0.0 * one)
    problem = GroupProblem(units, SETTINGS).problem(
        (9.0, 20.0 * two, one), rail, np.array([0.09, 3.0]), one, one, one
    )
    believed = [replace(unit, curve=RationalCurve(0.09, 3.0)) for unit in units]
    np.testing.assert_array_equal(problem.parameters, parameters(believed, 0.1))


@looped("count", [1, 2])
def test_a_group_keeps_the_slip_of_every_axle_and_a_unit_alone_its_target(
    make_context, make_sense, no_solver, count
):
    units = [make_context(axles=2, mass=40e3), make_context(axles=2, mass=60e3)][:count]
    controller = GroupController(units, SETTINGS)
    senses = [make_sense(speed=10.0 + j, slip=0.03, target=50.0, axles=2) for j in range(count)]
    answers = controller.decide(senses)
    problem = controller._solver.problem
    mean = 10.6 if count == 2 else 10.0
    np.testing.assert_allclose(
        problem.state[: 1 + 2 * count], [mean, *[(mean + 0.03) / 0.43] * 2 * count]
    )
    assert [a.torque for a in answers] == [0.0, 1.0][:count]
    carried = np.minimum(1.2 * controller.belief.carried_torque(), 1150.0)
    np.testing.assert_allclose(problem.upper, np.minimum(carried, 50.0) if count == 1 else carried)
    np.testing.assert_array_equal(problem.parameters[: 2 * count], controller.belief.peak)


def test_every_car_has_its_controller(make_context, make_sense, no_solver):
    units = [make_context(axles=1, car=c) for c in (1, 1, 3)]
    cars = CarControllers(units, SETTINGS)
    assert [len(members) for members in cars.cars] == [2, 1]
    answers = cars.decide([make_sense(axles=1, torque=10.0 * j) for j in range(3)])
    assert [a.torque for a in answers] == [0.0, 1.0, 0.0]
    assert cars.controllers[0]._solver.calls[0] == ("restart", [0.0, 10.0])
    assert cars.controllers[1]._solver.calls[0] == ("restart", [20.0])


def test_hosted_names_stand_for_their_controllers(make_context, no_solver):
    units = [make_context(axles=1, car=c, settings=SETTINGS) for c in (0, 1)]
    assert [one.statuses for one in MPC.factory(units[:1])] == [STATUSES]
    (compiled,) = MPC.factory(units[:1])
    assert compiled.kept[1]._settings is SETTINGS
    for hosted, kind in (
        (MPC_CAR, CarControllers),
        (MPC_TRAIN, TrainMpc),
        (MPC_TRAIN_IDEAL, GroupController),
    ):
        made = hosted.factory(units)
        assert type(made) is kind
        assert getattr(made, "settings", SETTINGS) is SETTINGS


# --- the joint problem of a train


def _report(time=1.0, axles=2, **values):
    defaults = {
        "speed": 10.0, "omega": np.full(axles, 23.5), "torque": 150.0, "command": 160.0, "target": 500.0,
        "limit": 1000.0, "peak": np.full(axles, 0.1), "peak_slip": 0.1, "steepness": 2.0, "carried": 400.0,
        "air": 0.0, "drag": 0.02,
    }  # fmt: skip
    return Report(time, **(defaults | values))


def test_the_joint_problem_begins_where_orders_can_act(make_context, no_solver, monkeypatch):
    states = []

    class Forecast:
        def __init__(self, context):
            self.shift = len(states) * 0.0

        def state(self, report, commands):
            states.append((report, commands))
            return np.array([report.speed - 0.5, *report.omega + 1.0, report.torque + 7.0])

    monkeypatch.setattr(joint_problem, "UnitForecast", Forecast)
    units = [
        make_context(axles=1, telegrams=Telegrams(period=0.03)),
        make_context(axles=2, radius=0.45),
    ]
    joint = JointProblem(units, SETTINGS)
    assert no_solver[0][1].iterations == 2
    reports = [
        _report(axles=1),
        _report(axles=2, speed=11.0, carried=60.0, target=600.0, peak_slip=0.4, steepness=8.0),
    ]
    commands = [np.array([]), np.array([165.0, 170.0, 180.0])]
    asked, solution = joint.solve(reports, commands)
    solver = joint._group.solver
    assert solver.calls == [("restart", [160.0, 180.0]), "solve"]
    problem = solver.problem
    slip = np.array([0.43, 0.45, 0.45]) * 24.5 - [9.5, 10.5, 10.5]
    np.testing.assert_allclose(
        problem.state, [9.5, *(9.5 + slip) / [0.43, 0.45, 0.45], 157.0, 157.0]
    )
    assert (problem.target.tolist(), problem.before.tolist()) == ([500.0, 600.0], [160.0, 180.0])
    # one model has one curve: the units' geometric mean
    np.testing.assert_allclose(problem.parameters[-6:-4], [0.2, 4.0])
    np.testing.assert_array_equal(problem.slip_limit, NO_SLIP_LIMIT)
    np.testing.assert_allclose(problem.upper, [480.0, 72.0])
    # an order stands for three steps: asked is what the third says, 4 and 5 of 0, 1, 2 ...
    assert (solution.torques[:2].tolist(), asked.tolist()) == ([0.0, 1.0], [4.0, 5.0])
    joint.solve(reports, commands)
    assert solver.calls[2:] == ["shift"] * 3 + ["solve"]
    joint.forget()
    joint.solve(reports, commands)
    assert solver.calls[6][0] == "restart"
    solver.status = "not finite"
    joint.solve(reports, commands)
    solver.status = "ok"
    joint.solve(reports, commands)
    assert [call for call in solver.calls if call[0] == "restart"] == [
        ("restart", [160.0, 180.0])
    ] * 3
    # who is bound by its rail is asked for more than it is believed to carry
    solver.torques[4:6] = 0.95 * 400.0, 0.9499 * 60.0
    asked, _ = joint.solve(reports, commands)
    np.testing.assert_allclose(asked, [500.0, 0.9499 * 60.0])
    solver.torques[4:6] = 450.0, 59.0
    asked, _ = joint.solve([reports[0], reports[1]._replace(target=50.0)], commands)
    np.testing.assert_allclose(asked, [540.0, 1.2 * 59.0])
    # nobody for more than its motors can; and the body has the speed of who leads
    asked, _ = joint.solve([reports[0]._replace(limit=510.0), reports[1]], commands, 1)
    assert asked[0] == 510.0
    assert solver.problem.state[0] == 10.5


@looped("works", [True, False])
def test_a_unit_of_which_no_report_is_used_rolls_with_the_leader(make_context, no_solver, works):
    joint = JointProblem([make_context(axles=1), make_context(axles=2, radius=0.45)], SETTINGS)
    leader = _report(axles=1, speed=9.0)
    supposed = joint.supposed(1, leader, 300.0, works)
    assert (supposed.time, supposed.speed, supposed.target) == (leader.time, 9.0, 300.0)
    np.testing.assert_allclose(supposed.omega, [20.0, 20.0])
    # it gives what is wanted of it, no more; or nothing, and none of its rail counts
    torque = 300.0 if works else 0.0
    assert (supposed.torque, supposed.command, supposed.limit) == (torque,) * 3
    assert supposed.peak.tolist() == [0.3, 0.3]
    assert (supposed.peak_slip, supposed.steepness) == (leader.peak_slip, leader.steepness)
    assert (supposed.carried > 300.0) if works else (supposed.carried == 0.0)
    # what its rails do not give holds it back less: it is as fast as the leader, whose air brake acts too
    again = joint.supposed(1, leader._replace(air=70.7), 300.0, works)
    pull = [
        one.axles * one.axle_load / (one.mass * GRAVITY) / torque_per_coefficient(one)
        for one in joint._contexts
    ]
    for report, given in ((supposed, 150.0), (again, 160.0)):
        gained = pull[1] * torque - report.drag, pull[0] * given - 0.02
        assert gained[0] == pytest.approx(gained[1], rel=1e-12)


@looped(("step", "horizon", "last"), [(0.01, 20, 9), (0.02, 20, 4), (0.01, 5, 4)])
def test_an_order_stands_for_a_telegrams_period(make_context, no_solver, step, horizon, last):
    joint = JointProblem([make_context(axles=1)], replace(SETTINGS, step=step, horizon=horizon))
    assert joint._last == last


# --- telegrams between the units


class Cars:
    """Controllers of single units that obey their targets."""

    def __init__(self, contexts, settings):
        self.senses, self.ok = [], True
        unit = [SimpleNamespace(belief=SimpleNamespace(
            parts=[np.arange(one.axles)], peak=np.full(one.axles, 0.1 + 0.01 * j), slip_limit=np.full(one.axles, 0.02),
            observers=[SimpleNamespace(curve=(0.1 + j, 2.0), grade=0.01 * j)],
            carried_torque=lambda j=j: np.array([400.0 + j]), air_torque=np.array([30.0 + j]),
        )) for j, one in enumerate(contexts)]  # fmt: skip
        self.controllers = unit

    def decide(self, senses):
        self.senses.append(senses)
        return [TorqueDecision(s.target, self.ok, "ok" if self.ok else "late", 0.5) for s in senses]


class Joint:
    """A joint problem whose answer is set."""

    def __init__(self, contexts, settings):
        self.asked, self.status, self.calls, self.forgotten = np.array([300.0, 350.0]), "ok", [], 0

    def forget(self):
        self.forgotten += 1

    def supposed(self, j, leader, target, works, leads):
        return leader._replace(target=target, command=target if works else 0.0, limit=-float(j))

    def solve(self, reports, commands, leader):
        self.calls.append((reports, [known.tolist() for known in commands]))
        self.leader = leader
        return self.asked, HorizonSolution(self.asked, 0.0, 0.0, 1, self.status)


TELEGRAMS = Telegrams(period=0.04, latency=0.02, silence=0.1)


@pytest.fixture
def train(make_context, monkeypatch):
    monkeypatch.setattr(train_controller, "CarControllers", Cars)
    monkeypatch.setattr(train_controller, "JointProblem", Joint)
    train = TrainMpc([make_context(axles=1, telegrams=TELEGRAMS) for _ in range(2)])
    train.telegraphy = Telegraphy(train, 2, TELEGRAMS)
    return train


def _drive(train, make_sense, ticks, targets=(500.0, 450.0), start=0, **values):
    """Targets that the units' own controllers were given, tick by tick."""
    found = []
    for tick in range(start, start + ticks):
        senses = [
            make_sense(axles=1, target=t, time=tick * 0.01, torque=100.0 + j, **values)
            for j, t in enumerate(targets)
        ]
        decisions = train.telegraphy.decide(senses)
        found.append([s.target for s in train.cars.senses[-1]])
        assert [d.torque for d in decisions] == found[-1]
    return np.array(found)


def test_orders_act_when_they_arrive_and_the_leaders_with_the_next_period(train, make_sense):
    targets = _drive(train, make_sense, 13)
    # the report of tick 3 is sent at 4 and solved for at 7; the order is sent at 8 and reaches unit 1 two ticks later
    assert len(train.joint.calls) == 2
    assert targets[:8].tolist() == [[500.0, 450.0]] * 8
    assert targets[8:10].tolist() == [[300.0, 450.0]] * 2
    assert targets[10:].tolist() == [[300.0, 350.0]] * 3
    reports, commands = train.joint.calls[0]
    assert [(r.time, r.torque, r.target, r.limit, r.carried) for r in reports] == [
        (0.07, 100.0, 500.0, 1150.0, 400.0), (0.03, 101.0, 450.0, 1150.0, 401.0),
    ]  # fmt: skip
    assert [report.peak.tolist() for report in reports][1] == [0.11]
    assert [(r.peak_slip, r.steepness) for r in reports] == [(0.1, 2.0), (1.1, 2.0)]
    assert commands == [[500.0] * 3, [450.0] * 7]
    # at 11 the order of 7, which acts from 10 on, is known, as far as the rail carries it
    _, commands = train.joint.calls[1]
    assert commands == [[300.0] * 3, [450.0] * 3 + [350.0] * 4]
    assert train.joint.forgotten == 1
    assert train.joint.leader == 0


def test_orders_beyond_what_the_rail_carries_count_as_that(train, make_sense):
    train.joint.asked = np.array([300.0, 900.0])
    _drive(train, make_sense, 13)
    assert train.joint.calls[1][1][1] == [450.0] * 3 + [pytest.approx(1.1 * 401.0)] * 4


def test_braking_reports_are_mirrored_and_orders_keep_the_sign(train, make_sense):
    targets = _drive(train, make_sense, 12, (-500.0, -450.0), brake_limit=700.0)
    report = train.joint.calls[0][0][1]
    assert (report.speed, report.torque, report.command, report.target, report.limit) == (
        -10.0,
        -101.0,
        450.0,
        450.0,
        700.0,
    )
    assert report.omega[0] < 0.0
    assert targets[-1].tolist() == [-300.0, -350.0]


def test_a_unit_that_failed_reports_its_torque(train, make_sense):
    train.cars.ok = False
    _drive(train, make_sense, 9)
    assert [r.command for r in train.joint.calls[0][0]] == [100.0, 101.0]


def test_orders_of_the_other_direction_are_not_followed(train, make_sense):
    _drive(train, make_sense, 13)
    targets = _drive(train, make_sense, 11, (-500.0, -450.0), start=13)
    # at 15 the report of 11 tells the old direction: of a driver who has changed his mind it says how much he wants now
    assert targets[:3].tolist() == [[-500.0, -450.0]] * 3
    assert targets[3:5].tolist() == [[-300.0, -450.0]] * 2
    assert targets[5:].tolist() == [[-300.0, -350.0]] * 6
    assert train.joint.forgotten == 2
    assert [r.target for r in train.joint.calls[2][0]] == [500.0, 450.0]


@pytest.mark.parametrize("other", [0.0, -450.0])
def test_demands_of_different_directions_suspend_the_orders(train, make_sense, other):
    _drive(train, make_sense, 13)
    targets = _drive(train, make_sense, 12, (500.0, other), start=13)
    assert len(train.joint.calls) == 3  # the last with a report from before
    assert targets[-1].tolist() == [500.0, other]
    assert np.isnan(train.orders.message).all()


def test_no_demand_means_no_joint_problem(train, make_sense):
    _drive(train, make_sense, 12, (0.0, 0.0))
    assert not train.joint.calls


def test_a_rising_demand_is_not_taken_for_an_uneven_one(train, make_sense):
    for tick in range(8):
        _drive(train, make_sense, 1, (100.0 * (tick + 1), 80.0 * (tick + 1)), start=tick)
    reports, _ = train.joint.calls[0]
    assert [r.target for r in reports] == [800.0, pytest.approx(640.0)]


def test_an_unsolved_problem_says_so_and_leaves_the_units_alone(train, make_sense):
    train.joint.status = "not finite"
    _drive(train, make_sense, 7)
    senses = [make_sense(axles=1, target=500.0, time=0.07) for _ in range(2)]
    decisions = train.telegraphy.decide(senses)
    assert [(d.status, d.ok) for d in decisions] == [("joint: not finite", True), ("ok", True)]
    assert decisions[0].solve_time > decisions[1].solve_time == 0.5
    assert _drive(train, make_sense, 3, start=8).tolist() == [[500.0, 450.0]] * 3
    train.cars.ok = False
    late = [s._replace(time=0.11) for s in senses]
    assert train.telegraphy.decide(late)[0].status == "late"


def test_silence_suspends_the_orders(train, make_sense):
    _drive(train, make_sense, 12)
    train.telegraphy.lost[:] = True
    targets = _drive(train, make_sense, 20, start=12)
    assert targets[0].tolist() == [300.0, 350.0]
    # the last report arrived at 10 and is silent from 21 on: at 23 the leader suspends its own; the last order at 10 too
    assert targets[10:12].tolist() == [[300.0, 450.0]] * 2
    assert targets[12:].tolist() == [[500.0, 450.0]] * 8
    assert np.isnan(train.orders.message).all()


def test_who_is_silent_is_left_to_the_driver_and_the_others_share(
    make_context, make_sense, monkeypatch
):
    monkeypatch.setattr(train_controller, "CarControllers", Cars)
    monkeypatch.setattr(train_controller, "JointProblem", Joint)
    train = TrainMpc([make_context(axles=1, telegrams=TELEGRAMS) for _ in range(3)])
    train.joint.asked = np.array([300.0, 350.0, 500.0])
    train.telegraphy = Telegraphy(train, 3, TELEGRAMS)
    train.telegraphy.lost[2] = True
    targets = _drive(train, make_sense, 16, (500.0, 450.0, 470.0))
    reports, commands = train.joint.calls[0]
    # of the silent unit is supposed what the leader's own demand is along an even train
    assert [(r.target, r.limit) for r in reports] == [
        (500.0, 1150.0),
        (450.0, 1150.0),
        (500.0, -2.0),
    ]
    assert commands[2] == [500.0] * 3
    assert targets[-1].tolist() == [300.0, 350.0, 470.0]
    # nobody is heard
    train.telegraphy.lost[1] = True
    assert _drive(train, make_sense, 24, (500.0, 450.0, 470.0), start=16)[-1].tolist() == [
        500.0,
        450.0,
        470.0,
    ]


def test_a_new_leader_begins_anew_and_knows_no_orders(make_context, make_sense, monkeypatch):
    monkeypatch.setattr(train_controller, "CarControllers", Cars)
    monkeypatch.setattr(train_controller, "JointProblem", Joint)
    train = TrainMpc([make_context(axles=1, telegrams=TELEGRAMS) for _ in range(3)])
    train.telegraphy = Telegraphy(train, 3, TELEGRAMS)
    train.joint.asked = np.array([300.0, 350.0, 370.0])
    _drive(train, make_sense, 11, (500.0, 450.0, 450.0))
    train.joint.asked = np.array([300.0, 350.0, 333.0])
    _drive(train, make_sense, 2, (500.0, 450.0, 450.0), start=11)
    assert train.joint.forgotten == 1
    for tick in range(13, 16):
        senses = [
            make_sense(axles=1, target=450.0, time=tick * 0.01, in_service=j > 0, planned=450.0)
            for j in range(3)
        ]
        train.telegraphy.decide(senses)
    assert (train.joint.leader, train.joint.forgotten) == (1, 2)
    # the order of tick 11, which acts at 14, was the old leader's: of it the new one has only what is reported
    reports, commands = train.joint.calls[-1]
    assert reports[2].time == pytest.approx(0.11)
    assert commands[2] == [370.0] * 7


def test_what_an_order_says_of_lost_motors_is_not_made_up_for_again(train, make_sense):
    _drive(train, make_sense, 12, planned=600.0)
    planned = [[sense.planned for sense in senses] for senses in train.cars.senses]
    assert planned[7] == [600.0, 600.0]
    assert planned[8:10] == [[0.0, 600.0]] * 2
    assert planned[10:] == [[0.0, 0.0]] * 2


def test_the_only_unit_whose_motors_work_leads_and_is_asked_for_what_the_others_lost(
    train, make_sense
):
    _drive(train, make_sense, 13)
    train.telegraphy.lost[:] = True  # it needs no telegram
    senses = [
        make_sense(axles=1, target=t, torque=100.0 + j, in_service=j == 1, planned=400.0)
        for j, t in enumerate((0.0, 450.0))
    ]
    for tick in range(13, 45):
        train.telegraphy.decide([s._replace(time=tick * 0.01) for s in senses])
    reports, _ = train.joint.calls[-1]
    assert [r.target for r in reports] == [pytest.approx(350.0), 450.0]
    assert (train.joint.leader, reports[0].command) == (1, 0.0)
    assert train.cars.senses[-1][1].target == 350.0  # as the joint problem answers
    # where none works nobody is asked
    for tick in range(45, 56):
        train.telegraphy.decide([s._replace(time=tick * 0.01, in_service=False) for s in senses])
    assert np.isnan(train.orders.message).all()


def test_a_forecast_is_no_longer_than_telegrams_without_loss_are_old(train, make_sense):
    train.telegraphy.lost[1] = False
    _drive(train, make_sense, 12)
    train._telegrams = replace(TELEGRAMS, silence=9.0)  # so that the last report stands
    train.telegraphy.lost[1] = True
    _drive(train, make_sense, 20, start=12)
    lengths = [len(commands[1]) for _, commands in train.joint.calls]
    # a report of 0.03 s is of 7 periods when the order acts; a period and two delays of 0.03 s are ten
    assert lengths == [7, 7, 10, 10, 10, 10, 10]
    assert [len(commands[0]) for _, commands in train.joint.calls] == [3] * 7


def test_demands_are_remembered_as_long_as_reports_may_come(train, make_sense):
    _drive(train, make_sense, 40)
    kept = sorted(train._demands)
    assert kept[0] == pytest.approx(0.23)  # 0.39 less silence and two periods is 0.21
    assert kept[-1] == pytest.approx(0.39)


def test_no_more_orders_are_remembered_than_can_matter(train, make_sense):
    _drive(train, make_sense, 100)
    assert len(train._sent[0]) == 1
    assert len(train._sent[1]) == 17
