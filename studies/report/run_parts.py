"""What a run is made of, as texts that name documents, and its values with their sources."""

import inspect
import re
from pathlib import Path
from typing import NamedTuple

from alloc.citations import Citation, cited_in, uses
from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import CURVES
from alloc.plant.train import Train
from alloc.rules import RULES
from alloc.sources import path_of
from studies.scenario.scenario import SCENARIOS, Scenario

SOURCED, ASSUMED, PARTLY = "sourced", "assumed", "sourced in part"
EVERY_RUN = {
    "slip detector": ("alloc.onboard.laws",),
    "disturbance observer": ("alloc.onboard.laws",),
    "wheel damage Q": ("alloc.estimation.wheel_damage",),
}
"""Parts that every run has, with their modules."""
BRAKING = {
    "slide protection": ("alloc.onboard.laws", "alloc.onboard.brakes"),
    "shoe force": ("alloc.onboard.laws",),
}  # fmt: skip
"""Parts of a run in which the driver brakes."""
COLLECTING = {"registry", "collection"}
"""Names of modules that know all parts of a kind."""
NUMBER = re.compile(r"^\s*(\w+)\s*=\s*([-+.\d\[][^#]*?)\s*(?:#\s*(.*?)\s*)?$")
"""A key with a number or a list in a TOML file, and the remark beside it."""


class Used(NamedTuple):
    """A document, and the parts of the run that name it."""

    document: Citation
    parts: list[str]


class Value(NamedTuple):
    """A value of a run: sourced, assumed, or sourced in part, and what is said of it."""

    of: str
    name: str
    standing: str
    why: str


def documents_of(scenario: Scenario, rule: str, controller: str) -> list[Used]:
    """Documents that the parts of a run name in their sources."""
    return [Used(*one) for one in uses(_texts(scenario, rule, controller)).items()]


def _texts(scenario: Scenario, rule: str, controller: str) -> dict[str, str]:
    """Part of the run -> what its source says."""
    event = scenario.event()
    train = event.model.train
    modules = {
        f"rule {rule}": _with_neighbours(RULES.origin(rule)),
        f"controller {controller}": _with_neighbours(module_of_controller(controller)),
        **EVERY_RUN,
    }
    if any(command.acceleration_kmhs < 0.0 for command in scenario.command):
        modules |= BRAKING
    if event.onboard.learning.kind != "none":
        modules["learning of increments"] = ("alloc.onboard.increment_learning",)
    if any(car.sanders for car in train.cars):
        modules["sanders"] = ("alloc.plant.train",)
    kind = scenario.rail.curve.kind
    if kind.startswith("polach"):
        modules["contact"] = ("alloc.plant.adhesion",)
    texts = {part: " ".join(module_text(one) for one in names) for part, names in modules.items()}
    texts[f"adhesion curve {kind}"] = inspect.getdoc(CURVES.find(kind)) or ""
    texts[f"train {train.name}"] = train_text(train)
    texts[f"scenario {scenario.name}"] = "\n".join(_lines(scenario))
    if scenario.rail.increments.law == "logarithmic":
        texts["growth of adhesion along the train"] = "JP5484215 (15)"
    if scenario.rail.speed_law == "curtius-kniffler":
        texts["adhesion over speed"] = "Curtius and Kniffler, 1950"
    return texts


def train_text(train: Train) -> str:
    """Where the values of a train come from."""
    return " ".join([train.source, *train.sources.values()])


def module_of_controller(controller: str) -> str:
    """Module of a controller: that of its class where it is a built-in one, which all stand in one registry."""
    found = CONTROLLERS.find(controller)
    return found.__module__ if isinstance(found, type) else CONTROLLERS.origin(controller)


def _with_neighbours(module: str) -> tuple[str, ...]:
    """A module and those of its own folder that it needs, but none behind one that collects all of them."""
    folder, found, waiting = module.rpartition(".")[0], set(), [module]
    while waiting:
        one = waiting.pop()
        here = one.rpartition(".")[0] == folder and one.rpartition(".")[2] not in COLLECTING
        if one not in found and here:
            found.add(one)
            waiting += re.findall(r"^\s*(?:from|import) ([\w.]+)", module_text(one), re.MULTILINE)
    return tuple(sorted(found))


def module_text(module: str) -> str:
    """Text of a module's file; empty where there is no file."""
    path = path_of(module)
    return "" if path is None else path.read_text(encoding="utf-8")


def _lines(scenario: Scenario) -> list[str]:
    """Lines of the scenario's file; none where it is not known by a file."""
    found = SCENARIOS.get(scenario.name)
    if not isinstance(found, Path) or not found.exists():
        return []
    return found.read_text(encoding="utf-8").splitlines()


def values_of(scenario: Scenario, lines: list[str] | None = None) -> list[Value]:
    """Values of the train and of the scenario's file (`lines`; those of a shipped one if nothing is said)."""
    train = scenario.event().model.train
    found = [
        Value(f"train {train.name}", name, _standing(why), why)
        for name, why in train.sources.items()
    ]
    table = ""
    for line in _lines(scenario) if lines is None else lines:
        if line.startswith("["):
            table = line.strip("[] \n").split("]")[0] + "."
        elif match := NUMBER.match(line):
            why = match[3] or "no source is stated"
            standing = SOURCED if cited_in(why) and "assumed" not in why else ASSUMED
            found.append(Value(f"scenario {scenario.name}", f"{table}{match[1]} = {match[2]}", standing, why))  # fmt: skip
    return found


def _standing(why: str) -> str:
    """Of a train's value, which says "assumed" where no source gives it."""
    if "assumed" not in why:
        return SOURCED
    return ASSUMED if why.lstrip().startswith("assumed") else PARTLY
