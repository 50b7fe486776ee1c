"""A train of one's own: what its file says is what runs, and a scenario is another one where the file is edited."""

import tomllib
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from alloc.plant import trains
from alloc.plant.trains import find_train
from alloc.run.simulation import simulate
from studies import StudyError
from studies.files.scenario_files import SHIPPED, json_schema, load_scenario
from studies.files.train_keys import read_train

TRAM = Path(__file__).with_name("tram.toml").read_text()
EVENT = (
    (SHIPPED / "very-low-adhesion.toml")
    .read_text()
    .replace('"commuter-8car"', '"trains/tram.toml"')
)


@pytest.fixture
def folder(tmp_path):
    """A scenario whose train lies in a folder beside it."""
    (tmp_path / "trains").mkdir()
    (tmp_path / "trains" / "tram.toml").write_text(TRAM)
    (tmp_path / "own.toml").write_text(EVENT)
    return tmp_path


def test_the_train_is_as_its_file_says():
    train = read_train(Path(__file__).with_name("tram.toml")).train
    assert (train.name, train.axle_count, train.mass) == ("tram", 6, 2 * 17e3 + 12e3)
    assert train.planned_acceleration == 4.0 / 3.6
    assert train.resistance == (900.0, 60.0, 4.0)
    motors = train.cars[0].motors
    assert (motors.inverter_group, motors.torque, motors.power) == ("1C2M", 750.0, 90e3)
    assert train.cars[1].motors is None


@pytest.mark.parametrize(
    "name", ["one-axle", "jp4209318-3car", "commuter-8car", "high-speed-16car", "freight-5"]
)
def test_shipped_sets_are_templates(name):
    assert read_train(Path(trains.__file__).with_name(f"{name}.toml")).train == find_train(name)


def test_the_schema_knows_a_train_and_names_a_misspelt_key():
    check = jsonschema.Draft202012Validator(json_schema("train"))
    keys = tomllib.loads(TRAM)
    check.validate(keys)
    keys["car"]["M"]["motors"]["gear_rato"] = 6.2
    (fault,) = check.iter_errors(keys)
    assert "gear_rato" in fault.message


def test_a_tram_slips_and_starts(folder):
    event = load_scenario(folder / "own.toml").changed(duration_s=6.0).event(1)
    run = simulate(event, "cooperative", "cut-and-ramp")
    assert run.attrs["train"] == "tram"
    assert (run["slipping"] > 0).any()
    assert 2.0 < run["speed"].values[-1] < 6.0 * 4.0 / 3.6
    assert np.isfinite(run["slip_velocity"].values).all()


def test_an_edited_train_makes_another_scenario_and_one_that_was_read_keeps_its_own(folder):
    before = load_scenario(folder / "own.toml")
    assert before.changed(train="commuter-8car").event().train == find_train("commuter-8car")
    (folder / "trains" / "tram.toml").write_text(TRAM.replace("mass_t = 14.0", "mass_t = 15.0"))
    after = load_scenario(folder / "own.toml")
    assert before.text != after.text
    assert [scenario.event().train.mass for scenario in (before, after)] == [46e3, 48e3]


@pytest.mark.parametrize(("old", "new", "message"), [
    ("mass_t = 14.0", "mas_t = 14.0", "unknown key 'car.M.mas_t'; did you mean 'mass_t'?"),
    ("mass_t = 14.0", "mass_t = 0.0", "key 'car.M.mass_t' = 0.0: must be greater than 0"),
    ("gear_ratio = 6.2, ", "", "key 'car.M.motors.gear_ratio' is missing: Turns of the motor"),
    ('"MTM"', '"MXM"', "key 'formation' = 'MXM': there is no [car.X]"),
    ('name = "tram"', 'name = "../tram"', "key 'name' = '../tram'"),
    ("[4.1, 5.9]", "[5.9, 4.1]", "car.M: axle_positions_m = [5.9, 4.1] must grow from the front"),
    ("[0, 0]", "[0]", "car.M: bogie_of_axle has 1 entries for 2 axles"),
    ("power_kw = 90.0", "effort_kn = [9.0]", "car.M: effort takes the place of torque, power"),
    ("torque_nm = 750.0, ", "", "car.M: give torque and power, or effort_speed and effort"),
    ("wheel_radius_m = 0.31", "wheel_radius_m = 310.0", "key 'car.M.wheel_radius_m' = 310.0"),
])  # fmt: skip
def test_what_cannot_be_names_both_files_and_the_key(folder, old, new, message):
    assert old in TRAM
    (folder / "trains" / "tram.toml").write_text(TRAM.replace(old, new))
    with pytest.raises(StudyError) as error:
        load_scenario(folder / "own.toml")
    assert f"own.toml': file '{folder / 'trains' / 'tram.toml'}': {message}" in str(error.value)
