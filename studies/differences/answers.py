"""Answers of rules to random problems, compared with the exact level and with what the bounds allow."""

import numpy as np

from alloc.rules import RULES as ALL_RULES
from alloc.rules import AllocationProblem
from studies.differences.kinds import problem

RULES = ("greedy", "greedy-claim", "exact", "qp")


def problem_rows(seed: int, kind: str, first: int, end: int) -> list[dict[str, object]]:
    """Rows of `answer_rows` for the problems `first` to `end` - 1 of a kind."""
    return [
        {"index": k, **row}
        for k in range(first, end)
        for row in answer_rows(problem(seed, kind, k))
    ]


def answer_rows(asked: AllocationProblem) -> list[dict[str, object]]:
    """Answer of each rule to a problem, all relative to the plan's coefficient.

    - case: that of the patent, which counts caps alone.
    - within_reach: whether caps, torque and rate allow the plan, with masses counted.
    - effort: mean of what limits and caps allow, weighted with mass.
    - short, over: effort below and above what the bounds allow of the plan.
    - beyond: largest limit above what cap, torque and rate allow.
    - apart: largest distance of a limit from the exact one.
    - unmet: whether the patent's case is B, and the sum of the limits below the plan.
    """
    answers = {rule: ALL_RULES[rule](asked) for rule in RULES}
    exact, upper, plan = answers["exact"].limit, asked.box[1], asked.expected
    case = "B" if float(np.asarray(asked.cap, dtype=float).mean()) > plan else "A"
    rows: list[dict[str, object]] = []
    for rule, answer in answers.items():
        effort = answer.usable(asked)
        rows.append(
            {
                "rule": rule,
                "status": "ok" if answer.status == "ok" else "failed",
                "case": case,
                "within_reach": asked.within_reach,
                "effort": effort / plan,
                "short": max(asked.attainable - effort, 0.0) / plan,
                "over": max(effort - asked.attainable, 0.0) / plan,
                "beyond": max(float((answer.limit - upper).max()), 0.0) / plan,
                "apart": float(np.abs(answer.limit - exact).max()) / plan,
                "unmet": case == "B" and float(answer.limit.sum()) < asked.n * plan * (1 - 1e-9),
            }
        )
    return rows
