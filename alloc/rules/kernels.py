"""Every rule that needs no solver, behind one compiled call without allocation, for loops that are compiled themselves."""

import numpy as np

from alloc.compilation import jit
from alloc.rules.allocation import CASE_A, CASE_B, CASE_NONE
from alloc.rules.exact import exact_limits
from alloc.rules.greedy import (
    claim_level,
    description_level,
    highest_cap,
    limits_under,
    within_reach,
)
from alloc.rules.prior_art import alone_limits, preset_limits, sharing_limits

ALONE, PRESET, SHARING, GREEDY, GREEDY_CLAIM, EXACT, ORACLE = 0, 1, 2, 3, 4, 5, 6
"""Identifiers of the compiled rules."""

PRESET_MOVED, SHARING_GAIN, SHARING_TOLERANCE = 0, 1, 2
"""Places in `rule_parameters`."""


@jit
def bounds_allow_plan(cap, expected, mass, limit_max):
    """Whether caps and torque limits allow more than the plan, weighted with mass."""
    balance = 0.0
    for j in range(cap.size):
        balance += mass[j] * (min(cap[j], limit_max[j]) - expected)
    return balance > 0.0


@jit
def allocate_compiled(
    rule_id, cap, expected, mass, limit_max, previous, delivered, truth, rule_parameters, limit_out
):
    """Limits under slip by the rule `rule_id`, written to `limit_out`; returns (level, case).

    All arrays are float64 (n,), as in `AllocationProblem`, except `rule_parameters` (3,). They are not checked. A rule
    reads only what it needs of `previous`, `delivered` and `truth`, so any array may stand in for the rest; `limit_out`
    may be the same array as `previous`. The level is nan for rules that have none. Rates of change are not known here.
    An unknown `rule_id` gives the plan with `CASE_NONE`.
    """
    level = np.nan
    if rule_id in (GREEDY, GREEDY_CLAIM):
        reached = within_reach(cap, expected)
        if not reached:
            level = highest_cap(cap)
        elif rule_id == GREEDY:
            level = description_level(cap, expected)
        else:
            level = claim_level(cap, expected)
        limits_under(level, cap, limit_max, limit_out)
    elif rule_id == EXACT:
        level, reached = exact_limits(cap, expected, mass, limit_max, limit_out)
    elif rule_id == ORACLE:
        level, reached = exact_limits(truth, expected, mass, limit_max, limit_out)
    else:
        reached = bounds_allow_plan(cap, expected, mass, limit_max)
        if rule_id == PRESET:
            preset_limits(expected, mass, limit_max, rule_parameters[PRESET_MOVED], limit_out)
        elif rule_id == SHARING:
            sharing_limits(
                expected,
                mass,
                limit_max,
                previous,
                delivered,
                rule_parameters[SHARING_GAIN],
                rule_parameters[SHARING_TOLERANCE],
                limit_out,
            )
        else:
            alone_limits(expected, limit_max, limit_out)
            if rule_id != ALONE:
                return level, CASE_NONE
    return level, CASE_B if reached else CASE_A
