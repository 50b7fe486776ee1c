"""`readhesion run-line` as a user meets it, and files of a line and a train; bad input is in the battery."""

import json
from copy import deepcopy

import pytest
import yaml
from PIL import Image

from alloc.recording import load
from studies.command_line.run_line import clock

PATH = {
    "schema": "https://railtoolkit.org/schema/running-path.json",
    "schema_version": "2022.05",
    "paths": [
        {
            "name": "short line",
            "id": "p1",
            "points_of_interest": [[400.0, "signal", "front"], [400.0, "clear", "rear"]],
            "characteristic_sections": [[0.0, 60, 0.0], [500.0, 40, 8.0], [900.0, 40, 0.0]],
        }
    ],
}
STOCK = {
    "schema": "https://railtoolkit.org/schema/rolling-stock.json",
    "schema_version": "2022.05",
    "trains": [{"name": "a train", "id": "T", "formation": ["R1", "R1"]}],
    "vehicles": [
        {
            "name": "railcar",
            "id": "R1",
            "vehicle_type": "multiple unit",
            "length": 41.0,
            "mass": 66.0,
            "load_limit": 10.0,
            "mass_traction": 44.0,
            "rotation_mass": 1.1,
            "base_resistance": 3.0,
            "rolling_resistance": 1.5,
            "air_resistance": 4.0,
            "speed_limit": 50,
            "a_braking": -0.6,
            "tractive_effort": [[0.0, 90e3], [10.0, 80e3], [60.0, 30e3]],
        }
    ],
}
NAMED_PATH = {
    "schema": "https://railtoolkit.org/schema/running-path.json",
    "schema_version": "2024.07",
    "paths": [
        {
            "description": "short line",
            "id": "p1",
            "points_of_interest": [
                {"position": 400.0, "label": "signal", "measure": "front"},
                {"position": 400.0, "label": "clear", "measure": "rear"},
            ],
            "characteristic_sections": [
                {"position": 0.0, "speed": 60, "resistance": 0.0},
                {"position": 500.0, "speed": 40, "resistance": 8.0},
                {"position": 900.0, "speed": 40},
            ],
        }
    ],
}
OWN_LINE = """
name = "own"
end_m = 2000.0
sections = [
    { start_m = 0.0, limit_kmh = 80.0 },
    { start_m = 1000.0, limit_kmh = 60.0, grade_permille = 5.0 },
]
points = [{ station_m = 500.0, name = "halt", dwell_s = 20.0 }]
"""
NOTHING = object()


def changed(content, *place_and_value):
    """A copy of a file's content with another value at a place, or without it if the value is `NOTHING`."""
    *place, last, value = place_and_value
    copy = deepcopy(content)
    at = copy
    for part in place:
        at = at[part]
    if value is NOTHING:
        del at[last]
    else:
        at[last] = value
    return copy


@pytest.fixture
def files(tmp_path):
    """Write contents of line and train, given as text or keys; gives the command's options."""

    def write(line=PATH, train=STOCK):
        options = []
        for option, content in (("line", line), ("train", train)):
            path = tmp_path / f"{option}.yaml"
            path.write_text(content if isinstance(content, str) else yaml.safe_dump(content))
            options += [f"--{option}", path]
        return options

    return write


def test_a_run_is_printed_recorded_and_drawn(call, files, tmp_path):
    code, out, _ = call(
        "run-line", *files(), "--out", tmp_path / "run.nc", "--figure", tmp_path / "run.png"
    )
    assert code == 0
    for words in ("a train on short line", "running time", "152.0 t", "stop at 900.0 m", "clear"):
        assert words in out
    run = load(tmp_path / "run.nc")
    assert run.attrs["running_time_s"] > 60.0
    points = json.loads(run.attrs["points_of_interest"])
    assert [point["name"] for point in points] == ["signal", "clear"]
    words = Image.open(tmp_path / "run.png").text["Source"].split()
    # the command that makes the figure again, without what is so by default
    assert [word for word in words if word.startswith("--")] == ["--line", "--train"]


def test_json_is_all_that_is_printed_and_load_makes_the_run_longer(call, files):
    full = json.loads(call("run-line", *files(), "--json")[1])
    code, out, _ = call("run-line", *files(), "--json", "--load", 0)
    content = json.loads(out)
    assert content["running_time_s"] < full["running_time_s"]
    assert code == 0
    assert content["mass_t"] == pytest.approx(132.0)
    assert content["highest_speed_kmh"] < 50.2
    signal, clear = content["points_of_interest"]
    assert (signal["measure"], clear["measure"]) == ("front", "rear")
    assert signal["time_s"] < clear["time_s"] < content["running_time_s"]
    (stop,) = content["stops"]
    assert abs(stop["error_m"]) < 0.05
    energy = content["energy_kWh"]
    assert energy["motors"] == pytest.approx(sum(energy.values()) - energy["motors"], rel=1e-3)


def test_what_is_assumed_is_said_once_and_in_json(call, files):
    train = changed(STOCK, "vehicles", 0, "a_braking", NOTHING)
    train = changed(train, "vehicles", 0, "air_resistence", 4.0)
    code, out, err = call("run-line", *files(PATH, train), "--json")
    remarks = json.loads(out)["remarks"]
    assert code == 0
    assert [f"readhesion: {remark}" for remark in remarks] == err.splitlines()
    assert len(remarks) == 2
    assert "did you mean 'air_resistance'?" in remarks[0]
    assert "'a_braking'; taken as -0.375 m/s2" in remarks[1]


def test_stops_and_style_come_from_options(call, files):
    code, out, _ = call(
        "run-line", *files(), "--stops", "signal,600", "--dwell", 12, "--coasting", 5, "--effort", 0.8,
        "--json",
    )  # fmt: skip
    content = json.loads(out)
    assert code == 0
    assert [stop["name"] for stop in content["stops"]] == ["signal", "600 m", "end of the line"]
    assert [stop["dwell_s"] for stop in content["stops"]] == pytest.approx([12.0, 12.0, 0.0])
    assert [point["name"] for point in content["points_of_interest"]] == ["clear"]
    assert (content["coasting_s"], content["share_of_effort"]) == (5.0, 0.8)
    assert content["remarks"] == []


def test_a_line_of_ones_own_stops_where_its_file_says(call, tmp_path, files):
    line = tmp_path / "own.toml"
    line.write_text(OWN_LINE)
    options = ("run-line", "--line", line, *files()[2:], "--json")
    stops = [
        [(stop["name"], stop["dwell_s"]) for stop in json.loads(call(*options, *more)[1])["stops"]]
        for more in ((), ("--dwell", 5), ("--stops", "none"))
    ]
    assert [len(each) for each in stops] == [2, 2, 1]
    assert [each[0][1] for each in stops[:2]] == pytest.approx([20.0, 5.0])


def test_times_read_as_minutes_and_seconds():
    assert [clock(t) for t in (0.0, 59.96, 391.615, 3437.53)] == [
        "0:00.0", "1:00.0", "6:31.6", "57:17.5",
    ]  # fmt: skip
