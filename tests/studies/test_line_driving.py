"""Stops, dwell, share of effort, coasting, and the two brakes of a line run."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.plant.train import TorqueLimit
from studies.files.study_error import FileWarning, StudyError
from studies.lines.distance_steps import run_by_distance
from studies.lines.driving_style import DrivingStyle, legs, with_stops
from studies.lines.line_run import line_model, run_line
from studies.lines.named_files import LINES, TRAINS, find_line, find_stock, shipped
from studies.lines.speed_profile import SpeedProfile
from studies.lines.train_forces import TrainForces
from studies.railtoolkit.records import PointOfInterest, RunningPath, Section
from tests.studies.example_line import EXAMPLE_PATH, example_stock
from tests.studies.test_minimum_time import OVERSPEED

STOPPING = with_stops(EXAMPLE_PATH, ["summit", "9000"], 25.0)


def electric(stock):
    """The same train with an electric brake of 40 kN and 500 kW."""
    (car,) = stock.train.cars
    motors, radius = car.motors, car.wheel_radius
    each = radius / (motors.gear_ratio * sum(car.driven))
    brake = TorqueLimit(40e3 * each, 500e3 / sum(car.driven), fade_speed=2.0)
    car = replace(car, motors=replace(motors, brake=brake))
    return replace(stock, train=replace(stock.train, cars=(car,)))


@pytest.fixture(scope="module")
def stock():
    return example_stock()


@pytest.fixture(scope="module")
def straight_through(stock):
    return run_line(EXAMPLE_PATH, stock)


@pytest.fixture(scope="module")
def stopping(stock):
    return run_line(STOPPING, stock)


def test_the_train_stands_where_and_as_long_as_it_is_to(stopping):
    assert [stop.point.station for stop in stopping.stops] == [5200.0, 9000.0, 15000.0]
    speed, time = stopping.run["speed"].values, stopping.run["time"].values
    for stop in stopping.stops[:-1]:
        assert abs(stop.error) < 0.02
        assert stop.departure - stop.arrival == pytest.approx(25.0)
        standing = (time > stop.arrival + 0.5) & (time < stop.departure)
        assert np.abs(speed[standing]).max() < 0.02
        assert np.abs(np.diff(stopping.run["position"].values[standing])).max() < 1e-3
        assert speed[np.searchsorted(time, stop.departure + 3.0)] > 0.5


def test_with_stops_no_limit_is_exceeded_and_energy_balances(stopping):
    run = stopping.run
    over = run["speed"].values - stopping.permitted(run["position"].values)
    moving = np.abs(run["position"].values[:, None] - [5200.0, 9000.0]).min(axis=1) > 1.0
    assert over[moving].max() < OVERSPEED
    energy = stopping.energy()
    assert sum(energy.values()) == pytest.approx(2.0 * energy["motors"], rel=1e-3)


def test_stops_cost_more_time_than_they_dwell(straight_through, stopping):
    assert stopping.running_time > straight_through.running_time + 2 * 25.0 + 20.0
    assert stopping.distance_time == pytest.approx(stopping.running_time, rel=6e-3)


def test_a_leg_is_a_run_of_its_own(stock, stopping):
    # from standstill to the first stop as on a line that ends there
    cut = [section for section in EXAMPLE_PATH.sections if section.start < 5200.0]
    alone = run_line(RunningPath("cut", tuple(cut)), stock)
    assert stopping.stops[0].arrival == pytest.approx(alone.running_time, abs=0.02)


def test_where_the_rear_is_to_be_the_front_stands_further_on(stock):
    path = replace(EXAMPLE_PATH, points=(PointOfInterest(8000.0, "platform", "middle", 10.0),))
    assert run_line(path, stock).legs[0].profile.end == 8000.0 + 0.5 * stock.length


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


def test_less_effort_and_more_coasting_cost_time_and_save_work(stock, straight_through):
    for styles in (
        [DrivingStyle(effort=share) for share in (0.8, 0.6)],
        [DrivingStyle(coasting=time) for time in (20.0, 60.0)],
    ):
        runs = [straight_through, *(run_line(EXAMPLE_PATH, stock, style) for style in styles)]
        times = [run.running_time for run in runs]
        work = [run.energy()["motors"] for run in runs]
        assert times == sorted(times)
        assert times[-1] > times[0] + 2.0
        assert work == sorted(work, reverse=True)
        for run in runs[1:]:  # the other way of calculation knows the same styles
            assert run.distance_time == pytest.approx(run.running_time, rel=6e-3)


def test_all_effort_and_no_coasting_is_the_fastest_run(stock, straight_through):
    again = run_line(EXAMPLE_PATH, stock, DrivingStyle(1.0, 0.0))
    assert again.running_time == straight_through.running_time


def test_a_train_that_coasts_on_a_climb_pulls_again_before_it_stands(stock):
    wall = (Section(0.0, 1500.0, 0.0, 25.0), Section(1500.0, 4000.0, 0.02, 25.0))
    run = run_line(RunningPath("climb", wall), stock, DrivingStyle(coasting=300.0))
    assert abs(run.stops[-1].error) < 0.05
    position, speed = run.run["position"].values, run.run["speed"].values
    assert speed[(position > 200.0) & (position < 3900.0)].min() > 1.0


def test_the_electric_brake_spares_the_shoes_and_not_the_time(stock, straight_through):
    run = run_line(EXAMPLE_PATH, electric(stock))
    air, both = straight_through.energy(), run.energy()
    assert air["electric_brake"] == 0.0
    assert both["electric_brake"] > 0.5 * air["brake_shoes"]
    total = both["electric_brake"] + both["brake_shoes"]
    assert total == pytest.approx(air["brake_shoes"], rel=0.01)
    assert run.pad_wear() < 0.5 * straight_through.pad_wear()
    assert run.running_time == pytest.approx(straight_through.running_time, abs=0.1)
    assert abs(run.stops[-1].error) < 0.05


def test_the_electric_brake_gives_no_more_than_it_can(stock):
    run = run_line(EXAMPLE_PATH, electric(stock)).run
    braking = -run["motor_torque"].values
    assert braking.max() > 0.0
    # the motors follow with a lag of 5 ms
    assert (braking - run["brake_limit"].values).max() < 0.01 * braking.max()


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


def test_what_ships_says_where_it_comes_from():
    assert set(shipped(LINES)) == {"dresden-goerlitz"}
    assert set(shipped(TRAINS)) == {"br-642", "ic2", "v90-ore"}
    path = find_line("dresden-goerlitz")
    assert path.source
    assert path.span == (0.0, 101_800.0)
    rise = sum((s.end - s.start) * s.grade for s in path.sections)
    assert rise == pytest.approx(221.0 - 118.0, abs=15.0)  # heights of the two stations
    for name in shipped(TRAINS):
        assert find_stock(name).train.source
        assert find_stock(name, 0.0).train.mass < find_stock(name).train.mass


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


@pytest.mark.parametrize(
    ("name", "words"), [("gb-unit-8car", "no motors"), ("one-axle", "no air brake")]
)
def test_a_train_that_cannot_pull_or_brake_is_refused(name, words):
    with pytest.warns(FileWarning):
        stock = find_stock(name)
    with pytest.raises(StudyError, match=words):
        run_line(EXAMPLE_PATH, stock)
