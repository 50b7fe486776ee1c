"""Rows of the readhesion paper's sensitivity grid, and of its cases A and B."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from studies.readhesion_paper.findings import case_findings
from studies.readhesion_paper.paper import CASE_A, CASE_B, Unprinted, run_cases
from studies.readhesion_paper.sensitivity import Cases, grid_tables, search_limits

TOLERANCE = 5e-4
"""To which the limit adhesion coefficient is searched for."""


def searched_rows(
    unprinted: Unprinted,
    margins: Sequence[float],
    widths: Sequence[float],
    step: float,
    curvature: float | None,
) -> list[dict[str, Any]]:
    """Part "indices": rows of `studies.readhesion_paper.paper.assess`; part "limit": limit coefficients.

    `fails_at`: greatest mu_lim tried below the limit without readhesion; `monotone`: whether all above it readhere.
    """
    tables = grid_tables(margins, widths)
    cases = Cases(unprinted, 1, step, curvature)
    found = search_limits(cases, tables, TOLERANCE)
    limits = pd.DataFrame(tables, columns=["margin", "width"]).assign(
        part="limit",
        limit_coefficient=found.limit,
        fails_at=found.fails_at,
        monotone=found.monotone,
    )
    rows = [*cases.table.assign(part="indices").to_dict("records"), *limits.to_dict("records")]
    return [{str(name): value for name, value in row.items()} for row in rows]


def case_rows(unprinted: Unprinted, step: float) -> list[dict[str, Any]]:
    """A row per number of every finding of cases A and B."""
    findings = case_findings(run_cases(unprinted, [CASE_A, CASE_B], step=step))
    return [
        {"finding": name, "met": finding.met, "quantity": quantity, "value": value}
        for name, finding in findings.items()
        for quantity, value in (finding.numbers or {"": np.nan}).items()
    ]
