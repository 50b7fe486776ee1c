"""Trial of rules, controllers and metrics of one's own: a faulty one is refused before anything is run."""

import json
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from numbers import Real
from typing import Any, TypeVar

import numpy as np

from alloc.metrics import METRICS
from alloc.onboard.host import HostedController, TellingController, TorqueDecision, UnitSense
from alloc.onboard.telegrams import AddedNumbers, Attachment
from alloc.recording import attributes_of
from alloc.registry import Registry
from alloc.rules import RULES, Allocation, AllocationProblem, Rule
from alloc.simulation import CONTROLLERS, simulate
from alloc.sources import PACKAGES
from studies.files.study_error import StudyError
from studies.scenario.loading import load_scenario

SCENARIO, DURATION = "wet-start", 0.2
"""Event of the trial, and its duration [s]: a few control periods."""
UNITS = 3
"""Units of the problem that a rule is asked about; no shipped train has so many, so that a fixed number is noticed."""

Found = TypeVar("Found")


def try_parts(rules: Iterable[str], controllers: Iterable[str] = ()) -> None:
    """Ask each rule for one small answer; try controllers and metrics that do not come with the project in a short run.

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
    cap = np.linspace(0.1, 0.2, UNITS)
    problem = AllocationProblem(cap=cap, expected=0.16)
    if not is_own(RULES, name):
        try:
            RULES.find(name)(problem)
        except (ValueError, ImportError) as error:
            raise StudyError(" ".join(str(error).split())) from None
        return
    rule = RULES[name]
    if not isinstance(rule, Rule):
        raise _fault(
            RULES, name, f"is a {type(rule).__name__}; register Rule(name, sentence, function)"
        )
    _check_colour(RULES, name)
    answer = called(RULES, name, lambda: rule(problem))
    if not isinstance(answer, Allocation):
        raise _fault(
            RULES, name,
            f"returns {_said(answer)}; return allocation(problem, limit, level, case, solve_time)",
        )  # fmt: skip
    if np.shape(answer.limit) != (UNITS,) or not np.isfinite(answer.limit).all():
        raise _fault(
            RULES, name, f"sets limits {answer.limit} for {UNITS} units; set one finite limit each"
        )


def _try_controller(name: str) -> None:
    found = CONTROLLERS[name]
    if not isinstance(found, HostedController):
        kind = type(found).__name__
        raise _fault(
            CONTROLLERS, name,
            f"is a {kind}; register HostedController(name, meaning, each_unit(class), colour, marker)",
        )  # fmt: skip
    _check_colour(CONTROLLERS, name)
    checked = replace(found, factory=lambda contexts: _checked(found.factory(contexts), name))
    run = called(CONTROLLERS, name, lambda: simulate(_event(), "alone", checked))
    told = attributes_of(run)
    if 0 < told["controller_calls"] == told["controller_failures"]:
        reason = ", ".join(json.loads(told["messages"])).replace("controller: ", "")
        wanted = f"gives no usable torque in a trial run ({reason}); return a finite torque in N m"
        raise _fault(CONTROLLERS, name, wanted)


def _checked(host: Any, name: str) -> Any:
    """A train's controller in Python whose answers are looked at; a compiled one has been looked at by its compiler."""
    if isinstance(host, tuple):
        return host
    if not hasattr(host, "decide"):
        raise _fault(
            CONTROLLERS, name, f"makes a {type(host).__name__} without decide(); define it"
        )
    return (_LookedAtTelling if isinstance(host, TellingController) else _LookedAt)(host, name)


class _LookedAt:
    """A controller whose every answer is checked; a `TrainController`."""

    def __init__(self, host: Any, name: str) -> None:
        self.host, self.name = host, name

    def decide(self, senses: Sequence[UnitSense]) -> Sequence[TorqueDecision]:
        """Answers of the controller; raises `StudyError` for one that is no decision."""
        answers: Sequence[TorqueDecision] = self.host.decide(senses)
        if not isinstance(answers, Sequence) or len(answers) != len(senses):
            wanted = f"{len(senses)} units; return a list with one answer each"
            raise _fault(CONTROLLERS, self.name, f"returns {_said(answers)} for {wanted}")
        for answer in answers:
            if not isinstance(answer, TorqueDecision):
                wanted = "return TorqueDecision(torque, ok, status, solve_time)"
                raise _fault(CONTROLLERS, self.name, f"returns {_said(answer)}; {wanted}")
            if not isinstance(answer.torque, Real):
                wanted = "give one number in N m"
                raise _fault(
                    CONTROLLERS, self.name, f"sets torque {_said(answer.torque)}; {wanted}"
                )
        return answers


class _LookedAtTelling(_LookedAt):
    """The same of a controller whose units tell each other more; a `TellingController`."""

    @property
    def added(self) -> AddedNumbers:
        """What its units tell."""
        added: AddedNumbers = self.host.added
        return added

    def connect(self, reports: Attachment, orders: Attachment) -> None:
        """Hand the arrays on."""
        self.host.connect(reports, orders)


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
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == file]
        place = f" in line {lines[-1]}" if lines else ""
        said = f"{type(error).__name__}: {' '.join(str(error).split()) or 'no message'}"
        raise _fault(registry, name, f"raises {said}{place}; correct the file") from None


def _fault(registry: Registry[Any], name: str, fault: str) -> StudyError:
    return StudyError(f"{registry.kind} {name!r} of {_file(registry, name)!r} {fault}")


def _file(registry: Registry[Any], name: str) -> str:
    module = registry.origin(name)
    return str(getattr(sys.modules.get(module), "__file__", module))


def _said(value: Any) -> str:
    """A value as a message shows it."""
    text = " ".join(repr(value).split())
    return f"{text if len(text) < 60 else text[:60] + ' ...'} ({type(value).__name__})"
