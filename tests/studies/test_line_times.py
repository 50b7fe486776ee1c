"""Running times and forces against other programs and other ways of calculation; real lines and trains in a scenario.

TrainRuns.jl takes the train as a mass point at its front and steps through the line by 20 m with explicit Euler. At the
start, where the effort falls quickly, such steps make it 2.2 s too fast: the same scheme here gives its times to 2e-4, and
with ever smaller steps goes to the simulated run.
"""

import json
import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
import yaml

from alloc.plant.array_model import ArrayModel
from alloc.plant.model import Model
from alloc.simulation import simulate
from studies.command_line.main import run
from studies.files.study_error import FileWarning, StudyError
from studies.lines.line_run import line_model, lumped, run_line
from studies.lines.named_files import LINES, find_line, find_stock, shipped, with_real_input
from studies.lines.named_files import TRAINS as TRAINS_SHIPPED
from studies.lines.speed_profile import SpeedProfile, TrainForces, legs, run_by_distance, with_stops
from studies.railtoolkit.reading import read_rolling_stock
from studies.railtoolkit.vehicles import PointOfInterest, RunningPath, sections
from studies.scenario.scenario import load_scenario
from tests.plant.numpy_plant import environment_at
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
SIMULATED = ("hoppers among empty flats", "express", "two units")


def test_resistance_inertia_and_times_are_those_of_other_calculations(tmp_path):
    """Resistance grows with the load of what is drawn; the published scheme and an exact solution are written anew."""
    for name in TRAINS:
        plain, stock = made(name, tmp_path)
        forces = TrainForces(line_model(PATH, stock))
        for speed in (0.0, 11.0, 29.0):
            assert forces.level_resistance(speed) == pytest.approx(plain.drag(speed), rel=1e-9), (
                name
            )
        assert forces.inertia == pytest.approx(plain.inertia, rel=1e-9), name
        assert stock.train.mass == pytest.approx(plain.mass, rel=1e-12), name
        ours = run_by_distance(forces, PATH.sections, legs(PATH, stock)).running_time
        assert ours == pytest.approx(published_scheme(plain), rel=5e-4), name
        if name in SIMULATED:
            one = run_line(PATH, stock)
            assert one.running_time == pytest.approx(exact_time(plain), rel=2e-3), name
            assert abs(one.stops[-1].error) < 0.05, name


PUBLISHED = {"br-642": 3437.529, "v90-ore": 8795.025, "ic2": 2913.109}
"""Running times [s] on the line from Dresden to Görlitz by TrainRuns.jl at commit 7ca94cb."""


def test_what_ships_says_where_it_comes_from_and_takes_the_published_times():
    assert set(shipped(LINES)) == {"dresden-goerlitz"}
    assert set(shipped(TRAINS_SHIPPED)) == set(PUBLISHED)
    path = find_line("dresden-goerlitz")
    assert path.source
    assert path.span == (0.0, 101_800.0)
    rise = sum((s.end - s.start) * s.grade for s in path.sections)
    assert rise == pytest.approx(221.0 - 118.0, abs=15.0)  # heights of the two stations
    for name, published in PUBLISHED.items():
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            stock = find_stock(name)
            forces = TrainForces(line_model(path, stock))
        assert stock.train.source
        assert find_stock(name, 0.0).train.mass < stock.train.mass
        route = legs(path, stock)
        time = run_by_distance(forces, path.sections, route).running_time
        assert time == pytest.approx(published, rel=2e-4 if name == "br-642" else 1e-3), name
        if name == "br-642":
            # a train without length could speed up at once: the other program does not do so
            eager = SpeedProfile(path.sections, 0.0, stock.deceleration, stock.speed_limit)
            sooner = run_by_distance(forces, path.sections, [replace(route[0], profile=eager)])
            assert sooner.running_time < published - 5.0


GRADES = [0.0, 1.0, 2.0, 5.0, -3.0, 5.0, -10.0, 15.0, -10.0]
TEN_KM = {
    "const": (391.6153, [(0.0, 160.0, 0.0), (10_000.0, 160.0, 0.0)]),
    "slope": (395.5151, [
        *((1000.0 * k, 160.0, grade) for k, grade in enumerate(GRADES)),
        (8500.0, 160.0, 20.0), (9000.0, 160.0, 0.0), (10_000.0, 160.0, 0.0),
    ]),
}  # fmt: skip
"""Lines of TrainRuns.jl: its running time [s] of the railcar `br-642`, and start, limit, gradient of each section."""
POINTS = {
    "const": [
        ("accelerating", 999.0, 22.517332598, 67.323261988, 19431.88834, 4044.84047, 0.16190075625),
        ("accelerating", 2000.0, 27.476497364, 107.01226356, 14864.23047, 5019.78204, 0.10358215942),
        ("accelerating", 3375.0, 31.842471092, 153.26361353, 14004.05249, 6015.33162, 0.08405640643),
        ("cruising", 5000.0, 33.333299037, 202.42710734, 6384.70692, 6384.70692, 0.0),
        ("braking", 9000.0, 29.165047331, 323.04001026, 0.0, 5389.57496, -0.4253),
    ],
    "slope": [
        ("accelerating", 850.0, 21.413266603, 60.540163328, 19400.0, 3850.35090, 0.16361162773),
        ("accelerating", 1000.0, 22.524508295, 67.367674023, 19428.53012, 4909.11660, 0.15277160688),
        ("accelerating", 2000.0, 27.191075082, 107.235302660, 14915.60649, 6685.14390, 0.08659998514),
    ],
}  # fmt: skip
"""Its states: what the train does, place [m], speed [m/s], time [s], effort, resistance [N], acceleration [m/s2]."""


class Forces(NamedTuple):
    effort: float
    resistance: float
    acceleration: float


def plant_forces(model: Model, speed: float, position: float, drives: bool) -> Forces:
    """What the plant's right side does to the train in pure rolling, motors at their bound or off.

    `position` is that of the train's middle, where the plant takes the gradient. Works per time over the speed are forces;
    the acceleration is that of body and wheels together, in which the forces between the two cancel.
    """
    arrays, n, s = ArrayModel.of(model), model.layout, model.structure
    state = model.initial_state(speed, position - s.car_offset[0])
    local = environment_at(model, 0.0, state)
    if drives:
        state[n.torque] = local.drive_limit
    rate = arrays.derivative(state, model.zero_inputs(), local)
    motors, _, drag, _ = rate[n.work]
    mass, rotating = s.body_mass, s.inertia / s.radius
    momentum = mass @ rate[n.speed] + rotating @ rate[n.omega]
    return Forces(
        motors / speed, drag / speed, momentum / (mass.sum() + (rotating / s.radius).sum())
    )


def test_forces_speeds_and_times_at_the_points_of_another_program():
    stock = find_stock("br-642")
    for line, (expected, rows) in TEN_KM.items():
        points = POINTS[line]
        places = tuple(PointOfInterest(s, f"{s}", "front") for _, s, *_ in points)
        path = RunningPath(line, sections(rows), places)
        model, found = line_model(path, stock), run_line(path, stock)
        steps = run_by_distance(TrainForces(model), path.sections, legs(path, stock))
        assert found.distance_time == steps.running_time == pytest.approx(expected, rel=2e-4)
        # misses 0.5 % by a tenth of it, all from the other program's first steps
        assert 0.0 < found.running_time / expected - 1.0 < 6e-3
        for (does, s, v, t, effort, resistance, a), passed in zip(
            points, found.passings, strict=True
        ):
            here = plant_forces(model, v, s, does == "accelerating")
            assert here.resistance == pytest.approx(resistance, rel=1e-4)
            if (
                does == "accelerating"
            ):  # effort and acceleration of the others are the driver's choice
                assert here.effort == pytest.approx(effort, rel=1e-4)
                assert here.acceleration == pytest.approx(a, rel=1e-4)
            else:
                k = int(np.searchsorted(found.run["position"].values, s))
                assert float(found.run["acceleration"][k]) == pytest.approx(a, rel=1e-2, abs=1e-5)
            speed = np.sqrt(np.interp(s, steps.position, steps.speed**2))
            assert speed == pytest.approx(v, rel=1e-5)
            k = int(np.searchsorted(steps.position, s)) - 1
            time = steps.time[k] + 2.0 * (s - steps.position[k]) / (steps.speed[k] + speed)
            assert time == pytest.approx(t, abs=2e-3)
            # its first steps make it 2.2 s early, and 0.8 % fast where speed is still low
            assert passed.speed == pytest.approx(v, rel=8e-3)
            assert 1.8 < passed.time - t < 2.4


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


def test_a_scenario_takes_a_real_line_and_train_from_its_steepest_climb_on(capsys, tmp_path):
    line, train = "dresden-goerlitz", str(TRAINS_SHIPPED / "br-642.toml")
    event = with_real_input(load_scenario("gradient-start"), line, train).event()
    # two of the railcar's three bogies are driven
    assert event.model.train.mass == pytest.approx(68.0e3 + 20.0e3)  # with its load
    assert event.model.train.rotating_mass == pytest.approx(0.08 * 88.0e3, rel=1e-3)
    assert sum(map(sum, (car.driven for car in event.model.train.cars))) == 4
    assert event.model.layout.units == 2
    assert event.initial_position == 868.0
    stations = event.model.line.stations
    assert event.model.line.grades[stations.index(868.0)] == pytest.approx(0.020)
    slipping = simulate(event, "greedy", "cut-and-ramp")
    assert slipping.attrs["detections"] > 0
    assert slipping["speed"].values[-1] > slipping.attrs["target_speed"]
    assert np.diff(slipping["position"].values).min() > -1e-3
    code = run([
        "compare", "--line", line, "--train", train, "--rules", "alone", "exact", "--controllers", "none",
        "--jobs", "1", "--no-figures", "--json", "--out", str(tmp_path),
    ])  # fmt: skip
    content = json.loads(capsys.readouterr().out)
    assert code == 0
    assert [(row["rule"], row["failed"]) for row in content["rows"]] == [("alone", 0), ("exact", 0)]
    (about,) = content["about"]["scenarios"].values()
    assert "868 m to 1082 m, 20 per mille" in about["title"]
