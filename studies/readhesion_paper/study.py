"""Sensitivity of the readhesion paper's controller (section 3.3): readhesion, adhesion used and limit over a_0 and a_w."""

from collections.abc import Sequence

from studies.core.cell import Task
from studies.core.study import Study
from studies.readhesion_paper.paper import (
    CALIBRATED,
    PAPER_LIMITS,
    PAPER_MARGINS,
    PAPER_WIDTHS,
    STEP,
    Unprinted,
)
from studies.readhesion_paper.sensitivity import case_rows, searched_rows
from studies.readhesion_paper.statements import readhesion_statements

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
) -> list[Task]:
    """The grid under each parabola, and the cases A and B; seed and events change nothing, since nothing is random."""
    return [
        *(
            Task(name, searched_rows, (unprinted, tuple(margins), tuple(widths), step, curvature),
                 (("parabola", name),))
            for name, curvature in PARABOLAS.items()
        ),
        Task("cases A and B", case_rows, (unprinted, step), (("part", "case"),)),
    ]  # fmt: skip


READHESION = Study(
    name="readhesion",
    question="what the readhesion paper found of its torque table: cases A and B, a_0, a_w",
    default_events=1,
    cells=cells,
    judge=lambda table: readhesion_statements(table, PRINTED, NARROW),
    whole=True,
)
