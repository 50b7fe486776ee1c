"""Starts of long trains, on hills and behind slack couplers, and logs without the train's speed: Q is right all the same."""

import json
import re
from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from studies.log_accuracy import defects as spoil
from studies.logs.aligned_log import find_dead_zone, open_log
from studies.logs.measured_log import check_log
from studies.logs.measured_run import analyse_run
from studies.logs.own_samples import own_samples
from studies.logs.simulated import log_table, rounded, write_log
from tests.studies.logged_runs import Logged, at_contact, clean, logged, misread, said
from tests.studies.test_measured_log import TRAIN

LONG, HILL, FREIGHT = "long-train 17", "gradient-start 4", "freight-start 12"


def forces(late: float) -> Callable[[Logged], pd.DataFrame]:
    return lambda c: spoil.shifted(c.table, spoil.forces_of(c.table), late)


def counted(c: Logged) -> pd.DataFrame:
    return spoil.counted(c.table, c.train.radius, 0.02)


def short_names(c: Logged) -> pd.DataFrame:
    """Of wheels and forces, beside accelerations of cars with names that follow the rules."""
    short = ((r"axle(\d+)_speed_kmh", r"v\1"), (r"axle(\d+)_force_kn", r"F\1"))
    return c.table.rename(columns=lambda n: re.sub(*short[1], re.sub(*short[0], n)))


CHANGES: list[tuple[str, Callable[[Logged], pd.DataFrame], str, float]] = [
    (LONG, counted, "pulses", 0.02),
    (LONG, lambda c: spoil.speed_held(c.table, 0.4, 1.0), "s late: made up for", 0.02),
    (LONG, lambda c: spoil.rear_late(c.table, 0.2), "than the others: made up for", 0.06),
    (LONG, forces(-0.28), "", 0.02),
    (LONG, lambda c: spoil.zero_below(c.table, 1.5), "all wheels say 0 below", 0.03),
    (HILL, lambda c: spoil.speed_with_gaps(c.table, 0.6, 1.0), "s late: made up for", 0.02),
    (HILL, lambda c: spoil.speed_interpolated(c.table, 0.5, 1.0), "s late: made up for", 0.02),
    (HILL, lambda c: spoil.rounded_to(spoil.speed_held(c.table, 0.3, 0.2), ["speed_kmh"], 1.0), "delay", 0.02),
    (HILL, lambda c: spoil.noisy(c.table, 0.1, 3), "", 0.05),
    (HILL, at_contact, "those between wheel and rail", 0.02),
    (FREIGHT, short_names, "guess", 0.02),
    (FREIGHT, counted, "pulses", 0.02),
    (FREIGHT, lambda c: spoil.rear_late(c.table, 0.1), "axles 14 to 26 are recorded 0.", 0.06),
    ("hill 49", lambda c: spoil.speed_with_gaps(c.table, 1.07, 0.5), "s late: made up for", 0.02),
    ("hill 12", lambda c: c.table, "", 0.005),  # it rolls back
    ("hill 1", lambda c: spoil.counted(c.table, c.train.radius, 0.01), "pulses", 0.02),
    ("hill 1", lambda c: spoil.rounded_to(c.table, spoil.speeds_of(c.table), 0.1), "", 0.02),
    ("crawl 18", lambda c: spoil.zero_below(c.table, 1.8), "all wheels say 0 below", 0.02),
    (LONG, forces(0.18), "s later than the wheels", 0.02),
    (HILL, forces(0.18), "s later than the wheels", 0.02),
    (HILL, forces(-0.28), "", 0.02),
    (FREIGHT, forces(0.18), "s later than the wheels", 0.08),
    (FREIGHT, forces(-0.18), "", 0.08),
    ("freight-start 3", forces(0.2), "s later than the wheels", 0.02),
    ("uneven-load 5", at_contact, "those between wheel and rail", 0.02),
]  # fmt: skip
"""A run, what is done to its log, what is said, and the error of Q. Half of the axles that are late lack the end."""


def test_starts_and_hills():
    wrong = {}
    for k, (run, change, words, share) in enumerate(CHANGES):
        if found := misread(run, change(logged(run)), words, share, slips=None):
            wrong[k, run, words] = found
    assert not wrong, "\n" + "\n".join(f"{key}: {value}" for key, value in wrong.items())


def test_a_locomotive_slips_against_itself_and_not_against_its_train():
    """Without the cars' accelerations slack that runs out passes for slips of the locomotive."""
    one, (log, found) = logged(FREIGHT), clean(FREIGHT)
    assert said(log, found) == []
    assert found.total_damage == pytest.approx(one.damage, rel=0.02)
    assert found.events == []
    # what slack leaves open of Q is stated
    assert abs(found.total_damage - one.damage) < 2.0 * found.errors.by_speed
    assert found.errors.total < 0.05 * one.damage
    assert found.slip_velocity.shape == log.run.rim_speed.shape
    assert np.abs(found.over_car - log.run.speed[:, None]).max() > 0.05
    _, without = one.found(one.table.drop(columns="car1_acceleration_ms2"))
    assert without.over_car is None
    assert len(without.events) > 0


def test_what_happens_between_two_rows_is_in_the_error_of_damage():
    one, (_, every) = logged(LONG), clean(LONG)
    _, rare = one.found(one.table.iloc[::10].reset_index(drop=True))
    assert rare.errors.by_sampling > 10.0 * every.errors.by_sampling
    e = rare.errors
    parts = np.array(
        [e.by_speed, e.by_delay, e.by_sensors, e.by_sampling, e.by_forces, 2e-3 * rare.total_damage]
    )
    assert e.total == pytest.approx(np.sqrt(parts @ parts))
    assert abs(rare.total_damage - one.damage) < 2.0 * e.total


def test_wheels_that_say_0_at_low_speed_do_not_slide_but_those_that_locked_do():
    """Three wheels roll to 1 m/s, where their sensors say 0; the fourth locked at 8 m/s. Then all four lock."""
    time = 0.01 * np.arange(1200)
    speed = np.maximum(11.5 - time, 0.0)
    low = np.repeat(np.where(speed > 1.0, speed, 0.0)[:, None], 4, axis=1)
    low[350:, 3] = 0.0
    lock = np.repeat((speed + 0.5)[:, None], 4, axis=1)
    for axle, since in enumerate((100, 300, 500, 700)):
        lock[since : since + 100, axle] = 0.0
    for rim, unknown in ((low, (speed > 0.01) & (speed <= 1.0)), (lock, speed > 99.0)):
        wheels = {i: own_samples(time, rim[:, i], speed=True) for i in range(4)}
        log = open_log(own_samples(time, speed, speed=True), wheels, {}, TRAIN)
        find_dead_zone(log, speed)
        assert np.isnan(log.rim[unknown][:, :3]).all()
        assert np.isfinite(log.rim[:, 3]).all()
        assert np.isfinite(log.rim[speed > 1.0]).all()
        told = "all wheels say 0 below 1 m/s" in "".join(one.text for one in log.remarks)
        assert told == unknown.any()


# run, every so many records of 10 ms; bounds: bias and largest error of the speed [m/s] but at the first instant, its
# largest stated deviation; Q (relative), coefficient at onset (largest)
WITHOUT_SPEED = [
    ("driven", 1, 0.002, 0.005, 0.005, 0.005, 0.008),
    ("driven", 10, 0.002, 0.030, 0.020, 0.02, 0.008),
    ("braked", 1, 0.060, 0.100, 0.300, 0.17, 0.005),
    ("braked", 10, 0.080, 0.150, 0.300, 0.17, 0.008),
    ("locomotive", 1, 0.030, 0.060, 0.080, 0.35, 0.01),  # so uncertain that its Q is withheld
    ("locomotive", 5, 0.040, 0.080, 0.120, 0.2, 0.01),
]


def test_without_the_trains_speed_it_is_right_within_the_stated_error():
    """Where the speed has noise of 0.04 km/h, and axles without sensors have none; Q and onsets are those of the run."""
    wrong = {}
    for name, every, bias, largest, stated, damage, onset in WITHOUT_SPEED:
        one = logged(name)
        table = rounded(log_table(one.run, one.model, every))
        rng = np.random.default_rng(0)
        for column in spoil.speeds_of(table):
            table[column] += rng.normal(0.0, 0.04, len(table))
        sensed = [car.speed_sensors for car in one.model.cars for _ in car.axle_positions]
        unsensed = [f"axle{i}_speed_kmh" for i, own in enumerate(sensed, 1) if not own]
        log = check_log(table.drop(columns=["speed_kmh", *unsensed]), one.train, "log")
        found = analyse_run(log.run, log.train)
        error = (log.run.speed - one.run["speed"].values[::every])[1:]
        covered = np.abs(error) < 3.0 * log.run.speed_deviation[1:] + 0.002
        q = found.total_damage / one.damage - 1.0
        limit, time = one.run["adhesion_limit"].values, one.run["time"].values
        onsets = [
            abs(event.onset_coefficient - limit[np.argmin(np.abs(time - event.onset_time)), event.axle])
            for event in found.events if np.isfinite(event.onset_time)
        ]  # fmt: skip
        values = {
            "bias": (abs(error.mean()), bias), "largest": (np.abs(error).max(), largest),
            "beyond": (1.0 - covered.mean(), 0.02), "stated": (log.run.speed_deviation.max(), stated),
            "Q": (abs(q), damage), "onset": (max(onsets, default=0.0), onset),
        }  # fmt: skip
        assert log.run.speed_source == "estimated"
        if far := {key: value for key, value in values.items() if not value[0] < value[1]}:
            wrong[name, every] = far, found.errors.total / one.damage
    assert not wrong


def test_the_source_of_the_speed_is_reported_and_without_forces_there_is_none(call, tmp_path):
    one, path = logged("driven"), tmp_path / "log.csv"
    write_log(one.run, one.model, path)
    table, train = pd.read_csv(path).drop(columns="speed_kmh"), tmp_path / "log.train.toml"
    table.to_csv(path, index=False)
    code, out, _ = call("analyse", path, "--train", train, "--figure", tmp_path / "log.png")
    assert code == 0
    assert "speed source: estimated, stated error 0.00" in out
    assert (tmp_path / "log.png").read_bytes().startswith(b"\x89PNG")
    content = json.loads(call("analyse", path, "--train", train, "--json")[1])
    assert content["speed_source"] == "estimated"
    assert 0.0 < content["speed_error_ms"]["mean"] < content["speed_error_ms"]["largest"] < 0.01
    table.drop(columns=spoil.forces_of(table)).to_csv(path, index=False)
    code, out, err = call("analyse", path, "--train", train)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert "neither the train's speed nor a force of an axle is there" in err


def test_without_forces_the_wheels_tell_the_speed_between():
    one = logged("driven")
    table = spoil.speed_held(one.table)
    log, found = one.found(table[[name for name in table if "force" not in name]])
    assert log.run.speed_source == "followed"
    assert len(found.events) == len(clean("driven")[1].events)
