"""A scenario file says an event, to the last bit; what it cannot mean is told in one line that names the key."""

import multiprocessing
import os
import pickle
import tomllib
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from itertools import pairwise

import jsonschema
import numpy as np
import pytest

from alloc.plant.curves import CURVES
from alloc.plant.trains import TRAINS, find_train
from studies import StudyError
from studies.files.scenario import find_remarks, make_scenario
from studies.files.scenario_files import (
    SHIPPED,
    default_scenarios,
    json_schema,
    load_scenario,
    new_scenario,
    shipped_names,
)

HASHES = {
    "failed-unit": ("40615631", "99fa88b4"), "failed-units": ("1ba6d115", "6956e165"),
    "falling-adhesion": ("db782085", "f90067ce"), "freight-start": ("67eae665", "72089f50"),
    "gradient-start": ("72ace410", "dc829695"), "jp4209318-stop": ("b7b8b1b1", "750bc88b"),
    "long-train": ("2acb9de4", "b9086ee4"),
    "lost-sensors": ("5c0123d4", "f7d36a9f"), "lost-telegrams": ("e5a305fa", "5a6ff49d"),
    "noisy-sensors": ("76af0bda", "5f2a95c8"), "rtri-all": ("4130cd12", "97c61ae9"),
    "rtri-emergency": ("8427c01b", "810ffd92"), "rtri-locomotive": ("70fdd71c", "4a47aff1"),
    "scattered-rail": ("f8057865", "29dcd3e2"),
    "uneven-load": ("9a762e79", "8c9bc605"), "very-low-adhesion": ("4fea81eb", "99886298"),
    "wet-front": ("d5d679bc", "3104a488"), "wet-patch": ("90550169", "b021c287"),
    "wet-start": ("9b93f9d6", "72c20ca3"), "wet-stop": ("3bff4673", "a7429124"),
    "wrong-increments": ("2d35c1b6", "359fdcc9"),
}  # fmt: skip
"""Shipped scenario -> the events of seeds 0 and 3. They change where the model's own records do, or by a mistake."""
PATCH = SHIPPED / "wet-patch.toml"
KEYS = tomllib.loads(PATCH.read_text())
ABSENT = object()


def with_key(path, value, data=KEYS):
    """The keys of a file with another value at a path such as "rail.patches.0.factor"; tables on the way are made."""
    keys = inner = deepcopy(data)
    *tables, key = path.split(".")
    for part, below in pairwise((*tables, key)):
        if isinstance(inner, list):
            inner = inner[int(part)]
        else:
            inner = inner.setdefault(part, [{}] if below == "0" else {})
    inner[key] = value
    if value is ABSENT:
        del inner[key]
    return keys


def test_events_are_the_same_to_the_last_bit():
    hashes = {
        name: tuple(load_scenario(name).event(seed).hash[:8] for seed in (0, 3))
        for name in shipped_names()
    }
    assert hashes == HASHES


def test_the_default_comparison_leaves_out_faults_of_single_functions_and_stops_by_air_alone():
    left_out = set(shipped_names()) - {scenario.name for scenario in default_scenarios()}
    by_air = {"jp4209318-stop", "rtri-all", "rtri-emergency", "rtri-locomotive"}
    assert left_out == {"lost-sensors", "lost-telegrams", "noisy-sensors"} | by_air


TWO = [{"time_s": 1.0, "acceleration_kmhs": 3.0}, {"time_s": 0.5, "acceleration_kmhs": 1.0}]
BAD = [
    ("duration", 3.0, "unknown key 'duration'; did you mean 'duration_s'?"),
    ("rail.levl", 0.1, "unknown key 'rail.levl'; did you mean 'level'?"),
    ("rail.patches.0.factr", 1.0, "unknown key 'rail.patches[1].factr'; did you mean 'factor'?"),
    ("onboard.sensors.speed_noise", 1.0, "did you mean 'speed_noise_kmh'?"),
    ("train", "comuter-8car", "train: unknown train 'comuter-8car'; did you mean 'commuter-8car'?"),
    ("train", "none.toml", "file 'none.toml': there is no such file"),
    ("train", ["commuter-8car"], "key 'train': must be a valid string"),
    ("title", ABSENT, "key 'title' is missing: One line that says what happens."),
    ("title", "a\x1b[31m", "key 'title' = 'a\\x1b[31m': must be: One line"),
    ("name", "a b", "key 'name' = 'a b': must be: Name in tables and of files"),
    ("name", "a\n", "key 'name' = 'a\\n': must be"),
    ("case", "C", "key 'case' = 'C': must be 'none', 'A' or 'B'"),
    ("reversed", 1, "key 'reversed' = 1: must be true or false"),
    ("duration_s", "22.0", "key 'duration_s' = '22.0': must be a valid number"),
    ("duration_s", True, "key 'duration_s' = True: must be a valid number"),
    ("duration_s", float("nan"), "key 'duration_s' = nan: must be a finite number"),
    ("duration_s", float("inf"), "key 'duration_s' = inf: must be a finite number"),
    ("duration_s", 10**400, "key 'duration_s' = 1000"),
    ("duration_s", 0.001, "duration_s = 0.001 must not be below the control period"),
    ("duration_s", 36000.0, "duration_s = 36000.0 is too long"),
    ("record_period_s", 1e3, "record_period_s = 1000.0 must not exceed duration_s = 22.0"),
    ("initial_speed_kmh", 1e6, "key 'initial_speed_kmh' = 1000000.0: must be"),
    ("command", [], "key 'command': must have at least 1 item"),
    ("command", {"time_s": 0.0}, "key 'command': must be a list; of tables, [[command]] each"),
    ("command", TWO, "command: times = (1.0, 0.5) must grow"),
    ("load_t", [1.0], "load_t: train 'commuter-8car': 1 loads for 8 cars; give one per car"),
    ("load_t", [-2.0] * 8, "key 'load_t[1]' = -2.0: must be greater than or equal to 0"),
    ("failures", [{"unit": 9}], "failures: the train has no traction unit 9; it has 4"),
    ("variation.level", [1.2], "key 'variation.level[2]' is missing"),
    ("rail", 3, "key 'rail' = 3: must be a table"),
    ("rail.level", 14.0, "key 'rail.level' = 14.0: must be less than or equal to 1"),
    ("rail.level", ABSENT, "key 'rail': speed_law = 'none' needs level"),
    ("rail.speed_law", "shinkansen", "key 'rail': speed_law = 'shinkansen' needs law_factor"),
    ("rail.increments", ABSENT, "key 'rail.increments' is missing: Growth of the coefficient"),
    ("rail.increments.law", "given", "key 'rail.increments': values go with law"),
    ("rail.patches.0.factor", 20.0, "give a coefficient of 4.4; at most 1 is possible"),
    ("rail.patches.0.end_m", 1.0,
     "rail.patches[1]: start_m = 5.0 must lie before end_m = 1.0"),
    ("rail.curve.kind", "polch", "key 'rail.curve': unknown adhesion curve 'polch'; did you mean 'polach'?"),
    ("rail.curve.decay", 0.2, "decay is no parameter of the piecewise curve"),
    ("rail.curve.residual_ratio", 2.0, "rail.curve: residual_ratio = 2.0 must be a finite number, 0 or greater, 0.999 at"),
    ("rail.curve.residual_ratio", "x", "rail.curve: residual_ratio = 'x' must be a finite number"),
    ("belief.increments", {"law": "given", "values": [0.1]}, "belief.increments.values: give one per axle, 32"),
    ("line.sections", [{"start_m": 0.0, "grade_permille": 1e6}], "key 'line.sections[1].grade_permille' = 1000000.0"),
    ("receptivity.period_s", 0.0, "key 'receptivity.period_s' = 0.0: must be greater than 0"),
    ("onboard.telegrams.period_s", 1e-3, "onboard: period_s = 0.01 must not exceed telegrams.period_s = 0.001"),
    ("onboard.detector.on_kmhs", 0.5,
     "onboard.detector: off_kmhs = 2.7 must be below on_kmhs = 0.5"),
    ("onboard.braking.car_shares", [1.0], "car_shares: 1 values for 8 cars"),
    ("onboard.sensors.dropouts", [{"axle": 99, "begin_s": 0.0}], "axle = 99 of a dropout, but the last axle is 31"),
]  # fmt: skip


@pytest.mark.parametrize(("path", "value", "message"), BAD)
def test_what_cannot_be_is_one_line_that_names_the_key(path, value, message):
    with pytest.raises(StudyError) as error:
        make_scenario({"name": "own"} | with_key(path, value), "own.toml").event()
    assert message in str(error.value)
    assert str(error.value).startswith(("own.toml: ", "scenario 'own': "))
    assert str(error.value).isprintable()


TEXT = PATCH.read_text()
FILES = {
    "there is no such file": None,
    "key 'title' is missing": b"",
    "can't decode byte": TEXT.encode("utf-16"),
    "not TOML": b"title = ",
    "Cannot declare": TEXT.encode() + b"[rail]\n",
    "maximum recursion depth": b"x = " + b"[" * 20_000,
    "tables are nested": b"x = " + b"[" * 300 + b"]" * 300 + b"\n" + TEXT.encode(),
    "rail.patches[1]: start_m = 5.0 must lie": TEXT.replace("85.0", "1.0").encode(),
}


@pytest.mark.parametrize("message", FILES)
def test_a_file_that_is_no_scenario_is_told_by_its_path(tmp_path, message):
    path = tmp_path / "own.toml"
    if FILES[message] is not None:
        path.write_bytes(FILES[message])
    with pytest.raises(StudyError) as error:
        load_scenario(path)
    assert message in str(error.value)
    assert str(error.value).startswith(f"file {str(path)!r}: ")
    assert str(error.value).isprintable()


def test_what_never_ends_is_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    for path in (tmp_path, tmp_path / "pipe.toml", tmp_path / "zero.toml"):
        with pytest.raises(StudyError, match="no regular file"):
            load_scenario(path)


NO_PART = {"title", "description", "case", "in_default_comparison"}
"""They say what an event is for."""
BESIDE = {
    "rail.law_factor": {"rail.level": ABSENT, "rail.speed_law": "shinkansen"},
    "rail.speed_law": {"rail.level": ABSENT, "rail.law_factor": 1.0},
    "rail.increments.values": {"rail.increments.law": "given"},
    "rail.curve.c": {"rail.curve.d": 0.3},
    "rail.curve.d": {"rail.curve.c": 0.3},
    "belief.increments.slope": {"belief.increments.law": "logarithmic"},
    "belief.increments.offset": {"belief.increments.law": "logarithmic"},
    "belief.increments.values": {"belief.increments.law": "given"},
    "failures.0.time_s": {"failures.0.unit": 1},
    "line.sections.0.start_m": {"line.sections.0.grade_permille": 5.0},
    "line.sections.0.grade_permille": {"line.sections.0.start_m": 5.0},
    "onboard.sensors.dropouts.0.axle": {"onboard.sensors.dropouts.0.begin_s": 1.0},
    "onboard.sensors.dropouts.0.begin_s": {"onboard.sensors.dropouts.0.axle": 1},
    "onboard.sensors.dropouts.0.until_s": {
        "onboard.sensors.dropouts": [{"axle": 1, "begin_s": 0.1}]
    },
}
"""What a key needs beside it."""
GIVEN = {
    "load_t": [1.0] * 8,
    "rail.speed_law": "curtius-kniffler",
    "rail.rear_speed_law": [0.0, 1.0, 0.9],
    "rail.increments.values": [0.01] * 32,
    "belief.increments.values": [0.01] * 32,
    "variation.level": [0.5, 0.6],
    "onboard.braking.car_shares": [0.9] * 8,
    "onboard.braking.slide_protection.fuzzy.slip": [0.0, 0.1, 0.2],
    "onboard.braking.slide_protection.fuzzy.rate_kmhs": [-2.0, 0.0, 2.0],
}


def leaves(schema, whole, path=""):
    """Path and schema of every key that holds no table; of a row of tables those of the first."""
    schema = whole["$defs"][schema["$ref"].rpartition("/")[2]] if "$ref" in schema else schema
    if "$ref" in schema:
        yield from leaves(schema, whole, path)
    elif "$ref" in schema.get("items", {}):
        yield from leaves(schema["items"], whole, f"{path}.0")
    elif "properties" in schema:
        for key, inner in schema["properties"].items():
            yield from leaves(inner, whole, f"{path}.{key}".strip("."))
    else:
        yield path, schema


def hash_of(keys):
    try:
        return make_scenario({"name": "own"} | keys, "own.toml").event(seed=1).hash
    except StudyError:
        return None


def trial_values(schema):
    """Values for a key by its schema."""
    choices = [*schema.get("anyOf", ()), schema]
    yield from (value for choice in choices for value in choice.get("enum", ()))
    if schema.get("type") == "boolean":
        yield from (True, False)
    sizes = (0.3, 2.0, 0.02, 0.9, 20.0) if schema.get("type") == "number" else (1, 2, 7)
    yield from (size for size in sizes if schema.get("type") in ("number", "integer"))
    yield "other"


def acts(path, schema):
    """Whether some value of a key gives another event."""
    bases = [KEYS]
    for beside, value in BESIDE.get(path, {}).items():
        bases = [with_key(beside, value, bases[0])]
    table, _, key = path.rpartition(".")
    if table.endswith("curve") and key != "kind":
        bases = [with_key(f"{table}.kind", kind, bases[0]) for kind in CURVES]
    values = [GIVEN[path]] if path in GIVEN else list(trial_values(schema))
    for base in bases:
        usual = hash_of(base)
        if any(hash_of(with_key(path, value, base)) not in (usual, None) for value in values):
            return True
    return False


def test_every_key_acts_on_the_event():
    whole = json_schema()
    idle = {path for path, schema in leaves(whole, whole) if not acts(path, schema)}
    assert idle == NO_PART


def test_the_schema_knows_every_file_and_names_a_misspelt_key():
    check = jsonschema.Draft202012Validator(json_schema())
    check.check_schema(check.schema)
    for path in SHIPPED.glob("*.toml"):
        check.validate(tomllib.loads(path.read_text()))
    for path in (
        "durations_s",
        "rail.levl",
        "rail.curve.decy",
        "onboard.sensors.noise",
    ):
        (fault,) = check.iter_errors(with_key(path, 1.0))
        assert path.rpartition(".")[2] in fault.message
    entry = check.schema["$defs"]["DetectorKeys"]["properties"]["on_kmhs"]
    assert entry["default"] == 5.4  # 1.5 m/s2
    assert entry["description"] == "The slip signal is on above this acceleration. Unit: km/h/s."


def test_a_scenario_is_known_by_its_text_in_this_process_and_in_others():
    scenario, again = (
        make_scenario({"name": "own"} | with_key("onboard.telegrams.loss", 0.1), "own.toml")
        for _ in range(2)
    )
    assert scenario == again
    assert len({scenario, again, scenario.changed(duration_s=5.0)}) == 2
    assert scenario.changed(duration_s=5.0).duration_s == 5.0
    assert scenario.changed(rail=scenario.rail).text == scenario.text
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        assert pool.submit(getattr, scenario, "text").result() == scenario.text
    with pytest.raises(ValueError, match="frozen"):
        scenario.duration_s = 5.0
    with pytest.raises(StudyError, match=r"scenario 'own': key 'duration_s' = 0\.0"):
        scenario.changed(duration_s=0.0)
    with pytest.raises(StudyError, match="seed = -1"):
        scenario.event(-1)


def test_a_file_is_read_each_time_and_its_name_is_that_of_the_scenario(tmp_path):
    path = tmp_path / "my event.toml"
    path.write_text(TEXT)
    assert load_scenario(path).name == "my-event"
    before = load_scenario(str(path)).event(3)
    path.write_text(TEXT.replace("level = 0.22", "level = 0.21"))
    assert load_scenario(path).event(3).rail.level < before.rail.level
    assert load_scenario("wet-patch") is load_scenario("wet-patch")
    with pytest.raises(StudyError, match="did you mean 'wet-start'"):
        load_scenario("wet-strat")


def test_a_seed_draws_the_day_and_nothing_else():
    scenario = load_scenario("scattered-rail")
    still, day, again = (scenario.event(seed) for seed in (0, 4, 4))
    assert day.hash == again.hash != still.hash
    assert still.rail.level == 0.145
    assert 0.97 <= day.rail.level / 0.145 <= 1.03
    assert abs(day.initial_position) <= 2.0
    assert 0.0 <= day.command.times[0] <= 0.1
    assert len({day.rail.seed, day.onboard.sensors.seed, still.rail.seed}) == 3


def test_a_new_scenario_runs_as_it_stands_and_is_not_overwritten(tmp_path):
    path = new_scenario("mine", "wet-stop", tmp_path / "new")
    assert path.read_text().startswith("#:schema ./scenario.schema.json\n")
    assert load_scenario(path).changed(name="wet-stop") == load_scenario("wet-stop")
    assert (path.parent / "scenario.schema.json").is_file()
    with pytest.raises(StudyError, match="exists; choose another name"):
        new_scenario("mine", "wet-start", tmp_path / "new")
    with pytest.raises(StudyError, match="give letters"):
        new_scenario("a/b", "wet-start", tmp_path)


@pytest.mark.parametrize(("path", "value", "message"), [
    ("command.0.time_s", 30.0, "command: none asks for an acceleration before the end, duration_s = 22"),
    ("command.0.acceleration_kmhs", 10.8, "command[1].acceleration_kmhs = 10.8 is beyond the motors"),
    ("command.0.acceleration_kmhs", -39.0, "command[1].acceleration_kmhs = -39 needs a coefficient of 1.1"),
    ("rail.patches.0.end_m", 1e4, None),
    ("rail.patches", [{"factor": 0.5, "start_m": 600.0}], "rail.patches[1]: no axle is ever between start_m = 600"),
    ("rail.patches", [{"factor": 0.5, "begin_s": 40.0}], "rail.patches[1]: the run is not between begin_s = 40"),
])  # fmt: skip
def test_what_is_hardly_meant_gets_a_remark(path, value, message):
    scenario = make_scenario({"name": "own"} | with_key(path, value), "own.toml")
    remarks = " ".join(find_remarks(scenario.event(0)))
    assert message in remarks if message else not remarks


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_events_need_no_remark(name):
    assert not list(find_remarks(load_scenario(name).event(3)))


def test_a_curve_that_is_none_is_one_line():
    CURVES.register("five", 5)
    with pytest.raises(StudyError, match=r"rail.curve: adhesion curve 'five': it is a int"):
        make_scenario({"name": "own"} | with_key("rail.curve.kind", "five"), "own.toml").event()


def test_a_train_that_a_plug_in_brings_counts_with_its_file():
    TRAINS.register("own-train", lambda: find_train("commuter-8car"))
    assert __name__ in load_scenario("wet-patch").changed(train="own-train").sources
    assert load_scenario("wet-patch").changed(duration_s=np.float64(3.0)).duration_s == 3.0
