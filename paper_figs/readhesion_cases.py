"""Runs that the readhesion paper's figures show, and what these figures share: colours and panels over time."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes

from studies.readhesion_paper.lanes import TableRuns
from studies.readhesion_paper.paper import (
    CALIBRATED,
    CASE_A,
    CASE_B,
    DROP,
    RECOVERY,
    Case,
    Unprinted,
    run_cases,
)

CASES: dict[str, Case] = {"A": CASE_A, "B": CASE_B}
COLOURS = {"A": "#0072b2", "B": "#d55e00"}
"""Colour of each case in every figure."""
SECOND, THIRD = "#000000", "#e69f00"
"""Colours of what is drawn beside a case's own quantity."""
FROM, UNTIL = 5.0, 15.0
"""Times [s] that the paper's figures show."""


@lru_cache(maxsize=4)
def case_runs(
    cases: tuple[Case, ...] = tuple(CASES.values()), unprinted: Unprinted = CALIBRATED
) -> TableRuns:
    """Runs of Table 2, the rail's recovery included; a lane per case."""
    return run_cases(unprinted, cases, recovers=True)


def on_coefficient_scale(runs: TableRuns, lane: int) -> np.ndarray:
    """Torque on the scale of the coefficient, (instants,): the tangential force it would hold at the wheel.

    By R_g/(W g r) M/(M + J/r2): of the motor's torque at the rim, the share that accelerates the wheelset itself at the
    train's acceleration is left out, so that torque and coefficient lie on each other as long as nothing slips.
    """
    return np.asarray(runs.torque[:, lane] / runs.torque_per_coefficient)


def heading(name: str, case: Case) -> str:
    """Title of a case."""
    return (
        f"case {name}: $a_w$ = {case.width:g}, $a_0$ = {case.margin:g} km/h/s, "
        rf"$\mu_\mathrm{{lim}}$ = {case.limit:g}"
    )


def over_time(axes: Axes, begin: float = FROM, end: float = UNTIL) -> None:
    """Mark when the rail is low, on an axis over time [s]."""
    axes.axvspan(DROP, RECOVERY, color="#000000", alpha=0.05, linewidth=0)
    axes.set_xlim(begin, end)


def last_label(columns: Sequence[Axes]) -> None:
    """Label the time of the last of several panels."""
    columns[-1].set_xlabel("time [s]")
