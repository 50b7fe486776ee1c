"""The train's joint MPC: what it may know, what it makes of it, and what is left when motors and telegrams fail."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.loop import REPORT_DELAY
from alloc.metrics import evaluate
from alloc.onboard.host import HostedController, UnitSense
from alloc.onboard.parameters import Belief, Braking, Onboard, Sensors, Telegrams
from alloc.plant.adhesion import RationalCurve
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.simulation import DriverCommand, Event, simulate
from mpc.belief import with_predicted_curve
from mpc.group import CarControllers, GroupController
from mpc.hosted import MPC, MPC_CAR, MPC_TRAIN, MPC_TRAIN_IDEAL
from mpc.model import parameters, substeps, unit_model
from mpc.train import (
    Order,
    Report,
    TrainMpc,
    UnitForecast,
    added_numbers,
    ordered_target,
    read_report,
    write_report,
)
from tests.cases import looped
from tests.mpc.made_problems import Telegraphy, train_of
from tests.mpc.peers import step_function

HOSTED = {one.name: one for one in (MPC, MPC_CAR, MPC_TRAIN, MPC_TRAIN_IDEAL)}


BAD = 0.07


"""Peak coefficient under the foremost motor car; the plan needs 0.17, and elsewhere the rail carries 0.3."""


def _event(telegrams=None, train=None, inverters="1C4M", **values):
    """The commuter set starts; the rail under its foremost motor car stays bad all the time."""
    train = train or find_set("commuter-8car")
    cars = tuple(
        car if car.motors is None else replace(car, motors=replace(car.motors, group=inverters))
        for car in train.cars
    )
    bad = tuple(BAD - 0.3 if 4 <= axle < 8 else 0.0 for axle in range(train.axle_count))
    model = build(replace(train, cars=cars), Rail(0.3, increments=bad))
    onboard = Onboard(
        belief=Belief(), braking=Braking(blended=False), telegrams=telegrams or Telegrams()
    )
    defaults = {"duration": 5.0, "initial_speed": 3.0}
    return Event("bad front", model, DriverCommand((0.2,), (0.7,)), onboard, **(defaults | values))


def _run(controller, **values):
    return simulate(_event(**values), "alone", HOSTED.get(controller, controller))


def _settled_effort(run):
    """Mean command of the motors over the driver's demand, from the third second on."""
    late = run["time"].values >= 3.0
    commands, targets = run["torque_command"].values[late], run["torque_target"].values[late]
    return commands.sum() / targets.sum()


@pytest.fixture(scope="module")
def runs():
    return {name: _run(name) for name in HOSTED}


def test_the_others_make_up_for_a_unit_on_bad_rail(runs):
    alone = 1.0 - _settled_effort(runs["mpc"])
    assert alone > 0.1, "the foremost unit must fall short"
    assert abs(1.0 - _settled_effort(runs["mpc-car"])) == pytest.approx(alone, abs=0.01)
    for name in ("mpc-train", "mpc-train-ideal"):
        assert abs(1.0 - _settled_effort(runs[name])) < 0.15 * alone, name


def test_the_others_share_what_is_missing(runs):
    for name in ("mpc-train", "mpc-train-ideal"):
        last = runs[name]["torque_command"].values[-50:].mean(axis=0)
        assert last[0] < 0.6 * last[1]
        np.testing.assert_allclose(last[1:], last[1:].mean(), rtol=0.03)


def test_no_wheel_runs_away_and_no_solver_fails(runs):
    for name, run in runs.items():
        assert evaluate(run)["slip_peak"] < 0.5, name
        assert run.attrs["controller_failures"] == 0, name
    assert evaluate(simulate(_event(), "alone", "none"))["slip_peak"] > 1.0


def test_without_delay_orders_are_nearly_those_of_the_ideal_controller(runs):
    # what is left of the delay: a telegram is sent in the period after what it says was decided, there and back
    def distance(run):
        late = run["time"].values >= 3.0
        own, ideal = (one["torque_command"].values[late] for one in (run, runs["mpc-train-ideal"]))
        return (np.abs(own - ideal) / run["torque_target"].values[late]).mean()

    quick = _run("mpc-train", telegrams=Telegrams(period=0.01, latency=0.0))
    assert distance(quick) < 0.02
    assert distance(runs["mpc-car"]) > 0.05


def test_lost_telegrams_cost_something_and_are_survived(runs):
    lossy = _run("mpc-train", telegrams=Telegrams(loss=0.3, jitter=0.05))
    assert lossy.attrs["controller_failures"] == 0
    assert abs(1.0 - _settled_effort(lossy)) < 0.5 * (1.0 - _settled_effort(runs["mpc"]))
    assert not np.array_equal(lossy["torque_command"], runs["mpc-train"]["torque_command"])


@looped("name", ["mpc-car", "mpc-train"])
def test_a_car_with_four_inverters_on_load_transfer(name):
    # the axles of a bogie differ in load by some percent: with torques of their own each is used like the others
    train = find_set("commuter-8car")
    short = Train(train.name, train.cars[:2], load_transfer=True)
    run = _run(name, train=short, inverters="1C1M", duration=4.0)
    assert run.attrs["controller_failures"] == 0
    late = run["time"].values >= 2.5
    driven = run["axle_unit"].values >= 0
    used = (run["coefficient"].values / run["adhesion_limit"].values)[late][:, driven].mean(axis=0)
    torque = run["torque_command"].values[late].mean(axis=0)
    load = run["axle_load"].values[late][:, driven].mean(axis=0)
    assert np.all(used > 0.9)
    assert np.ptp(load) > 0.02 * load.mean()
    np.testing.assert_array_equal(np.argsort(torque), np.argsort(load))


def _sense(time, torque=300.0, target=500.0):
    slip = 0.01
    return UnitSense(time, 5.0, np.full(4, (5.0 + slip) / 0.43), torque, target, 1e3, 1e3, 0.1, False)  # fmt: skip


def _commands(changed_from, telegrams, ticks=50):
    """Commands (ticks, units) of three units; from `changed_from` [s] on the last one's limit is half as high."""
    controller = Telegraphy(TrainMpc(train_of(3, telegrams=telegrams)), 3, telegrams)
    answers = []
    for k in range(ticks):
        time = 0.01 * k
        halved = time >= changed_from - 1e-9
        senses = [_sense(time), _sense(time), _sense(time, target=250.0 if halved else 500.0)]
        answers.append([decision.torque for decision in controller.decide(senses)])
    return np.array(answers)


@looped("latency", [0.02, 0.07, 0.12])
def test_nothing_younger_than_the_telegrams_influences_an_answer(latency):
    # telegrams every control period, so that nothing but the latency delays
    telegrams, event = Telegrams(period=0.01, latency=latency), 0.2
    same, other = (_commands(start, telegrams) for start in (np.inf, event))
    changed = np.abs(same - other) > 0.0
    assert changed.any(axis=0).all()
    first = changed.argmax(axis=0) * 0.01
    assert first[2] == pytest.approx(event), "its own controller sees it at once"
    # what is told in a period is sent in the next: the foremost unit follows its own order after one latency and two
    # periods, and the second unit after two
    assert first[0] == pytest.approx(event + latency + 0.02)
    assert first[1] == pytest.approx(event + 2.0 * latency + 0.02)


CURVE = (0.08, 2.5)


def _report(time, command=300.0, carried=800.0):
    peak = np.full(4, 0.15)
    omega = np.array([5.01, 5.02, 5.05, 5.1]) / 0.43
    return Report(time, 5.0, omega, 250.0, command, 500.0, 1e3, peak, *CURVE, carried, 0.0, 0.02)


def test_the_forecast_over_the_delay_is_the_unit_model():
    context = replace(train_of(1)[0], unloading=(), curve=RationalCurve(*CURVE))
    report, commands = _report(0.0), np.array([300.0, 300.0, 450.0, 450.0])
    steps = substeps(with_predicted_curve(context), 0.01)
    step = step_function(unit_model(context), 0.01, steps)
    state = np.concatenate([[report.speed], report.omega, [report.torque]])
    forecast = UnitForecast(context)
    np.testing.assert_array_equal(forecast.state(report, commands[:0]), state)
    for command in commands:
        state = np.asarray(step(state, command, parameters(context, report.peak, 0.02))).ravel()
    np.testing.assert_allclose(forecast.state(report, commands), state, rtol=1e-11)


def test_an_order_scales_with_the_driver_and_ends_with_him():
    order = Order(torque=600.0, demand=500.0)
    assert ordered_target(None, _sense(0.0, target=400.0)) == 400.0
    assert ordered_target(order, _sense(0.0, target=400.0)) == pytest.approx(480.0)
    assert ordered_target(order, _sense(0.0, target=0.0)) == 0.0
    assert ordered_target(order, _sense(0.0, target=-300.0)) == -300.0
    assert ordered_target(order, _sense(0.0, target=900.0)) == 1e3  # what the motors can
    assert ordered_target(Order(600.0, -500.0), _sense(0.0, target=-250.0)) == -300.0
    # of motors that have failed nothing is ordered
    failed = _sense(0.0, target=-250.0)._replace(in_service=False)
    assert ordered_target(Order(0.0, -500.0), failed) == 0.0


def test_a_report_arrives_as_it_was_written():
    units = [replace(unit, axles=axles) for unit, axles in zip(train_of(2), (2, 4), strict=True)]
    added = added_numbers(units)
    numbers = np.full((2, added.report), np.nan)
    assert [read_report(row, unit.axles) for row, unit in zip(numbers, units, strict=True)] == [
        None
    ] * 2
    for row, unit in zip(numbers, units, strict=True):
        report = _report(0.3)
        part = {name: getattr(report, name)[: unit.axles] for name in ("omega", "peak")}
        report = report._replace(**part)
        write_report(report, row)
        for told, read in zip(report, read_report(row, unit.axles), strict=True):
            np.testing.assert_array_equal(told, read)
    assert np.isfinite(numbers[1]).all()  # the unit with the most axles fills its telegram


def test_an_answer_comes_whatever_is_read():
    for controller in (
        CarControllers(train_of(2)),
        Telegraphy(TrainMpc(train_of(2)), 2, Telegrams(latency=0.0)),
        GroupController(train_of(2)),
    ):
        for time, value in ((0.09, 0.0), (0.1, 0.0), (0.19, np.nan), (0.2, 0.0), (0.29, 5.0)):
            senses = [_sense(time), _sense(time)._replace(speed=value)]
            decisions = controller.decide(senses)
            assert decisions[1].ok == np.isfinite(value)
            assert len(decisions) == 2


FAILURE = 2.0


KNOWN = FAILURE + REPORT_DELAY


TOLD = KNOWN + 0.3


"""From then on every unit has an order that was made after the failure was known."""


class Noting(TrainMpc):
    """Notes what it is asked, tells and reads in every control period; spoils reports of a unit on request."""

    spoilt = None

    def __init__(self, contexts, settings=None):
        super().__init__(contexts, settings)
        self.notes = []

    def decide(self, senses):
        read = self.reports.read.copy(), self.orders.read.copy()
        heard = np.array([self.reports.heard, self.orders.heard])
        answers = super().decide(senses)
        if self.spoilt is not None and not senses[self.spoilt].in_service:
            self.reports.message[self.spoilt, 1:] = -7.0
        told = self.orders.message.copy()
        self.notes.append((senses, self._leader, *read, told, heard))
        return answers


def _failing_event(failures=None, telegrams=None, level=0.3, seed=0, blended=False, **values):
    """The commuter set, of four units, on even rail."""
    model = build(find_set("commuter-8car"), Rail(level), failures=failures)
    onboard = Onboard(
        belief=Belief(), braking=Braking(blended=blended), telegrams=telegrams or Telegrams(),
        sensors=Sensors(seed=seed),
    )  # fmt: skip
    defaults = {"duration": 5.0, "initial_speed": 3.0}
    return Event("failing", model, DriverCommand((0.2,), (0.7,)), onboard, **(defaults | values))


def _noted_run(event, spoilt=None):
    """The run, and its notes as arrays over the control periods: time, leader, read, told, limits, plan."""
    made = []

    def factory(contexts):
        made.append(Noting(contexts, contexts[0].settings))
        made[0].spoilt = spoilt
        return made[0]

    run = simulate(event, "alone", HostedController("noting", "mpc-train that notes", factory))
    notes = made[0].notes
    return run, {
        "time": np.array([senses[0].time for senses, *_ in notes]),
        "leader": np.array([note[1] for note in notes]),
        "reports": np.array([note[2] for note in notes]),
        "orders": np.array([note[3] for note in notes]),
        "told": np.array([note[4] for note in notes]),
        "heard": np.array([note[5] for note in notes]),
        "limit": np.array([[s.drive_limit * s.in_service for s in note[0]] for note in notes]),
        "planned": np.array([[s.planned for s in note[0]] for note in notes]),
        "target": np.array([[s.target for s in note[0]] for note in notes]),
    }


@pytest.fixture(scope="module")
def failed():
    return {unit: _noted_run(_failing_event({unit: FAILURE})) for unit in (0, 2)}


@looped("unit", [0, 2])
def test_a_failed_unit_is_asked_for_nothing_and_the_others_for_the_plan(failed, unit):
    run, notes = failed[unit]
    torque = notes["told"][:, :, 0]
    made = np.isfinite(torque).all(axis=1)
    known = made & (notes["time"] >= KNOWN + 0.1)
    assert np.all(torque[known, unit] == 0.0)
    assert np.all(torque[made & (notes["time"] < KNOWN - 1e-9), unit] > 0.0)
    # what was planned for it the others carry, as evenly as they are
    late = notes["time"] >= TOLD + 1.0
    others = [j for j in range(4) if j != unit]
    np.testing.assert_allclose(
        torque[late].sum(axis=1), notes["planned"][late].sum(axis=1), rtol=0.01
    )
    np.testing.assert_allclose(
        torque[late][:, others], notes["planned"][late][:, others] * 4 / 3, rtol=0.02
    )
    late = run["time"].values >= TOLD + 1.0
    delivered = run["motor_torque"].values[late].sum(axis=1)
    np.testing.assert_allclose(
        delivered, run["torque_target"].values[late].max(axis=1) * 4.0, rtol=0.02
    )
    assert run.attrs["controller_failures"] == 0


@looped("unit", [0, 2])
@looped("loss", [0.0, 0.7])
def test_orders_exceed_neither_the_demand_nor_the_motors_in_service(failed, unit, loss):
    lossy = _failing_event({unit: FAILURE}, Telegrams(loss=loss, jitter=0.05, silence=0.5))
    _, notes = failed[unit] if loss == 0.0 else _noted_run(lossy)
    torque = notes["told"][:, :, 0]
    made = np.isfinite(torque).all(axis=1)
    assert made.mean() > 0.5
    assert np.all(torque[made].sum(axis=1) <= 1.01 * notes["planned"][made].sum(axis=1))
    orders = np.flatnonzero(made & (notes["time"] * 100 % 10 >= 8.5))
    assert orders.size > 20
    assert np.all(torque[orders] <= notes["limit"][orders] + 1e-9)


def test_motors_that_cannot_make_up_give_what_they_have():
    # at speed three units have less than the plan of four
    _, notes = _noted_run(_failing_event({2: FAILURE}, initial_speed=16.0))
    late = notes["time"] >= TOLD + 1.0
    limit, planned = notes["limit"][late], notes["planned"][late]
    assert np.all(limit.sum(axis=1) < 0.97 * planned.sum(axis=1))
    torque = notes["told"][late][:, :, 0]
    # of limits that sink with the speed reports tell those of 0.2 s before at most
    before = notes["limit"][np.flatnonzero(late) - 20]
    assert np.all(torque <= before + 1e-9)
    np.testing.assert_allclose(torque.sum(axis=1), limit.sum(axis=1), rtol=0.03)


def test_nothing_that_a_failed_unit_tells_is_used(failed):
    run, _ = _noted_run(_failing_event({2: FAILURE}), spoilt=2)
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(run[name], failed[2][0][name])


def test_where_the_leader_fails_the_next_unit_leads(failed):
    _, notes = failed[0]
    known = notes["time"] >= KNOWN - 1e-9
    assert set(notes["leader"][~known]) == {0}
    assert set(notes["leader"][known]) == {1}
    assert set(failed[2][1]["leader"]) == {0}
    # who leads is told without a telegram: in the next period it reads what it wrote; the others with the latency
    told, read = notes["told"][:, :, 0], notes["orders"][:, :, 0]
    late = np.flatnonzero(known)[2:]
    np.testing.assert_array_equal(read[late, 1], told[late - 1, 1])
    made = late[np.isin(np.round(notes["time"][late] * 100) % 10, 5)]  # 0.05 s after a telegram
    np.testing.assert_array_equal(read[made, 3], told[made - 6, 3])


@looped("failures", [None, {0: FAILURE}])
def test_without_telegrams_every_unit_is_alone(failures):
    event = _failing_event(failures, Telegrams(loss=1.0), level=0.12, duration=4.0)
    mute, notes = _noted_run(event)
    alone = simulate(event, "alone", MPC_CAR)
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(mute[name], alone[name])
    assert (
        mute.attrs["telegrams_lost"]
        == mute.attrs["telegrams_sent"]
        == alone.attrs["telegrams_sent"]
    )
    assert np.isnan(notes["reports"][:, 3]).all()


@looped("seed", [3, 4])
def test_the_telegrams_of_the_joint_mpc_are_those_of_the_rules_and_are_counted(seed):
    event = _failing_event(telegrams=Telegrams(loss=0.4), seed=seed, duration=4.0)
    run, notes = _noted_run(event)
    rule = simulate(event, "cooperative", "cut-and-ramp")
    sent, lost = run.attrs["telegrams_sent"], run.attrs["telegrams_lost"]
    assert (sent, lost) == (rule.attrs["telegrams_sent"], rule.attrs["telegrams_lost"])
    assert sent == 2 * 3 * 40  # three units and the leader tell each other ten times a second
    # without jitter no telegram overtakes another: each arrives at an instant of its own, unless it was counted as lost
    arrived = sum(len(set(line[line > 0.0])) for line in notes["heard"][:, :, 1:].reshape(400, 6).T)
    assert arrived == sent - lost
    np.testing.assert_array_equal(run["fallen_back"], rule["fallen_back"])


def test_the_ideal_controller_makes_up_for_a_failed_unit_too():
    run = simulate(_failing_event({0: FAILURE}, duration=4.0), "alone", MPC_TRAIN_IDEAL)
    late = run["time"].values >= KNOWN + 0.5
    commands, targets = run["torque_command"].values[late], run["torque_target"].values[late]
    assert np.all(commands[:, 0] == 0.0)
    np.testing.assert_allclose(commands.sum(axis=1), 4.0 * targets.max(axis=1), rtol=0.01)


def test_a_blended_brake_fills_what_failed_motors_lack():
    command = {"command": DriverCommand((0.2,), (-0.7,)), "initial_speed": 20.0}
    event = _failing_event({1: FAILURE}, blended=True)
    whole = replace(_failing_event(blended=True), **command)
    both = [_noted_run(replace(one, **command))[0] for one in (event, whole)]
    failed, sound = (run["acceleration"].values[run["time"].values >= 4.0].mean() for run in both)
    assert sound < -0.5
    assert failed == pytest.approx(sound, rel=0.02)
    assert both[0]["torque_command"].values[-1][1] == 0.0
    assert both[0]["air_brake_force"].values[-1][1] > 0.9 * both[0]["air_brake_force"].values.max()
