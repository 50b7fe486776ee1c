"""Scenarios by name or path: shipped ones, those of plug-ins, and your own files."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from alloc.registry import Registry
from studies.files.strict import parse, read_toml
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario, safe_name
from studies.scenario.train_file import is_file

SHIPPED = Path(__file__).parent / "shipped"
SCENARIOS: Registry[Path | Mapping[str, Any]] = Registry(
    "scenario", "readhesion.scenarios", StudyError
)
"""Name -> TOML file of the scenario, or its keys."""
for _file in sorted(SHIPPED.glob("*.toml")):
    SCENARIOS.register(_file.stem, _file)


def shipped_scenarios() -> list[str]:
    """Names of the scenarios that come with the project, in alphabetical order."""
    return [name for name in SCENARIOS if SCENARIOS.origin(name) == __name__]


def default_scenarios() -> list[Scenario]:
    """Shipped scenarios of the default comparison, in alphabetical order."""
    shipped = [load_scenario(name) for name in shipped_scenarios()]
    return [scenario for scenario in shipped if scenario.in_default_comparison]


@cache
def shipped_scenario(name: str) -> Scenario:
    """A shipped scenario; read once, because random events are made from it by the million."""
    return load_scenario(SHIPPED / f"{name}.toml")


def load_scenario(name_or_path: str | Path) -> Scenario:
    """A scenario by name, or any TOML file by path; paths inside it are relative to the file's folder.

    Raises `StudyError` naming the file, the key and the reason.
    """
    scenario = parse(Scenario, read_scenario(name_or_path), str(name_or_path))
    scenario.event()  # impossible values show now, not in the middle of a study
    return scenario


def read_scenario(name_or_path: str | Path) -> dict[str, Any]:
    """Unchecked keys of a scenario as its file has them, with its name. Raises as `load_scenario`."""
    text = str(name_or_path)
    is_path = text.endswith(".toml") or "/" in text
    if not is_path and text not in SCENARIOS and Path(f"{text}.toml").is_file():
        raise StudyError(f"unknown scenario {text!r}; did you mean the file {text}.toml?")
    found = text if is_path else SCENARIOS.find(text)
    if isinstance(found, Mapping):
        return {"name": text} | dict(found)
    path = Path(found)
    data = read_toml(str(path), "scenario", "`readhesion list` names the shipped ones")
    return {"name": safe_name(path.stem)} | _resolved(data, path.parent)


def _resolved(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The same content with paths of files counted from `folder`."""
    data = dict(data)
    if isinstance(data.get("train"), str) and is_file(data["train"]):
        data["train"] = str(folder / data["train"])
    line = data.get("line")
    if isinstance(line, dict) and isinstance(line.get("file"), str):
        data["line"] = line | {"file": str(folder / line["file"])}
    return data
