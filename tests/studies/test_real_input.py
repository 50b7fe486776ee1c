"""A real line and a real train, where the data folder is at hand."""

import json
from pathlib import Path

import numpy as np
import pytest

from alloc.simulation import simulate
from studies.command_line.main import run
from studies.lines.real_input import with_real_input
from studies.scenario.loading import load_scenario

DATA = Path(__file__).parents[3] / "shared" / "data" / "railtoolkit"
LINE, TRAIN = DATA / "path_realworld.yaml", DATA / "train_local.yaml"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the railtoolkit example files are absent"
)


@pytest.fixture(scope="module")
def scenario():
    return with_real_input(load_scenario("gradient-start"), str(LINE), str(TRAIN))


def test_the_train_is_the_one_of_the_file(scenario):
    # two of the railcar's three bogies are driven, with 45.333 t of its 68 t
    event = scenario.event()
    train = event.model.train
    assert train.mass == pytest.approx(68.0e3)
    assert train.rotating_mass == pytest.approx(0.08 * 68.0e3)
    assert sum(map(sum, (car.driven for car in train.cars))) == 4
    assert event.model.layout.units == 2


def test_it_starts_on_the_20_per_mille_section(scenario):
    event = scenario.event()
    assert event.initial_position == 868.0
    line = event.model.line
    assert line.grades[line.stations.index(868.0)] == pytest.approx(0.020)


def test_its_wheels_slip_on_the_wet_climb_and_it_gets_away(scenario):
    run = simulate(scenario.event(), "greedy", "cut-and-ramp")
    assert run.attrs["detections"] > 0
    assert run["speed"].values[-1] > run.attrs["target_speed"]
    assert np.diff(run["position"].values).min() > -1e-3


def test_the_command_compares_rules_on_it(capsys, tmp_path):
    code = run([
        "compare", "--line", str(LINE), "--train", str(TRAIN), "--rules", "alone", "greedy", "exact",
        "--jobs", "1", "--no-figures", "--json", "--out", str(tmp_path),
    ])  # fmt: skip
    content = json.loads(capsys.readouterr().out)
    assert code == 0
    assert [row["rule"] for row in content["rows"]] == ["alone"] * 3 + ["greedy"] * 3 + [
        "exact"
    ] * 3
    assert len({row["controller"] for row in content["rows"]}) == 3
    assert all(row["failed"] == 0 for row in content["rows"])
    (about,) = content["about"]["scenarios"].values()
    assert "868 m to 1082 m, 20 per mille" in about["title"]
