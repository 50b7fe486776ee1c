"""Allocation rules: how the units of a train share the effort when adhesion falls short.

Read `reference` first, the patent's rule in plain Python; then `problem`, what every rule is asked; then `exact`.
"""

from alloc.rules.baselines import ALONE, ERP, PRESET, SHARING, UNIFORM
from alloc.rules.convex import QP_CVXPY, QP_ROBUST, WEAR_QP, convex_rule, robust_rule
from alloc.rules.cooperative import COOPERATIVE, WEAR
from alloc.rules.exact import EXACT, ORACLE, exact_limits
from alloc.rules.patent import GREEDY, GREEDY_CLAIM, GREEDY_LITERAL, GREEDY_PRINTED, GREEDY_TUNED
from alloc.rules.problem import Allocation, AllocationProblem, allocated, optimality
from alloc.rules.qp import QP
from alloc.rules.reference import reference_rule
from alloc.rules.rule import PROMISES, RULES, Rule

__all__ = [
    "PROMISES", "RULES", "Allocation", "AllocationProblem", "Rule", "allocated", "convex_rule", "exact_limits", "optimality",
    "reference_rule", "robust_rule",
]  # fmt: skip

for _rule in (
    ALONE, UNIFORM, PRESET, SHARING, ERP,  # what a method must beat
    GREEDY, GREEDY_PRINTED, GREEDY_LITERAL, GREEDY_TUNED, GREEDY_CLAIM,  # the patent's
    EXACT, QP, QP_CVXPY, QP_ROBUST,  # the best answer to the same problem
    COOPERATIVE, WEAR, WEAR_QP,  # from what units report
    ORACLE,  # knows the rail
):  # fmt: skip
    RULES.register(_rule.name, _rule)
