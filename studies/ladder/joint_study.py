"""Allocation rules against the joint optimum: one problem of allocation and readhesion over the whole train."""

import pandas as pd

from studies.core.claims import AT_LEAST, Claim, conjunction
from studies.core.drawn_events import Arm, paired
from studies.core.job import Job
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement
from studies.core.study import EachEvent, Study
from studies.ladder.curves_study import METRICS
from studies.patent.claim_events import DURATION, event_name, measure, scenario

OPTIMUM = Arm("alone", "mpc-train-ideal")
"""One problem over all units every control period, with no telegram's delay: the optimum of its cost and its belief."""
ARMS = (
    Arm("alone", "cut-and-ramp"),
    Arm("greedy", "cut-and-ramp"),
    Arm("exact", "cut-and-ramp"),
    Arm("alone", "mpc"),
    Arm("greedy", "mpc"),
    Arm("exact", "mpc"),
    Arm("alone", "mpc-train"),
)
NEAR = 0.01
"""Effort over the plan by which an arm may fall short and still count as reaching the optimum's."""


def _less(arm: Arm, metric: str) -> str:
    return f"{metric}@{'/'.join(arm)} - {metric}@{'/'.join(OPTIMUM)}"


CLAIMS = tuple(
    Claim(
        " under ".join(arm), "reaches the effort of the joint optimum to within a point",
        _less(arm, next(iter(METRICS))), AT_LEAST, -NEAR, reason="a hundredth is what a driver could notice in a timetable",
        numbers={f"{text}, less the optimum's": _less(arm, metric) for metric, text in METRICS.items()},
        method=f"mean of paired differences; holds if its interval lies above -{NEAR:g}, does not if below, else undecided; "
        f"{INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}",
    )
    for arm in ARMS
)  # fmt: skip


def joint_statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per arm, from rows that succeeded."""
    rows = table.assign(scenario=table["event"], arm=table["rule"] + "/" + table["controller"])
    events = paired(rows, "arm", METRICS, [])
    return [conjunction(events, claim) for claim in CLAIMS]


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
