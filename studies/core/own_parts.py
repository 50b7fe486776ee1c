"""Trial of rules, controllers and metrics of one's own: a faulty one is refused before anything is run."""

import re
import sys
from collections.abc import Callable, Iterable
from contextlib import redirect_stdout
from difflib import get_close_matches
from typing import Any, TypeVar

import numpy as np

from alloc.metrics import METRICS
from alloc.onboard.host import HostedController
from alloc.plant.adhesion import CURVES
from alloc.registry import Registry
from alloc.rules import RULES, AllocationProblem, Rule
from alloc.rules.testing import Unusable, usable
from alloc.simulation import CONTROLLERS, simulate
from alloc.sources import PACKAGES
from alloc.testing import tried
from studies.core.plugins import line_in
from studies.files.study_error import StudyError
from studies.scenario.scenario import load_scenario

SCENARIO, DURATION = "wet-start", 0.2
"""Event of the trial, and its duration [s]: a few control periods."""
UNITS = 3
"""Units of the problem that a rule is asked about; no shipped train has so many, so that a fixed number is noticed."""

Found = TypeVar("Found")


def try_parts(rules: Iterable[str], controllers: Iterable[str] = ()) -> None:
    """Ask rules in Python for a small answer; try controllers and metrics that do not come with the project in a short run.

    Raises `StudyError` where a rule is unknown or its solver is missing, and where a part of one's own raises an error or
    answers with something else than it should.
    """
    for rule in rules:
        _try_rule(rule)
    for controller in controllers:
        if is_own(CONTROLLERS, controller):
            _try_controller(controller)
    metrics = [name for name in METRICS if is_own(METRICS, name)]
    if metrics:
        run = simulate(_event(), "alone", "none")
        for name in metrics:
            part = METRICS[name]
            called(METRICS, name, lambda part=part: float(part.function(run)))  # type: ignore[misc]


def _try_rule(name: str) -> None:
    problem = AllocationProblem(cap=np.linspace(0.1, 0.2, UNITS), expected=0.16)
    if not is_own(RULES, name):
        try:
            rule = RULES.find(name)
            # those with a law need no solver, and are compiled where a worker needs them
            if rule.law is None:
                rule(problem)
        except (ValueError, ImportError) as error:
            raise StudyError(" ".join(str(error).split())) from None
        return
    rule = RULES[name]
    if not isinstance(rule, Rule):
        raise _fault(
            RULES, name, f"is a {type(rule).__name__}; register Rule(name, sentence, function)"
        )
    _check_colour(RULES, name)
    called(RULES, name, lambda: usable(rule, problem))


def _try_controller(name: str) -> None:
    found = CONTROLLERS[name]
    if not isinstance(found, HostedController):
        kind = type(found).__name__
        raise _fault(
            CONTROLLERS, name,
            f"is a {kind}; register HostedController(name, meaning, each_unit(class), colour, marker)",
        )  # fmt: skip
    _check_colour(CONTROLLERS, name)
    called(CONTROLLERS, name, lambda: tried(found, _event()))


def _check_colour(registry: Registry[Any], name: str) -> None:
    colour = registry[name].colour
    if not re.fullmatch("#[0-9a-fA-F]{6}", str(colour)):
        raise _fault(
            registry, name, f"has colour {colour!r}; give a hexadecimal one such as '#117733'"
        )


def _event() -> Any:
    return load_scenario(SCENARIO).changed(duration_s=DURATION).event(seed=0)


def is_own(registry: Registry[Any], name: str) -> bool:
    """Whether a part is a user's, or of an installed package."""
    return name in registry and registry.origin(name).partition(".")[0] not in {
        *PACKAGES,
        "paper_figs",
        "tests",
    }


def called(registry: Registry[Any], name: str, call: Callable[[], Found]) -> Found:
    """What `call` returns; an error in it names the part, and the line of its file."""
    file = _file(registry, name)
    try:
        with redirect_stdout(sys.stderr):
            return call()
    except StudyError:
        raise
    except Unusable as error:
        raise _fault(registry, name, str(error)) from None
    except (Exception, SystemExit) as error:
        said = f"{type(error).__name__}: {' '.join(str(error).split()) or 'no message'}"
        raise _fault(
            registry, name, f"raises {said}{line_in(file, error)}; correct the file"
        ) from None


def _fault(registry: Registry[Any], name: str, fault: str) -> StudyError:
    return StudyError(f"{registry.kind} {name!r} of {_file(registry, name)!r} {fault}")


def _file(registry: Registry[Any], name: str) -> str:
    module = registry.origin(name)
    return str(getattr(sys.modules.get(module), "__file__", module))


def registry_of(name: str) -> Registry[Any]:
    """The registry of rules, controllers or curves that has a part of this name; raises `StudyError` if none has."""
    kinds: tuple[Registry[Any], ...] = (RULES, CONTROLLERS, CURVES)
    for registry in kinds:
        if name in registry:
            return registry
    near = get_close_matches(name, [one for registry in kinds for one in registry], 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise StudyError(
        f"no rule, controller or adhesion curve is called {name!r}; {hint}`readhesion list` has the names"
    )
