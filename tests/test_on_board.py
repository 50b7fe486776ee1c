"""Computers on board: what they sense, report, hear, and ask of motors and brakes, against exact solutions."""

import inspect
import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard import beliefs, sensing, targets, telegrams
from alloc.onboard import reference_speed as speed
from alloc.onboard import slide_protection as slide
from alloc.onboard.columns import AXLE, BRAKE, NEVER, ONBOARD, RUN, SLIDE, UNIT
from alloc.plant import dynamics
from alloc.plant.columns import CAR, CYLINDER, DRIVE, PLANT, WHEELSET
from alloc.run import wire
from alloc.run.event import DriverCommand
from alloc.run.simulation import ADVANCE, Simulation, simulate
from alloc.schema.tables import memory_words
from studies.files.scenario_files import load_scenario
from studies.population import population
from tests.cases import looped

H = 0.01
COMPILED = {
    f"{module.__name__.rpartition('.')[2]}.{name}": function
    for module in (sensing, speed, telegrams, targets, slide, beliefs)
    for name, function in vars(module).items()
    if hasattr(function, "py_func") and function.py_func.__module__ == module.__name__
}


def unequal(table, n, rng, **values):
    """Rows whose every number is another, but for these."""
    rows = table.rows(n)
    for name, column in table.columns.items():
        if isinstance(column.default, float):
            size = column.default if 0.0 < abs(column.default) < 1e8 else 0.1
            rows[name] = size * rng.uniform(0.7, 1.3, n)
    for name, value in values.items():
        rows[name] = value
    return rows


def board(seed=0, **run):
    """What functions on board take, by name: units of two and three axles, of which one is not seen, and a trailer."""
    rng, unit, brake = np.random.default_rng(seed), [0, 0, 1, 1, 1, -1], [0, 0, 1, 1, 1, 2]
    gear = [7.0, 6.9, 6.8, 6.7, 6.6, 0.0]
    seen = [1, 1, 0, 1, 1, 1]
    axles = unequal(AXLE, 6, rng, unit=unit, brake=brake, gear=gear, seen=seen, was_seen=1)
    units = unequal(UNIT, 2, rng, axles=[2, 3], protected=[0, 1])
    brakes = unequal(BRAKE, 3, rng, axles=[2, 3, 1], unit=[0, 1, -1])
    now = {
        "period": H,
        "telegram": 0.1,
        "time": 0.4,
        "driver_command": -0.8,
        "sign": -1.0,
        "braking": 1,
    }
    speeds = {"reference_speed": 20.0, "before": 20.1}
    said = UNIT.record(50, 2)
    said.delivered, said.limited, said.wanted = rng.uniform(0.05, 0.1, (3, 50, 2))
    y = [50.0, 20.0, *rng.uniform(40.0, 50.0, 6), -900.0, -700.0, 1e5, 2e5, 3e5, *np.zeros(10)]
    sent, table = np.tile([[40, 30]], (50, 1)), np.linspace(9e3, 1e3, 200) * np.ones((2, 1))
    return {
        "wheelsets": WHEELSET.rows(6, sensed=seen, lost=9.0), "cars": CAR.rows(3), "drives": DRIVE.rows(2),
        "cylinders": CYLINDER.rows(3), "axles": axles, "units": units, "brakes": brakes, "u": units[1],
        "a": axles[3], "b": brakes[1],
        "plant": unequal(PLANT, 1, rng)[0], "onboard": unequal(ONBOARD, 1, rng, speed_quantum=1e-3)[0],
        "run": unequal(RUN, 1, rng, **now | speeds | run)[0], "slide": unequal(SLIDE, 1, rng, protection=2)[0],
        "reports": said, "orders": said, "order_tick": sent, "report_tick": sent, "y": np.array(y),
        "noise": 0.01 * rng.standard_normal(6),
        "effort": table, "retard": 0.9 * table, "omega": 2, "torque": 8, "k": 40, "tick": 40, "j": 1, "always": True,
        "asks": False, "instant": 0.3, "span": 0.2, "time": 9.5, "force": 1e4, "speed": 20.0, "turning": 0.1,
        "bound": 900.0, "full": 1500.0,
    }  # fmt: skip


def call(function, b):
    """The function on what it takes of the board."""
    return function(*(b[one] for one in inspect.signature(function).parameters))


@pytest.mark.parametrize("name", COMPILED)
@pytest.mark.parametrize("now", [{}, {"sign": 1.0, "driver_command": 0.8, "braking": 0}])
def test_compiled_code_is_the_python_that_it_is_written_in(name, now):
    found = []
    for function in (COMPILED[name], COMPILED[name].py_func):
        b = board(**now)
        with np.errstate(all="ignore"):
            answer = call(function, b)
        rows = [memory_words(b[table]).tobytes() for table in ("axles", "units", "brakes")]
        found.append(([*rows, b["run"].tobytes()], np.array(answer, dtype=float)))
    assert found[0][0] == found[1][0]
    assert np.array_equal(found[0][1], found[1][1], equal_nan=True)


WIRED = [
    name
    for name, part in vars(wire).items()
    if hasattr(part, "py_func") and name not in vars(dynamics)
]


@pytest.mark.parametrize("name", [name for name in WIRED if name not in ("top", "has_signal")])
def test_the_wire_compiled_is_the_python_that_it_is_written_in(name):
    run, found = Simulation(load_scenario("jp4209318-stop").event(1), "alone", "none"), []
    for _ in range(60):
        run.run_to(ADVANCE)
    for function in (getattr(wire, name), getattr(wire, name).py_func):
        w = deepcopy(run.world)._asdict()
        rows = {key: w[key][0] for key in ("plant", "onboard", "run", "noise")}
        call(function, w | rows | {"y": w["state"], "t": 0.6})
        found.append({key: memory_words(w[key]).tobytes() for key in w if w[key].dtype.names})
    assert found[0] == found[1]


@pytest.mark.parametrize("pole", [5.0, 10.0, 40.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_constant_acceleration_is_found_as_it_is(pole, sign):
    u, onboard, run = (
        UNIT.rows(1)[0],
        ONBOARD.rows(1, detector_pole=pole)[0],
        RUN.rows(1, sign=sign)[0],
    )
    for k in range(500):
        u.rim = 20.0 + 1.3 * k * H
        sensing.detect_slip(u, onboard, run)
        rising = -math.expm1(-pole * k * H)
        assert u.computed_acceleration == pytest.approx(sign * 1.3 * rising, abs=1e-10)


@pytest.mark.parametrize(
    ("gain", "sign", "printed"), [(0, 1, 0), (2, 1, 0), (-1, -1, 0), (-1, -1, 1)]
)
def test_the_observer_finds_what_the_rail_carries_and_as_printed_what_motors_give(
    gain, sign, printed
):
    u = UNIT.rows(1, motor_torque=2000.0, load=9e4, radius=0.45, inertia=120.0, gear=6.0, air=900.0)[0]  # fmt: skip
    run = RUN.rows(1, sign=sign, braking=sign < 0)[0]
    onboard = ONBOARD.rows(1, inertia_in_estimate=1 - printed)[0]
    turning, off = 0.0 if printed else 120.0 * sign * gain / 0.45, []
    for k in range(400):
        u.rim = 20.0 + gain * k * H
        sensing.observe_coefficient(u, onboard, run)
        off.append(
            u.coefficient_estimate - (6.0 * 2000.0 - turning) / (9e4 * 0.45) - (sign < 0) * 0.01
        )
    assert off[-1] == pytest.approx(0.0, abs=1e-10)
    assert off[60] == pytest.approx(math.exp(-25.0 * 10 * H) * off[50], abs=1e-12)


@pytest.mark.parametrize("commanded", [0, 1])
def test_readings_are_true_rim_speeds_with_noise_steps_and_wrong_radii(commanded):
    b, seen = board(seed=3), [0, 1, 3, 4, 5]
    axles, units, g = b["axles"], b["units"], b["brakes"][b["axles"].brake]
    b["onboard"].air_commanded, b["onboard"].true_speed = commanded, 1
    units.air_brake_force = [1500.0, 2500.0]
    b["axles"].true_speed = b["run"].true_speed = 20.0
    call(wire.read, b)
    call(sensing.sense_train, b)
    steps = (axles.radius * b["y"][2:8] + b["noise"]) / b["onboard"].speed_quantum
    assert (axles.reading / b["onboard"].speed_quantum)[seen] == pytest.approx(np.rint(steps[seen]))
    assert (
        axles.reading[2] == b["run"].reference_speed == 20.0
    )  # what is not seen rolls with the train
    assert list(units.seen) == [2, 2]
    own = axles.reading[[0, 1]], axles.reading[[3, 4]]
    assert units.rim == pytest.approx([one.mean() for one in own])
    assert units.worst_slip == pytest.approx([20.0 - one.min() for one in own])
    bound = np.interp(3.6 * units.rim, np.arange(200), b["effort"][0])
    assert [*units.drive_limit, *units.brake_limit] == pytest.approx([*bound, *0.9 * bound])
    friction = (
        g.friction_numerator / (3.6 * axles.reading + g.friction_offset) + g.friction_constant
    )
    shoes = g.gain * b["y"][10 + axles.brake] * friction
    forces = [1500.0, 2500.0] if commanded else [shoes[:2].mean(), shoes[2:5].mean()]
    assert units.air == pytest.approx(forces)


def test_slip_is_signalled_with_hysteresis_and_the_estimate_held_at_its_begin():
    u, onboard = UNIT.rows(1, filtered=5.0, rim=5.0)[0], ONBOARD.rows(1)[0]
    run, on = RUN.rows(1, driver_command=0.8)[0], []
    for k in range(400):  # slip grows for a second and falls from the third to the fourth
        run.time, u.coefficient_estimate = k * H, 0.1 + 1e-4 * k
        u.worst_slip = min(k * H, 1.0, 4.0 - k * H)
        sensing.detect_slip(u, onboard, run)
        on.append(u.slipping)
    assert np.flatnonzero(np.diff(on)) == pytest.approx([60, 370], abs=1)
    assert (u.detected, u.held) == (on.index(1) * H, 0.1 + 1e-4 * on.index(1))
    assert u.slipped == (on.index(1) + sum(on) - 1) * H
    run.driver_command, u.worst_slip, u.detected = 0.0, 2.0, NEVER
    sensing.detect_slip(u, onboard, run)
    assert (u.slipping, u.detected) == (1, NEVER)  # without a demand there is nothing to hold


def test_a_failure_is_known_a_tenth_of_a_second_later():
    found = []
    for k in range(50):
        b = board(time=k * H)
        b["drives"].failure = [0.2, 0.3]
        call(wire.read, b)
        found.append(list(b["units"].works))
    assert list(np.sum(found, axis=0)) == [30, 40]
    for failure in ([0.2, 0.3, 9.0], [0.2, 0.3, 0.1]):  # the hindmost leads where none works
        leaders = telegrams.find_leaders(50, np.array(failure), H)
        assert list(leaders) == [0] * 30 + [1] * 10 + [2] * 10


def estimate(run, onboard, force, reading, units=(), brakes=(), **axle):
    """A period of the estimate where one axle is seen, at the train's end of its mean."""
    axles = AXLE.rows(1, reading=reading, ahead=run.sign * (reading - run.reference_speed), **axle)
    rows = (units if len(units) else UNIT.rows(0)), (brakes if len(brakes) else BRAKE.rows(0))
    speed.estimate_speed(axles, *rows, onboard, force, run)
    return axles[0]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_filter_finds_speed_and_the_force_that_nothing_explains(sign):
    run = RUN.rows(1, reference_speed=19.8, sign=sign, plan=0.1, braking=int(sign < 0))[0]
    onboard = ONBOARD.rows(1, train_mass=1e5, resistance=1000.0, resistance_quadratic=2.0)[0]
    for k in range(6000):
        true = 20.0 + sign * 0.3 * (k + 1) * H
        force = sign * 0.3e5 + 1000.0 + 2.0 * true**2 - 0.04e5  # 0.04 m/s2 more than is known of
        estimate(run, onboard, force, true, pull=0.1)
    assert (run.reference_speed, run.unknown) == pytest.approx((true, 0.04), abs=2e-3)
    known = run.reference_deviation
    for _ in range(300):  # all slip: the balance carries the speed on, and it is known ever less
        estimate(run, onboard, force, run.reference_speed + sign * 5.0, pull=0.1)
    assert run.reference_speed == pytest.approx(true + sign * 0.9, abs=0.02)
    assert run.reference_deviation == math.sqrt(run.p_vv) > 1.2 * known


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_that_contradicts_the_speed_is_believed_and_the_force_doubted(sign):
    run = RUN.rows(1, reference_speed=2.0, sign=sign, p_dd=1e-6)[0]
    onboard = ONBOARD.rows(1, train_mass=1e5)[0]
    estimate(run, onboard, 0.0, 2.0 - sign * 0.3)
    assert run.reference_speed == pytest.approx(2.0 - sign * 0.3, abs=0.02)
    assert run.p_dd == pytest.approx(onboard.unknown_most**2, rel=1e-3)


@looped(("sign", "held", "acting", "ahead", "learns"), [
    (sign, *case)
    for sign in (1.0, -1.0)
    for case in (
        (False, 0.1, 0.15, True),  # nothing holds axles back: the least ahead rolls
        (True, 0.1, 0.15, False),  # it may creep, and teaches nothing of speed and force
        (True, 0.1, -0.15, True),  # yet no axle runs behind the train
        (True, 0.0, 0.15, True),  # without force it rolls
        (True, 0.0, 6.0, False),  # but not where all wheels slide
    )
])  # fmt: skip
def test_what_an_axle_teaches_of_the_speed(sign, held, acting, ahead, learns):
    """The same pulling and braking; what holds back is a unit's controller or a valve, now or in the last two seconds."""
    for j, age in ((0, 0.0), (0, 1.9), (0, 2.1), (1, 0.0)):
        if j and sign > 0.0:
            continue
        run = RUN.rows(1, reference_speed=20.0, sign=sign, plan=0.1, time=9.0, p_vv=0.01)[0]
        run.braking, run.reference_deviation = int(sign < 0.0), 0.1
        units = UNIT.rows(1, torque_target=100.0, torque_command=100.0)
        brakes = BRAKE.rows(1)
        if held and age == 0.0:
            units.torque_command[0], brakes.valve[0] = (100.0, 1.0) if j else (50.0, 0.0)
        run.verge = 9.0 - age if held and not j else -1e9
        onboard = ONBOARD.rows(1, train_mass=1e5)[0]
        estimate(run, onboard, 0.0, 20.0 + sign * ahead, units, brakes, pull=acting, free=1.0)
        moved = sign * (run.reference_speed - 20.0)
        assert (moved != 0.0) == (learns or (age > 2.0 and abs(ahead) < 1.0)), (j, age)
        assert moved * ahead >= 0.0


@pytest.mark.parametrize("shoe", [0.0, 0.05])
def test_a_unit_is_eased_in_doubt_one_that_brakes_by_air_in_great_doubt(shoe):
    onboard, units = ONBOARD.rows(1)[0], UNIT.rows(2)
    axles = AXLE.rows(2, unit=[0, 1], shoe=shoe, reading=20.0)
    for deviation in (0.5, 1.5, 2.5):
        run = RUN.rows(1, plan=0.1, braking=1, reference_speed=20.0)[0]
        run.reference_deviation = deviation * onboard.doubt
        units.eased = 1.0
        speed.weigh_axles(axles, units, BRAKE.rows(0), run)
        speed.ease_units(units, onboard, run)
        assert (units.eased.min() < 1.0) == (deviation > (1.0 if shoe == 0.0 else 2.0))


@looped("gone", (0.0, 0.6, 9.0))
def test_a_unit_is_measured_from_when_its_air_has_gone_or_not_at_all(gone):
    """`gone`: when, in seconds. The wait has an end, and wheels that roll are sure for the time of an easing."""
    onboard, units = ONBOARD.rows(1)[0], UNIT.rows(1, eased=0.4)
    run = RUN.rows(1, plan=0.1, braking=1, reference_speed=20.0, easing=0.0)[0]
    axles, sure, k = AXLE.rows(1, unit=0, reading=20.0, pull=0.04), 0, 0
    while units.eased[0] < 1.0:
        axles.shoe, k = (0.05 if k * H < gone else 0.0), k + 1
        sure += speed.weigh_axles(axles, units, BRAKE.rows(0), run)[2]
        speed.ease_units(units, onboard, run)
    wait = min(gone, speed.EMPTIED)
    assert k * H == pytest.approx(wait + speed.SHORTEST, abs=3.0 * H)
    assert (sure > 0.4 * speed.SHORTEST / H) == (gone < speed.EMPTIED)


@pytest.mark.parametrize("returns", [6.0, 0.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_that_slid_in_the_other_direction_is_not_behind_the_train(sign, returns):
    """Neither while it returns, in m/s2, nor where it stays in its slide without any force."""
    run = RUN.rows(1, reference_speed=20.0, sign=sign, plan=0.1, time=5.0)[0]
    axles, units = AXLE.rows(2, reading=20.0, pull=0.1, unit=0), UNIT.rows(1)
    axles.ahead = [0.0, 3.0]  # the second ran ahead while the train was asked for the other
    speed.turn_round(axles, units, run)
    onboard = ONBOARD.rows(1, train_mass=1e5)[0]
    for k in range(60):
        run.time = 5.0 + k * H
        axles.reading[1] = 20.0 - sign * max(3.0 - returns * k * H, 0.0)
        speed.estimate_speed(axles, units, BRAKE.rows(0), onboard, 0.0, run)
        assert run.reference_speed == pytest.approx(20.0, abs=0.15), k


def test_in_a_stop_whose_wheels_all_creep_the_speed_stays_known():
    """Events of which the estimate once ran away: behind, as it followed creeping wheels, and ahead for good."""
    for number in (288, 257):
        run = simulate(population.event(65, number).event(0), "cooperative", "perturb-observe")
        assert float(abs(run.reference_speed - run.car_speed.mean("car")).max()) < 0.3, number


@pytest.mark.parametrize("then", [(0.0, -0.8), (0.6, 0.6)])
def test_brakes_released_while_wheels_slide_leave_the_speed_known(then):
    """Shoes that still hold a wheel, and one that returns, are no proof that the train is slower."""
    command = DriverCommand((0.0, 5.0, 7.0), (-0.8, *then))
    stop = replace(load_scenario("wet-stop").event(1), command=command, duration=12.0)
    run = simulate(stop, "cooperative", "perturb-observe")
    assert float(abs(run.slip_velocity.sel(time=5.0, method="nearest")).max()) > 1.0
    assert float(abs(run.reference_speed - run.car_speed.mean("car")).max()) < 0.2


@pytest.mark.parametrize("level", [0.08, 0.5])
def test_a_locomotive_is_eased_where_all_its_wheels_creep_and_knows_its_speed(level):
    scenario = load_scenario("freight-start")
    rail = scenario.rail.model_dump(mode="json") | {"level": level, "patches": []}
    run = Simulation(
        scenario.changed(rail=rail, duration_s=8.0).event(), "alone", "perturb-observe"
    )
    run.run_to_end()
    assert (run.world.run[0].easing < 1e3) == (level < 0.1)
    found = run.recorded()
    assert float(abs(found.reference_speed - found.car_speed[:, 0]).max()) < 0.3


@pytest.mark.parametrize("reached", [0.0, 0.4, 1.0])
def test_a_report_is_the_limit_that_is_followed_whatever_the_train_gains(reached):
    run = RUN.rows(1, driver_command=0.5, plan=0.1, before=10.0)[0]
    units, limit = UNIT.rows(2, turning=[0.1, 0.2]), np.array([0.08, 0.12])
    units.coefficient_estimate = limit * (1.0 + units.turning) - units.turning * reached * 0.1
    for k in range(600):
        run.time, run.reference_speed = k * H, 10.0 + 0.5 * reached * (k + 1) * H
        sensing.report_units(units, run)
    assert units.delivered == pytest.approx(limit, rel=1e-9)


def test_a_unit_says_with_its_telegrams_what_limits_it():
    units = UNIT.rows(6, load=1e5, torque_target=600.0)
    units.torque_command = [500.0, 599.0, 500.0, 599.0, 599.0, 599.0]
    units.works[3], units.protected[4], units.runs_away[5] = 0, 1, 1
    run = RUN.rows(1, driver_command=0.8, plan=0.1, leader=2)[0]
    for k in range(38):
        run.time = k * H
        sensing.report_units(units, run)
    assert list(units.limited) == pytest.approx([0.3, NEVER, 0.37, 0.3, 0.3, 0.3])
    units.limited, run.plan, run.time = (
        NEVER,
        0.3,
        0.4,
    )  # a target below half of the plan says nothing
    sensing.report_units(units[:3], run)
    assert (units.limited[:3] == NEVER).all()


def newest(latency=0.0, jitter=0.0, loss=0.0):
    return telegrams.draw_telegrams(np.zeros(400, int), 4, 10, H, latency, jitter, loss, seed=1)


@pytest.mark.parametrize("latency", [0.0, 0.03, 0.25])
def test_telegrams_are_heard_after_their_latency_and_the_leader_hears_itself_at_once(latency):
    k = np.arange(400)
    late = np.maximum(k - round(latency / H), 0) // 10 * 10
    for found in newest(latency):
        assert np.array_equal(found, np.column_stack([k, late, late, late]))


def test_jitter_and_loss_are_as_often_as_asked_and_both_ways_are_drawn():
    heard, told = (one[:, 1:] for one in newest(0.02, 0.05, 0.3))
    for one in (heard, told):
        assert np.diff(one, axis=0).min() == 0
        assert (np.arange(400)[:, None] - one)[10:].min() == 3
        share = np.mean([np.unique(one[:, j]).size for j in range(3)]) / 40
        assert share == pytest.approx(0.7, abs=0.15)
    assert not np.array_equal(heard, told)
    late = newest(0.02, 0.05)[0][:, 1]
    assert {int(np.argmax(late >= s)) - s for s in range(10, 390, 10)} == {3, 4, 5, 6, 7}
    lossless = newest(0.05, 0.0, 0.0)[0][:, 1:]
    assert (newest(0.05, 0.0, 0.3)[0][:, 1:] <= lossless).all()
    assert not newest(loss=1.0)[0][:, 1:].any()


def test_orders_count_when_they_have_arrived_and_silence_ends_them():
    units = UNIT.rows(4, wanted=[0.11, 0.12, 0.13, math.inf])
    orders = UNIT.record(200, 4)
    orders.wanted = 0.05 + 1e-3 * np.arange(200)[:, None] + 0.001 * np.arange(4)
    told, onboard, run = np.tile([[150, 140, 39, 150]], (200, 1)), ONBOARD.rows(1)[0], RUN.rows(1, plan=0.2)[0]  # fmt: skip
    telegrams.set_limits(150, units, told, orders, onboard, run)
    assert list(units.limit) == pytest.approx([0.11, 0.191, 0.2, 0.2])
    assert [*units.follows, *units.fallen_back] == [1, 1, 0, 0, 0, 0, 1, 0]
    told[150, 2] = 40  # a second, and a telegram's period
    telegrams.set_limits(150, units, told, orders, onboard, run)
    assert (units.limit[2], units.fallen_back[2]) == (pytest.approx(0.092), 0)


@pytest.mark.parametrize("inertia", [0, 1])
def test_a_target_is_the_limit_on_the_loaded_axles_within_the_motors_and_rises_slowly(inertia):
    units = UNIT.rows(3, load=[9e4, 1.2e5, 9e4], radius=[0.45, 0.43, 0.45], gear=[6.0, 7.0, 6.0], turning=0.1)  # fmt: skip
    units.limit, units.drive_limit, units.brake_limit = [0.1, 0.12, 0.2], [9e3, 9e3, 100.0], 400.0
    run = RUN.rows(1, driver_command=1.0, plan=0.2, rise=0.5)[0]
    onboard, found = ONBOARD.rows(1, inertia_in_limit=inertia)[0], []
    for _ in range(61):
        targets.set_targets(units, onboard, run)
        found.append(list(units.torque_target))
    scale = (1.0 + 0.1 * inertia) * units.load * units.radius / units.gear  # (6), (6')
    assert found[0] == pytest.approx(np.minimum(0.2 * scale * H / 0.5, [9e3, 9e3, 100.0]))
    assert found[-1] == pytest.approx([0.1 * scale[0], 0.12 * scale[1], 100.0])
    run.sign = -1.0
    targets.set_targets(units, onboard, run)
    assert units.torque_target == pytest.approx([400.0, 400.0, 100.0 + 0.2 * scale[2] * H / 0.5])


FULL = 1.05 * 0.1 * 1e5 * 0.43 / 7.0


def braking(ticks, takes=1.0, left=1.0, limit=0.1, **columns):
    """Blended braking of a unit whose line takes a share and whose controller leaves a share of the target."""
    units = UNIT.rows(1, load=1e5, brake_turning=0.05, brake_limit=5e3, limit=limit, **columns)
    run = RUN.rows(1, driver_command=-1.0, sign=-1.0, braking=1, plan=0.1)[0]
    u, onboard = units[0], ONBOARD.rows(1)[0]
    for _ in range(ticks):
        targets.set_brake_targets(units, onboard, run)
        u.torque_command = left * u.torque_target
        targets.foresee_torques(units, run)
        taken = min(u.torque_command, takes * FULL)
        u.motor_torque += -math.expm1(-H / u.lag) * (taken - u.motor_torque)
        yield u


@pytest.mark.parametrize("takes", [1.0, 0.4, 0.0])
def test_motors_and_air_sum_up_to_the_demand_and_air_gives_what_the_line_does_not_take(takes):
    for u in braking(1500, takes):
        assert u.torque_target + u.air_brake_force * 0.43 / 7.0 == pytest.approx(u.pattern)
    assert (u.pattern, u.kept) == pytest.approx((FULL, 1.0))
    assert u.torque_target == pytest.approx(takes * FULL, abs=0.01 * FULL)
    for u in braking(300, works=0):
        assert (u.torque_target, u.air_brake_force) == (0.0, pytest.approx(u.pattern * 7.0 / 0.43))


@pytest.mark.parametrize(("takes", "works"), [(2.0, 1), (0.4, 1), (0.0, 1), (0.0, 0)])
def test_beyond_the_plan_only_motors_brake(takes, works):
    for u in braking(1500, takes, limit=0.13, works=works):
        assert u.air_brake_force <= (1.0 + 1e-12) * FULL * 7.0 / 0.43
    motors, air = u.torque_target, u.air_brake_force * 0.43 / 7.0
    assert motors == pytest.approx(min(takes, 1.3) * FULL, abs=0.01 * FULL)
    assert air == pytest.approx(max(FULL - motors, 0.0), abs=1e-6 * FULL)


def test_a_unit_that_follows_an_order_makes_up_for_its_cylinders():
    for u in braking(500, follows=1, air=4000.0):
        assert u.torque_target == pytest.approx(max(u.pattern - 4000.0 * 0.43 / 7.0, 0.0))


def test_air_gives_way_where_readhesion_control_leaves_little():
    kept = [u.kept for u in braking(500, takes=0.4, left=0.2)]
    assert np.diff(kept)[110:300] == pytest.approx((0.2 - 0.5) * H, rel=1e-6)
    assert kept[-1] == 0.0


def test_trailers_are_asked_for_their_part_and_lack_what_their_shoes_do_not_give():
    b = board(plan=0.1, braked=0.8, reference_speed=20.0)
    brakes, units, run, onboard = b["brakes"], b["units"], b["run"], b["onboard"]
    brakes.valve, brakes.most = [0.0, 1.0, 0.0], [0.0, 0.0, 1e9]
    targets.ask_brakes(b["axles"], units, brakes, onboard, run)
    friction = (
        brakes.friction_numerator / (72.0 + brakes.friction_offset) + brakes.friction_constant
    )
    part = brakes.share[2] * 0.08 * brakes.load[2]
    force = np.array([*units.air_brake_force, part * (1.0 + brakes.turning[2])])
    pressure = np.minimum(force / (brakes.gain * friction), brakes.most_pressure)
    assert [*brakes.pressure_target, *units.protected] == pytest.approx([*pressure, 0, 1])
    brakes.pressure[2] = 0.5 * force[2] / (brakes.gain * friction)[2]
    lacking = 0.5 * part / (2 * units.load[0] + 3 * units.load[1])
    assert targets.trailers_lack(units, brakes, run) == pytest.approx(lacking)
    brakes.most[2] = 0.08 * part  # the oracle's
    targets.ask_brakes(b["axles"], units, brakes, onboard, run)
    assert brakes.pressure_target[2] == pytest.approx(0.08 * pressure[2])


@pytest.mark.parametrize("slides", [False, True])
def test_slide_protection_of_a_bogie_is_known_to_each_of_its_units(slides):
    b = board()
    b["axles"].unit, b["axles"].brake = [0, 1, 0, 1, -1, -1], [0, 0, 1, 1, 2, 2]
    b["brakes"].valve, b["brakes"].unit = [0.0, float(slides), 2.0], [1, 1, -1]
    call(targets.ask_brakes, b)
    assert list(b["units"].protected) == [slides, slides]


def valves(readings, protection=1, speed=20.0, ticks=1, braking=1):
    axles, rows = AXLE.rows(4, reading=readings, brake=[0, 0, 1, 1]), BRAKE.rows(2)
    run = RUN.rows(1, braking=braking, reference_speed=speed)[0]
    for k in range(ticks):
        slide.protect_wheels(k, axles, rows, SLIDE.rows(1, protection=protection)[0], run)
    return list(rows.valve)


def test_the_worst_axle_of_a_bogie_moves_its_valves():
    supply, hold, release, medium = 0.0, 1.0, 2.0, 20.0 * (1.0 - 0.077716)
    assert valves([20.0, 18.0, 20.0, 16.0]) == [hold, release]  # 10 and 20 % of slip ratio
    assert valves([18.5, 20.0, 0.0, 20.0]) == [supply, release]  # one stands
    for off in ({"braking": 0}, {"protection": 0}, {"speed": 1.3}):  # below the cut-out speed
        assert valves([0.0, 1.0, 1.0, 1.0], **off) == [supply, supply]
    assert valves([20.0, medium, 20.0, 12.0], 2, ticks=200) == [hold, release]
    assert valves([20.0, medium, 20.0, 19.5], 2) == [release, hold]  # slip that grows


@pytest.mark.parametrize("watched", [1, 0])
@pytest.mark.parametrize(("seen", "peak"), [([0, 1, 1, 1], 0.03), ([0, 0, 0, 0], 0.02), ([1, 0, 1, 0], 0.03)])  # fmt: skip
def test_an_unseen_axle_cannot_run_away(watched, seen, peak):
    b = board(sign=1.0, braking=0, driver_command=1.0, plan=0.1)
    axles, units = AXLE.rows(4, unit=0, gear=7.0), UNIT.rows(1, limit=0.1)
    b |= {"axles": axles, "units": units, "brakes": BRAKE.rows(0), "noise": np.zeros(4)}
    b |= {
        "wheelsets": WHEELSET.rows(4, sensed=seen),
        "drives": DRIVE.rows(1),
        "cylinders": CYLINDER.rows(0),
    }
    b["onboard"] = ONBOARD.rows(1, true_speed=1)[0]
    peaks, worst, y = np.where(seen, 0.15, peak), 0.0, np.array([0.0, 5.0, *[5.0 / 0.43] * 4, *np.zeros(5)])  # fmt: skip
    for k in range(1500):  # on a train that gains 0.3 m/s2
        b["run"].time, y[1], b["y"] = k * H, 5.0 + 0.3 * k * H, y
        call(wire.tell_speed, b)
        call(wire.read, b)
        call(sensing.sense_train, b)
        units.runs_away &= watched
        targets.set_targets(units, b["onboard"], b["run"])
        y[6] = units.torque_target[0]
        for _ in range(10):
            slip = 0.43 * y[2:6] - y[1]
            rail = peaks * 1e5 * np.clip(slip / 0.1, -1.0, 1.0) * np.where(slip > 0.1, 0.6, 1.0)
            y[2:6] += 1e-3 * (7.0 * y[6] - 0.43 * rail) / 100.0
        worst = max(worst, slip.max())
        share = 1.0 if any(seen) else 0.5  # a blind unit is asked for half
        assert y[6] <= share * 0.1 * 1e5 * 0.43 / 7.0 + 1e-9
    assert worst < 3.0 if watched else worst > 20.0
