"""The train's joint MPC: what it may know, what it makes of it, and what is left when telegrams fail."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.metrics import evaluate
from alloc.onboard.host import UnitSense
from alloc.onboard.parameters import Belief, Braking, Onboard, Telegrams
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
from tests.benchmarks.unit_step import step_function
from tests.mpc.groups import train_of
from tests.mpc.telegraphy import Telegraphy

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


def test_without_telegrams_the_train_is_its_cars(runs):
    mute = _run("mpc-train", telegrams=Telegrams(loss=1.0))
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(mute[name], runs["mpc-car"][name])


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


@pytest.mark.parametrize("name", ["mpc-car", "mpc-train"])
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


@pytest.mark.parametrize("latency", [0.02, 0.07, 0.12])
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


def test_orders_on_their_way_count_from_when_they_act():
    controller = TrainMpc(train_of(2))
    controller._sent[1] = [(0.05, 100.0), (0.15, 400.0), (0.25, 2000.0)]
    # what was in force when it reported is in its report; the last order is more than its rail carries
    known = controller._known(1, _report(0.1), 0.3)
    np.testing.assert_allclose(known, [*[300.0] * 5, *[400.0] * 10, *[880.0] * 5])


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
