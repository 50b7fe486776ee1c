"""Allocation rules: how the units of a train share the effort when adhesion falls short.

Read `reference` first, the patent's rule in plain Python; then `problem`, what every rule is asked; then `exact`. A file for
each family ends with the registration of its rules.
"""

from alloc.rules.convex import convex_rule, robust_rule
from alloc.rules.exact import exact_limits
from alloc.rules.problem import Allocation, AllocationProblem, allocated, optimality
from alloc.rules.reference import reference_rule
from alloc.rules.rule import PROMISES, RULES, Rule

__all__ = [
    "PROMISES",
    "RULES",
    "Allocation",
    "AllocationProblem",
    "Rule",
    "allocated",
    "convex_rule",
    "exact_limits",
    "optimality",
    "reference_rule",
    "robust_rule",
]
