"""The readhesion paper's sensitivity grid (section 3.3): mu_lim by 0.01, then by 0.002 near the limit, then bisection."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.metrics.search import LimitSearch, limit_coefficient
from studies.readhesion_paper.findings import case_findings
from studies.readhesion_paper.paper import (
    CASE_A,
    CASE_B,
    PAPER_LIMITS,
    PAPER_MARGINS,
    PAPER_WIDTHS,
    STEP,
    Case,
    Unprinted,
    assess,
    run_cases,
)

FINE_STEP = 0.002
"""Step of mu_lim near the limit, section 3.3."""
TOLERANCE = 5e-4
"""To which the limit adhesion coefficient is searched for."""


class Cases:
    """Indices of the requested cases; each is run once."""

    def __init__(
        self,
        unprinted: Unprinted,
        jobs: int = 1,
        step: float = STEP,
        top_curvature: float | None = None,
    ) -> None:
        self._how = (unprinted, jobs, step, top_curvature)
        self._rows: dict[Case, int] = {}
        self.table = pd.DataFrame(columns=list(Case._fields))
        """A row per case, as `assess` gives it, in the order in which they were run."""

    def rows(self, cases: Sequence[Case]) -> pd.DataFrame:
        """Rows of these cases, in their order."""
        # rounded: a coefficient reached by other sums is the same case
        keys = [Case._make(round(float(value), 9) for value in case) for case in cases]
        missing = [key for key in dict.fromkeys(keys) if key not in self._rows]
        if missing:
            new = assess(self._how[0], missing, *self._how[1:])
            self._rows.update({key: len(self._rows) + k for k, key in enumerate(missing)})
            self.table = pd.concat([self.table, new], ignore_index=True) if len(self.table) else new
        return self.table.iloc[[self._rows[key] for key in keys]]


def grid_tables(
    margins: Sequence[float] = PAPER_MARGINS, widths: Sequence[float] = PAPER_WIDTHS
) -> list[tuple[float, float]]:
    """(a_0, a_w) of the grid: every a_0 at the a_w of case A, every a_w at its a_0, once each."""
    pairs = [(margin, CASE_A.width) for margin in margins]
    return list(dict.fromkeys(pairs + [(CASE_A.margin, width) for width in widths]))


def search_limits(
    cases: Cases, tables: Sequence[tuple[float, float]], tolerance: float = FINE_STEP
) -> LimitSearch:
    """Limit adhesion coefficient of each (a_0, a_w): the paper's grid, its fine step, then bisection to `tolerance`.

    Every case on the way stays in `cases.table`.
    """

    def possible(search: NDArray[np.int64], limit: NDArray[np.float64]) -> NDArray[np.bool_]:
        asked = [Case(tables[k][0], tables[k][1], mu) for k, mu in zip(search, limit, strict=True)]
        return cases.rows(asked)["possible"].to_numpy(dtype=bool)

    low, high = min(PAPER_LIMITS), max(PAPER_LIMITS)
    coarse = (high - low) / (len(PAPER_LIMITS) - 1)
    found = limit_coefficient(possible, len(tables), low, high, coarse, len(PAPER_LIMITS) - 2)
    limit, fails_at, monotone = found.limit.copy(), found.fails_at.copy(), found.monotone.copy()
    within = np.flatnonzero(np.isfinite(fails_at))
    fine = round(coarse / FINE_STEP) - 1
    for points, width in ((fine, FINE_STEP), (1, tolerance)):
        if within.size == 0 or width > np.max((limit - fails_at)[within]) - 1e-9:
            continue
        found = limit_coefficient(
            lambda search, limit: possible(within[search], limit),
            within.size, fails_at[within], limit[within], width, points,
        )  # fmt: skip
        limit[within], fails_at[within] = found.limit, found.fails_at
        monotone[within] &= found.monotone
    return LimitSearch(limit, fails_at, monotone)


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
        part="limit", limit_coefficient=found.limit, fails_at=found.fails_at, monotone=found.monotone
    )  # fmt: skip
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
