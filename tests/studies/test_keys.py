"""Every key of a file has unit, default, meaning and source; schema, page and new files say what the reader does."""

import tomllib
from dataclasses import asdict
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from alloc.onboard.parameters import Onboard
from alloc.plant.rail import Line, Rail, Receptivity
from alloc.plant.train import DraftGear
from alloc.simulation import inputs_hash
from alloc.units import unit_of
from mpc.settings import MpcSettings
from studies.files.json_schema import tables_of
from studies.files.strict import parse
from studies.files.study_error import StudyError
from studies.scenario.file_kinds import FILE_KINDS, places_of, reference_page, schema_of_kind
from studies.scenario.onboard_keys import OnboardKeys, built
from studies.scenario.rail_keys import LineKeys, RailKeys, ReceptivityKeys
from studies.scenario.scenario import load_scenario, shipped_scenarios
from studies.scenario.train_file import DraftGearKeys

ROOT = Path(__file__).parents[2]
FILES = [
    *(("scenario", path) for path in sorted((ROOT / "studies/scenario/shipped").glob("*.toml"))),
    *(("train", path) for path in sorted((ROOT / "studies/lines/shipped_trains").glob("*.toml"))),
    *(("line", path) for path in sorted((ROOT / "studies/lines/shipped_lines").glob("*.toml"))),
    *(("train", path) for path in sorted((ROOT / "alloc/plant/sets").glob("*.toml"))),
    ("train", ROOT / "docs/plugins/tram.toml"),
]
NEEDED = {
    "factor": 0.5, "unit": 1, "axle": 0, "start_m": 0.0, "end_m": 100.0, "radius_m": 300.0, "grade_permille": 5.0,
    "stiffness_n_per_m": 2e7, "begin_s": 0.0, "time_s": 0.0, "acceleration_kmhs": 3.0, "law": "none", "title": "t",
    "train": "one-axle", "duration_s": 1.0, "level": 0.1,
}  # fmt: skip
"""A value of each key of a scenario that is required."""


@pytest.fixture(scope="module")
def schemas():
    return {kind: schema_of_kind(kind) for kind in FILE_KINDS}


@pytest.fixture(scope="module")
def tables(schemas):
    """(kind of file, name of table, key) of every key."""
    names = {
        kind: dict.fromkeys(name for _, name in places_of(one)) for kind, one in schemas.items()
    }
    return [
        (kind, name, key)
        for kind, schema in schemas.items()
        for name in names[kind]
        for table in tables_of(schema, name)
        for key in table.keys
    ]


def test_every_key_has_unit_default_meaning_and_source(tables):
    assert len(tables) > 300
    for kind, table, key in tables:
        place = f"{kind}: {table}.{key.name}"
        assert key.meaning.endswith("."), place
        assert key.source, place
        assert key.required or key.default or key.left_out or key.table, place
        assert not (key.required and key.default), place
        text = str({word: one for word, one in key.said.items() if not word.startswith("x-")})
        if "'number'" in text or "'integer'" in text:
            assert key.unit, place
        ending = unit_of(key.name)
        assert key.unit == ending.symbol or not ending.ending, place


def defaults(schema, name):
    """Every default of a table and of the tables in it that stand once, as a file would say them."""
    found = {}
    for key in tables_of(schema, name)[0].keys:
        if "default" in key.said:
            found[key.name] = key.said["default"]
        elif key.table and not key.several:
            found[key.name] = defaults(schema, key.table)
    return found


def flat(values, place=""):
    """Numbers and words of nested records, by place."""
    if isinstance(values, dict):
        parts = [flat(value, f"{place}.{key}") for key, value in values.items()]
    elif isinstance(values, list | tuple):
        parts = [flat(value, f"{place}.{k}") for k, value in enumerate(values)]
    else:
        return {place: values}
    return {key: value for part in parts for key, value in part.items()}


def same(record, other):
    one, two = (
        {place: x for place, x in flat(asdict(r)).items() if x is not None} for r in (record, other)
    )
    numbers = {place for place, x in two.items() if isinstance(x, float)}
    assert one.keys() == two.keys()
    assert all(one[place] == two[place] for place in two.keys() - numbers)
    assert {p: one[p] for p in numbers} == pytest.approx({p: two[p] for p in numbers}, rel=1e-9)


def test_the_default_that_is_said_is_the_one_that_holds(schemas):
    schema = schemas["scenario"]
    onboard = defaults(schema, "OnboardKeys")
    hosted = {name: onboard.pop(name) for name in list(onboard) if name.startswith("mpc")}
    assert len(hosted) == 5
    same(built(OnboardKeys.model_validate(onboard), Onboard), Onboard())
    found = OnboardKeys.model_validate(hosted).hosted()
    assert set(found) == {"mpc", "mpc-car", "mpc-opti", "mpc-train", "mpc-train-ideal"}
    for settings in found.values():
        same(settings, MpcSettings())
    rail = defaults(schema, "RailKeys") | {"level": 0.1, "increments": {"law": "none"}}
    same(RailKeys.model_validate(rail).rail(4, 0), Rail(0.1))
    same(DraftGearKeys.model_validate(defaults(schema, "DraftGearKeys")).coupler(), DraftGear())
    same(LineKeys.model_validate(defaults(schema, "LineKeys")).line(), Line())
    keys = ReceptivityKeys.model_validate(defaults(schema, "ReceptivityKeys"))
    same(keys.receptivity(0.0), Receptivity())


def test_schemas_are_schemas(schemas):
    for schema in schemas.values():
        Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize(("kind", "path"), FILES, ids=lambda value: getattr(value, "stem", value))
def test_files_that_ship_follow_their_schema(schemas, kind, path):
    content = tomllib.loads(path.read_text("utf-8"))
    assert not list(Draft202012Validator(schemas[kind]).iter_errors(content))


def with_table(schema, place, name):
    """A scenario that has a table at this place with what it needs, and the table itself."""
    content = {
        key.name: NEEDED[key.name] for key in tables_of(schema)[0].keys if key.name in NEEDED
    }
    content |= {"rail": {"level": 0.1, "increments": {"law": "none"}}}
    content |= {"command": [{"time_s": 0.0, "acceleration_kmhs": 3.0}]}
    inner = content
    parts = place.strip("[]").split(".") if place else []
    for part in parts:
        inner = inner.setdefault(part, {})
        inner = inner[0] if isinstance(inner, list) else inner
    inner |= {key.name: NEEDED[key.name] for key in tables_of(schema, name)[0].keys
              if key.required and key.name in NEEDED}  # fmt: skip
    if place.startswith("[["):
        outer = content
        for part in parts[:-1]:
            outer = outer[part]
        outer[parts[-1]] = [inner]
    return content, inner


def refused(schema, content):
    """Whether schema and reader refuse a scenario; they agree."""
    by_schema = not Draft202012Validator(schema).is_valid(content)
    assert by_schema == (read(content) is None), content
    return by_schema


def read(content):
    """The scenario that the reader makes of a content, None if it refuses it."""
    try:
        return parse(FILE_KINDS["scenario"], {"name": "own"} | content, "own.toml")
    except StudyError:
        return None


def test_schema_and_reader_refuse_unknown_keys_in_every_table(schemas):
    schema = schemas["scenario"]
    places = [(place, name) for place, name in places_of(schema) if "mpc_" not in place]
    assert len(places) > 40
    for place, name in places:
        content, inner = with_table(schema, place, name)
        assert not refused(schema, content)
        inner["nonsense"] = 1.0
        assert refused(schema, content)


SEVERAL = (1, 0.5, "yes", "0.5", True, [], [1.0], ["a"], {"a": 1})
"""Values of every type."""


def test_what_the_schema_refuses_the_reader_refuses_too(schemas):
    schema = schemas["scenario"]
    validator = Draft202012Validator(schema)
    count = 0
    for place, name in places_of(schema):
        if "mpc_" in place:
            continue
        for key in tables_of(schema, name)[0].keys:
            named = key.name in (
                "train",
                "curve_law",
                "speed_law",
            )  # looked for when the event is made
            for value in () if named else SEVERAL:
                content, inner = with_table(schema, place, name)
                inner[key.name] = value
                if not validator.is_valid(content):
                    count += 1
                    assert read(content) is None, (place, key.name, value)
    assert count > 1000


@pytest.mark.parametrize(
    "rail",
    [
        {"level": 0.1, "speed_law": "none"},
        {"law_factor": 1.0, "speed_law": "shinkansen"},
        {"law_factor": 1.0, "speed_law": [13.6, 85.0, 0.0]},
        {"level": 0.1, "curve": {"kind": "slip-ratio", "peak_slip_ratio": 0.1}},
    ],
)
def test_schema_and_reader_take_a_rail(schemas, rail):
    content, inner = with_table(schemas["scenario"], "[rail]", "RailKeys")
    del inner["level"]
    inner |= rail
    assert not refused(schemas["scenario"], content)


@pytest.mark.parametrize(
    "rail",
    [
        {},
        {"law_factor": 1.0},
        {"level": 0.1, "law_factor": 1.0},
        {"level": 0.1, "speed_law": "shinkansen"},
        {"speed_law": "shinkansen"},
        {"level": 0.1, "law_factor": 1.0, "speed_law": "shinkansen"},
        {"level": 0.1, "curve": {"kind": "polch"}},
        {"level": 0.1, "curve": {"kind": "polach", "micro_slope": 5.0}},
        {"level": 1e9},
    ],
)
def test_schema_and_reader_refuse_a_rail(schemas, rail):
    content, inner = with_table(schemas["scenario"], "[rail]", "RailKeys")
    del inner["level"]
    inner |= rail
    assert refused(schemas["scenario"], content)


def test_the_reference_page_is_that_of_the_code():
    stored = (ROOT / "docs" / "keys.md").read_text("utf-8")
    assert stored == reference_page(), "`make keys` writes it anew"


def test_a_new_scenario_shows_every_key_and_runs(call, tmp_path, tables):
    path = tmp_path / "mine.toml"
    code, out, _ = call("new-scenario", "mine", "--out", tmp_path)
    assert (code, str(path) in out.replace("\n", "")) == (0, True)
    lines = path.read_text("utf-8").splitlines()
    shown = {
        line.lstrip("#").partition(" =")[0] for line in lines if " =" in line and line[:2] != "# "
    }
    headers = {
        line.strip("#[]").rpartition(".")[2] for line in lines if line.lstrip("#")[:1] == "["
    }
    for kind, name, key in tables:
        if kind == "scenario":
            assert key.name in (headers if key.table else shown), (name, key.name)
    for line in lines:
        if line.startswith("#") and not line.startswith(("# ", "#[")) and not line.endswith("="):
            assert len(tomllib.loads(line[1:])) == 1
    code, out, _ = call("simulate", path, "--rule", "alone", "--json")
    assert (code, '"scenario": "mine"' in out) == (0, True)


@pytest.mark.parametrize("like", shipped_scenarios())
def test_a_new_scenario_is_the_event_of_the_one_it_is_like(call, tmp_path, like):
    path = tmp_path / "Größe.toml"
    assert call("new-scenario", "Größe", "--like", like, "--out", path)[0] == 0
    assert inputs_hash(load_scenario(path).event(3)) == inputs_hash(load_scenario(like).event(3))
    assert load_scenario(path).changed(name=like) == load_scenario(like)


def test_a_new_scenario_replaces_no_file(call, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text("mine")
    code, _, err = call("new-scenario", "mine", "--out", tmp_path)
    assert (code, "exists, and is left as it is" in err) == (2, True)
    assert path.read_text() == "mine"


def test_paths_in_a_new_scenario_hold_from_where_it_lies(call, tmp_path, write_scenario):
    (tmp_path / "tram.toml").write_bytes((ROOT / "docs/plugins/tram.toml").read_bytes())
    like = write_scenario(write_scenario.short, ('"commuter-8car"', '"tram.toml"'))
    path = tmp_path / "deep" / "own.toml"
    assert call("new-scenario", "own", "--like", like, "--out", path.parent)[0] == 0
    assert inputs_hash(load_scenario(path).event()) == inputs_hash(load_scenario(like).event())
