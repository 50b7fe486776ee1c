"""Trains of several vehicles and with load: running times against other ways of calculation."""

import warnings
from dataclasses import replace

import pytest
import yaml

from studies.files.study_error import FileWarning, StudyError
from studies.lines.distance_steps import run_by_distance
from studies.lines.driving_style import legs, with_stops
from studies.lines.line_run import line_model, run_line
from studies.lines.lumped_train import lumped
from studies.lines.named_files import find_line, find_stock
from studies.lines.train_forces import TrainForces
from studies.railtoolkit.reading import read_rolling_stock
from studies.railtoolkit.records import RunningPath, sections
from tests.studies.other_programs import PlainRun, PlainVehicle, exact_time, published_scheme

LINE = [
    (0.0, 60.0, 0.0), (700.0, 60.0, 6.0), (1500.0, 100.0, 3.0), (3100.0, 100.0, -8.0), (4300.0, 70.0, -2.0),
    (4700.0, 140.0, 0.0), (6900.0, 140.0, 9.0), (8200.0, 50.0, 0.0), (8500.0, 120.0, -4.0), (10_000.0, 120.0, 0.0),
]  # fmt: skip


def hyperbola(start: float, power: float, last: float) -> tuple[tuple[float, float], ...]:
    """Effort [N] of a starting effort and a power [W], every 1 km/h."""
    return (
        (0.0, start),
        *((float(k), min(start, 3.6 * power / k)) for k in range(1, int(last) + 1)),
    )


FREIGHT_ENGINE = PlainVehicle(
    "locomotive", 20.9, 123.0, 0.0, 1.15, 123.0, 2.8, 0.0, 7.5, hyperbola(360e3, 2.9e6, 120)
)
HOPPER = PlainVehicle("freight", 15.5, 23.5, 66.0, 1.03, base=1.5, air=4.4)
FLAT = PlainVehicle("freight", 19.7, 18.0, 0.0, 1.05, base=1.9, air=11.0)
EXPRESS_ENGINE = PlainVehicle(
    "locomotive", 19.2, 86.0, 0.0, 1.2, 86.0, 2.4, 0.0, 5.1, hyperbola(270e3, 5.2e6, 200)
)
COACH = PlainVehicle("passenger", 26.4, 42.0, 7.0, 1.05, base=1.9, rolling=0.3, air=2.6)
DINER = PlainVehicle("passenger", 27.5, 55.0, 3.0, 1.04, base=2.1, rolling=0.7, air=2.0)
PAIR = PlainVehicle(
    "multiple unit", 52.0, 96.0, 21.0, 1.07, 48.0, 3.1, 1.6, 3.3, hyperbola(110e3, 0.9e6, 140)
)

TRAINS = {
    "full hoppers": ([FREIGHT_ENGINE, *[HOPPER] * 12], 100.0, 0.225),
    "hoppers among empty flats": ([FREIGHT_ENGINE, *[HOPPER, FLAT, FLAT] * 5], 90.0, 0.225),
    "two engines": ([FREIGHT_ENGINE, FREIGHT_ENGINE, *[HOPPER] * 20], 80.0, 0.225),
    "express": ([EXPRESS_ENGINE, *[COACH] * 8, DINER], 160.0, 0.375),
    "pushed coaches": ([COACH, DINER, COACH, EXPRESS_ENGINE], 140.0, 0.375),
    "two units": ([PAIR, PAIR], 120.0, 0.375),
}
"""Made up for this test: vehicles from the front, limit [km/h], usual deceleration [m/s2] of the format."""


@pytest.fixture(params=TRAINS)
def train(request, tmp_path):
    """A train, as plain numbers and as read from a file without `a_braking`."""
    return made(request.param, tmp_path)


def made(name, tmp_path):
    """The same for one of `TRAINS`."""
    vehicles, limit, brake = TRAINS[name]
    kinds = {id(vehicle): f"V{k}" for k, vehicle in enumerate(vehicles)}
    stock = {
        "schema": "https://railtoolkit.org/schema/rolling-stock.json",
        "schema_version": "2022.05",
        "trains": [
            {"name": "a train", "id": "T", "formation": [kinds[id(v)] for v in vehicles]}
        ],
        "vehicles": [
            v.keys(kinds[id(v)]) | {"speed_limit": limit} for v in {id(v): v for v in vehicles}.values()
        ],
    }  # fmt: skip
    path = tmp_path / "train.yaml"
    path.write_text(yaml.safe_dump(stock))
    with pytest.warns(FileWarning, match=f"'a_braking'; taken as -{brake:g} m/s2"):
        read = read_rolling_stock(path)
    return PlainRun(vehicles, brake, limit, LINE), read


PATH = RunningPath("ups and downs", sections(LINE))


def test_resistance_grows_with_the_load_of_what_is_drawn_and_not_of_what_draws(train):
    plain, stock = train
    forces = TrainForces(line_model(PATH, stock))
    for speed in (0.0, 11.0, 29.0):
        assert forces.level_resistance(speed) == pytest.approx(plain.drag(speed), rel=1e-9)
    assert forces.inertia == pytest.approx(plain.inertia, rel=1e-9)
    assert stock.train.mass == pytest.approx(plain.mass, rel=1e-12)


def test_the_published_scheme_gives_the_same_time_written_down_anew(train):
    plain, stock = train
    forces = TrainForces(line_model(PATH, stock))
    ours = run_by_distance(forces, PATH.sections, legs(PATH, stock)).running_time
    assert ours == pytest.approx(published_scheme(plain), rel=5e-4)


@pytest.mark.parametrize("name", ["hoppers among empty flats", "express", "two units"])
def test_the_simulated_run_takes_the_time_of_an_exact_solution(name, tmp_path):
    plain, stock = made(name, tmp_path)
    run = run_line(PATH, stock)
    assert run.running_time == pytest.approx(exact_time(plain), rel=2e-3)
    assert abs(run.stops[-1].error) < 0.05


@pytest.mark.parametrize(
    ("name", "published"), [("br-642", 3437.529), ("v90-ore", 8795.025), ("ic2", 2913.109)]
)
def test_trains_that_ship_take_the_published_times(name, published):
    # those of TrainRuns.jl at commit 7ca94cb, for the same line
    path, stock = find_line("dresden-goerlitz"), find_stock(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        forces = TrainForces(line_model(path, stock))
    run = run_by_distance(forces, path.sections, legs(path, stock))
    assert run.running_time == pytest.approx(published, rel=1e-3)


def test_one_wheelset_under_a_wagon_changes_nothing_that_counts():
    train = find_stock("v90-ore").train
    short = lumped(train)
    assert short.axle_count == 4 + 10
    assert short.mass == pytest.approx(train.mass)
    assert short.rotating_mass == pytest.approx(train.rotating_mass)
    for before, after in zip(train.cars, short.cars, strict=True):
        forces = [
            car.air_brake.force_per_pascal * len(car.axle_positions) for car in (before, after)
        ]
        assert forces[0] == pytest.approx(forces[1])


def test_a_train_starts_on_a_ramp_that_a_mass_point_cannot_climb():
    ramp = [(0.0, 70.0, 0.0), (400.0, 70.0, 40.0), (490.0, 70.0, 0.0), (1200.0, 70.0, 0.0)]
    path = with_stops(RunningPath("ramp", sections(ramp)), ["470"], 0.0)
    run = run_line(path, find_stock("v90-ore"))
    assert run.distance_time is None
    assert abs(run.stops[-1].error) < 0.05
    # with all of the train on it, it cannot
    long = replace(path, sections=sections([(0.0, 70.0, 40.0), (2000.0, 70.0, 0.0)]), points=())
    with pytest.raises(StudyError, match="cannot climb at 0 m"):
        run_line(long, find_stock("v90-ore"))
