"""Sensitivity of the readhesion paper's controller (section 3.3): readhesion, adhesion used and limit over a_0 and a_w."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from studies.core.code_version import hash_with
from studies.core.statement import Statement
from studies.core.store import Store
from studies.core.stored_events import stored_table
from studies.readhesion_paper import findings as readhesion_findings
from studies.readhesion_paper import grid as readhesion_grid
from studies.readhesion_paper import paper as readhesion_paper
from studies.readhesion_paper.findings import Finding, case_findings
from studies.readhesion_paper.grid import Cases, grid_tables, search_limits
from studies.readhesion_paper.paper import (
    CALIBRATED,
    CASE_A,
    CASE_B,
    PAPER_LIMITS,
    PAPER_MARGINS,
    PAPER_WIDTHS,
    STEP,
    Unprinted,
    run_cases,
)
from studies.readhesion_paper.statements import readhesion_statements

DESCRIPTION = "what the readhesion paper found of its torque table: cases A and B, a_0, a_w"
DEFAULT_EVENTS = 1
"""Nothing is random here: more events add nothing."""
TOLERANCE = 5e-4
"""To which the limit adhesion coefficient is searched for."""
TABLE = "readhesion.parquet"
PRINTED, NARROW = "as printed", "narrow throughout"
PARABOLAS: dict[str, float | None] = {
    PRINTED: None,
    NARROW: 0.25 * 5.0**2 / min(PAPER_LIMITS),
}
"""Curvature of the curve's parabola: as printed, and narrowed by the plant only where the curve would not exist otherwise
(mu_max < 0.156); or so narrow from the start that the plant narrows it nowhere."""

OnRow = Callable[[str, int, int], None]


def run(
    folder: Path,
    events: int,
    seed: int,
    jobs: int,
    on_row: OnRow | None = None,
    unprinted: Unprinted = CALIBRATED,
    margins: Sequence[float] = PAPER_MARGINS,
    widths: Sequence[float] = PAPER_WIDTHS,
    step: float = STEP,
) -> pd.DataFrame:
    """The table of all runs, kept in `folder`; `events` and `seed` change nothing, since nothing is random.

    Rows of part "indices" are those of `studies.readhesion_paper.paper.assess`, of part "limit" their
    `limit_coefficient` (`fails_at`: greatest mu_lim tried below it without readhesion; `monotone`), for each `parabola`;
    of part "case" the numbers of the findings of cases A and B.
    """
    store = Store(folder)
    known = stored(folder)
    full = (unprinted, tuple(margins), tuple(widths), step) == (
        CALIBRATED, PAPER_MARGINS, PAPER_WIDTHS, STEP
    )  # fmt: skip
    if full and known is not None:
        return known
    tables = grid_tables(margins, widths)
    parts = []
    for k, (name, curvature) in enumerate(PARABOLAS.items()):
        if on_row is not None:
            on_row(f"parabola {name}", k, len(PARABOLAS) + 1)
        parts.append(_searched(Cases(unprinted, jobs, step, curvature), tables, name))
    if on_row is not None:
        on_row("cases A and B", len(PARABOLAS), len(PARABOLAS) + 1)
    runs = run_cases(unprinted, [CASE_A, CASE_B], step=step)
    parts.append(pd.DataFrame(_case_rows(case_findings(runs))))
    table = pd.concat(parts, ignore_index=True).assign(code_hash=_hash())
    if not full:
        return table
    table.to_parquet(store.folder / TABLE, index=False)
    return pd.read_parquet(store.folder / TABLE)  # as a later call gives it


def stored(folder: Path) -> pd.DataFrame | None:
    """The whole table that a folder holds, None if there is none or it comes from other code."""
    return stored_table(folder, TABLE, _hash())


def statements(table: pd.DataFrame) -> list[Statement]:
    """Every finding of the paper: whether it holds here, and the numbers."""
    return readhesion_statements(table, PRINTED, NARROW)


def _searched(cases: Cases, tables: list[tuple[float, float]], name: str) -> pd.DataFrame:
    found = search_limits(cases, tables, TOLERANCE)
    limits = pd.DataFrame(tables, columns=["margin", "width"]).assign(
        part="limit",
        limit_coefficient=found.limit,
        fails_at=found.fails_at,
        monotone=found.monotone,
    )
    both = pd.concat([cases.table.assign(part="indices"), limits], ignore_index=True)
    return both.assign(parabola=name)


def _case_rows(findings: dict[str, Finding]) -> list[dict[str, object]]:
    """A row per number of every finding."""
    return [
        {
            "part": "case",
            "finding": name,
            "met": finding.met,
            "quantity": quantity,
            "value": value,
        }
        for name, finding in findings.items()
        for quantity, value in (finding.numbers or {"": np.nan}).items()
    ]


def _hash() -> str:
    modules = (readhesion_findings, readhesion_grid, readhesion_paper)
    return hash_with(__file__, *(str(module.__file__) for module in modules))


__all__ = ["DEFAULT_EVENTS", "DESCRIPTION", "run", "statements", "stored"]
