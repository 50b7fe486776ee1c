"""Minimum-time runs: braking curves, limits, stops, energy, and bounds of the running time."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.plant.array_model import ArrayModel
from alloc.plant.model import build
from studies.files.study_error import StudyError
from studies.lines.distance_steps import run_by_distance
from studies.lines.driving_style import legs
from studies.lines.line_run import LineRun, line_model, run_line
from studies.lines.minimum_time import MinimumTimeDriver
from studies.lines.speed_profile import SpeedProfile
from studies.lines.train_forces import TrainForces
from studies.railtoolkit.records import PointOfInterest, RunningPath, Section
from tests.plant.numpy_plant import environment_at
from tests.studies.example_line import EXAMPLE_PATH, example_stock

OVERSPEED = 0.05
"""Margin [m/s], 0.2 km/h, by which a limit is exceeded for a moment where the gradient jumps."""


def straight(length: float, limit_kmh: float = 80.0, grade: float = 0.0) -> RunningPath:
    """A line of one section."""
    return RunningPath("straight", (Section(0.0, length, grade, limit_kmh / 3.6),))


def limited(path: RunningPath, section: int, limit_kmh: float) -> RunningPath:
    """The line with another limit on one section."""
    changed = list(path.sections)
    changed[section] = replace(changed[section], speed_limit=limit_kmh / 3.6)
    return replace(path, sections=tuple(changed))


@pytest.fixture(scope="module")
def stock():
    return example_stock()


@pytest.fixture(scope="module")
def found(stock) -> LineRun:
    return run_line(EXAMPLE_PATH, stock)


limits = st.lists(st.floats(20.0, 160.0), min_size=1, max_size=8)


@given(limits, st.floats(0.0, 400.0), st.floats(0.2, 1.2))
@settings(deadline=None)
def test_permitted_speed_is_reachable_and_below_every_limit_under_the_train(kmh, length, b):
    sections = tuple(
        Section(700.0 * k, 700.0 * (k + 1), 0.0, limit / 3.6) for k, limit in enumerate(kmh)
    )
    profile = SpeedProfile(sections, length, b, 120.0 / 3.6)
    x = np.linspace(0.0, profile.end, 1501)
    permitted = profile.permitted(x)
    assert permitted[-1] == 0.0
    assert permitted.max() <= 120.0 / 3.6
    for section in sections:
        inside = (x >= section.start) & (x - length < section.end)
        assert permitted[inside].max(initial=0.0) <= section.speed_limit * (1.0 + 1e-12)
    # no fall is steeper than the brake: v^2 + 2 b s never decreases along the line
    assert np.diff(permitted**2 + 2.0 * b * x).min() >= -1e-6


def test_braking_curves_obey_their_law():
    b = 0.5
    profile = SpeedProfile(straight(1000.0).sections, 0.0, b)
    way = np.linspace(0.0, 400.0, 9)
    expected = np.minimum(np.sqrt(2.0 * b * way), 80.0 / 3.6)
    np.testing.assert_allclose(profile.permitted(1000.0 - way), expected, rtol=1e-12)


def test_a_limit_holds_for_the_whole_train():
    path = limited(straight(1000.0), 0, 40.0).sections[0]
    sections = (path, Section(1000.0, 3000.0, 0.0, 80.0 / 3.6))
    profile = SpeedProfile(sections, 42.0, 0.5)
    assert profile.limit(1041.9) == pytest.approx(40.0 / 3.6)
    assert profile.limit(1042.1) == pytest.approx(80.0 / 3.6)


def test_the_driver_knows_the_forces_of_the_plant(stock):
    model = line_model(EXAMPLE_PATH, stock)
    line = replace(model.line, curves=((280.0, 7000.0, 400.0), (8200.0, 8290.0, 250.0)))
    model = build(model.train, model.rail, line, span=model.span)
    forces, arrays, n = TrainForces(model), ArrayModel.of(model), model.layout
    for position, speed in ((300.0, 2.0), (3000.0, 15.0), (7010.0, 30.0), (8303.0, 22.2)):
        state = model.initial_state(speed, position)
        local = environment_at(model, 0.0, state)
        state[n.torque] = local.drive_limit
        state[n.pressure] = forces.brake_pressure(30e3, speed)
        motors, shoes, drag, _ = arrays.derivative(state, model.zero_inputs(), local)[n.work]
        assert forces.effort(speed) == pytest.approx(motors / speed, rel=1e-9)
        assert forces.resistance(position, speed) == pytest.approx(drag / speed, rel=1e-9)
        assert shoes / speed == pytest.approx(30e3, rel=1e-9)
        np.testing.assert_allclose(forces.torque(1.0, speed), local.drive_limit, rtol=1e-9)


def test_no_limit_is_exceeded(found):
    run = found.run
    over = run["speed"].values - found.permitted(run["position"].values)
    assert over.max() < OVERSPEED


def test_the_train_stops_at_the_end(found):
    (stop,) = found.stops
    assert abs(stop.error) < 0.01
    assert float(found.run["speed"][-1]) < 0.02


def test_on_the_braking_curve_the_whole_deceleration_is_the_vehicles(found, stock):
    run, profile = found.run, found.legs[0].profile
    speed, position = run["speed"].values, run["position"].values
    curve = np.array([profile.braking_speed(x) for x in position])
    limit = np.array([profile.limit(x) for x in position])
    # well inside the curve, where neither limit nor end is near
    inside = (curve < limit - 1.0) & (np.abs(speed - curve) < 0.02) & (speed > 2.0)
    assert inside.sum() > 100
    deceleration = -run["acceleration"].values[inside]
    assert np.median(deceleration) == pytest.approx(stock.deceleration, rel=1e-3)
    assert np.abs(deceleration - stock.deceleration).max() < 0.15 * stock.deceleration


def test_a_speed_is_held_without_limit_cycle(stock):
    path = straight(4000.0, 60.0, 0.005)
    run = run_line(path, stock).run
    held = run.where((run["position"] > 1500.0) & (run["position"] < 3000.0), drop=True)
    assert np.ptp(held["speed"].values) < 1e-4
    assert np.ptp(held["motor_torque"].values) < 1e-3 * held["motor_torque"].values.max()
    assert float(held["cylinder_pressure"].max()) < 1.0


def test_energy_balances(found, stock):
    energy = found.energy()
    losses = sum(energy.values()) - energy["motors"]
    assert losses == pytest.approx(energy["motors"], rel=1e-4)
    # along the run too, with the kinetic energy
    run, inertia = found.run, stock.train.mass + stock.train.rotating_mass
    stored = run["motor_work"] - run["resistance_work"] - run["shoe_work"]
    stored -= run["friction_work"].sum("axle")
    kinetic = 0.5 * inertia * run["speed"] ** 2
    assert float(abs(stored - kinetic).max()) < 1e-3 * float(kinetic.max())


def test_no_run_is_faster_than_always_at_the_limit_and_never_at_once(found, stock):
    assert found.running_time > found.legs[0].profile.shortest_time()
    # level line, one limit: a train that were at once at full speed would still lose v / (2 b) on braking
    run = run_line(straight(3000.0), stock)
    speed = 80.0 / 3.6
    bound = 3000.0 / speed + speed / (2.0 * stock.deceleration)
    greatest = TrainForces(line_model(run.path, stock)).effort(0.0) / (
        stock.train.mass + stock.train.rotating_mass
    )
    bound += speed / (2.0 * greatest)
    assert bound < run.running_time < 1.1 * bound


def test_a_lower_limit_never_shortens_the_running_time(found, stock):
    for section in (0, 3, 8):
        kmh = 3.6 * EXAMPLE_PATH.sections[section].speed_limit
        slower = run_line(limited(EXAMPLE_PATH, section, kmh - 10.0), stock)
        assert slower.running_time > found.running_time


@given(st.lists(st.integers(3, 12), min_size=4, max_size=4), st.integers(0, 3))
@settings(deadline=None, max_examples=30)
def test_nor_does_it_by_distance_steps(tens, lowered):
    stock = example_stock()
    path = RunningPath(
        "random",
        tuple(
            Section(1000.0 * k, 1000.0 * (k + 1), 0.0, 10.0 * limit / 3.6)
            for k, limit in enumerate(tens)
        ),
    )
    forces = TrainForces(line_model(path, stock))
    times = [
        run_by_distance(forces, each.sections, legs(each, stock), step=5.0).running_time
        for each in (path, limited(path, lowered, 10.0 * tens[lowered] - 10.0))
    ]
    assert times[1] > times[0] - 0.05  # a step's error


def test_the_running_time_does_not_depend_on_the_control_period(found, stock):
    for period in (0.05, 0.2):
        other = run_line(EXAMPLE_PATH, stock, period=period)
        assert other.running_time == pytest.approx(found.running_time, abs=0.1)


def test_distance_steps_converge_to_the_simulated_run(found, stock):
    forces = TrainForces(line_model(EXAMPLE_PATH, stock))
    times = [
        run_by_distance(forces, found.path.sections, found.legs, step).running_time
        for step in (8.0, 2.0, 0.5)
    ]
    errors = [abs(time - found.running_time) for time in times]
    assert all(after < before for before, after in pairwise(errors))
    assert errors[-1] < 1e-3 * found.running_time


def test_points_are_passed_in_order_by_front_or_rear(found):
    times = [p.time for p in found.passings]
    assert times == sorted(times)
    by_name = {p.point.name: p for p in found.passings}
    clear = by_name["bridge clear"]
    front = np.interp(clear.time, found.run["time"].values, found.run["position"].values)
    assert front == pytest.approx(7080.0 + found.stock.length, abs=0.01)
    assert clear.speed == pytest.approx(60.0 / 3.6, abs=0.5)


def test_a_point_that_the_rear_never_reaches_is_said_so(stock):
    path = replace(straight(800.0), points=(PointOfInterest(790.0, "late", "rear"),))
    (late,) = run_line(path, stock).passings
    assert (late.time, late.speed) == (None, None)


def test_a_train_that_cannot_climb_is_refused(stock):
    path = RunningPath("wall", (Section(0.0, 900.0, 0.0, 20.0), Section(900.0, 5000.0, 0.2, 20.0)))
    with pytest.raises(StudyError, match=r"cannot climb at 10\d\d m"):
        run_line(path, stock)


def test_a_line_steeper_than_the_brake_is_refused(stock):
    with pytest.raises(StudyError, match="falls by 60 per mille at 0 m"):
        run_line(straight(1000.0, grade=-0.06), stock)


def test_on_the_steepest_fall_the_train_still_stops_at_the_end(stock):
    run = run_line(straight(1500.0, grade=-0.05), stock)
    assert abs(run.stops[-1].error) < 0.05
    over = run.run["speed"].values - run.permitted(run.run["position"].values)
    assert over.max() < OVERSPEED


def test_a_train_without_brake_is_refused(stock):
    car = replace(stock.train.cars[0], air_brake=None)
    model = line_model(EXAMPLE_PATH, replace(stock, train=replace(stock.train, cars=(car,))))
    with pytest.raises(StudyError, match="no air brake"):
        MinimumTimeDriver(model, legs(EXAMPLE_PATH, stock))


def test_effort_beyond_the_rail_is_refused(stock):
    with pytest.raises(StudyError, match=r"needs an adhesion coefficient of 0\.\d\d"):
        line_model(EXAMPLE_PATH, stock, adhesion=0.05)


@pytest.mark.parametrize(("length", "deceleration"), [(-1.0, 0.5), (10.0, 0.0), (10.0, np.nan)])
def test_impossible_profiles_are_refused(length, deceleration):
    with pytest.raises(StudyError, match="must be finite"):
        SpeedProfile(EXAMPLE_PATH.sections, length, deceleration)
