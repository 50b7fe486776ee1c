"""Files of scenarios: those that ship, a user's, and drawn events by their name; a new file, and the schema for editors."""

import json
import re
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Literal

from studies import StudyError
from studies.files.scenario import DRAWN, Scenario, make_scenario
from studies.files.toml_keys import Schema, name_source, read_toml, suggest_name
from studies.files.train_keys import TrainKeys

SHIPPED = Path(__file__).with_name("scenarios")
SCHEMA = "scenario.schema.json"


def shipped_names() -> list[str]:
    """Names of the scenarios that come with the project."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


def default_scenarios() -> list[Scenario]:
    """Those of the default comparison."""
    scenarios = map(load_scenario, shipped_names())
    return [scenario for scenario in scenarios if scenario.in_default_comparison]


def load_scenario(name: str | Path) -> Scenario:
    """A shipped scenario or a drawn event by its name; the scenario of a TOML file by its path, which is read each time.

    Raises `StudyError` of one line that names the file, the key and the reason.
    """
    text = str(name)
    if isinstance(name, Path) or "/" in text or text.endswith(".toml"):
        return _read_scenario(Path(name))
    if text in shipped_names():
        return _read_shipped(text)
    if is_drawn := DRAWN.fullmatch(text):
        population = "population.population" if text[0] == "p" else "claims"
        event: Scenario = import_module(f"studies.{population}").event(
            int(is_drawn[2]), int(is_drawn[3])
        )
        return event
    hint = suggest_name(text, [*shipped_names(), "population-65-0000"])
    if Path(f"{text}.toml").is_file():
        hint = f"; did you mean the file {text}.toml?"
    raise StudyError(f"unknown scenario {text!r}{hint}")


@cache
def _read_shipped(name: str) -> Scenario:
    return _read_scenario(SHIPPED / f"{name}.toml")


def _read_scenario(path: Path) -> Scenario:
    name, source = re.sub(r"[^\w.+-]", "-", path.stem)[:100], f"file {str(path)!r}"
    with name_source(source):
        data = {"name": name} | read_toml(path)
    scenario = make_scenario(data, source, path.parent)
    with name_source(source):
        scenario.build_event(0)  # what is impossible shows now, not in the middle of a study
    return scenario


def json_schema(kind: Literal["scenario", "train"] = "scenario") -> Schema:
    """JSON schema (2020-12) of a file, with the parts of plug-ins."""
    table = Scenario if kind == "scenario" else TrainKeys
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return dialect | table.model_json_schema() | {"title": f"readhesion {kind}"}


def new_scenario(name: str, like: str = "wet-start", folder: str | Path = ".") -> Path:
    """Write a copy of the scenario `like` as a file to begin with, and the schema beside it; the file's path.

    Raises `StudyError` where a file of this name exists, or cannot be written.
    """
    if not re.fullmatch(r"[\w.+-]{1,100}", name):
        raise StudyError(f"name {name!r}: give letters, digits, and . + - _")
    load_scenario(like)
    source = SHIPPED / f"{like}.toml" if like in shipped_names() else Path(like)
    text = re.sub(r"(?m)\A#:schema.*\n|^name *=.*\n", "", source.read_text("utf-8-sig"))
    train = read_toml(source).get("train", "")
    if train.endswith(".toml"):  # its path counts from the other folder
        text = text.replace(train, str((source.parent / train).resolve()))
    path = Path(folder) / f"{name.removesuffix('.toml')}.toml"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, "x", encoding="utf-8") as file:
            file.write(f"#:schema ./{SCHEMA}\n# It began as a copy of {source.stem}.\n{text}")
        path.with_name(SCHEMA).write_text(json.dumps(json_schema(), indent=1), "utf-8")
    except FileExistsError:
        raise StudyError(f"file {str(path)!r} exists; choose another name") from None
    except OSError as error:
        raise StudyError(f"file {str(path)!r} cannot be written: {error.strerror}") from None
    return path
