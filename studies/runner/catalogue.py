"""What there is by name: studies, each a module that is imported when it is asked for, and all that a command takes."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from alloc.evaluation.metrics import METRICS
from alloc.onboard.beliefs import BELIEFS
from alloc.onboard.controllers import CONTROLLERS
from alloc.plant.curves import CURVES
from alloc.plant.trains import TRAINS, find_train
from alloc.rules import RULES
from studies import StudyError
from studies.files.scenario_files import load_scenario, shipped_names
from studies.files.toml_keys import suggest_name
from studies.runner.plugins import load_plugins
from studies.runner.study import Study

STUDIES = (
    "benchmark",
    "tuning",
    "assumptions",
    "mpc_parts",
    "mpc_settings",
    "conditioning",
    "claims",
    "braking",
    "learning",
    "readhesion_paper",
    "jp4209318",
    "rtri",
    "jph07322414",
    "measured",
    "solvers",
    "optimum",
)


def find_study(name: str) -> Study:
    """The study of this name, or of a file that has a `STUDY`. Raises `StudyError` where there is none."""
    if name.endswith(".py"):
        (module,) = load_plugins([name])
        users = getattr(module, "STUDY", None)
        if not isinstance(users, Study):
            raise StudyError(f"{name}: it has no STUDY, a studies.runner.study.Study")
        return users
    plain = name.replace("-", "_")
    if plain not in STUDIES:
        kind = "file" if Path(name).suffix else "study"
        raise StudyError(f"unknown {kind} {name!r}{suggest_name(plain, STUDIES)}")
    study: Study = import_module(f"studies.{plain}").STUDY
    return study


def _describe_trains() -> dict[str, str]:
    trains = ((name, find_train(name)) for name in TRAINS)
    return {name: f"{len(train.cars)} cars, {train.mass / 1e3:.0f} t" for name, train in trains}


KINDS: dict[str, Callable[[], dict[str, str]]] = {
    "scenarios": lambda: {name: load_scenario(name).title for name in shipped_names()},
    "rules": lambda: {name: rule.description for name, rule in RULES.items()},
    "controllers": lambda: {name: part.meaning for name, part in CONTROLLERS.items()},
    "beliefs": lambda: {name: belief.description for name, belief in BELIEFS.items()},
    "curves": lambda: {name: str(part.__doc__).partition("\n")[0] for name, part in CURVES.items()},
    "trains": _describe_trains,
    "studies": lambda: {name: find_study(name).question for name in STUDIES},
    "metrics": lambda: {
        name: f"{part.description} [{part.unit}]" for name, part in METRICS.items()
    },
}
"""Kinds of things that a command takes by name, and what gives their names with a line of meaning."""
