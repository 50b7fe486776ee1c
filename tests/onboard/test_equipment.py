"""What the computers know of a train in which no two cars are alike, summed up car by car by hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.onboard import sensing
from alloc.onboard.equipment import equipment
from alloc.onboard.host import each_unit, unit_contexts
from alloc.onboard.parameters import (
    Belief,
    Braking,
    Dropout,
    Onboard,
    ReferenceSpeed,
    Sensors,
    Telegrams,
)
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.onboard.telegrams import SLOTS
from alloc.plant.adhesion import POLACH_WET
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.rules.rule import Trigger
from tests.cases import looped
from tests.onboard.uneven import uneven_train

GRAVITY = 9.80665


UNITS = ((1, (4, 5, 6, 7)), (2, (8, 9)), (2, (10, 11)), (3, (12, 13, 14, 15)))


"""Car and axles of each traction unit of the uneven train."""


GROWTH = tuple(0.002 * k + 0.0003 * k**2 for k in range(20))


LOADS = (100.0, 2500.0, 700.0, 0.0, 1234.0)


def _model(**options):
    return build(uneven_train(**options), Rail(0.15))


def test_all_brakes_together_are_asked_for_mass_times_deceleration():
    """However the axles of a car are loaded and turn: the plan counts every axle, not the first of its group."""
    rng = np.random.default_rng(4)
    for k in range(20):
        even = uneven_train(k % 2 == 0)
        share = [x / x.sum() for x in rng.uniform(0.5, 1.5, (len(even.cars), 4))]
        cars = [
            replace(car, axle_load_share=tuple(x), wheel_inertia=tuple(rng.uniform(50.0, 200.0, 4)))
            for car, x in zip(even.cars, share, strict=True)
        ]
        train, onboard = replace(even, cars=tuple(cars)), Onboard(inertia_in_limit=k % 3 > 0)
        model = build(train, Rail(0.15))
        eq, s = equipment(model, onboard), model.structure
        own = eq.group.unit < 0
        asked = (eq.axles * eq.axle_load * (1.0 + eq.brake_inertia)).sum()
        asked += (eq.group.axles * eq.group.weight * (1.0 + eq.group.inertia))[own].sum()
        moved = sum(car.mass for car in cars) + (s.inertia / s.radius**2).sum()
        assert eq.brake_share * asked == pytest.approx(moved, rel=1e-9)


@looped("blended", [True, False])
@looped("inertia", [True, False])
@looped("coupled", [True, False])
def test_every_value_follows_from_the_cars(coupled, inertia, blended):
    train = uneven_train(coupled)
    onboard = Onboard(
        belief=Belief(increments=GROWTH, loads=LOADS, unit_deviation=(0.01, 0.02, 0.03, 0.04)),
        braking=Braking(blended=blended), inertia_in_limit=inertia,
    )  # fmt: skip
    eq = equipment(build(train, Rail(0.15)), onboard)
    cars = [train.cars[k] for k, _ in UNITS]
    empty = np.array([car.empty_mass / 4 for car in cars])
    load = np.array([LOADS[k] / 4 for k, _ in UNITS])
    count = np.array([len(axles) for _, axles in UNITS])
    wheel = [np.mean([train.cars[k].wheel_inertia[i % 4] for i in axles]) for k, axles in UNITS]
    turning = [[j / car.wheel_radius**2 for j in car.wheel_inertia] for car in train.cars]
    by_unit = np.array([np.mean([turning[k][i % 4] for i in axles]) for k, axles in UNITS])
    weight = (empty + load) * count
    whole = sum(car.empty_mass for car in train.cars) + sum(LOADS)
    everything = sum(map(sum, turning))
    trailers = sum(turning[0]) + sum(turning[4])
    moved = whole + (trailers if inertia else everything)
    braked = whole + everything if not inertia else whole if blended else whole + trailers
    planned = moved / (GRAVITY * weight.sum())
    brake_share = braked / (GRAVITY * whole) if blended else planned
    own = by_unit / (empty + load) * inertia
    expected = {
        "axle_unit": [-1] * 4 + [0] * 4 + [1] * 2 + [2] * 2 + [3] * 4 + [-1] * 4,
        "axle_car": np.repeat(range(5), 4), "axle_body": np.repeat(range(5), 4) * coupled,
        "axle_group": [0, 0, 1, 1, 2, 2, 3, 3, -1, -1, -1, -1, 4, 4, 5, 5, 6, 6, 7, 7],
        "axle_radius": np.repeat([car.wheel_radius for car in train.cars], 4),
        "unit_body": np.array([k for k, _ in UNITS]) * coupled, "axles": count,
        "radius": [car.wheel_radius for car in cars], "inertia": wheel,
        "gear": [car.motors.gear_ratio for car in cars], "empty_axle_mass": empty, "load_per_axle": load,
        "axle_load": (empty + load) * GRAVITY, "mass": weight / weight.mean(),
        "own_inertia": own / (GRAVITY * planned),
        "planned_share": planned, "blended": blended,
        "brake_inertia": own / (GRAVITY * brake_share), "brake_share": brake_share,
    }  # fmt: skip
    for name, value in expected.items():
        np.testing.assert_allclose(getattr(eq, name), value, rtol=1e-12, err_msg=name)
    increment = [np.mean([GROWTH[i] for i in axles]) for _, axles in UNITS]
    np.testing.assert_allclose(eq.learnt.increment, increment, rtol=1e-12)
    assert eq.learnt.deviation.tolist() == [0.01, 0.02, 0.03, 0.04]
    first = (0, 2, 4, 6, 12, 14, 16, 18)
    at = [i // 4 for i in first]
    mass = np.array([(train.cars[k].empty_mass + LOADS[k]) / 4 for k in at])
    wheels = np.array([np.mean(turning[i // 4][i % 4 : i % 4 + 2]) for i in first]) * inertia
    groups = {
        "unit": [-1, -1, 0, 0, 3, 3, -1, -1], "body": np.array(at) * coupled, "car": at, "axles": [2.0] * 8,
        "weight": mass * GRAVITY, "inertia": wheels / mass / (GRAVITY * brake_share),
        "gain": [train.cars[k].air_brake.force_per_pascal for k in at], "pressure": [420e3] * 8,
        "friction": [train.cars[k].air_brake.friction for k in at],
    }  # fmt: skip
    for name, value in groups.items():
        np.testing.assert_allclose(getattr(eq.group, name), value, rtol=1e-12, err_msg=name)


def test_load_signals_err_by_car_and_none_is_negative():
    model = _model()
    loads = np.array([car.load for car in model.train.cars])
    eq = equipment(model, Onboard(sensors=Sensors(load_error=0.6, seed=3)))
    signals = np.maximum(loads * (1.0 + 0.6 * np.random.default_rng(3).standard_normal(5)), 0.0)
    np.testing.assert_allclose(eq.load_per_axle, signals[[1, 2, 2, 3]] / 4, rtol=1e-12)
    sound = equipment(model, Onboard())
    np.testing.assert_allclose(sound.load_per_axle, loads[[1, 2, 2, 3]] / 4, rtol=1e-12)
    np.testing.assert_array_equal(sound.learnt, np.zeros((6, 4)))


def test_a_train_without_motors_brakes_with_air_alone():
    train = uneven_train()
    trailers = replace(train, cars=(train.cars[0], train.cars[4]))
    eq = equipment(build(trailers, Rail(0.15)), Onboard(braking=Braking(blended=False)))
    assert eq.blended
    assert eq.planned_share == 0.0
    assert eq.axles.size == 0
    np.testing.assert_allclose(eq.brake_share, 1.0 / GRAVITY, rtol=1e-12)


def test_a_train_that_neither_pulls_nor_brakes_is_refused():
    train = uneven_train(braked=False)
    with pytest.raises(OnboardError, match="no traction unit and no air brake"):
        equipment(build(replace(train, cars=(train.cars[0], train.cars[4])), Rail(0.15)), Onboard())


@looped(
    ("belief", "words"),
    [
        (Belief(loads=(1.0,) * 4), "4 loads for 5 cars"),
        (Belief(increments=(0.0,) * 19), "19 increments for 20 axles"),
        (Belief(unit_increments=(0.0, 0.1, 0.2, np.nan)), "4 unit_increments for 4 traction units"),
        (Belief(unit_deviation=(0.0,) * 5), "5 unit_deviation for 4"),
    ],
)
def test_beliefs_that_do_not_fit_are_refused(belief, words):
    with pytest.raises(OnboardError, match=words):
        equipment(_model(), Onboard(belief=belief))


def test_a_dropout_of_the_last_axle_fits_and_of_the_next_does_not():
    equipment(_model(), Onboard(sensors=Sensors(dropouts=(Dropout(19, 0.0),))))
    with pytest.raises(OnboardError, match="axle 20, but the train has 20 axles, 0 to 19"):
        equipment(_model(), Onboard(sensors=Sensors(dropouts=(Dropout(20, 0.0),))))


@looped(("make", "words"), [
        (lambda: Dropout(-1, 0.0), "axle = -1"),
        (lambda: Dropout(True, 1.0, 1.0), "must lie before"),
        (lambda: Dropout(0, 2.0, 1.0), "begin = 2.0 must lie before until = 1.0"),
        (lambda: Telegrams(loss=1.01), "loss = 1.01"),
        (lambda: Telegrams(loss=-0.01), "loss = -0.01"),
        (lambda: Sensors(blind_share=1.01), "blind_share"),
        (lambda: Sensors(blind_share=-0.01), "blind_share"),
        (lambda: Sensors(sensorless_pole=0.0), "sensorless_pole"),
        (lambda: Sensors(sensorless_pole=3.0, dropouts=(Dropout(0, 0.0),)), "dropouts need sensors"),
        (lambda: Belief(loads=(1.0, -0.1)), "0 or greater"),
        (lambda: Belief(loads=(np.inf,)), "finite"),
        (lambda: Onboard(limit_rate=0.0), "limit_rate = 0.0"),
        (lambda: Onboard(period=0.2), "period = 0.2 must not exceed telegrams.period = 0.1"),
        (lambda: Sensors(radius_error=0.6), "radius_error = 0.6 must lie in 0 to 0.5"),
        (lambda: Sensors(load_error=5.0), "load_error = 5.0 must lie in 0 to 1"),
        (lambda: Onboard(trigger="skid"), "trigger = 'skid' must be one of limited, slip"),
        (lambda: ReferenceSpeed("forecast"), "source = 'forecast' must be one of estimate, truth"),
    ])  # fmt: skip
def test_impossible_parameters_are_refused(make, words):
    with pytest.raises(OnboardError, match=words):
        make()


def test_bounds_themselves_are_possible():
    assert Telegrams(loss=1.0).loss + Telegrams(loss=0.0).loss == 1.0
    assert Sensors(blind_share=1.0).blind_share + Sensors(blind_share=0.0).blind_share == 1.0
    assert Onboard(period=0.1).telegrams.period == 0.1
    assert Belief(loads=(0.0,)).loads == (0.0,)


def test_settings_are_the_parameters_in_the_loops_own_terms():
    lost = (Dropout(3, 1.0, 2.0), Dropout(7, 0.5))
    onboard = Onboard(
        period=0.02, telegrams=Telegrams(period=0.13), sensors=Sensors(speed_noise=0.01, speed_quantum=0.03, dropouts=lost)
    )  # fmt: skip
    st = settings(onboard, RuleSettings(1, Trigger.STEPWISE), "cut-and-ramp")
    assert (st.period, st.hold_time, st.rise_time) == (0.02, onboard.hold_time, onboard.rise_time)
    assert st.rule == RuleSettings(1, Trigger.STEPWISE)
    assert not st.hosted
    assert st.telegrams.ticks == 6
    assert (st.sensors.noisy, st.sensors.speed_quantum, st.sensors.pole) == (True, 0.03, 0.0)
    assert (st.sensors.dropout.axle.tolist(), st.sensors.dropout.begin.tolist()) == (
        [3, 7],
        [1.0, 0.5],
    )
    assert st.sensors.dropout.until.tolist() == [2.0, np.inf]
    assert st.detector.gain == pytest.approx(1.0 - np.exp(-0.02 * onboard.detector.pole))
    assert st.observer.pole == onboard.observer.pole
    assert not st.reference.given
    # sensor, noise, and the quantum's even distribution
    assert st.reference.noise == pytest.approx(np.sqrt(0.005**2 + 0.01**2 + 0.03**2 / 12.0))
    assert (st.brakes.inertia_in_estimate, st.brakes.by_pressure) == (True, True)
    other = replace(
        onboard, sensors=Sensors(sensorless_pole=4.0), telegrams=Telegrams(period=0.02), hosted={"mpc": 3},
        reference=ReferenceSpeed("truth"), braking=Braking(inertia_in_estimate=False, air_force="command"), trigger="slip",
    )  # fmt: skip
    st = settings(other, RuleSettings(1, Trigger.STEPWISE), "mpc")
    assert st.rule == RuleSettings(1, Trigger.SLIPPING)
    assert st.hosted
    assert (st.sensors.noisy, st.sensors.pole, st.telegrams.ticks) == (False, 4.0, 1)
    assert st.reference.given
    assert st.reference.noise == 0.005
    assert (st.brakes.inertia_in_estimate, st.brakes.by_pressure) == (False, False)


def test_a_run_begins_rolling_in_the_plan_with_nothing_heard():
    eq = equipment(_model(coupled=True), Onboard())
    m = memory(eq, 9.0, 0.07)
    start = {
        "reference": [9.0] * 5, "mean_speed": [9.0] * 4, "speed": [9.0] * 4,
        "differentiator": [9.0] * 4, "observer": [np.nan] * 4, "limit_max": [np.inf] * 4, "in_service": [True] * 4,
        "cap": [0.07] * 4, "limit_wanted": [0.07] * 4, "delivered": [0.07] * 4, "received": [np.inf] * 4,
        "rise": [0.0] * 4, "axle_seen": [True] * 20, "demonstrated": [np.inf] * 4, "limited": [False] * 4,
        "slipping": [False] * 4, "air_most": [np.inf] * 8, "message": [[np.inf]] * 4,
    }  # fmt: skip
    for name, value in start.items():
        np.testing.assert_array_equal(getattr(m, name), value, err_msg=name)
    np.testing.assert_allclose(m.axle_omega * eq.axle_radius, 9.0)
    for line, fields, nothing in (
        (m.orders, 1, [np.inf]),
        (m.report.line, 5, [0.07, np.nan, -np.inf, 0.0, -np.inf]),
    ):
        assert line.arrival.shape == line.sent.shape == (4, SLOTS)
        assert line.content.shape == (4, SLOTS, fields)
        assert np.isinf(line.arrival).all()
        np.testing.assert_array_equal(line.heard, [0.0] * 4)
        np.testing.assert_array_equal(line.newest, [-np.inf] * 4)
        np.testing.assert_array_equal(line.read, [nothing] * 4)
    np.testing.assert_array_equal(m.report.own, [[0.07, np.nan, -np.inf, 0.0, -np.inf]] * 4)
    np.testing.assert_array_equal(m.report.counted, [-np.inf] * 4)
    np.testing.assert_array_equal(m.report.limited_at, [-np.inf] * 4)
    unit = dict.fromkeys(m.unit._fields, 0.0) | {
        "limit": 0.07,
        "axles_seen": eq.axles,
        "torque_factor": 1.0,
    }
    for (name, value), row in zip(unit.items(), m.unit_block, strict=True):
        np.testing.assert_array_equal(
            getattr(m.unit, name), np.broadcast_to(value, 4), err_msg=name
        )
        assert np.shares_memory(row, getattr(m.unit, name))
    assert m.train_block.ravel().tolist()[:5] == [0.0, 0.07, 0.0, 0.0, 0.0]
    assert np.isnan(m.train.level[0])
    assert m.lead.detected[0] == m.lead.slipped[0] == -np.inf
    assert (m.lead.unit.dtype, m.lead.allocate.dtype) == (np.int64, np.bool_)
    assert {value.item() for value in m.counter} == {0}


def test_a_hosted_controller_is_told_what_its_unit_is():
    onboard = Onboard(
        belief=Belief(loads=LOADS, curve=POLACH_WET),
        sensors=Sensors(seed=5),
        hosted={"mine": "settings"},
    )
    train = replace(uneven_train(True), load_transfer=True)
    model = build(train, Rail(0.15))
    eq = equipment(model, onboard)
    contexts = unit_contexts(model, eq, onboard, "mine")
    weight = [len(axles) * (train.cars[k].empty_mass + LOADS[k]) / 4 for k, axles in UNITS]
    for j, ((k, axles), context) in enumerate(zip(UNITS, contexts, strict=True)):
        assert (context.unit, context.car, context.axles) == (j, k, len(axles))
        found = (context.radius, context.gear_ratio, context.axle_load, context.inertia)
        assert found == (eq.radius[j], eq.gear[j], eq.axle_load[j], eq.inertia[j])
        assert context.mass == pytest.approx(train.mass * weight[j] / sum(weight))
        assert context.torque_lag == train.cars[k].motors.torque_lag
        curve = POLACH_WET.on(0.5 * context.axle_load, context.radius)
        assert (context.curve, context.period, context.blended) == (
            curve,
            onboard.period,
            eq.blended,
        )
        assert context.settings == "settings"
        # coupled cars tell their own speed: a unit that has all axles of its car has no free one
        assert context.free_axle == (len(axles) == 2)
        np.testing.assert_array_equal(context.unloading, model.structure.unloading[list(axles)])
        assert any(context.unloading)
    rigid = _model()
    assert all(
        c.free_axle for c in unit_contexts(rigid, equipment(rigid, onboard), onboard, "none")
    )
    assert unit_contexts(rigid, equipment(rigid, onboard), onboard, "none")[0].settings is None


def test_controllers_side_by_side_see_their_own_units():
    class Echo:
        def __init__(self, context):
            self.context = context

        def decide(self, sense):
            return self.context, sense

    assert each_unit(Echo)(["a", "b"]).decide([1, 2]) == [("a", 1), ("b", 2)]


def plain(part):
    """The Python function of a compiled part."""
    return getattr(part, "py_func", part)


@looped(
    ("rim", "seen"),
    [(1.0, 1.0), (1.04, 1.0), (1.06, 1.1), (1.09, 1.1), (-0.06, -0.1), (-0.04, 0.0)],
)
def test_a_quantised_speed_is_the_nearest_step(rim, seen):
    """Not the one below, which would make every train slower by half a step."""
    equipment = SimpleNamespace(
        axles=np.ones(1), unit_body=np.zeros(1, int), axle_body=np.zeros(1, int),
        axle_radius=np.array([0.5]), axle_unit=np.zeros(1, int),
    )  # fmt: skip
    settings = SimpleNamespace(sensors=SimpleNamespace(speed_quantum=0.1, pole=0.0), period=0.01)
    memory = SimpleNamespace(
        unit=SimpleNamespace(axles_seen=np.ones(1)), mean_speed=np.zeros(1), speed=np.zeros(1),
        reference=np.zeros(1), axle_omega=np.zeros(1), axle_seen=np.ones(1, bool),
        estimate=SimpleNamespace(radii=SimpleNamespace(factor=np.ones(1))),
    )  # fmt: skip
    omega, noise = np.array([(rim - 0.02) / 0.5]), np.array([0.02])
    plain(sensing._read_speeds)(equipment, settings, memory, omega, noise)
    assert memory.speed[0] == pytest.approx(seen, abs=1e-12)
    assert memory.axle_omega[0] == pytest.approx(seen / 0.5, abs=1e-12)
