"""The studies by name: every `Study` of a module named `study` in a folder of its own."""

import pkgutil
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import studies
from studies.core.study import Study
from studies.files.study_error import unknown


@cache
def all_studies() -> dict[str, Study]:
    """Every study by name, in alphabetical order."""
    found: dict[str, Study] = {}
    for folder in pkgutil.iter_modules(studies.__path__, "studies."):
        if folder.ispkg:
            found |= _studies_of(folder.name)
    return dict(sorted(found.items()))


@cache
def _studies_of(folder: str) -> dict[str, Study]:
    found: dict[str, Study] = {}
    for module in pkgutil.iter_modules(import_module(folder).__path__, f"{folder}."):
        if module.name.endswith((".study", "_study")):
            values = vars(import_module(module.name)).values()
            found |= {one.name: one for one in values if isinstance(one, Study)}
    return found


def find_study(name: str) -> Study:
    """The study called `name`; raises `StudyError` with the nearest name for one that does not exist."""
    folder = f"studies.{name.replace('-', '_')}"
    if name.replace("-", "").isidentifier() and find_spec(folder) is not None:
        known = _studies_of(folder)  # importing the others takes a second
        if name in known:
            return known[name]
    if name not in all_studies():
        raise unknown("sweep", name, all_studies())
    return all_studies()[name]


def study_folder(out: str | Path, name: str) -> Path:
    """Folder of a study's table under the results' folder `out`."""
    return Path(out) / "sweeps" / name
