"""The studies by name; each is a module that is imported when it is asked for."""

from importlib import import_module
from pathlib import Path

from studies.core import Study, StudyError
from studies.plugins import load_plugins
from studies.scenario import near

STUDIES = (
    "claims", "braking", "learning",  # JP5484215
    "readhesion_paper", "jp4209318", "rtri", "jph07322414",
    "headroom", "ladder", "broad",
)  # fmt: skip


def find_study(name: str) -> Study:
    """The study of this name, or of a file that has a `STUDY`. Raises `StudyError` where there is none."""
    if name.endswith(".py"):
        (module,) = load_plugins([name])
        found = getattr(module, "STUDY", None)
        if not isinstance(found, Study):
            raise StudyError(f"{name}: it has no STUDY, a studies.core.Study")
        return found
    plain = name.replace("-", "_")
    if plain not in STUDIES:
        kind = "file" if Path(name).suffix else "study"
        raise StudyError(f"unknown {kind} {name!r}{near(plain, STUDIES)}")
    study: Study = import_module(f"studies.{plain}").STUDY
    return study
