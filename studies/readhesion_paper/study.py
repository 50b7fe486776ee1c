"""Sensitivity of the readhesion paper's controller (section 3.3) over a_0 and a_w, and what its ensemble leaves open.

Rows with a unit are those of the ensemble's members, in that unit of a_0 and a_w; those without are of the set in use.
"""

from collections.abc import Sequence
from typing import Any

from studies.core.cell import Task
from studies.core.study import Study
from studies.readhesion_paper.calibration import CALIBRATION_STEP
from studies.readhesion_paper.members import MEMBERS
from studies.readhesion_paper.paper import (
    CALIBRATED,
    PAPER_LIMITS,
    PAPER_MARGINS,
    PAPER_WIDTHS,
    RIVAL,
    STEP,
    Unprinted,
)
from studies.readhesion_paper.sensitivity import case_rows, searched_rows
from studies.readhesion_paper.statements import STATED, readhesion_statements

MOST_MEMBERS = 8
"""Members in each unit whose whole grid is run: 5 s each."""
PRINTED, NARROW = "as printed", "narrow throughout"
PARABOLAS: dict[str, float | None] = {PRINTED: None, NARROW: 0.25 * 5.0**2 / min(PAPER_LIMITS)}
"""Curvature of the curve's parabola: as printed, and narrowed by the plant only where the curve would not exist otherwise
(mu_max < 0.156); or so narrow from the start that the plant narrows it nowhere."""


def cells(
    seed: int,
    events: int,
    unprinted: Unprinted = CALIBRATED,
    margins: Sequence[float] = PAPER_MARGINS,
    widths: Sequence[float] = PAPER_WIDTHS,
    step: float = STEP,
) -> list[Task]:  # fmt: skip
    """The grid under each parabola, and the cases A and B; then of the first `events` members in each unit.

    Nothing is random, so the seed changes nothing.
    """
    grid = tuple(margins), tuple(widths)
    return [
        *(
            Task(name, searched_rows, (unprinted, *grid, step, curvature), (("parabola", name),))
            for name, curvature in PARABOLAS.items()
        ),
        Task("cases A and B", case_rows, (unprinted, step), (("part", "case"),)),
        *(
            Task(
                f"member/{unit}/{k}", member_rows, (one, *grid, _step(step, one)),
                (("unit", unit), ("member", k)),
            )
            for unit, sets in MEMBERS.items()
            for k, one in enumerate(sets[:events])
        ),
    ]  # fmt: skip


def _step(step: float, one: Unprinted) -> float:
    """The set that is drawn in the other unit is as exact as the one in use; other members are as in calibration."""
    return step if one == RIVAL else max(step, CALIBRATION_STEP)


def member_rows(
    unprinted: Unprinted, margins: Sequence[float], widths: Sequence[float], step: float
) -> list[dict[str, Any]]:
    """Cases A and B and the grid of a set of the ensemble, with the parabola as printed."""
    cases = [{"part": "case", **row} for row in case_rows(unprinted, step)]
    return [*cases, *searched_rows(unprinted, margins, widths, step, PARABOLAS[PRINTED])]


READHESION = Study(
    name="readhesion",
    question="what the readhesion paper found of its torque table: cases A and B, a_0, a_w",
    default_events=MOST_MEMBERS,  # members of the ensemble in each unit
    cells=cells,
    judge=lambda table: readhesion_statements(table, PRINTED, NARROW),
    claims=STATED,
    whole=True,
)
