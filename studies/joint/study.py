"""Allocation rules against the joint optimum: one problem of allocation and readhesion over the whole train."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from studies.claims.events import DURATION, event_name, scenario
from studies.claims.measures import measure
from studies.core.arms import Arm, arm_difference
from studies.core.job import Job
from studies.core.runner import run_jobs
from studies.core.statement import CONDITIONS, CONFIDENCE, FAILS, HOLDS, TOO_FEW, Statement
from studies.core.store import Store
from studies.core.verdict import LEAST_EVENTS
from studies.curves.statements import METRICS

DESCRIPTION = "how near allocation rules, and the joint problem by telegrams, come to the joint optimum without delay"
DEFAULT_EVENTS = 12
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


def run(
    folder: Path,
    events: int,
    seed: int,
    jobs: int,
    on_row: Callable[[str, int, int], None] | None = None,
    duration: float = DURATION,
) -> pd.DataFrame:
    """One row per event and arm: metrics, measures and "event". The events are those of the claims.

    Rows that the store in `folder` holds are not run again. `duration` [s] shortens the events.
    """
    scenarios = {event_name(seed, k): scenario(seed, k, duration) for k in range(events)}
    cells = [
        Job(one, *arm, k) for k, one in enumerate(scenarios.values()) for arm in (*ARMS, OPTIMUM)
    ]
    table = run_jobs(cells, Store(folder), jobs, on_row=on_row, measure=measure)
    return table.assign(event=table["scenario"].map({name: k for k, name in enumerate(scenarios)}))


def statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per arm: does it reach the effort of the joint optimum, and what does it cost besides?"""
    good = table[table["status"] == "ok"]
    return [_statement(good, arm) for arm in ARMS]


def _statement(table: pd.DataFrame, arm: Arm) -> Statement:
    found = {
        f"{text}, less the optimum's": arm_difference(table, arm, OPTIMUM, metric)
        for metric, text in METRICS.items()
    }
    effort = arm_difference(table, arm, OPTIMUM, "held_effort")
    if effort.count < LEAST_EVENTS:
        verdict = TOO_FEW
    elif effort.low > -NEAR:
        verdict = HOLDS
    else:
        verdict = FAILS if effort.high < -NEAR else CONDITIONS
    return Statement(
        f"{arm.rule} under {arm.controller}",
        "reaches the effort of the joint optimum to within a point",
        verdict,
        found,
        ("the interval holds the bound: more events would decide",)
        if verdict == CONDITIONS
        else (),
        f"mean of paired differences; holds if its interval lies above -{NEAR:g}, does not if below; Student's t, "
        f"{CONFIDENCE:.0%}",
    )


__all__ = ["ARMS", "DEFAULT_EVENTS", "DESCRIPTION", "OPTIMUM", "run", "statements"]
