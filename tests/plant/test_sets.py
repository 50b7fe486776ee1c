"""Named sets build, weigh what their sources say and can do what their plans ask for; impossible parameters are refused."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from alloc.errors import PlantError
from alloc.plant import sets
from alloc.plant.adhesion import PiecewiseCurve, PolachCurve, RationalCurve, SlipRatioCurve
from alloc.plant.laws import GRAVITY, hyperbolic_speed_law
from alloc.plant.model import build
from alloc.plant.rail import SPEED_LAWS, Line, Patch, Rail, Receptivity
from alloc.plant.sets import SETS, find_set
from alloc.plant.train import (
    EFFORT_SPEED_STEP,
    EFFORT_TABLE_LENGTH,
    AirBrake,
    Coupler,
    Motors,
    Sander,
    TorqueLimit,
    Train,
)
from studies.core import StudyError
from studies.jp4209318 import train as slide_train
from studies.rtri import LEVERS, RIGGING, STANDSTILL_FRICTION
from studies.trains import read_train
from tests.cases import looped
from tests.plant.conftest import FLAT, make_car

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


AXLE_COUNT = {
    "one-axle": 1,
    "jp4209318-3car": 12,
    "commuter-8car": 32,
    "gb-unit-8car": 32,
    "high-speed-16car": 64,
    "freight-5": 26,
    "freight-17": 74,
    "heavy-70": 280,
}


@looped("name", SETS)
def test_weighs_what_its_source_says(name):
    train = find_set(name)
    assert train.name == name
    assert train.mass == pytest.approx(
        MASS[name], rel=0.002 if name == "high-speed-16car" else 1e-12
    )
    assert train.axle_count == AXLE_COUNT[name]
    assert train.source
    assert train.sources


@looped("name", SETS)
def test_builds_and_runs(run, name):
    model = build(find_set(name), Rail(0.2))
    step = 1e-3 / model.substeps(1e-3)
    trace = run(model, 0.2, 15.0, position=500.0, step=step, sample=0.05)
    assert np.all(np.isfinite(trace.state))
    np.testing.assert_allclose(trace.rows("speed")[-1], 15.0, rtol=0.01)


@looped("name", [n for n in SETS if any(c.motors for c in SETS[n]().cars)])
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
    assert 2.0 < LEVERS < 10.0


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


UNREAD = {"gb-unit-8car": r"car\.S\.sanders", "heavy-70": "draft_gear"}


def test_every_file_beside_the_registry_is_a_set_under_its_own_name():
    """A user may copy any of them: the reader of one's own trains finds the same train, or names what it does not know."""
    files = sorted(Path(sets.__file__).parent.glob("*.toml"))
    assert {path.stem for path in files} == set(SETS.shipped())
    for path in files:
        if path.stem in UNREAD:
            with pytest.raises(StudyError, match=f"unknown key '{UNREAD[path.stem]}'"):
                read_train(str(path))
            continue
        assert read_train(str(path)) == find_set(path.stem)
        assert read_train(str(path)).sources == find_set(path.stem).sources


@looped("cars", [1, 2, 3])
def test_slide_train_by_number_of_cars(cars):
    train = slide_train(cars)
    assert train.mass == cars * 32e3
    assert train.axle_count == 4 * cars


NAN, INF = math.nan, math.inf


def _motors(**changes):
    return Motors(**({"group": "1C4M", "gear_ratio": 7.0, "drive": FLAT, "brake": FLAT} | changes))


def _brake(**changes):
    return AirBrake(
        **(
            {
                "maximum_pressure": 4e5,
                "force_per_pascal": 0.05,
                "fill_time": 1.0,
                "release_time": 1.0,
            }
            | changes
        )
    )


def _train(**changes):
    return Train(**({"name": "t", "cars": (make_car(),)} | changes))


FAULTS = [
    *[(make_car, {"mass": value}, "empty_mass") for value in (0.0, -1.0, NAN, INF)],
    *[(make_car, {name: NAN}, name) for name in ("length", "wheel_radius", "load", "pivot_height")],
    *[(make_car, {name: -1.0}, name) for name in ("load", "centre_of_mass_height", "pivot_height")],
    *[(make_car, {name: 0.0}, name) for name in ("length", "wheel_radius")],
    (make_car, {"wheel_inertia": (150.0, -1.0, 150.0, 150.0)}, "wheel_inertia"),
    (make_car, {"wheel_inertia": (150.0, NAN, 150.0, 150.0)}, "wheel_inertia"),
    (make_car, {"wheel_inertia": (0.0,) * 4}, "wheel_inertia"),
    (make_car, {"wheel_inertia": (150.0,) * 3}, "wheel_inertia has 3 entries for 4"),
    (make_car, {"driven": (True,) * 5}, "driven has 5 entries for 4"),
    (make_car, {"bogie_of_axle": (0, 0)}, "bogie_of_axle has 2 entries"),
    (make_car, {"bogie_of_axle": (0, 0, 2, 2)}, "bogie_of_axle"),
    (make_car, {"bogie_of_axle": (1, 1, 2, 2)}, "bogie_of_axle"),
    (make_car, {"axle_positions": ()}, "axle_positions"),
    (make_car, {"axle_positions": (2.0, 1.0, 3.0, 4.0)}, "axle_positions"),
    (make_car, {"axle_positions": (2.0, 4.0, 14.0, 21.0)}, "axle_positions"),
    (make_car, {"axle_positions": (-1.0, 4.0, 14.0, 16.0)}, "axle_positions"),
    (make_car, {"axle_positions": (2.0, NAN, 14.0, 16.0)}, "axle_positions"),
    (make_car, {"motors": None}, "no motors"),
    (make_car, {"axle_load_share": (0.5, 0.5)}, "axle_load_share"),
    (make_car, {"axle_load_share": (0.5, 0.5, 0.5, 0.5)}, "axle_load_share"),
    (make_car, {"axle_load_share": (0.5, NAN, 0.1, 0.1)}, "axle_load_share"),
    (make_car, {"axle_load_share": (0.5, -0.1, 0.1, 0.1)}, "axle_load_share"),
    (_motors, {"group": "1C8M"}, "group"),
    *[(_motors, {"gear_ratio": value}, "gear_ratio") for value in (0.0, NAN)],
    *[(_motors, {"torque_lag": value}, "torque_lag") for value in (0.0, -1e-3, NAN)],
    *[(TorqueLimit, {"peak": value, "power": 1e5}, "peak") for value in (-1.0, NAN)],
    (TorqueLimit, {"peak": 1.0, "power": INF}, "power"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "pull_out_speed": 0.0}, "pull_out_speed"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "pull_out_speed": NAN}, "pull_out_speed"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "fade_speed": -1.0}, "fade_speed"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "table": ()}, "table"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "table": (1.0, NAN)}, "table"),
    (TorqueLimit, {"peak": 1.0, "power": 1.0, "table": (1.0, -1.0)}, "table"),
    *[(_brake, {name: NAN}, name) for name in ("maximum_pressure", "fill_time", "dead_time")],
    *[(_brake, {name: 0.0}, name) for name in ("maximum_pressure", "fill_time", "release_time")],
    *[(_brake, {name: -0.1}, name) for name in ("force_per_pascal", "dead_time")],
    (_brake, {"friction": (1.0, 0.0, 1.0)}, "friction"),
    (_brake, {"friction": (NAN, 1.0, 1.0)}, "friction"),
    (_brake, {"friction": (0.0, 1.0)}, "friction"),
    *[(Coupler, {"stiffness": value}, "stiffness") for value in (0.0, -1.0, NAN)],
    *[(Coupler, {name: -1.0}, name) for name in ("stiffening", "damping", "slack")],
    (_train, {"cars": ()}, "no cars"),
    (_train, {"couplers": (Coupler(),)}, "1 couplers for 1 cars"),
    (_train, {"resistance": (1.0, NAN, 1.0)}, "resistance"),
    (_train, {"resistance": (-1.0, 0.0, 1.0)}, "resistance"),
    (_train, {"resistance": (1.0, 0.0)}, "resistance"),
    (_train, {"planned_acceleration": NAN}, "planned_acceleration"),
    *[(Rail, {"level": value}, "level") for value in (0.0, -0.1, NAN, INF)],
    (Rail, {"level": 0.1, "speed_law": "shinkanzen"}, "speed_law"),
    (Rail, {"level": 0.1, "speed_law": (1.0, 0.0, 0.0)}, "speed_law"),
    (Rail, {"level": 0.1, "speed_law": (1.0, 2.0)}, "speed_law"),
    (
        Rail,
        {"level": 0.1, "rear_speed_law": (1.0, 2.0, 0.0)},
        "must have the offset 1.0 of speed_law",
    ),
    (Rail, {"level": 0.1, "rear_speed_law": (1.0, 1.0, math.inf)}, "three finite numbers"),
    (Rail, {"level": 0.1, "rear_axles": 0.0}, "rear_axles"),
    (Rail, {"level": 0.1, "scatter": -0.01}, "scatter"),
    (Rail, {"level": 0.1, "scatter_length": 0.0}, "scatter_length"),
    (Rail, {"level": 0.1, "seed": -1}, "seed"),
    (Rail, {"level": 0.1, "seed": 0.5}, "seed"),
    (Rail, {"level": 0.1, "increments": (0.0, NAN)}, "increments"),
    (Rail, {"level": 0.1, "conditioning": NAN}, "conditioning"),
    (Rail, {"level": 0.1, "conditioning_slip": 0.0}, "conditioning_slip"),
    (Rail, {"level": 0.1, "cleaning_spacing": 0.0}, "cleaning_spacing"),
    *[
        (Rail, {"level": 0.1, name: 0.0}, name)
        for name in ("sanded_coefficient", "sand_saturation")
    ],
    *[(Rail, {"level": 0.1, "sand_decay": value}, "sand_decay") for value in (-0.1, 1.1, NAN)],
    *[(Sander, {"axle": axle, "rate": 0.1}, "axle") for axle in (-1, 0.5, True)],
    *[(Sander, {"axle": 0, "rate": value}, "rate") for value in (0.0, -1.0, NAN)],
    (Sander, {"axle": 0, "rate": 0.1, "amount": 0.0}, "amount"),
    (make_car, {"sanders": (Sander(4, 0.1),)}, "sanders at axles"),
    (make_car, {"sanders": (Sander(2, 0.1), Sander(2, 0.1))}, "sanders at axles"),
    *[(Patch, {"factor": value}, "factor") for value in (0.0, -1.0, NAN)],
    (Patch, {"factor": 0.5, "edge": 0.0}, "edge"),
    (Patch, {"factor": 0.5, "fade": 0.0}, "fade"),
    (Patch, {"factor": 0.5, "start": 10.0, "end": 5.0}, "start"),
    (Patch, {"factor": 0.5, "begin": NAN}, "begin"),
    (Line, {"stations": (0.0, 1.0)}, "2 stations and 1 grades"),
    (Line, {"stations": (), "grades": ()}, "0 stations"),
    (Line, {"stations": (0.0, -1.0), "grades": (0.0, 0.1)}, "stations"),
    (Line, {"grades": (NAN,)}, "grades"),
    (Line, {"tunnels": ((5.0, 5.0),)}, "tunnel"),
    (Line, {"tunnels": ((NAN, 5.0),)}, "tunnel"),
    (Line, {"tunnel_factor": 0.0}, "tunnel_factor"),
    (Line, {"spacing": 0.0}, "spacing"),
    (Receptivity, {"period": 0.0}, "period"),
    (Receptivity, {"mean": -0.1}, "mean"),
    (Receptivity, {"phase": NAN}, "phase"),
    (PiecewiseCurve, {"residual_ratio": 1.0}, "residual_ratio"),
    (PiecewiseCurve, {"residual_ratio": NAN}, "residual_ratio"),
    *[
        (PiecewiseCurve, {"constant_residual": v}, "constant_residual")
        for v in (0.0, -0.1, NAN, INF)
    ],
    *[(PiecewiseCurve, {n: 0.0}, n) for n in ("micro_slope", "top_curvature", "macro_slope")],
    *[(PolachCurve, {n: NAN}, n) for n in ("adhesion_factor", "slip_factor", "creep_stiffness")],
    *[(PolachCurve, {n: -1.0}, n) for n in ("decay", "ratio_at_infinity")],
    *[(SlipRatioCurve, {"peak_slip_ratio": value}, "peak_slip_ratio") for value in (0.0, 1.0, NAN)],
    *[(SlipRatioCurve, {"residual_ratio": value}, "residual_ratio") for value in (-0.1, 1.1, NAN)],
    *[
        (RationalCurve, {n: v}, n)
        for n in ("peak_slip", "steepness")
        for v in (0.0, -1.0, NAN, INF)
    ],
]


def test_impossible_parameter_is_named():
    wrong = []
    for make, fields, named in FAULTS:
        try:
            made = make(**fields)
        except PlantError as error:
            wrong += [] if re.search(named, str(error)) else [f"{fields}: {error}"]
        else:
            wrong.append(f"{fields}: {made}")
    assert not wrong


RAIL = Rail(0.2)


MISFITS = [
    ({"rail": Rail(0.2, increments=(0.0, 0.1))}, "increments: 2 values for 4 axles"),
    ({"span": (5.0, 1.0)}, "span"),
    ({"span": (0.0, NAN)}, "span"),
    ({"failures": {7: 1.0}}, "no traction unit 8"),
    ({"failures": {-1: 1.0}}, "no traction unit 0"),
    ({"failures": {0: NAN}}, "traction unit 1"),
]


@looped(("arguments", "named"), MISFITS)
def test_train_rail_and_line_that_do_not_fit(arguments, named):
    with pytest.raises(PlantError, match=named):
        build(_train(), **({"rail": RAIL} | arguments))


@looped("name", ["speed", "position"])
@looped("value", [NAN, INF])
def test_initial_state_that_is_not_finite(name, value):
    with pytest.raises(PlantError, match=name):
        build(_train(), RAIL).initial_state(**{name: value})


def test_loads_need_one_per_car():
    with pytest.raises(PlantError, match="2 loads for 1 cars"):
        _train().loaded((1.0, 2.0))


def test_unknown_set_suggests_the_nearest():
    with pytest.raises(PlantError, match="did you mean 'freight-17'"):
        find_set("freigt-17")
    with pytest.raises(PlantError, match="known: one-axle"):
        find_set("zzz")


def test_plant_error_is_a_value_error():
    assert issubclass(PlantError, ValueError)


def test_motors_that_are_planned_by_adhesion_ask_no_more_of_a_wheel_than_the_law():
    """And no less, from the speed on at which neither peak nor power bounds them."""
    train = find_set("high-speed-16car")
    car = next(one for one in train.cars if one.motors)
    speed = EFFORT_SPEED_STEP * np.arange(EFFORT_TABLE_LENGTH)
    law = hyperbolic_speed_law(speed, *SPEED_LAWS["shinkansen"])
    load = car.empty_mass * GRAVITY / len(car.axle_positions)
    for limit in (car.motors.drive, car.motors.brake):
        torque = limit.tabulate(car.wheel_radius, car.motors.gear_ratio)
        used = torque * car.motors.gear_ratio / (car.wheel_radius * load)
        assert np.all(used <= law * (1.0 + 1e-12))
        assert np.isclose(used, law, rtol=1e-12).any()
