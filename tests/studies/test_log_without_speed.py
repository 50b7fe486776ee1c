"""A log without the speed over ground gives nearly what it gives with that: simulated runs, exported and read back.

The bounds are what was measured, rounded up.
"""

import json
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.simulation import simulate
from studies.ladder.events import scenario
from studies.logs.export import log_table, rounded, write_log
from studies.logs.measured_log import check_log
from studies.logs.measured_run import MeasuredTrain, analyse_run
from tests.simulation.slides import CLEANED_RAIL, TRAIN, braked, driven, readhering

NOISE = 0.04


class Case(NamedTuple):
    run: xr.Dataset
    train: Train

    def log(
        self, every: int = 1, noise_kmh: float = NOISE, without: tuple[str, ...] = ("speed_kmh",)
    ):
        """The checked log with a CSV file's decimals, every so many records, without some columns."""
        table = rounded(log_table(self.run, self.train, every))
        rng = np.random.default_rng(0)
        for name in table:
            if "speed" in name and noise_kmh > 0.0:
                table[name] += rng.normal(0.0, noise_kmh, len(table))
        return check_log(table.drop(columns=list(without)), MeasuredTrain.of(self.train), "log")

    def unsensed(self) -> tuple[str, ...]:
        """Columns of the train's speed, and of the speeds of axles that have no sensor."""
        sensed = [car.speed_sensors for car in self.train.cars for _ in car.axle_positions]
        return "speed_kmh", *(f"axle{i}_speed_kmh" for i, one in enumerate(sensed, 1) if not one)


@pytest.fixture(scope="module")
def cases() -> dict[str, Case]:
    """Wheels that run away between others that roll, a slide of all wheels, a locomotive before wagons without sensors."""
    event = scenario(50, 2).event(0)
    locomotive = simulate(event, "alone", "perturb-observe")
    return {
        "driven": Case(driven(), find_set("commuter-8car")),
        "braked": Case(braked(readhering, rail=CLEANED_RAIL), TRAIN),
        "locomotive": Case(locomotive, event.model.train),
    }


# case, every so many records of 10 ms; bounds: bias and largest error of the speed [m/s], its largest stated deviation
SPEEDS = [
    ("driven", 1, 0.002, 0.005, 0.005),
    ("driven", 5, 0.002, 0.010, 0.015),
    ("driven", 10, 0.002, 0.030, 0.020),
    ("braked", 1, 0.060, 0.100, 0.300),
    ("braked", 5, 0.070, 0.120, 0.300),
    ("braked", 10, 0.080, 0.150, 0.300),
    ("locomotive", 1, 0.020, 0.040, 0.080),
    ("locomotive", 5, 0.040, 0.080, 0.120),
]


@pytest.mark.parametrize(("name", "every", "bias", "largest", "stated"), SPEEDS)
def test_the_speed_is_right_within_the_stated_error(cases, name, every, bias, largest, stated):
    case = cases[name]
    run = case.log(every, without=case.unsensed()).run
    error = run.speed - case.run["speed"].values[::every]
    assert abs(error.mean()) < bias
    assert np.abs(error).max() < largest
    assert (np.abs(error) < 3.0 * run.speed_deviation + 0.002).mean() > 0.98
    assert run.speed_deviation.max() < stated


# bounds: coefficient at onset (largest, against the rail), Q (relative), slips found (relative)
FINDINGS = [
    ("driven", 0.008, 0.005, 0.0),
    ("braked", 0.005, 0.17, 0.2),
    ("locomotive", 0.01, 0.2, 1.0),
]


@pytest.mark.parametrize(("name", "onset", "damage", "found"), FINDINGS)
def test_onsets_and_damage_are_nearly_those_of_the_true_speed(cases, name, onset, damage, found):
    case = cases[name]
    unsensed = case.unsensed()
    measured, estimated = (
        analyse_run(log.run, log.train)
        for log in (case.log(without=unsensed[1:]), case.log(without=unsensed))
    )
    assert estimated.total_damage == pytest.approx(measured.total_damage, rel=damage)
    assert abs(len(estimated.events) - len(measured.events)) <= found * max(len(measured.events), 1)
    limit, time = case.run["adhesion_limit"].values, case.run["time"].values
    for event in estimated.events:
        truth = limit[np.argmin(np.abs(time - event.onset_time)), event.axle]
        assert event.onset_coefficient == pytest.approx(truth, abs=onset)


def test_the_speed_of_a_log_with_its_column_is_left_alone(cases):
    log = cases["driven"].log(without=())
    assert log.run.speed_source == "measured"


def test_stretches_in_which_no_axle_tells_the_speed_are_remarked_on(cases):
    remarks = [remark for remark in cases["braked"].log().remarks if remark.kind == "estimate"]
    assert remarks
    assert all("standard deviation up to" in remark.text for remark in remarks)
    assert not [remark for remark in cases["driven"].log().remarks if remark.kind == "estimate"]


@pytest.fixture
def short(tmp_path, cases):
    """A log without the train's speed, and the train beside it."""
    path = tmp_path / "log.csv"
    case = cases["driven"]
    write_log(case.run, case.train, path)
    pd.read_csv(path).drop(columns="speed_kmh").to_csv(path, index=False)
    return path


def test_source_and_error_of_the_speed_are_reported(call, short, tmp_path):
    train = tmp_path / "log.train.toml"
    code, out, _ = call("analyse", short, "--train", train, "--figure", tmp_path / "log.png")
    assert code == 0
    assert "speed source: estimated, stated error 0.00" in out
    assert (tmp_path / "log.png").read_bytes().startswith(b"\x89PNG")
    content = json.loads(call("analyse", short, "--train", train, "--json")[1])
    assert content["speed_source"] == "estimated"
    assert 0.0 < content["speed_error_ms"]["mean"] < content["speed_error_ms"]["largest"] < 0.01


def test_a_log_without_forces_ends_with_one_line(call, short, tmp_path):
    table = pd.read_csv(short)
    table.drop(columns=[name for name in table if "force" in name]).to_csv(short, index=False)
    code, out, err = call("analyse", short, "--train", tmp_path / "log.train.toml")
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert "'speed_kmh or speed_ms': is missing and cannot be estimated: axle 1 has no force" in err
