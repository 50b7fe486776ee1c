"""Every named set builds, weighs what its source says, and can do what its plan asks for."""

from pathlib import Path

import numpy as np
import pytest

from alloc.plant import sets
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import SETS, find_set
from studies.brake_force.running_tests import LEVER_RATIO, RIGGING, STANDSTILL_FRICTION
from studies.scenario.train_file import read_train_file
from studies.slides.jp4209318 import slide_train

MASS = {
    "one-axle": 20e3,  # readhesion paper, Table 1
    "jp4209318-3car": 3 * 8 * 4000.0,  # JP4209318, Table 2: 4000 kg per wheel
    "commuter-8car": 4 * 32e3 + 4 * 27e3,
    "gb-unit-8car": 2 * 4 * 43.4e3,
    "high-speed-16car": 700e3,  # series N700
    "freight-5": 96e3 + 5 * 59e3,  # DF200 and loaded Koki wagons
    "freight-17": 96e3 + 17 * 59e3,
    "heavy-70": 70 * 85e3,
}
AXLES = {
    "one-axle": 1,
    "jp4209318-3car": 12,
    "commuter-8car": 32,
    "gb-unit-8car": 32,
    "high-speed-16car": 64,
    "freight-5": 26,
    "freight-17": 74,
    "heavy-70": 280,
}


@pytest.mark.parametrize("name", SETS)
def test_weighs_what_its_source_says(name):
    train = find_set(name)
    assert train.name == name
    assert train.mass == pytest.approx(
        MASS[name], rel=0.002 if name == "high-speed-16car" else 1e-12
    )
    assert train.axle_count == AXLES[name]
    assert train.source
    assert train.sources


@pytest.mark.parametrize("name", SETS)
def test_builds_and_runs(run, name):
    model = build(find_set(name), Rail(0.2))
    step = 1e-3 / model.substeps(1e-3)
    trace = run(model, 0.2, 15.0, position=500.0, step=step, sample=0.05)
    assert np.all(np.isfinite(trace.state))
    np.testing.assert_allclose(trace.rows("speed")[-1], 15.0, rtol=0.01)


@pytest.mark.parametrize("name", [n for n in SETS if any(c.motors for c in SETS[n]().cars)])
def test_motors_can_do_what_the_plan_asks(name):
    """At 10 km/h the driven axles carry the planned acceleration of train and wheelsets."""
    train = find_set(name)
    s = build(train, Rail(0.5)).structure
    torque = s.drive_table[:, 10]
    effort = (torque * s.unit_axles * s.unit_gear).sum() / s.radius[0]
    assert effort >= (train.mass + train.rotating_mass) * train.planned_acceleration


def test_planned_coefficients():
    """Readhesion paper, Table 2: 0.17 on the driven axle. Freight: 0.16 of the locomotive's axles."""
    single = find_set("one-axle")
    load = single.cars[0].static_axle_loads[0]
    assert single.mass * single.planned_acceleration / load == pytest.approx(0.17, abs=5e-4)
    for name in ("freight-5", "freight-17"):
        train = find_set(name)
        force = (train.mass + train.rotating_mass) * train.planned_acceleration
        assert force / (train.cars[0].mass * GRAVITY) == pytest.approx(0.16)


def test_freight_brake_is_that_of_the_report():
    """RTRI report 3.2.2: about 60 kN on the locomotive in stops from 25 km/h, wagons in proportion to mass."""
    cars = find_set("freight-5").cars
    friction = (12.5 + 150.0) / (2.0 * 12.5 + 150.0)  # at the mean speed of such a stop
    force = [c.air_brake.force_per_pascal * 350e3 * friction * len(c.axle_positions) for c in cars]
    assert force[0] == pytest.approx(60e3)
    np.testing.assert_allclose(np.array(force) / [c.mass for c in cars], 60e3 / 96e3)


def test_a_wagons_rigging_gives_its_brake_force():
    """RTRI report (7): tau kappa eta S P mu."""
    brake = find_set("freight-5").cars[-1].air_brake
    force = RIGGING.force(350e3, STANDSTILL_FRICTION)
    assert force == pytest.approx(4 * brake.force_per_pascal * 350e3)
    assert 2.0 < LEVER_RATIO < 10.0


def test_dead_time_grows_along_the_freight_train():
    dead = [car.air_brake.dead_time for car in find_set("freight-17").cars]
    assert np.all(np.diff(dead) > 0.0)
    assert dead[-1] == pytest.approx(0.3 + (19.6 + 16 * 20.4) / 250.0)


def test_cars_of_the_sets_are_the_same_from_either_end():
    """Bogies of one wheelbase, as far from one end as from the other."""
    for name in SETS:
        for car in find_set(name).cars:
            if len(car.axle_positions) > 1:
                axles, ends = np.array(car.axle_positions), np.array(car.reversed().axle_positions)
                np.testing.assert_allclose(axles, ends, atol=1e-9, err_msg=name)


def test_the_heavy_train_pulls_and_brakes_as_stated():
    """600 kN at the foremost vehicle; 10 % of every vehicle's weight at 500 kPa; the pipe's wave at 250 m/s."""
    train = find_set("heavy-70")
    s = build(train, Rail(0.5)).structure
    pull = s.drive_table[:, 10] * s.unit_axles * s.unit_gear / s.radius[0]
    assert pull.sum() == pytest.approx(600e3, rel=1e-3)
    for k, car in enumerate(train.cars):
        force = car.air_brake.force_per_pascal * 500e3 * len(car.axle_positions)
        assert force == pytest.approx(0.1 * car.mass * GRAVITY, rel=1e-9)
        assert car.air_brake.maximum_pressure == 500e3
        assert car.air_brake.dead_time == pytest.approx(0.3 + 13.9 * k / 250.0)


def test_the_high_speed_train_has_a_tenth_in_hand_and_its_resistance_by_weight():
    train = find_set("high-speed-16car")
    s = build(train, Rail(0.5)).structure
    effort = (s.drive_table[:, 10] * s.unit_axles * s.unit_gear).sum() / s.radius[0]
    planned = (train.mass + train.rotating_mass) * train.planned_acceleration
    assert effort == pytest.approx(1.1 * planned, rel=1e-9)
    assert train.resistance[0] == pytest.approx(1.273 * GRAVITY * train.mass / 1e3, rel=1e-9)


def test_both_freight_trains_have_the_same_cars():
    short, long = (find_set(name).cars for name in ("freight-5", "freight-17"))
    assert long[: len(short)] == short


def test_every_file_beside_the_registry_is_a_set_under_its_own_name():
    """A user may copy any of them: the reader of one's own trains finds the same train."""
    files = sorted(Path(sets.__file__).parent.glob("*.toml"))
    assert {path.stem for path in files} == set(SETS.shipped())
    for path in files:
        assert read_train_file(str(path)) == find_set(path.stem)
        assert read_train_file(str(path)).sources == find_set(path.stem).sources


@pytest.mark.parametrize("cars", [1, 2, 3])
def test_slide_train_by_number_of_cars(cars):
    train = slide_train(cars)
    assert train.mass == cars * 32e3
    assert train.axle_count == 4 * cars
