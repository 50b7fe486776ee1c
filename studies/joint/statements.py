"""Statements of the study `joint`: does an arm reach the effort of the joint optimum, and what else does it cost?"""

import pandas as pd

from studies.core.arms import Arm, arm_difference
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement
from studies.core.verdict import Bound, decided
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


def joint_statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per arm, from rows that succeeded."""
    return [_statement(table, arm) for arm in ARMS]


def _statement(table: pd.DataFrame, arm: Arm) -> Statement:
    found = {
        f"{text}, less the optimum's": arm_difference(table, arm, OPTIMUM, metric)
        for metric, text in METRICS.items()
    }
    effort = next(iter(found.values()))
    return decided(
        f"{arm.rule} under {arm.controller}", "reaches the effort of the joint optimum to within a point",
        {"": Bound("", effort, least=-NEAR)}, found,
        f"mean of paired differences; holds if its interval lies above -{NEAR:g}, does not if below, else undecided; "
        f"{INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}",
    )  # fmt: skip
