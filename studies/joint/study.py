"""Allocation rules against the joint optimum: one problem of allocation and readhesion over the whole train."""

import pandas as pd

from studies.claims.events import DURATION, event_name, scenario
from studies.claims.measures import measure
from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.joint.statements import ARMS, CLAIMS, OPTIMUM, joint_statements


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` of the claims in every arm; rules are called as the patent is printed, at the foremost unit's slip."""
    one = scenario(seed, k, duration)
    one = one.changed(onboard=one.onboard.model_dump(exclude_unset=True) | {"trigger": "slip"})
    return [Job(one, *arm, k, measure) for arm in (*ARMS, OPTIMUM)]


def numbered(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with the number of their event."""
    numbers = {event_name(seed, k): k for k in range(events)}
    return table.assign(event=table["scenario"].map(numbers))


JOINT = Study(
    name="joint",
    question="how near allocation rules, and the joint problem by telegrams, come to the joint optimum without delay",
    default_events=12,
    cells=EachEvent(cells),
    finish=numbered,
    judge=lambda table: joint_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
