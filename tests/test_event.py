"""Events: equal ones give equal worlds, what is drawn can be drawn again, and the hash has all that defines one."""

from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from typing import Literal, get_args, get_origin

import numpy as np
import pytest
from numba import typeof

from alloc.onboard.columns import ONBOARD, RUN, SLIDE
from alloc.onboard.settings import Dropout, Onboard, Sensors, Telegrams
from alloc.plant.rail import Line, Patch, Rail, logarithmic_increments
from alloc.plant.trains import TRAINS, find_train
from alloc.run.event import DriverCommand, Event
from alloc.schema.errors import InputError
from tests.cases import looped

SENSORS = Sensors(0.01, 0.002, 0.03, 0.01, 5, dropouts=(Dropout(6, 1.0, 2.0),))
EVENT = Event(
    "made", find_train("commuter-8car").loaded([1e3 * c for c in range(8)]),
    Rail(0.1, scatter=0.01, conditioning=0.1, increments=tuple(logarithmic_increments(32)), patches=(Patch(0.5, 5.0, 9.0),)),
    DriverCommand((0.5, 2.0), (0.8, -0.7)), Onboard(sensors=SENSORS, telegrams=Telegrams(jitter=0.04, loss=0.2)),
    Line((0.0, 50.0), (0.0, 0.02)), failures={1: 1.5}, duration=3.0, initial_speed=5.0, initial_position=10.0,
)  # fmt: skip


def with_sensors(**changes):
    return replace(EVENT, onboard=replace(EVENT.onboard, sensors=replace(SENSORS, **changes)))


def test_equal_events_give_equal_worlds_and_each_run_has_its_own():
    first, again, other = EVENT.world(), EVENT.world(), replace(EVENT, name="made").world()
    for one, two, three in zip(first, again, other, strict=True):
        assert one.tobytes() == two.tobytes() == three.tobytes()
        assert not np.shares_memory(one, two)
    first.units.cap[:] = 0.0
    assert np.isinf(EVENT.world().units.cap).all()


def test_worlds_of_all_trains_have_one_type_so_one_loop_serves_them():
    others = [Event("plain", find_train(name), Rail(0.1), EVENT.command) for name in TRAINS]
    assert {typeof(one.world()) for one in others} == {typeof(EVENT.world())}


def test_another_seed_draws_what_is_drawn_and_nothing_else():
    one, two = EVENT.world(), with_sensors(seed=6).world()
    differ = {
        name for name in one._fields if getattr(one, name).tobytes() != getattr(two, name).tobytes()
    }
    assert differ == {"axles", "units", "brakes", "onboard", "noise", "report_tick", "order_tick"}
    changed = {name for name in one.axles.dtype.names if (one.axles[name] != two.axles[name]).any()}
    assert changed == {"radius"}
    plain = with_sensors(speed_noise=0.0, load_error=0.0, radius_error=0.0)
    plain = replace(plain, onboard=replace(plain.onboard, telegrams=Telegrams()))
    other = replace(
        plain, onboard=replace(plain.onboard, sensors=replace(plain.onboard.sensors, seed=6))
    )
    assert plain.inputs_hash == other.inputs_hash != EVENT.inputs_hash


def test_errors_have_the_sizes_that_sensors_state():
    w = EVENT.world()
    assert w.noise.std() == pytest.approx(0.01, rel=0.05)
    raw = replace(EVENT, onboard=EVENT.onboard.with_settings({"reference.radii_compared": False}))
    off, before = (one.axles.radius / 0.43 - 1.0 for one in (w, raw.world()))
    assert off.std() == pytest.approx(1e-4, rel=0.3)
    assert off.mean() == pytest.approx(before.mean(), abs=1e-4)
    assert before.std() == pytest.approx(0.01 / 3.0**0.5, rel=0.3)


def test_a_run_begins_rolling():
    w, n = EVENT.world(), 32
    assert w.state[:2].tolist() == [10.0, 5.0]
    assert w.state[2 : 2 + n] * w.wheelsets.radius == pytest.approx(5.0)
    assert not w.state[2 + n :].any()
    assert w.state.size == 2 + n + w.units.size + w.brakes.size + n + 4
    assert w.run.reference_speed == w.plant.speed == 5.0
    coupled = replace(EVENT, train=find_train("freight-5"), rail=Rail(0.1)).world()
    assert coupled.state[:12].tolist() == [10.0] * 6 + [5.0] * 6


def test_the_leader_is_the_foremost_unit_that_is_known_to_work():
    event = replace(EVENT, failures={0: 1.0, 1: 0.5})
    leader = event.world().leader
    assert leader[:110].tolist() == [0] * 110
    assert set(leader[112:]) == {2}
    assert event.world().drives.failure[:3].tolist() == [1.0, 0.5, 1e9]


def test_a_telegram_that_has_arrived_stays_and_none_comes_from_the_future():
    w = EVENT.world()
    tick = np.arange(EVENT.ticks)[:, None]
    for found in (w.report_tick, w.order_tick):
        assert (np.diff(found, axis=0) >= 0).all()
        assert (found <= tick).all()
        assert (found[tick[:, 0], w.leader] == tick[:, 0]).all()
        assert (found[:, 2:] % 10 == 0).all()
        assert (tick - found)[:, 2:][found[:, 2:] > 0].min() in (
            5,
            6,
        )  # a latency of 50 ms and more
    silent = replace(EVENT, onboard=Onboard(telegrams=Telegrams(loss=1.0))).world()
    assert not silent.report_tick[:, 1:].any()


def test_lost_signals_and_commands_come_when_they_are_said():
    w = EVENT.world()
    assert [w.wheelsets.lost[6], w.wheelsets.back[6]] == [1.0, 2.0]
    assert (np.delete(w.wheelsets.lost, 6) == 1e9).all()
    assert [float(w.command[k]) for k in (0, 49, 50, 199, 200)] == [0.0, 0.0, 0.8, 0.8, -0.7]


def test_rows_of_the_default_computers_are_the_defaults_of_the_columns():
    w = replace(EVENT, onboard=Onboard(), initial_speed=0.0, initial_position=0.0).world()
    of_train = {
        "planned",
        "brake_planned",
        "train_mass",
        "resistance",
        "resistance_linear",
        "resistance_quadratic",
        "detector_pole",  # open: it follows the noise
    }
    for table, rows in ((ONBOARD, w.onboard), (SLIDE, w.slide), (RUN, w.run)):
        for name, column in table.columns.items():
            if name not in of_train:
                assert rows[name][0] == pytest.approx(column.default, nan_ok=True), name


def nudged(value, kind):
    """Other values of a field, some of which its record may refuse."""
    choices = [
        one
        for part in (kind, *get_args(kind))
        if get_origin(part) is Literal
        for one in get_args(part)
    ]
    if choices or isinstance(value, bool):
        return [one for one in choices or (True, False) if one != value]
    if isinstance(value, str):
        return [value + "x", "shinkansen"]
    if isinstance(value, int | float):
        return [value + 1, value * 1.01 + 1e-3, value * 0.99]
    if isinstance(value, tuple) and value:
        return [(one, *value[1:]) for one in nudged(value[0], type(value[0]))]
    return [(0.1,) * 4, 0.5, {0: 1.0}]


def changes(record):
    """Records that differ from `record` in one field, at any depth."""
    for item in fields(record):
        value = getattr(record, item.name)
        inner = value[0] if isinstance(value, tuple) and value else value
        if is_dataclass(inner):
            for path, one in changes(inner):
                whole = (one, *value[1:]) if isinstance(value, tuple) else one
                yield f"{item.name}.{path}", replace(record, **{item.name: whole})
            continue
        for other in nudged(value, item.type):
            with suppress(InputError, TypeError):
                changed = replace(record, **{item.name: other})
                if other != value:
                    yield item.name, changed
                    break


def test_the_hash_changes_with_every_field():
    known = {EVENT.hash: "itself"}
    for path, event in changes(EVENT):
        assert event.hash not in known, (path, known[event.hash])
        known[event.hash] = path
    assert len(known) > 100
    assert replace(EVENT).hash == EVENT.hash


@looped(
    ("change", "named"),
    [
        ({"duration": 1e6}, "duration"),
        ({"duration": 0.001}, "duration"),
        ({"step": 1e-9}, "duration"),
        ({"record_period": 5.0}, "record_period"),
        ({"failures": {4: 1.0}}, "no traction unit 5"),
        ({"rail": Rail(0.1, increments=(0.1, 0.2))}, "increments"),
        ({"onboard": Onboard(sensors=Sensors(dropouts=(Dropout(32, 1.0),)))}, "axle = 32"),
        ({"onboard": Onboard().with_settings({"braking.car_shares": (1.0,)})}, "car_shares"),
        (
            {"onboard": Onboard().with_settings({"belief.unit_increments": (1.0,)})},
            "unit_increments",
        ),
    ],
)
def test_what_cannot_run_is_refused_in_a_line_that_says_why(change, named):
    with pytest.raises(InputError, match=rf"^[^\n]*{named}[^\n]*$"):
        replace(EVENT, **change).world()


def test_settings_reach_every_depth_and_no_further():
    changed = Onboard().with_settings(
        {"detector.pole": 10.0, "braking.slide_protection.law": "fuzzy", "hold_time": 2.0}
    )
    assert (changed.detector.pole, changed.braking.slide_protection.law, changed.hold_time) == (
        10.0,
        "fuzzy",
        2.0,
    )
    for path in ("detector.poles", "pole", "hold_time.x", ""):
        with pytest.raises(InputError, match="no field"):
            Onboard().with_settings({path: 1.0})
    with pytest.raises(InputError, match="pole"):
        Onboard().with_settings({"detector.pole": -1.0})


def test_lines_change_where_they_say():
    origin, rows = Line((0.0, 100.0), (0.0, 0.02), ((40.0, 60.0),), 2.0).rows(-20.0, 200.0)
    at = {place: rows[int((place - origin) / 5.0)] for place in (-10.0, 25.0, 50.0, 150.0)}
    assert [float(at[place].grade) for place in at] == [0.0, 0.0, 0.0, 0.02]
    assert [float(at[place].air) for place in at] == [1.0, 1.0, 2.0, 1.0]
    assert Line().rows(0.0, 1e4)[1].size == 1
