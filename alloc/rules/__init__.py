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

_BASELINES = ALONE, UNIFORM, PRESET, SHARING, ERP
_PATENT = GREEDY, GREEDY_PRINTED, GREEDY_LITERAL, GREEDY_TUNED, GREEDY_CLAIM
_BEST = EXACT, QP, QP_CVXPY, QP_ROBUST  # the best answer to the same problem
_BY_REPORTS = COOPERATIVE, WEAR, WEAR_QP
for _rule in (*_BASELINES, *_PATENT, *_BEST, *_BY_REPORTS, ORACLE):
    RULES.register(_rule.name, _rule)
