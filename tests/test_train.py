"""Trains: rows of records equal sums by hand, and what cannot be is refused in one line that names the field."""

import math
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest

from alloc.laws import GRAVITY
from alloc.onboard.rows import radius_errors
from alloc.onboard.settings import Assumed, Dropout, Onboard, Sensors
from alloc.plant.curves import CURVES, own_curve
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.rows import level_for, offered_by, planned_coefficients, rows_of_train
from alloc.plant.train import AirBrake, Car, Coupler, Motors, Train
from alloc.plant.trains import TRAINS, find_train
from alloc.run.event import DriverCommand, Event
from alloc.run.world import believed_train
from alloc.schema.errors import InputError
from alloc.schema.parameters import Parameters, meanings
from tests.cases import looped

MOTORS = Motors(6.0, "1C2M", 1000.0, 200e3, brake_torque=800.0, fade_speed=3.0, kind="induction")
BRAKE = AirBrake(4e5, 2e4, 0.4, 0.6, friction=(37.5, 75.0, 0.5), cut_out=(1,), friction_factor=0.8)
CAR_A = Car(
    name="A", length=20.0, mass=3e4, load=5e3, axle_positions=(2.0, 4.5, 15.0, 17.0),
    bogie_of_axle=(0, 0, 1, 1), wheel_radius=0.4, wheel_inertia=90.0,
    driven=(True, True, True, False), motors=MOTORS, air_brake=BRAKE, axle_load_share=(0.2, 0.3, 0.3, 0.2),
)  # fmt: skip
CAR_B = replace(
    CAR_A, name="B", length=12.0, load=0.0, axle_positions=(3.0, 9.0), bogie_of_axle=(0, 1), wheel_radius=0.45,
    wheel_inertia=50.0, driven=(False, False), motors=None, axle_load_share=None,
)  # fmt: skip
COUPLERS = (Coupler(1e7, 2.0, 3.0, 0.01), Coupler(2e7, 4.0, 5.0, 0.02))
UNEQUAL = Train("unequal", (CAR_A, CAR_B, CAR_A), (900.0, 80.0, 7.0), COUPLERS, load_transfer=True)
EVERY_TRAIN = [*(find_train(name) for name in TRAINS), UNEQUAL, replace(UNEQUAL, couplers=None)]
every_train = looped("train", EVERY_TRAIN)


@every_train
def test_rows_are_the_sums_of_the_cars(train):
    rows, weight = rows_of_train(train), 0.0
    for c, car in enumerate(train.cars):
        mine = rows.wheelsets[rows.wheelsets.car == c]
        weight = (car.mass + car.load) * 9.80665 * sum(car.axle_load_share or (1.0,))
        assert mine.static_load.sum() == pytest.approx(weight)
        assert (mine.gear > 0.0).tolist() == (mine.unit >= 0).tolist() == list(car.powered)
        behind = sum(one.length for one in train.cars[:c])
        assert mine.offset == pytest.approx([-behind - place for place in car.axle_positions])
    names = "resistance", "resistance_linear", "resistance_quadratic"
    assert [rows.cars[name].sum() for name in names] == pytest.approx(train.resistance)
    assert rows.cars.mass.sum() == pytest.approx(train.mass)
    turning = rows.wheelsets.inertia / rows.wheelsets.radius**2
    assert turning.sum() == pytest.approx(train.rotating_mass)
    assert (rows.wheelsets.body == rows.wheelsets.car * (train.couplers is not None)).all()


@every_train
def test_units_and_brakes_count_from_the_front_and_know_their_axles(train):
    rows = rows_of_train(train)
    _, units, brakes, _ = believed_train(rows, train, Onboard())
    for kind, member in ((units, rows.wheelsets.unit), (brakes, rows.wheelsets.brake)):
        assert [int((member == k).sum()) for k in range(kind.size)] == kind.axles.tolist()
        assert np.unique(member[member >= 0]).tolist() == list(range(kind.size))
        assert (np.diff(member[member >= 0]) >= 0).all()
        mean = [rows.wheelsets.static_load[member == k].mean() for k in range(kind.size)]
        assert kind.load == pytest.approx(mean)
    for g, brake in enumerate(brakes):
        assert brake.unit == rows.wheelsets.unit[rows.wheelsets.brake == g].max()


@every_train
def test_the_plan_moves_the_train_and_turns_the_wheels_that_do_not_act(train):
    rows = rows_of_train(train)
    _, units, _, believed = believed_train(rows, train, Onboard())
    wheels, load = rows.wheelsets, rows.wheelsets.static_load
    blended = rows.cylinders.size > 0 or rows.drives.size == 0
    plans = planned_coefficients(wheels, wheels.inertia, load, train.mass, True, blended)
    driven, turning = rows.wheelsets.unit >= 0, rows.wheelsets.inertia / rows.wheelsets.radius**2
    braked = driven | (rows.wheelsets.brake >= 0)
    for name, acting in (("planned", driven), ("brake_planned", braked)):
        force = plans[name] * rows.wheelsets.static_load[acting].sum()
        needed = train.mass + turning[~acting].sum() if acting.any() else 0.0
        assert force == pytest.approx(needed)
        assert believed[name] == pytest.approx(plans[name])
    for j, unit in enumerate(units):
        own = turning[rows.wheelsets.unit == j].mean()
        assert unit.turning * plans["planned"] * unit.load == pytest.approx(own)


@every_train
def test_a_train_reversed_twice_is_itself(train):
    there, back, again = (
        rows_of_train(one) for one in (train, train.reversed(), train.reversed().reversed())
    )
    for name in (
        "static_load",
        "inertia",
        "gear",
        "shoe_gain",
        "offset",
        "unit",
        "brake",
        "unloading",
    ):
        assert again.wheelsets[name] == pytest.approx(there.wheelsets[name])
        if name in ("static_load", "inertia", "gear", "shoe_gain"):
            assert back.wheelsets[name][::-1] == pytest.approx(there.wheelsets[name])
    assert -train.length - back.wheelsets.offset[::-1] == pytest.approx(there.wheelsets.offset)
    assert back.cars.stiffness[:-1][::-1] == pytest.approx(there.cars.stiffness[:-1])


@every_train
def test_pitch_moves_load_and_keeps_moments(train):
    for car in train.cars:
        lost, place = car.unloading(), np.array(car.axle_positions)
        assert lost.sum() == pytest.approx(0.0, abs=1e-12)
        if np.unique(car.bogie_of_axle).size > 1:
            # the moment about the rail; a bogie's part acts at its pivot's height, or at the rail where it has one axle
            assert -lost @ place == pytest.approx(car.centre_of_mass_height)


@every_train
def test_a_load_rests_on_its_car_and_is_believed_as_measured(train):
    loads = [1000.0 * (1 + c) for c in range(len(train.cars))]
    empty, full = train.loaded([0.0] * len(loads)), train.loaded(loads)
    assert full.mass - empty.mass == pytest.approx(sum(loads))
    more = rows_of_train(full).wheelsets.static_load - rows_of_train(empty).wheelsets.static_load
    share = np.concatenate([car.shares for car in train.cars])
    assert more == pytest.approx(
        GRAVITY * np.array(loads)[rows_of_train(full).wheelsets.car] * share
    )
    errors = np.random.default_rng(5).standard_normal(len(loads))
    measured = train.loaded((loads * (1.0 + 0.1 * errors)).tolist())
    wrong = believed_train(
        rows_of_train(full), full, Onboard(sensors=Sensors(load_error=0.1, seed=5))
    )
    right = believed_train(rows_of_train(measured), measured, Onboard())
    assert wrong[1].load == pytest.approx(right[1].load)


def test_torque_limits_follow_torque_power_pull_out_and_fading():
    radius, gear, motors = 0.43, 7.0, Motors(7.0, torque=900.0, power=150e3, brake_power=90e3)
    motors = replace(motors, pull_out_speed=20.0, fade_speed=2.0)
    for k, (drive, brake) in enumerate(motors.limits(radius, 4, 1e4).T[1:], 1):
        speed = k / 3.6
        per_power = radius / (gear * speed)
        assert drive == pytest.approx(min(900.0, 150e3 * per_power) * min(1.0, 20.0 / speed))
        assert brake == pytest.approx(min(900.0, 90e3 * per_power) * min(1.0, speed / 2.0))
    as_driven = replace(motors, brake_power=None, pull_out_speed=None, fade_speed=0.0)
    assert np.ptp(as_driven.limits(radius, 4, 1e4), axis=0).max() == 0.0
    table = Motors(gear, effort_speed=(0.0, 50.0 / 3.6, 100.0 / 3.6), effort=(1e4, 8e3, 4e3))
    drive, brake = table.limits(radius, 4, 1e4)
    assert drive[[0, 25, 75, 400]] * 4 * gear / radius == pytest.approx([1e4, 9e3, 6e3, 4e3])
    assert not brake.any()
    planned = replace(motors, torque=1e6, power=1e9, planned_adhesion="shinkansen")
    most = radius / gear * 13.6 / (np.array([0, 100, 300]) + 85.0) * 1e4 * GRAVITY
    assert replace(planned, pull_out_speed=None).limits(radius, 4, 1e4)[
        0, [0, 100, 300]
    ] == pytest.approx(most)


@looped("train", [find_train("freight-17"), find_train("freight-17").reversed()])
def test_a_command_runs_along_the_brake_pipe_from_the_head_of_the_train(train):
    rows, front = rows_of_train(train), np.cumsum([0.0, *(car.length for car in train.cars)])
    for g, group in enumerate(rows.cylinders):
        car = rows.wheelsets.car[rows.wheelsets.brake == g][0]
        brake = train.cars[car].air_brake
        assert group.dead_time == pytest.approx(brake.dead_time + front[car] / 250.0)
        assert (group.fill_time, group.release_time) == (brake.lag, brake.release_lag) == (3.0, 6.0)


def test_what_the_computers_cannot_know_is_in_other_tables():
    rows, wrong = rows_of_train(UNEQUAL), Onboard(sensors=Sensors(radius_error=0.01, seed=2))
    errors = radius_errors(wrong, 10)
    axles, units, brakes, _ = believed_train(rows, UNEQUAL, wrong)
    assert axles.radius == pytest.approx(rows.wheelsets.radius * (1.0 + errors))
    assert [axles.radius[axles.unit == j].mean() for j in range(4)] == pytest.approx(units.radius)
    cut = rows.wheelsets.brake % 2 == 1
    assert (rows.wheelsets.shoe_gain[cut] == 0.0).all()
    assert rows.wheelsets.shoe_gain[~cut] == pytest.approx(0.8 * 0.05)
    assert brakes.gain == pytest.approx(0.05)
    assert rows.drives.slip_torque == pytest.approx(2.0 * 2.5 * 1000.0 / (10.0 * math.pi))
    assert replace(MOTORS, inverter_group="1C1M").slip_torque(1000.0) == 0.0  # its own inverter
    assert rows.cars.stiffness.tolist() == [1e7, 2e7, 0.0]


FACTORS = {
    "mass_factor": {"train_mass"},
    "resistance_factor": {"resistance", "resistance_linear", "resistance_quadratic"},
    "lag_factor": {"unit.lag"},
    "inertia_factor": {"axle.inertia", "unit.inertia", "unit.turning", "unit.brake_turning", "brake.turning"},
    "brake_factor": {"brake.gain"},
}  # fmt: skip


@looped("factor", [item.name for item in fields(Assumed) if item.name.endswith("_factor")])
def test_a_wrong_belief_changes_what_is_believed(factor):
    onboard = Onboard().with_settings({f"belief.{factor}": 1.3})
    right, wrong = ({
        **{f"{name}.{key}": table[key].tobytes() for name, table in zip(("axle", "unit", "brake"), believed, strict=False)
           for key in table.dtype.names},
        **believed[3],
    } for believed in (believed_train(rows_of_train(UNEQUAL), UNEQUAL, one) for one in (Onboard(), onboard)))  # fmt: skip
    changed = {key for key in right if right[key] != wrong[key]} - {"planned", "brake_planned"}
    assert changed == FACTORS[factor]


@looped("name", CURVES.shipped())
def test_a_level_offers_what_it_was_sought_for(name):
    curve = CURVES[name]()
    for train in (find_train("commuter-8car"), UNEQUAL):
        level = level_for(curve, 0.08, 8.0, train)
        assert offered_by(curve, level, 8.0, train) == pytest.approx(0.08, rel=1e-6)


# Every record: what it declares, it enforces

EVENT = Event("made", UNEQUAL, Rail(0.1, patches=(Patch(0.5),)), DriverCommand((0.0,), (1.0,)))
CURVES_MADE = tuple(kind() for kind in CURVES.values())
LOST = Onboard(sensors=Sensors(dropouts=(Dropout(1, 2.0),)))


def records_in(value):
    if isinstance(value, tuple):
        for one in value:
            yield from records_in(one)
    elif is_dataclass(value):
        yield value
        for one in fields(value):
            yield from records_in(getattr(value, one.name))


MADE = (EVENT, LOST, Line(), CURVES_MADE, own_curve("hump", lambda slip: slip * np.exp(-slip)))
RECORDS = {type(one): one for one in records_in(MADE) if isinstance(one, Parameters)}


def kinds_of(kind=Parameters):
    return {kind}.union(*map(kinds_of, kind.__subclasses__()))


def test_every_kind_of_record_is_looked_at():
    shipped = {kind for kind in kinds_of() if kind.__module__.startswith("alloc.")}
    assert {one.__name__ for one in shipped - RECORDS.keys() if fields(one)} == set()


@looped("record", RECORDS.values())
def test_a_number_beyond_its_bounds_is_refused_in_a_line_that_names_it(record):
    for item in fields(record):
        bounds = item.metadata.get("bounds")
        if bounds is None:
            continue
        low = bounds.above if bounds.above > -math.inf else bounds.least - 0.5
        beyond = {math.nan, -math.inf, low, bounds.most + 0.5} - (
            set() if not bounds.infinite else {math.inf}
        )
        several = "tuple" in str(item.type)
        for value in beyond:
            with pytest.raises(InputError, match=rf"^[^\n]*\b{item.name}(\[0\])? = "):
                replace(record, **{item.name: (value,) if several else value})


@looped("record", RECORDS.values())
def test_every_number_has_a_meaning(record):
    for item in fields(record):
        assert "bounds" not in item.metadata or meanings(type(record))[item.name].text


@looped(
    ("record", "changes", "named"),
    [
        (CAR_A, {"axle_positions": (4.0, 2.0, 15.0, 17.0)}, "axle_positions"),
        (CAR_A, {"bogie_of_axle": (0, 0, 2, 2)}, "bogie_of_axle"),
        (CAR_A, {"driven": (True,)}, "driven"),
        (CAR_A, {"motors": None}, "motors"),
        (CAR_A, {"speed_sensors": False}, "speed_sensors"),
        (CAR_A, {"axle_load_share": (0.5, 0.5, 0.5, 0.5)}, "axle_load_share"),
        (BRAKE, {"friction": (1.0, 0.0, 1.0)}, "friction"),
        (MOTORS, {"inverter_group": "2C2M"}, "inverter_group"),
        (MOTORS, {"kind": "series"}, "kind"),
        (UNEQUAL, {"couplers": COUPLERS[:1]}, "couplers"),
        (UNEQUAL, {"cars": ()}, "cars"),
        (Line(), {"grades": (0.0, 0.01)}, "grades"),
        (Rail(0.1), {"speed_law": "dry"}, "speed_law"),
        (Rail(0.1), {"level": 14.0}, "level"),
        (Patch(0.5), {"start": 10.0, "end": 5.0}, "start"),
    ],
)
def test_what_does_not_fit_together_is_refused_in_a_line_that_names_it(record, changes, named):
    with pytest.raises(InputError, match=rf"^[^\n]*\b{named}\b[^\n]*$"):
        replace(record, **changes)
