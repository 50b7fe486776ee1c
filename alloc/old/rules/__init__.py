"""Allocation rules: how the units of a train share the effort when adhesion falls short. All on one signature.

A rule registers where it is written.
"""

from typing import TYPE_CHECKING

from alloc.old.registry import names_of

if TYPE_CHECKING:
    from alloc.old.errors import AllocationError
    from alloc.old.rules.exact import Optimality, optimality
    from alloc.old.rules.problem import CASES, Allocation, AllocationProblem
    from alloc.old.rules.qp import robust_rule
    from alloc.old.rules.rule import RULES, Caps, Rule, Trigger, find_rule
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
