"""The studies by name: every `Study` of a module named `study`, or after the study, in a folder of its topic."""

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
    for module in _modules("*/study.py", "*/*_study.py"):
        found |= _studies_of(module)
    return dict(sorted(found.items()))


def _modules(*patterns: str) -> list[str]:
    """Names of the modules in folders of studies whose files are so called."""
    return [
        ".".join(("studies", *path.relative_to(root).with_suffix("").parts))
        for root in map(Path, studies.__path__)
        for pattern in patterns
        for path in root.glob(pattern)
    ]


@cache
def _studies_of(module: str) -> dict[str, Study]:
    values = vars(import_module(module)).values()
    return {one.name: one for one in values if isinstance(one, Study)}


def find_study(name: str) -> Study:
    """The study called `name`; raises `StudyError` with the nearest name for one that does not exist."""
    own = name.replace("-", "_")
    if own.isidentifier():  # importing the others takes a second
        for module in _modules(f"{own}/study.py", f"*/{own}_study.py"):
            if name in (known := _studies_of(module)):
                return known[name]
    if name not in all_studies():
        raise unknown("sweep", name, all_studies())
    return all_studies()[name]


def study_folder(out: str | Path, name: str) -> Path:
    """Folder of a study's table under the results' folder `out`."""
    return Path(out) / "sweeps" / name
