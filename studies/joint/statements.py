"""Claims of the study `joint`: does an arm reach the effort of the joint optimum, and what else does it cost?"""

import pandas as pd

from studies.core.claims import AT_LEAST, Claim, conjunction
from studies.core.drawn_events import Arm, paired
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement
from studies.curves.statements import METRICS

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
