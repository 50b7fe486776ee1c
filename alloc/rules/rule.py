"""Definition of an allocation rule, the registry of all rules, and the simplest one: every unit works alone."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from alloc.compilation import jit
from alloc.display import displayed
from alloc.errors import AllocationError
from alloc.registry import Registry
from alloc.rules.problem import (
    CASE_A,
    CASE_B,
    CASE_NONE,
    Allocation,
    AllocationProblem,
    Floats,
    allocation,
    bounds_allow_plan,
)

# Definition of an allocation rule, and the registry of all rules.


class Units(NamedTuple):
    """What a compiled law reads of the units, float64 (n,) each and unchecked, as in `AllocationProblem`."""

    cap: Floats
    mass: Floats
    limit_max: Floats
    previous: Floats
    delivered: Floats
    truth: Floats
    open_to: Floats
    """Coefficient up to which each unit may be asked for more than the plan; inf: it was never limited."""
    plan: float
    """What the driver asks of every unit; the rule may be called with more, to make up for others."""


@displayed
@dataclass(frozen=True)
class Rule:
    """An allocation rule: call it with an `AllocationProblem` to get an `Allocation`.

    A rule has an `answer` in Python or a compiled `law`; it has both where the law leaves out rates of change. Raises
    `AllocationError` where a library that the rule needs is not installed. Several threads may call shipped rules, including
    the same rule: an answer depends on its own call alone. A solver that keeps a workspace answers one call at a time.
    """

    name: str
    description: str
    answer: Callable[[AllocationProblem], Allocation] | None = field(default=None, repr=False)
    """Function that is called under slip; without slip every rule answers with the plan."""
    law: Any = field(default=None, repr=False)
    """Compiled: fills an array of limits from `Units` and the plan; returns level and whether the plan is within reach. The
    array may be that of the previous limits. None if the rule needs Python."""
    periodic: bool = False
    """Whether it is called with every telegram, instead of once per detection of slip."""
    always: bool = False
    """Whether it is called with every telegram, whether or not units are limited."""
    own_caps: bool = False
    """Whether its caps are what each unit finds itself, instead of what (5) derives from the foremost unit's cap."""
    on_slip: bool = False
    """Whether it is called at the foremost unit's slip alone, as JP5484215 says, whatever units report."""
    own_slips: bool = False
    """Whether, called on slip, it receives every unit's detections, each of which is that unit's own cap."""
    onboard: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """Settings of the equipment that belong to the rule, whatever the event says: values by the path of their fields in
    `alloc.onboard.parameters.Onboard`, as "detector.pole"."""
    needs_truth: bool = False
    """Whether it reads true values that no computer on board can know."""
    colour: str = "#402020"
    """Hexadecimal; the same in every figure."""
    marker: str = "h"
    """In figures, as Matplotlib names it."""

    def __call__(self, problem: AllocationProblem) -> Allocation:
        """The rule's answer to `problem`."""
        if not problem.slip:
            return plan(problem)
        return self.answer(problem) if self.answer is not None else self._by_law(problem)

    def _by_law(self, problem: AllocationProblem) -> Allocation:
        """Answer of the law; where limits may change at a rate only, it is cut to what they can reach."""
        started = time.perf_counter()
        limit = np.empty(problem.n)
        level, reached = self.law(units_of(problem), problem.expected, limit)
        if problem.rate is not None:
            lower, upper = problem.rate_box if np.isnan(level) else problem.box
            np.clip(limit, lower, upper, out=limit)
        case = CASE_B if reached else CASE_A
        return allocation(problem, limit, level, case, time.perf_counter() - started)


def units_of(problem: AllocationProblem) -> Units:
    """What compiled laws read of `problem`."""
    cap = np.asarray(problem.cap, dtype=float)
    return Units(
        cap, problem.weight, problem.torque_limit, problem.in_force, problem.obtained, problem.available,
        np.full(problem.n, np.inf), problem.expected,
    )  # fmt: skip


def plan(problem: AllocationProblem) -> Allocation:
    """Every unit at the plan: the answer while nothing slips."""
    limit = np.full(problem.n, problem.expected)
    return allocation(problem, limit, np.nan, CASE_NONE, 0.0)


RULES: Registry[Rule] = Registry(
    "rule", "readhesion.rules", AllocationError, "alloc.rules",
    (
        "alone", "preset", "sharing", "greedy", "greedy-literal", "greedy-tuned", "greedy-claim", "exact", "qp", "qp-cvxpy",
        "qp-robust", "cooperative", "oracle",
    ),
)  # fmt: skip
"""Every rule by name: those of the prior art, the patent's, exact ones, and the one that knows the truth."""


find_rule = RULES.find
"""The rule of a name; raises `AllocationError` with the nearest name for one that does not exist."""


# No redistribution: every unit works alone.


@jit
def alone_law(units, expected, limit_out):
    """Every unit keeps the plan, within its torque limit; only its own readhesion control acts."""
    for j in range(limit_out.size):
        limit_out[j] = min(expected, units.limit_max[j])
    return np.nan, bounds_allow_plan(units.cap, expected, units.mass, units.limit_max)


ALONE = Rule(
    "alone", "every unit keeps the plan and looks after its own slip", law=alone_law,
    colour="#7f7f7f", marker="o",
)  # fmt: skip
RULES.register("alone", ALONE)
