"""Definition of an allocation rule, the registry of all rules, and the simplest one: every unit works alone.

A rule is an answer to a problem, with two choices beside it: when it is asked (`Trigger`), and what it is given (`Caps`).
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numba import types

from alloc.old.compilation import jit
from alloc.old.display import displayed
from alloc.old.errors import AllocationError
from alloc.old.records import stored_at
from alloc.old.registry import Registry
from alloc.old.rules.problem import (
    CASE_A,
    CASE_B,
    CASE_NONE,
    Allocation,
    AllocationProblem,
    Floats,
    allocation,
    bounds_allow_plan,
)


class Trigger(IntEnum):
    """When the leader, the foremost unit that works, asks a rule. Those before `SLIP` go by what units report."""

    LIMITED = 0
    """With every telegram while a unit is limited by the rail, by its motors' power or by a failure."""
    STEPWISE = 1
    """As `LIMITED`; each answer is a step from the limits in force."""
    TELEGRAM = 2
    """With every telegram, whether or not a unit is limited."""
    SLIP = 3
    """Once at each slip detection of the leader; limits are held for the hold time."""
    SLIPPING = 4
    """With every telegram while the leader slips, and for the hold time after."""
    ANY_SLIP = 5
    """At each slip detection of any unit; limits are held for the hold time."""
    PERIOD = 6
    """In every control period."""


AT_SLIP = {
    Trigger.LIMITED: Trigger.SLIP,
    Trigger.STEPWISE: Trigger.SLIPPING,
    Trigger.TELEGRAM: Trigger.SLIP,
}
"""Trigger in its place where an event asks rules at slip alone; only for rules whose caps are `Caps.FRONT`."""


class Caps(IntEnum):
    """Coefficients that a rule is given as what each unit can carry."""

    FRONT = 0
    """JP5484215 (5): what the foremost unit that the rail limits has shown, and the increments along the train."""
    DETECTED = 1
    """What each unit carried at its own slip detection; (5) from the foremost of these for those behind it."""
    DELIVERED = 2
    """What each limited unit delivers; what each other unit has shown to carry."""
    PREVIEW = 3
    """As `DELIVERED`; and the true peak ahead of every unit but the leader, as if the units ahead had measured it."""
    TRUE = 4
    """The truth, which no computer on board can know."""


TRIGGERS = {
    Caps.FRONT: (
        Trigger.LIMITED, Trigger.STEPWISE, Trigger.TELEGRAM, Trigger.SLIP, Trigger.SLIPPING
    ),
    Caps.DETECTED: (Trigger.ANY_SLIP,),
    Caps.DELIVERED: (Trigger.LIMITED, Trigger.TELEGRAM),
    Caps.PREVIEW: (Trigger.LIMITED, Trigger.TELEGRAM),
    Caps.TRUE: (Trigger.PERIOD,),
}  # fmt: skip
"""Triggers that go with caps; a rule with others is refused."""


PROMISES = ("exact", "reference", "heuristic", "baseline")
"""What a rule may promise, see `alloc.old.rules.testing`; each includes those behind it. Exact: the optimum. Reference: where
caps grow along the train and bound the units alone, an answer as near to the plan as the reference rule's. Heuristic: it
asks for no more than the plan where it goes beyond caps. Baseline: what every rule keeps, though it may ask for anything."""


class Units(NamedTuple):
    """What a compiled law reads of the units, float64 (n,) each and unchecked, as in `AllocationProblem`."""

    cap: Floats
    mass: Floats
    limit_max: Floats
    previous: Floats
    delivered: Floats
    truth: Floats
    """Inf where a rule that is told the truth is not told that of a unit."""
    upper_bound: Floats
    """Coefficient up to which each unit may be asked for more than the plan; inf: it was never limited."""
    mark: Floats
    """Coefficient that each unit has shown to carry; one that was never limited counts as the best of the others."""
    plan: float
    """What the driver asks of every unit; the rule may be called with more, to make up for others."""


LAW = types.FunctionType(
    types.Tuple((types.float64, types.boolean))(
        types.NamedTuple((types.float64[::1],) * 8 + (types.float64,), Units),
        types.float64,
        types.float64[::1],
    )
)
"""A compiled law, see `Rule.law`, whose address the loop of a run is given."""
law_at = stored_at(LAW)


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
    trigger: Trigger = Trigger.LIMITED
    """When it is asked."""
    caps: Caps = Caps.FRONT
    """What it is given as each unit's cap."""
    promise: str = "heuristic"
    """How good its answers are, one of `PROMISES`; its tests follow from it."""
    onboard: Mapping[str, Any] = field(default_factory=dict, hash=False)
    """Settings of the equipment that belong to the rule, whatever the event says: values by the path of their fields in
    `alloc.old.onboard.parameters.Onboard`, as "detector.pole"."""
    colour: str = "#402020"
    """Hexadecimal; the same in every figure."""
    marker: str = "h"
    """In figures, as Matplotlib names it."""

    def __post_init__(self) -> None:
        for name, kind in (("trigger", Trigger), ("caps", Caps)):
            if not isinstance(getattr(self, name), kind):
                choices = ", ".join(f"{kind.__name__}.{one.name}" for one in kind)
                raise AllocationError(
                    f"rule {self.name!r}: {name} = {getattr(self, name)!r} must be one of {choices}"
                )
        AllocationError.check_choice(f"rule {self.name!r}", "promise", self.promise, PROMISES)
        able = TRIGGERS[self.caps]
        if self.trigger not in able:
            names = " or ".join(one.name for one in able)
            raise AllocationError(
                f"rule {self.name!r}: trigger {self.trigger.name} does not go with caps {self.caps.name}; choose {names}"
            )

    def promising(self, promise: str) -> "Rule":
        """The same rule with another promise."""
        return replace(self, promise=promise)

    @property
    def needs_truth(self) -> bool:
        """Whether it reads true values that no computer on board can know."""
        return self.caps is Caps.TRUE

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
        problem.searching, problem.peak, problem.own_plan,
    )  # fmt: skip


def plan(problem: AllocationProblem) -> Allocation:
    """Every unit at the plan: the answer while nothing slips."""
    limit = np.full(problem.n, problem.expected)
    return allocation(problem, limit, np.nan, CASE_NONE, 0.0)


RULES: Registry[Rule] = Registry(
    "rule", "readhesion.rules", AllocationError, "alloc.old.rules",
    (
        "alone", "plan-times", "uniform", "preset", "sharing", "erp", "greedy", "greedy-printed", "greedy-literal",
        "greedy-tuned", "greedy-claim", "exact", "qp", "qp-daqp", "qp-cvxpy", "qp-robust", "cooperative", "wear", "wear-qp",
        "wear-cvxpy", "preview", "oracle",
    ),
)  # fmt: skip
"""Every rule by name: baselines and prior art, the patent's, exact ones, and the one that knows the truth."""


find_rule = RULES.find
"""The rule of a name; raises `AllocationError` with the nearest name for one that does not exist."""


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
