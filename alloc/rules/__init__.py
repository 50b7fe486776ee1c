"""Allocation rules: how the units of a train share the effort when adhesion falls short. All on one signature.

A rule registers where it is written; those with a compiled law are named in `alloc.rules.dispatch` too.
"""

from typing import TYPE_CHECKING

from alloc.lazy import names_of

if TYPE_CHECKING:
    from alloc.errors import AllocationError
    from alloc.rules.allocation import CASES, Allocation
    from alloc.rules.optimality_check import Optimality, optimality
    from alloc.rules.problem import AllocationProblem
    from alloc.rules.qp_robust import robust_rule
    from alloc.rules.rule import RULES, Rule, find_rule
else:
    __getattr__ = names_of(
        __name__,
        allocation="CASES Allocation",
        optimality_check="Optimality optimality",
        problem="AllocationError AllocationProblem",
        qp_robust="robust_rule",
        rule="RULES Rule find_rule",
    )

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
