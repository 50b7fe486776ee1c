"""Motors: torque lag, limits by speed, receptivity that fluctuates, failed units, inverter groups."""

import numpy as np
import pytest

from alloc.plant.model import build
from alloc.plant.rail import Rail, Receptivity
from alloc.plant.train import Motors, TorqueLimit, Train
from tests.plant.numpy_plant import environment_at

LAG = 5e-3


def test_torque_lags_the_command(run, train):
    trace = run(build(train("M"), Rail(0.3)), 0.05, 10.0, command=1000.0)
    expected = 1000.0 * -np.expm1(-trace.time / LAG)
    np.testing.assert_allclose(trace.rows("torque")[:, 0], expected, rtol=1e-4)


@pytest.mark.parametrize("command", [9e3, -9e3])
def test_torque_is_bounded(run, train, command):
    trace = run(build(train("M"), Rail(0.5)), 0.2, 20.0, command=command)
    assert trace.rows("torque")[-1, 0] == pytest.approx(np.sign(command) * 4000.0, rel=1e-9)


def test_limit_by_speed():
    """Peak torque, then constant power, then falling with the square of the speed; fading at low speed."""
    limit = TorqueLimit(1000.0, 150e3, pull_out_speed=30.0, fade_speed=5.0)
    table = limit.tabulate(0.43, 7.0)
    speed = np.arange(table.size) / 3.6
    np.testing.assert_allclose(table[:18], 1000.0 * speed[:18] / 5.0)
    power = (speed > 12.0) & (speed < 30.0)
    np.testing.assert_allclose(table[power] * 7.0 * speed[power] / 0.43, 150e3)
    beyond = speed > 30.0
    np.testing.assert_allclose(table[beyond] * speed[beyond] ** 2, 150e3 * 0.43 / 7.0 * 30.0)
    assert table.max() <= 1000.0


def test_table_is_interpolated_at_the_mean_rim_speed_of_the_unit(car):
    given = tuple(1000.0 + 10.0 * k for k in range(100))
    motors = Motors("1C4M", 7.0, TorqueLimit(1.0, 0.0, table=given), TorqueLimit(1.0, 0.0))
    model = build(Train("one", (car(motors=motors),)), Rail(0.3))
    state = model.initial_state(0.0)
    state[model.layout.omega] = np.array([10.0, 11.0, 12.0, 14.0]) / 0.43
    local = environment_at(model, 0.0, state)
    assert local.drive_limit[0] == pytest.approx(1000.0 + 10.0 * 3.6 * 11.75)
    state[model.layout.omega] = 300.0
    assert environment_at(model, 0.0, state).drive_limit[0] == pytest.approx(given[-1])


def test_electric_brake_follows_the_receptivity(run, train):
    """First-order response to mean + amplitude sin(w t + phase): amplitude and phase of the closed form."""
    mean, amplitude, period, phase = 0.6, 0.2, 0.5, 0.7
    model = build(train("M"), Rail(0.5), receptivity=Receptivity(mean, amplitude, period, phase))
    trace = run(model, 1.0, 20.0, command=-9e3)
    w, t = 2.0 * np.pi / period, trace.time
    wave = np.sin(w * t + phase - np.arctan(w * LAG)) / np.hypot(1.0, w * LAG)
    late = t > 0.1
    expected = -4000.0 * (mean + amplitude * wave)
    np.testing.assert_allclose(trace.rows("torque")[late, 0], expected[late], rtol=1e-5)


def test_receptivity_does_not_touch_driving_and_stays_in_bounds(run, train):
    model = build(train("M"), Rail(0.5), receptivity=Receptivity(0.5, 3.0, 1.0))
    driving = run(model, 0.6, 20.0, command=2000.0).rows("torque")
    assert driving[-1, 0] == pytest.approx(2000.0)
    braking = run(model, 1.0, 20.0, command=-9e3).rows("torque")
    assert braking.min() >= -4000.0
    assert braking.max() <= 0.0
    assert braking.min() < -3999.0


def test_failed_unit_loses_its_torque_at_that_time(run, train):
    model = build(train("MM"), Rail(0.5), failures={1: 0.3})
    torque = run(model, 0.6, 10.0, command=1000.0).rows("torque")
    time = np.arange(torque.shape[0]) * 1e-3
    after = time > 0.3005
    np.testing.assert_allclose(torque[time < 0.2995, 0], torque[time < 0.2995, 1])
    np.testing.assert_allclose(torque[after, 0], 1000.0, rtol=1e-9)
    # the step that straddles the failure is the only inexact one
    decayed = 1000.0 * np.exp(-(time[after] - 0.3) / LAG)
    np.testing.assert_allclose(torque[after, 1], decayed, rtol=0.1, atol=1e-9)


@pytest.mark.parametrize(("group", "units"), [("1C4M", 2), ("1C2M", 4), ("1C1M", 8)])
def test_inverter_groups(train, group, units):
    model = build(train("TMM", group), Rail(0.3))
    assert model.layout.units == units
    unit = model.structure.axle_unit
    assert list(unit[:4]) == [-1] * 4
    assert sorted(set(unit[4:])) == list(range(units))
    assert np.all(np.diff(unit[4:]) >= 0)


def test_power_of_the_motors_is_what_the_work_adds_up(run, train):
    trace = run(build(train("M"), Rail(0.5)), 1.0, 10.0, command=1000.0)
    power = 7.0 * trace.rows("torque")[:, 0] * trace.rows("omega").sum(axis=1)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) * 1e-3])
    np.testing.assert_allclose(trace.rows("work")[:, 0], work, rtol=1e-4, atol=20.0)
