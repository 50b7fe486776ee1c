"""What the train's momentum says of a log: signs, units and delays of forces, dead sensors, jumps of the speed."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

from studies.log_accuracy import defects as spoil
from studies.logs.common_instants import Instants
from studies.logs.export import log_table, rounded
from studies.logs.known_train import MeasuredTrain
from studies.logs.mapping import Mapping
from studies.logs.measured_log import MeasuredLog, check_log
from studies.logs.measured_run import Findings, analyse_run
from studies.logs.momentum_check import forwards_too
from tests.simulation.slides import CLEANED_RAIL, TRAIN, braked, readhering

EVERY = 2


class Clean(NamedTuple):
    table: pd.DataFrame
    train: MeasuredTrain
    damage: float
    slips: int

    def found(
        self, table: pd.DataFrame, mapping: Mapping | None = None
    ) -> tuple[MeasuredLog, Findings]:
        log = check_log(table, self.train, "log", mapping)
        return log, analyse_run(log.run, log.train)


@pytest.fixture(scope="module")
def clean() -> Clean:
    """Three cars whose wheels slide and readhere, at 20 ms."""
    train = MeasuredTrain.of(TRAIN)
    table = rounded(log_table(braked(readhering, rail=CLEANED_RAIL), TRAIN, EVERY))
    log = check_log(table, train, "clean")
    found = analyse_run(log.run, train)
    assert log.remarks == ()
    return Clean(table, train, found.total_damage, len(found.events))


def at_contact(clean: Clean) -> pd.DataFrame:
    time, found = clean.table["time_s"], {}
    for i, (inertia, radius) in enumerate(
        zip(clean.train.inertia, clean.train.radius, strict=True), 1
    ):
        rate = np.gradient(clean.table[f"axle{i}_speed_kmh"] / 3.6, time)
        name = f"axle{i}_force_kn"
        found[name] = clean.table[name] - 1e-3 * inertia / radius**2 * rate
    return clean.table.assign(**found)


def dropped(table: pd.DataFrame) -> pd.DataFrame:
    """A receiver that says 0 where it has no fix, and jumps now and then."""
    time, speed = table["time_s"], table["speed_kmh"].copy()
    speed[(time > 8.0) & (time < 11.5)] = 0.0
    speed[(time > 20.0) & (time < 20.4)] = 0.0
    speed[::211] += 20.0
    return table.assign(speed_kmh=speed)


REPAIRED: dict[str, tuple[Callable[[Clean], pd.DataFrame], str]] = {
    "forces late": (lambda c: spoil.shifted(c.table, spoil.forces_of(c.table), 0.3), "recorded 0.300 s later"),
    "forces early": (lambda c: spoil.shifted(c.table, spoil.forces_of(c.table), -0.2), "s earlier than the wheels"),
    "wheels late": (lambda c: spoil.shifted(c.table, spoil.wheels_of(c.table), 0.2), "s earlier than the wheels"),
    "braking positive": (
        lambda c: c.table.assign(**{n: -c.table[n] for n in spoil.forces_of(c.table)}), "braking counts positive",
    ),
    "at the contact": (at_contact, "between wheel and rail"),
    "dropouts": (lambda c: dropped(c.table), "to which no train jumps"),
}  # fmt: skip


@pytest.mark.parametrize("name", REPAIRED)
def test_what_contradicts_the_motion_is_repaired_and_said(clean, name):
    change, words = REPAIRED[name]
    log, found = clean.found(change(clean))
    assert any(words in remark.text for remark in log.remarks)
    assert found.total_damage == pytest.approx(clean.damage, rel=0.02)
    assert abs(len(found.events) - clean.slips) <= 2


def test_a_mapping_says_where_forces_act(clean):
    columns = {"time_s": {"is": "time", "unit": "s"}, "speed_kmh": {"is": "speed", "unit": "km/h"}}
    for i in range(1, 13):
        columns[f"axle{i}_speed_kmh"] = {"is": f"axle{i}_speed", "unit": "km/h"}
        columns[f"axle{i}_force_kn"] = {"is": f"axle{i}_force", "unit": "kN"}
    told = {"columns": columns, "forces": {"at": "contact"}}
    log, found = clean.found(at_contact(clean), Mapping.model_validate(told))
    assert found.total_damage == pytest.approx(clean.damage, rel=0.02)
    assert not [remark for remark in log.remarks if remark.kind == "guess"]


def test_a_gear_ratio_lies_between_motor_and_wheelset(clean):
    gear, table = 5.83, {"t": clean.table["time_s"], "v": clean.table["speed_kmh"]}
    columns = {"t": {"is": "time", "unit": "s"}, "v": {"is": "speed", "unit": "km/h"}}
    for i, radius in enumerate(clean.train.radius, 1):
        turning = clean.table[f"axle{i}_speed_kmh"] / 3.6 / radius
        table[f"n{i}"] = turning * gear * 30.0 / np.pi
        table[f"M{i}"] = 1e3 * clean.table[f"axle{i}_force_kn"] * radius / gear
        columns[f"n{i}"] = {"is": f"axle{i}_speed", "unit": "rpm", "gear_ratio": gear}
        columns[f"M{i}"] = {"is": f"axle{i}_torque", "unit": "N m", "gear_ratio": gear}
    _, found = clean.found(pd.DataFrame(table), Mapping.model_validate({"columns": columns}))
    assert found.total_damage == pytest.approx(clean.damage, rel=1e-3)


@pytest.mark.parametrize("factor", [1.609344, 1.0 / 1.609344, 1.3])
def test_a_unit_that_all_speeds_share_shows_in_the_balance(clean, factor):
    speeds = spoil.speeds_of(clean.table)
    log, _ = clean.found(clean.table.assign(**{n: clean.table[n] * factor for n in speeds}))
    (balance,) = (remark for remark in log.remarks if remark.kind == "balance")
    assert f"{factor:.2g} ±" in balance.text or f"{factor:.2g} times" in balance.text


def test_a_sensor_that_dies_is_no_locked_wheel(clean):
    speed = clean.table["axle5_speed_kmh"].where(clean.table["time_s"] < 9.0, 0.0)
    log, found = clean.found(clean.table.assign(axle5_speed_kmh=speed))
    assert any("dead sensor" in remark.text for remark in log.remarks)
    assert found.total_damage < clean.damage  # what the axle did after is not known
    assert not [event for event in found.events if event.axle == 4 and event.slip_ratio > 0.99]


def test_a_braked_wheel_that_runs_ahead_has_another_radius(clean):
    speed = clean.table["axle5_speed_kmh"] * 1.04
    log, _ = clean.found(clean.table.assign(axle5_speed_kmh=speed))
    (radius,) = (remark for remark in log.remarks if remark.kind == "radius")
    assert (radius.column, "although it is braked" in radius.text) == ("axle5_speed_kmh", True)


def test_a_wheel_that_stands_but_for_rounding_is_locked(clean):
    table, stand = clean.table.copy(), slice(600, 700)
    before = np.linspace(table["axle1_speed_kmh"][570], 0.0, 30)
    table.loc[570:599, "axle1_speed_kmh"] = before
    table.loc[600:699, "axle1_speed_kmh"] = np.random.default_rng(3).uniform(0.0, 1e-12, 100)
    table.loc[560:699, "axle1_force_kn"] = -10.0
    log, _ = clean.found(table)
    assert any("a locked wheel" in remark.text for remark in log.remarks)
    assert np.isfinite(log.run.rim_speed[stand, 0]).all()


@pytest.mark.parametrize(("turned", "gain"), [(True, -1.6), (False, 0.6)])
def test_forces_whose_signs_differ_show_on_a_hill_too(turned, gain):
    """Uphill, a braked train slows down by more than its brakes; pulled too little, it slows down too."""
    time, train = np.arange(0.0, 20.0, 0.01), MeasuredTrain.of(TRAIN)
    axles = train.radius.size
    force = np.full((time.size, axles), 0.06 * train.car_mass.sum() * 9.81 / axles)
    rate = gain * force.sum(axis=1) / train.car_mass.sum()
    speed = 25.0 + np.cumsum(rate) * 0.01
    if turned:  # recorded as positive, and the wheels creep as braked ones do
        rim = np.repeat(0.99 * speed[:, None], axles, axis=1)
    else:
        speed, rim = 45.0 - speed, np.repeat(1.01 * (45.0 - speed[:, None]), axles, axis=1)
    instants = Instants(time, np.zeros(time.size, dtype=np.int64))
    found, remarks = forwards_too(instants, speed, rim, force, train, False)
    assert [r.kind for r in remarks] == ["sign"] * turned
    np.testing.assert_array_equal(found, -force if turned else force)
