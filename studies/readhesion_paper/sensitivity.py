"""The readhesion paper's sensitivity grid (section 3.3): mu_lim by 0.01, then by 0.002 near the limit, then bisection."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.metrics.readhesion import LimitSearch, limit_coefficient
from studies.readhesion_paper.paper import (
    CASE_A,
    PAPER_LIMITS,
    PAPER_MARGINS,
    PAPER_WIDTHS,
    STEP,
    Case,
    Unprinted,
    assess,
)

FINE_STEP = 0.002
"""Step of mu_lim near the limit, section 3.3."""


class Cases:
    """Indices of the cases asked for; each is run once."""

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
    limit, fails_at, monotone = (
        found.limit.copy(), found.fails_at.copy(), found.monotone.copy()
    )  # fmt: skip
    within = np.flatnonzero(np.isfinite(fails_at))
    fine = round(coarse / FINE_STEP) - 1
    for points, width in ((fine, FINE_STEP), (1, tolerance)):
        if within.size == 0 or width > np.max((limit - fails_at)[within]) - 1e-9:
            continue

        def possible_within(
            search: NDArray[np.int64], limit: NDArray[np.float64]
        ) -> NDArray[np.bool_]:
            return possible(within[search], limit)

        found = limit_coefficient(
            possible_within, within.size, fails_at[within], limit[within], width, points
        )
        limit[within], fails_at[within] = found.limit, found.fails_at
        monotone[within] &= found.monotone
    return LimitSearch(limit, fails_at, monotone)
