"""Allocation rules: how the units of a train share the effort when adhesion falls short. All on one signature."""

from difflib import get_close_matches

from alloc.rules import kernels
from alloc.rules.allocation import CASES, Allocation
from alloc.rules.optimality import Optimality, optimality
from alloc.rules.problem import AllocationError, AllocationProblem
from alloc.rules.qp import answer_qp
from alloc.rules.qp_cvxpy import answer_qp_cvxpy
from alloc.rules.robust import QP_ROBUST, robust_rule
from alloc.rules.rule import Rule, answer_compiled

_COMPILED = (
    Rule(
        "alone", "every unit keeps the plan and looks after its own slip", answer_compiled, kernels.ALONE
    ),
    Rule(
        "preset", "a fixed part of the front's effort moved to the rear (JP H05-276606)",
        answer_compiled, kernels.PRESET,
    ),
    Rule(
        "sharing", "each unit's shortfall handed to the others step by step (JP 4225233)",
        answer_compiled, kernels.SHARING, periodic=True,
    ),
    Rule(
        "greedy", "the reference: rear caps bound at the next unit's cap (JP5484215 par. 0041, 0049)",
        answer_compiled, kernels.GREEDY,
    ),
    Rule(
        "greedy-claim", "the reference as claim 1 of JP5484215 words it: a running sum",
        answer_compiled, kernels.GREEDY_CLAIM,
    ),
    Rule(
        "exact", "the exact level of JP5484215 par. 0050, weighted with mass", answer_compiled, kernels.EXACT
    ),
)  # fmt: skip
_SOLVED = (
    Rule("qp", "quadratic program: least deviation from the plan (OSQP)", answer_qp),
    Rule("qp-cvxpy", "the same program stated in cvxpy: readable reference, slow", answer_qp_cvxpy),
    QP_ROBUST,
)
_ORACLE = Rule(
    "oracle", "the exact level on the true coefficients: what could be had at best", answer_compiled,
    kernels.ORACLE, periodic=True, needs_truth=True,
)  # fmt: skip

RULES: dict[str, Rule] = {rule.name: rule for rule in (*_COMPILED, *_SOLVED, _ORACLE)}
"""Every rule by name."""


def find_rule(name: str) -> Rule:
    """The rule called `name`; raises `AllocationError` with the nearest name for one that does not exist."""
    if name not in RULES:
        near = get_close_matches(name, RULES, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise AllocationError(f"unknown rule {name!r}; {hint}Known: {', '.join(RULES)}")
    return RULES[name]


__all__ = [
    "CASES",
    "RULES",
    "Allocation",
    "AllocationError",
    "AllocationProblem",
    "Optimality",
    "Rule",
    "find_rule",
    "optimality",
    "robust_rule",
]
