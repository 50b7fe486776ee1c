"""The rule of a run inside compiled code: every rule that has a compiled law, behind one call without allocation."""

from typing import Any

import numpy as np

from alloc.compilation import equation, jit
from alloc.rules.baselines import ERP, PLAN_TIMES, UNIFORM
from alloc.rules.exact import COOPERATIVE, EXACT, ORACLE
from alloc.rules.patent import GREEDY, GREEDY_CLAIM
from alloc.rules.prior_art import PRESET, SHARING
from alloc.rules.problem import CASE_A, CASE_B, CASE_NONE
from alloc.rules.rule import ALONE, Rule
from alloc.rules.wear import WEAR

COMPILED: tuple[Rule, ...] = (
    ALONE,
    PLAN_TIMES,
    UNIFORM,
    PRESET,
    SHARING,
    ERP,
    GREEDY,
    GREEDY_CLAIM,
    EXACT,
    COOPERATIVE,
    ORACLE,
    WEAR,
)
"""Rules that compiled code knows, by their place here; a rule registered at run time is called in Python."""


def _case(index: int, law: Any, otherwise: Any) -> Any:
    """Law of a run: `law` where its rule has this index, else `otherwise`."""

    @equation
    def choose(rule, units, expected, limit_out):
        if rule == index:
            level, reached = law(units, expected, limit_out)
            return level, CASE_B if reached else CASE_A
        else:
            return otherwise(rule, units, expected, limit_out)

    return choose


@equation
def _keep_plan(rule, units, expected, limit_out):
    for j in range(limit_out.size):
        limit_out[j] = min(expected, units.limit_max[j])
    return np.nan, CASE_NONE


_answer: Any = _keep_plan
for _index, _rule in reversed(list(enumerate(COMPILED))):
    _answer = _case(_index, _rule.law, _answer)


@jit
def allocate_compiled(rule, units, expected, limit_out):
    """Limits under slip by the rule `rule`, a place in `COMPILED`, written to `limit_out`; returns level and case.

    `units`: `alloc.rules.rule.Units`, unchecked; `limit_out` may be `units.previous`. The level is nan for rules that have
    none. Rates of change are not known here. An unknown rule gives the plan.
    """
    return _answer(rule, units, expected, limit_out)


def compiled_index(rule: Rule) -> int:
    """Place of `rule` in `COMPILED`; -1 if it is called in Python."""
    return next((k for k, one in enumerate(COMPILED) if one.law is rule.law), -1)
