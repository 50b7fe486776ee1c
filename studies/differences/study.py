"""Where greedy, exact level and QP differ: thousands of random problems, and some closed-loop events of each kind."""

import pandas as pd

from studies.claims.measures import measure
from studies.core.cell import Cell, Task
from studies.core.job import Job
from studies.core.study import Study
from studies.differences.answers import RULES, problem_rows
from studies.differences.kinds import EVENTS, KINDS, event, event_name
from studies.differences.statements import CLAIMS, difference_statements

PROBLEMS_PER_EVENT = 50
"""One closed-loop event of each kind per this number of problems; at least two. Problems are answered in blocks of this
size."""


def cells(seed: int, problems: int, duration: float | None = None) -> list[Cell]:
    """`problems` of each kind, and closed-loop events of each kind; `duration` [s] shortens the events."""
    changed = {} if duration is None else {"duration_s": duration}
    size = PROBLEMS_PER_EVENT
    blocks = [(first, min(first + size, problems)) for first in range(0, problems, size)]
    return [
        *(
            Task(f"{kind}/{seed}/{block[0]}", problem_rows, (seed, kind, *block),
                 (("part", "problem"), ("kind", kind)))
            for kind in KINDS
            for block in blocks
        ),
        *(
            Job(event(seed, kind, k).changed(**changed), rule, "cut-and-ramp", k, measure)
            for kind in EVENTS
            for k in range(_events(problems))
            for rule in RULES
        ),
    ]  # fmt: skip


def _events(problems: int) -> int:
    return max(2, problems // PROBLEMS_PER_EVENT)


def labelled(table: pd.DataFrame, seed: int, problems: int) -> pd.DataFrame:
    """The table with part, kind and index of the closed-loop events too."""
    names = {
        event_name(seed, kind, k): (kind, k) for kind in EVENTS for k in range(_events(problems))
    }
    ran = table["scenario"].isin(names)
    meaning = table.loc[ran, "scenario"].map(names)
    table.loc[ran, "part"] = "event"
    table.loc[ran, "kind"] = meaning.str[0]
    table.loc[ran, "index"] = meaning.str[1]
    return table


DIFFERENCES = Study(
    name="differences",
    question="where greedy, exact level and QP differ, by how much, and when it matters",
    default_events=1000,  # problems of each kind
    step=PROBLEMS_PER_EVENT,
    cells=cells,
    finish=labelled,
    judge=difference_statements,
    claims=CLAIMS,
)
