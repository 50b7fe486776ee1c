"""What a rule is, and the rules that are compiled."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from alloc.rules.allocation import CASE_A, CASE_B, CASE_NONE, Allocation, allocation
from alloc.rules.exact import box_limits
from alloc.rules.kernels import EXACT, ORACLE, allocate_compiled
from alloc.rules.problem import AllocationProblem, Floats

PRESET_MOVED = 0.1
"""Part of the plan that the preset pattern moves between the train's ends. Its source names none; a tenth is what the
increments (15) add along 8 motor cars, so the pattern is right for the rail that it was preset for."""
SHARING_GAIN = 0.5
"""Share of the shortfall handed on per telegram by dynamic sharing; its source names none."""
SHARING_TOLERANCE = 0.02
"""Shortfall, as a share of the plan, that dynamic sharing takes for none."""

Answer = Callable[["Rule", AllocationProblem], Allocation]


@dataclass(frozen=True)
class Rule:
    """An allocation rule: call it with an `AllocationProblem` to get an `Allocation`.

    Raises `AllocationError` where a library that the rule needs is not installed.
    """

    name: str
    description: str
    answer: Answer = field(repr=False)
    """What is called under slip; without slip every rule answers with the plan."""
    compiled_id: int | None = None
    """Identifier for `alloc.rules.kernels.allocate_compiled`; None if the rule needs Python."""
    periodic: bool = False
    """Whether it is asked with every telegram, instead of once per detection of slip."""
    needs_truth: bool = False
    """Whether it reads what nobody on board can know."""
    parameters: tuple[float, ...] = (PRESET_MOVED, SHARING_GAIN, SHARING_TOLERANCE)
    """Numbers of the rule: `rule_parameters` of `allocate_compiled` where it is compiled, else as its module says."""

    def __call__(self, problem: AllocationProblem) -> Allocation:
        """The rule's answer to `problem`."""
        if not problem.slip:
            return plan(problem)
        return self.answer(self, problem)


def plan(problem: AllocationProblem) -> Allocation:
    """Every unit at the plan: what stands while nothing slips."""
    limit = np.full(problem.n, problem.expected)
    return allocation(problem, limit, np.nan, CASE_NONE, 0.0)


def answer_compiled(rule: Rule, problem: AllocationProblem) -> Allocation:
    """Answer of a compiled rule. A bound on the rate of change is part of the exact levels; others are cut to it."""
    started = time.perf_counter()
    limit = np.empty(problem.n)
    if problem.rate is not None and rule.compiled_id in (EXACT, ORACLE):
        level, case = exact_in_box(problem, rule.compiled_id == ORACLE, limit)
    else:
        assert rule.compiled_id is not None
        level, case = allocate_compiled(
            rule.compiled_id, problem.cap, problem.expected, problem.weight, problem.torque_limit,
            problem.in_force, problem.obtained, problem.available, np.asarray(rule.parameters), limit,
        )  # fmt: skip
        if problem.rate is not None:
            knows_caps = not np.isnan(level)
            lower, upper = problem.box if knows_caps else problem.rate_box
            np.clip(limit, lower, upper, out=limit)
    return allocation(problem, limit, level, case, time.perf_counter() - started)


def exact_in_box(
    problem: AllocationProblem, knows_truth: bool, limit_out: Floats
) -> tuple[float, int]:
    """Fill `limit_out` with the exact limits under rates of change as well; returns level and case."""
    if knows_truth:
        problem = problem.changed(cap=problem.available)
    lower, upper = problem.box
    level, reached = box_limits(lower, upper, problem.weight, problem.expected, limit_out)
    return level, CASE_B if reached else CASE_A
