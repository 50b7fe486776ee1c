"""Allocation rules: how the units of a train share the effort when adhesion falls short. All on one signature.

A rule registers where it is written.
"""

from typing import TYPE_CHECKING

from alloc.registry import names_of

if TYPE_CHECKING:
    from alloc.errors import AllocationError
    from alloc.rules.exact import Optimality, optimality
    from alloc.rules.problem import CASES, Allocation, AllocationProblem
    from alloc.rules.qp import robust_rule
    from alloc.rules.rule import RULES, Caps, Rule, Trigger, find_rule
else:
    __getattr__ = names_of(
        __name__,
        exact="Optimality optimality",
        problem="CASES Allocation AllocationError AllocationProblem",
        qp="robust_rule",
        rule="RULES Caps Rule Trigger find_rule",
    )

__all__ = [
    "CASES",
    "RULES",
    "Allocation",
    "AllocationError",
    "AllocationProblem",
    "Caps",
    "Optimality",
    "Rule",
    "Trigger",
    "find_rule",
    "optimality",
    "robust_rule",
]
