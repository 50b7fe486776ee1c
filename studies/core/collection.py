"""The studies by name: every `Study` of a module named `study` in a folder of its own."""

import pkgutil
from functools import cache
from importlib import import_module
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
            paths = import_module(folder.name).__path__
            modules = pkgutil.iter_modules(paths, f"{folder.name}.")
            for module in modules:
                if module.name.endswith((".study", "_study")):
                    values = vars(import_module(module.name)).values()
                    found |= {one.name: one for one in values if isinstance(one, Study)}
    return dict(sorted(found.items()))


def find_study(name: str) -> Study:
    """The study called `name`; raises `StudyError` with the nearest name for one that does not exist."""
    studies_by_name = all_studies()
    if name not in studies_by_name:
        raise unknown("sweep", name, studies_by_name)
    return studies_by_name[name]


def study_folder(out: str | Path, name: str) -> Path:
    """Where a study keeps its table under the results' folder `out`."""
    return Path(out) / "sweeps" / name
