"""A rule of one's own: the deficit goes to the units with most adhesion to spare, in proportion to what they can spare."""

import time

import numpy as np

from alloc.rules import RULES, Caps, Rule
from alloc.rules.problem import CASE_A, CASE_B, allocation


def answer(problem):
    """Every unit at its cap where it is short; the others take over in proportion to cap less plan."""
    started = time.perf_counter()
    lower, upper = problem.box
    short = np.minimum(upper, problem.expected)
    spare = np.maximum(upper - problem.expected, 0.0)
    lacking = float(problem.weight @ (problem.expected - short))
    available = float(problem.weight @ spare)
    share = min(lacking / available, 1.0) if available > 0.0 else 1.0
    limit = np.clip(short + share * spare, lower, upper)
    case = CASE_B if available > lacking else CASE_A
    return allocation(problem, limit, np.nan, case, time.perf_counter() - started)


# told what each limited unit delivers, not what the foremost one has shown
TEXT = "the deficit in proportion to what units can spare"
RULES.register("weighted", Rule("weighted", TEXT, answer, caps=Caps.DELIVERED))
