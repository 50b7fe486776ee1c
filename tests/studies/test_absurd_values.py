"""Every number of a scenario and of a train file takes absurd values: an error names the key, or the run is finite."""

import copy
import math
import tomllib
from itertools import product
from typing import Any

import numpy as np
import pytest

from alloc.simulation import simulate
from studies.files.json_schema import in_toml
from studies.files.strict import parse
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario
from studies.scenario.train_file import read_train_file
from tests.studies.test_bad_input_battery import KEYS, TRAM, content_with

ABSURD = (1e9, -1.0, 10.0, math.nan, math.inf)
NO_NUMBER_BY_DESIGN = {"level"}
"""Variables of a run that are nan where a rule has no such quantity."""


def named(key: str, message: str) -> bool:
    """Whether a message names the key; running resistance is a quantity of three keys, and the whole is named."""
    return key in message or (key.startswith("resistance_") and "resistance = " in message)


def table_of(key: tuple) -> str:
    return ".".join(table for table, _ in key[0])


@pytest.mark.parametrize("table", sorted(set(map(table_of, KEYS))))
def test_an_absurd_number_is_refused_by_the_name_of_its_key_or_runs(table):
    keys = [key for key in KEYS if table_of(key) == table]
    for (place, base, name), value in product(keys, ABSURD):
        for given in (value, [value]):  # one of the two is of the wrong type
            try:
                event = parse(Scenario, content_with(place, base, name, given), "own.toml").event()
            except StudyError as error:
                message = str(error)
                assert "\n" not in message, name
                assert name in message, name
                continue
            if value == 10.0 and name == "duration_s":
                continue
            assert_finite(simulate(event, "alone", "cut-and-ramp"))


def assert_finite(run):
    for name, variable in run.data_vars.items():
        if variable.dtype.kind == "f" and name not in NO_NUMBER_BY_DESIGN:
            assert np.isfinite(variable.values).all(), name


@pytest.mark.parametrize(
    ("rail", "words"),
    [
        ({"level": 10.0}, "'rail.level' = 10.0: "),
        ({"speed_law": "shinkansen", "law_factor": 8.0}, "law_factor = 8.0 gives a coefficient of 1.28"),
        ({"speed_law": [100.0, 10.0, 0.0], "law_factor": 1.0}, "law_factor = 1.0 gives a coefficient of 10"),
        ({"level": 0.1, "patches": [{"factor": 20.0}]}, "level = 0.1 gives a coefficient of 2"),
        ({"level": 0.1, "scatter": 3.0}, "'rail.scatter' = 3.0: "),
        ({"level": 0.1, "sanded_coefficient": 4.0}, "'rail.sanded_coefficient' = 4.0: "),
        ({"level": 0.1, "increments": {"law": "given", "values": [3.0]}}, "'rail.increments.values[1]' = 3.0: "),
    ],
)  # fmt: skip
def test_no_rail_carries_more_than_the_wheels_load(rail, words):
    content = content_with((), {}, "start_m", 0.0)
    content["rail"] = {"increments": {"law": "none"}} | rail
    with pytest.raises(StudyError) as refused:
        parse(Scenario, content, "own.toml").event()
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"onboard": {"detector": {"on_kmhs": -3.0}}}, "onboard.detector.on_kmhs = -3.0 must be"),
        ({"onboard": {"perturb_observe": {"lowest_kmh": 3.6, "highest_kmh": 1.8}}},
         "onboard.perturb_observe.lowest_kmh = 3.6 must be below onboard.perturb_observe.highest_kmh = 1.8"),
        ({"onboard": {"mpc": {"step_s": -2.0}}}, "mpc.step_s = -2.0 must be"),
        ({"coupler": {"stiffness_n_per_m": 1e7, "slack_mm": -5.0}}, "coupler.slack_mm = -5.0 must be"),
        ({"onboard": {"period_s": 0.5}},
         "onboard.period_s = 0.5 must not exceed onboard.telegrams.period_s = 0.1"),
        ({"onboard": {"telegrams": {"period_s": 0.001}}},
         "onboard.period_s = 0.01 must not exceed onboard.telegrams.period_s = 0.001"),
        ({"onboard": {"mpc": {"search": {"first_kmh": 9.0}}}},
         "mpc.search.first_kmh = 9.0 must lie between mpc.search.lowest_kmh = 0.072 and mpc.search.highest_kmh = 5.76"),
        ({"onboard": {"sensors": {"radius_error": 1.0}}}, "onboard.sensors.radius_error = 1.0 must lie in 0 to 0.5"),
        ({"load_t": [-2.0]}, "load_t[1] = -2.0 must be"),
        ({"line": {"tunnels": [{"start_m": 9.0, "end_m": 3.0}]}}, "end_m = 3.0 must lie beyond start_m = 9.0"),
    ],
)  # fmt: skip
def test_an_error_has_the_key_and_the_unit_of_the_file(content, words):
    whole = content_with((), {}, "start_m", 0.0) | content
    with pytest.raises(StudyError) as refused:
        parse(Scenario, whole, "own.toml").event()
    assert words in str(refused.value)


TRAIN: dict[str, Any] = tomllib.loads(TRAM)
TRAIN["car"]["M"]["sanders"] = [{"axle": 0, "rate_kg_per_min": 2.0, "amount_g_per_m": 7.5}]
TRAIN["car"]["M"]["motors"] |= {
    "brake_torque_nm": 700.0, "brake_power_kw": 80.0, "pull_out_speed_kmh": 60.0, "fade_speed_kmh": 5.0,
}  # fmt: skip
TRAIN["car"]["M"]["air_brake"] |= {"lag_s": 1.0, "dead_time_s": 0.05, "friction_factor": 1.0}
TRAIN |= {"speed_limit_kmh": 70.0, "service_deceleration_kmhs": 4.0}


def numbers(content: Any, path: tuple = ()) -> list[tuple]:
    """Paths of all numbers in nested tables."""
    pairs = content.items() if isinstance(content, dict) else enumerate(content)
    found = []
    for key, value in pairs:
        if isinstance(value, dict | list):
            found += numbers(value, (*path, key))
        elif isinstance(value, float | int):
            found.append((*path, key))
    return found


def write(content: Any) -> str:
    """A train as TOML, in tables without order."""
    top = {key: value for key, value in content.items() if key != "car"}
    lines = [f"{key} = {in_line(value)}" for key, value in top.items()]
    for letter, car in content["car"].items():
        lines.append(f"[car.{letter}]")
        lines += [f"{key} = {in_line(value)}" for key, value in car.items()]
    return "\n".join(lines)


def in_line(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{k} = {in_line(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(in_line(v) for v in value) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return repr(value)
    return in_toml(value)


def test_an_absurd_number_of_a_train_is_refused_by_the_name_of_its_key_or_runs(tmp_path):
    file = tmp_path / "own.toml"
    for path, value in product(numbers(TRAIN), ABSURD):
        *_, key = (part for part in path if isinstance(part, str))
        content = copy.deepcopy(TRAIN)
        inner = content
        for part in path[:-1]:
            inner = inner[part]
        inner[path[-1]] = (
            int(value) if math.isfinite(value) and isinstance(inner[path[-1]], int) else value
        )
        file.write_text(write(content))
        try:
            read_train_file(str(file))
            scenario = content_with((), {}, "start_m", 0.0) | {"train": str(file)}
            event = parse(Scenario, scenario, "own.toml").event()
        except StudyError as error:
            message = str(error)
        else:
            assert_finite(simulate(event, "alone", "cut-and-ramp"))
            continue
        assert named(key, message), message
