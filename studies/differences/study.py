"""Where greedy, exact level and QP differ: thousands of random problems, and some closed-loop events of each kind."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from alloc.rules import RULES as ALL_RULES
from alloc.rules import AllocationProblem
from studies.claims.measures import measure
from studies.core.code_version import code_hash
from studies.core.job import Job
from studies.core.runner import check_rules, run_jobs
from studies.core.statement import Statement
from studies.core.store import Store
from studies.core.stored_events import stored_table
from studies.differences.kinds import EVENTS, KINDS, event, problem
from studies.differences.statements import difference_statements

DESCRIPTION = "where greedy, exact level and QP differ, by how much, and when it matters"
DEFAULT_EVENTS = 1000
"""Problems of each kind."""
PROBLEMS_PER_EVENT = 50
"""One closed-loop event of each kind for so many problems; two at least."""
RULES = ("greedy", "greedy-claim", "exact", "qp")


TABLE = "differences.parquet"
"""File of the whole table in the sweep's folder."""


def run(
    folder: Path,
    events: int,
    seed: int,
    jobs: int,
    on_row: Callable[[str, int, int], None] | None = None,
    duration: float | None = None,
) -> pd.DataFrame:
    """`events` problems of each kind, and a closed-loop event for every `PROBLEMS_PER_EVENT` of them.

    One row per (part, kind, index, rule): "problem" rows have what `answer_row` gives, "event" rows metrics and measures.
    Events that the store in `folder` holds are not run again; problems take seconds and are, always. Both are written to
    `TABLE` there. `duration` [s] shortens the events.
    """
    store = Store(folder)
    check_rules(RULES)
    rows = [
        {"part": "problem", "kind": kind, "index": k, **row}
        for kind in KINDS
        for k in range(events)
        for row in answer_rows(problem(seed, kind, k))
    ]
    each = max(2, events // PROBLEMS_PER_EVENT)
    scenarios = {(kind, k): event(seed, kind, k) for kind in EVENTS for k in range(each)}
    if duration is not None:
        scenarios = {key: one.changed(duration_s=duration) for key, one in scenarios.items()}
    cells = [
        Job(one, rule, "cut-and-ramp", k) for (_, k), one in scenarios.items() for rule in RULES
    ]
    ran = run_jobs(cells, store, jobs, on_row=on_row, measure=measure)
    names = {one.name: key for key, one in scenarios.items()}
    ran["part"] = "event"
    ran["kind"] = [names[name][0] for name in ran["scenario"]]
    ran["index"] = [names[name][1] for name in ran["scenario"]]
    table = pd.concat([pd.DataFrame(rows), ran], ignore_index=True)
    table.to_parquet(store.folder / TABLE, index=False)
    return table


def stored(folder: Path) -> pd.DataFrame | None:
    """The table that a folder holds, None if there is none or it comes from other code."""
    return stored_table(folder, TABLE, code_hash())


def answer_rows(asked: AllocationProblem) -> list[dict[str, object]]:
    """What each rule answers to a problem, all relative to the plan's coefficient.

    case: that of the patent, which counts caps alone. within_reach: whether caps, torque and rate allow the plan, masses
    counted. effort: mean of what limits and caps allow, weighted with mass. short, over: effort below and above what the
    bounds allow of the plan. beyond: largest limit above what cap, torque and rate allow. apart: largest distance of a
    limit from the exact one. unmet: whether the patent's case is B, and the sum of the limits below the plan.
    """
    answers = {rule: ALL_RULES[rule](asked) for rule in RULES}
    exact = answers["exact"].limit
    plan = asked.expected
    upper = asked.box[1]
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


def statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per kind, one on the QP, one on the reading of claim 1."""
    return difference_statements(table)
