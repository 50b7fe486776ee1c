"""Line runs: permitted speeds, the driver's forces, and what every run keeps: limits, stops, energy, bounds of its time."""

import functools
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.plant.array_model import ArrayModel
from alloc.plant.model import build
from alloc.plant.train import TorqueLimit
from studies.files.study_error import FileWarning, StudyError
from studies.lines.line_run import LineRun, line_model, run_line
from studies.lines.named_files import find_stock
from studies.lines.speed_profile import (
    DrivingStyle,
    MinimumTimeDriver,
    SpeedProfile,
    TrainForces,
    legs,
    run_by_distance,
    with_stops,
)
from studies.railtoolkit.vehicles import PointOfInterest, RunningPath, Section
from tests.plant.numpy_plant import environment_at
from tests.studies.example_lines import EXAMPLE_PATH, example_stock

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


def electric(stock):
    """The same train with an electric brake of 40 kN and 500 kW."""
    (car,) = stock.train.cars
    motors, radius = car.motors, car.wheel_radius
    each = radius / (motors.gear_ratio * sum(car.driven))
    brake = TorqueLimit(40e3 * each, 500e3 / sum(car.driven), fade_speed=2.0)
    car = replace(car, motors=replace(motors, brake=brake))
    return replace(stock, train=replace(stock.train, cars=(car,)))


STOPPING = with_stops(EXAMPLE_PATH, ["summit", "9000"], 25.0)
CLIMB = RunningPath("climb", (Section(0.0, 1500.0, 0.0, 25.0), Section(1500.0, 4000.0, 0.02, 25.0)))
RUNS = {
    "straight through": lambda s: run_line(EXAMPLE_PATH, s),
    "all effort, no coasting": lambda s: run_line(EXAMPLE_PATH, s, DrivingStyle(1.0, 0.0)),
    "effort 0.8": lambda s: run_line(EXAMPLE_PATH, s, DrivingStyle(effort=0.8)),
    "effort 0.6": lambda s: run_line(EXAMPLE_PATH, s, DrivingStyle(effort=0.6)),
    "coasting 20 s": lambda s: run_line(EXAMPLE_PATH, s, DrivingStyle(coasting=20.0)),
    "coasting 60 s": lambda s: run_line(EXAMPLE_PATH, s, DrivingStyle(coasting=60.0)),
    "stopping": lambda s: run_line(STOPPING, s),
    "electric brake": lambda s: run_line(EXAMPLE_PATH, electric(s)),
    "steepest fall": lambda s: run_line(straight(1500.0, grade=-0.05), s),
    "coasting on a climb": lambda s: run_line(CLIMB, s, DrivingStyle(coasting=300.0)),
}


OVERSPEEDS = {"electric brake": 0.2}
"""Where the electric brake gives way to the shoes, for a moment."""
TIMES = {"coasting on a climb": 0.05}
"""Where the way of a mass point off the climb is another than the train's."""


@functools.cache
def done(name) -> LineRun:
    return RUNS[name](example_stock())


@pytest.fixture(scope="module")
def stock():
    return example_stock()


@pytest.fixture(scope="module")
def found() -> LineRun:
    return done("straight through")


def test_every_run_keeps_limits_stops_and_energy_and_takes_the_time_of_distance_steps():
    wrong = {}
    for name in RUNS:
        one = done(name)
        position, speed = one.run["position"].values, one.run["speed"].values
        halts = np.array([stop.point.station for stop in one.stops[:-1]])
        moving = (np.abs(position[:, None] - halts) > 1.0).all(axis=1)
        energy = one.energy()
        kept = {
            "limits": (speed - one.permitted(position))[moving].max() < OVERSPEEDS.get(name, OVERSPEED),
            "stops": max(abs(stop.error) for stop in one.stops) < 0.05,
            "stands": speed[-1] < 0.02,
            "energy": sum(energy.values()) == pytest.approx(2.0 * energy["motors"], rel=5e-5),
            "time": one.distance_time == pytest.approx(one.running_time, rel=TIMES.get(name, 6e-3)),
            "not faster than the limit": one.running_time > one.legs[-1].profile.shortest_time(),
        }  # fmt: skip
        if broken := [law for law, is_kept in kept.items() if not is_kept]:
            wrong[name] = broken
    assert not wrong
    assert abs(done("straight through").stops[0].error) < 0.01


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


def test_a_profile_of_many_sections_a_long_way_off_holds_its_limits():
    rng = np.random.default_rng(3)
    ends = -1e9 + np.cumsum(rng.uniform(5.0, 300.0, 8000))
    starts = np.concatenate([[-1e9], ends[:-1]])
    limits = rng.integers(2, 16, 8000) * 10.0 / 3.6
    path = [Section(*row, 0.0, v) for *row, v in zip(starts, ends, limits, strict=True)]
    profile = SpeedProfile(path, 400.0, 0.5, 33.0)
    for x in rng.uniform(-1e9, ends[-1], 300):
        under = (starts <= x) & (ends > x - 400.0)
        assert profile.limit(x) == min(33.0, limits[under].min())


def test_the_braking_point_is_where_curve_and_speed_meet():
    rng = np.random.default_rng(5)
    path = [
        Section(500.0 * k, 500.0 * (k + 1), 0.0, v) for k, v in enumerate(rng.uniform(5, 40, 30))
    ]
    profile = SpeedProfile(path, 0.0, 0.5)
    for x in rng.uniform(0.0, 14_000.0, 50):
        speed = 0.9 * float(profile.permitted(x))
        met, _ = profile.braking_point(x, speed)
        if profile.limit(met) >= speed:  # else a lower limit is met on the way
            assert profile.braking_speed(met) == pytest.approx(speed, rel=1e-6)


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


def test_energy_balances_all_along_the_run(found, stock):
    run, inertia = found.run, stock.train.mass + stock.train.rotating_mass
    stored = run["motor_work"] - run["resistance_work"] - run["shoe_work"]
    stored -= run["friction_work"].sum("axle")
    kinetic = 0.5 * inertia * run["speed"] ** 2
    assert float(abs(stored - kinetic).max()) < 1e-3 * float(kinetic.max())


def test_no_run_is_as_fast_as_one_that_were_at_once_at_full_speed(stock):
    # level line, one limit: it would still lose v / (2 b) on braking
    run = run_line(straight(3000.0), stock)
    speed = 80.0 / 3.6
    bound = 3000.0 / speed + speed / (2.0 * stock.deceleration)
    greatest = TrainForces(line_model(run.path, stock)).effort(0.0) / (
        stock.train.mass + stock.train.rotating_mass
    )
    bound += speed / (2.0 * greatest)
    assert bound < run.running_time < 1.1 * bound


@given(st.lists(st.integers(3, 12), min_size=4, max_size=4), st.integers(0, 3))
@settings(deadline=None, max_examples=30)
def test_a_lower_limit_never_shortens_the_running_time(tens, lowered):
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


@given(
    st.lists(st.floats(50.0, 14_900.0), min_size=1, max_size=5, unique_by=lambda x: round(x / 60.0))
)
@settings(deadline=None, max_examples=30)
def test_any_further_stop_makes_the_run_longer(stations):
    stock = example_stock()
    forces = TrainForces(line_model(EXAMPLE_PATH, stock))
    times = []
    for count in range(len(stations) + 1):
        path = with_stops(EXAMPLE_PATH, [str(x) for x in stations[:count]], 0.0)
        try:
            route = legs(path, stock)
        except StudyError:  # two are too close
            return
        times.append(run_by_distance(forces, path.sections, route).running_time)
    assert all(b > a for a, b in pairwise(times))


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


def test_points_are_passed_in_order_by_front_or_rear_and_some_never(found, stock):
    times = [p.time for p in found.passings]
    assert times == sorted(times)
    by_name = {p.point.name: p for p in found.passings}
    clear = by_name["bridge clear"]
    front = np.interp(clear.time, found.run["time"].values, found.run["position"].values)
    assert front == pytest.approx(7080.0 + found.stock.length, abs=0.01)
    assert clear.speed == pytest.approx(60.0 / 3.6, abs=0.5)
    path = replace(straight(800.0), points=(PointOfInterest(790.0, "late", "rear"),))
    (late,) = run_line(path, stock).passings
    assert (late.time, late.speed) == (None, None)


def test_the_train_stands_where_and_as_long_as_it_is_to(stock, found):
    one = done("stopping")
    assert [stop.point.station for stop in one.stops] == [5200.0, 9000.0, 15000.0]
    speed, time = one.run["speed"].values, one.run["time"].values
    for stop in one.stops[:-1]:
        assert abs(stop.error) < 0.02
        assert stop.departure - stop.arrival == pytest.approx(25.0)
        standing = (time > stop.arrival + 0.5) & (time < stop.departure)
        assert np.abs(speed[standing]).max() < 0.02
        assert np.abs(np.diff(one.run["position"].values[standing])).max() < 1e-3
        assert speed[np.searchsorted(time, stop.departure + 3.0)] > 0.5
    assert one.running_time > found.running_time + 2 * 25.0 + 20.0
    # a leg is a run of its own: from standstill to the first stop as on a line that ends there
    cut = [section for section in EXAMPLE_PATH.sections if section.start < 5200.0]
    alone = run_line(RunningPath("cut", tuple(cut)), stock)
    assert one.stops[0].arrival == pytest.approx(alone.running_time, abs=0.02)
    # where the middle is to be at a platform, the front stands further on
    path = replace(EXAMPLE_PATH, points=(PointOfInterest(8000.0, "platform", "middle", 10.0),))
    assert legs(path, stock)[0].profile.end == 8000.0 + 0.5 * stock.length


def test_less_effort_and_more_coasting_cost_time_and_save_work(found):
    assert done("all effort, no coasting").running_time == found.running_time
    for styles in (("effort 0.8", "effort 0.6"), ("coasting 20 s", "coasting 60 s")):
        runs = [found, *map(done, styles)]
        times = [run.running_time for run in runs]
        work = [run.energy()["motors"] for run in runs]
        assert times == sorted(times)
        assert times[-1] > times[0] + 2.0
        assert work == sorted(work, reverse=True)
    # a train that coasts on a climb pulls again before it stands
    climb = done("coasting on a climb").run
    position, speed = climb["position"].values, climb["speed"].values
    assert speed[(position > 200.0) & (position < 3900.0)].min() > 1.0


def test_the_electric_brake_spares_the_shoes_and_not_the_time_and_gives_no_more_than_it_can(found):
    one = done("electric brake")
    air, both = found.energy(), one.energy()
    assert air["electric_brake"] == 0.0
    assert both["electric_brake"] > 0.5 * air["brake_shoes"]
    total = both["electric_brake"] + both["brake_shoes"]
    assert total == pytest.approx(air["brake_shoes"], rel=0.01)
    assert one.pad_wear() < 0.5 * found.pad_wear()
    assert one.running_time == pytest.approx(found.running_time, abs=0.1)
    braking = -one.run["motor_torque"].values
    assert braking.max() > 0.0
    # the motors follow with a lag of 5 ms
    assert (braking - one.run["brake_limit"].values).max() < 0.01 * braking.max()


def test_half_the_load_lies_between():
    empty, half, full = (find_stock("v90-ore", share).train for share in (0.0, 0.5, 1.0))
    assert half.mass == pytest.approx(0.5 * (empty.mass + full.mass))
    assert half.resistance[0] == pytest.approx(0.5 * (empty.resistance[0] + full.resistance[0]))
    assert half.resistance[2] == full.resistance[2]


def test_a_set_of_trains_runs_a_line_too():
    with pytest.warns(
        FileWarning, match=r"'commuter-8car' is run as rigid.* 1\.35 km/h/s, usual for passenger"
    ):
        stock = find_stock("commuter-8car")
    run = run_line(EXAMPLE_PATH, stock)
    energy = run.energy()
    assert abs(run.stops[-1].error) < 0.05
    assert energy["electric_brake"] > 10.0 * energy["brake_shoes"]
    with pytest.warns(FileWarning, match=r"0\.81 km/h/s, usual for freight"):
        assert find_stock("freight-17").deceleration == 0.225


def test_what_cannot_run_is_refused(stock):
    wall = RunningPath("wall", (Section(0.0, 900.0, 0.0, 20.0), Section(900.0, 5000.0, 0.2, 20.0)))
    car = replace(stock.train.cars[0], air_brake=None)
    unbraked = replace(stock, train=replace(stock.train, cars=(car,)))
    with pytest.warns(FileWarning):
        unmotored, unbraked_set = find_stock("gb-unit-8car"), find_stock("one-axle")
    for asked, words in (
        (lambda: run_line(wall, stock), r"cannot climb at 10\d\d m"),
        (lambda: run_line(straight(1000.0, grade=-0.06), stock), "falls by 60 per mille at 0 m"),
        (lambda: MinimumTimeDriver(line_model(EXAMPLE_PATH, unbraked), legs(EXAMPLE_PATH, stock)), "no air brake"),
        (lambda: line_model(EXAMPLE_PATH, stock, adhesion=0.05), r"needs an adhesion coefficient of 0\.\d\d"),
        (lambda: run_line(EXAMPLE_PATH, unmotored), "no motors"),
        (lambda: run_line(EXAMPLE_PATH, unbraked_set), "no air brake"),
        (lambda: SpeedProfile(EXAMPLE_PATH.sections, -1.0, 0.5), "must be finite"),
        (lambda: SpeedProfile(EXAMPLE_PATH.sections, 10.0, 0.0), "must be finite"),
        (lambda: SpeedProfile(EXAMPLE_PATH.sections, 10.0, np.nan), "must be finite"),
    ):  # fmt: skip
        with pytest.raises(StudyError, match=words):
            asked()
