"""What the sweep `readhesion` says: the paper's findings one by one, and what this plant's reading of them does."""

import math

import pandas as pd

from studies.core.statement import Statement
from studies.core.verdict import decided, over_cases
from studies.readhesion_paper.findings import CLAIMS, Finding, grid_findings

SETTLED_BELOW = 0.01
"""Largest change of a limit adhesion coefficient that leaves the paper's figures as they are: a step of its grid."""
EXISTS_FROM = 5.0**2 / (4.0 * 40.0)
"""Least mu_max at which g1 = 5 and C = 40 make a curve: (2) with mu_max, g1^2/(4 C)."""
METHOD = (
    "no randomness: each number is that of one run or of all runs of the grid; bounds in "
    "studies/readhesion_paper/findings.py"
)


def readhesion_statements(table: pd.DataFrame, printed: str, narrow: str) -> list[Statement]:
    """Statements on `CLAIMS`, on the limit adhesion coefficient, and on the parabola (names of both in the table)."""
    indices, limits = (_by_parabola(table, part) for part in ("indices", "limit"))
    findings = {name: grid_findings(_typed(indices[name])) for name in (printed, narrow)}
    open_part = indices[narrow]["limit"].astype(float) < EXISTS_FROM
    kept_part = indices[printed]["limit"].astype(float) >= EXISTS_FROM
    mixed = pd.concat([indices[printed][kept_part], indices[narrow][open_part]])
    narrow_below = grid_findings(_typed(mixed))
    cases = _cases(table[table["part"] == "case"])
    return [
        *(_statement(name, {**cases, **findings[printed]}[name]) for name in CLAIMS),
        _limit_exists(limits[printed]),
        _parabola(findings[printed], narrow_below, findings[narrow], limits[printed], limits[narrow]),
    ]  # fmt: skip


def _by_parabola(table: pd.DataFrame, part: str) -> dict[str, pd.DataFrame]:
    rows = table[table["part"] == part]
    return {str(name): rows[rows["parabola"] == name] for name in rows["parabola"].unique()}


def _typed(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of one part: a column that other parts lack has lost its type to missing values."""
    return rows.assign(possible=rows["possible"].astype(bool))


def _cases(rows: pd.DataFrame) -> dict[str, Finding]:
    found = {}
    for name, own in rows.groupby("finding", sort=False):
        numbers = {q: float(v) for q, v in zip(own["quantity"], own["value"], strict=True) if q}
        found[str(name)] = Finding(bool(own["met"].iloc[0]), math.nan, numbers)
    return found


def _statement(name: str, finding: Finding) -> Statement:
    return decided(name, CLAIMS[name], {"": finding.met}, finding.numbers, METHOD)


def _limit_exists(limits: pd.DataFrame) -> Statement:
    """Section 3.2 takes for granted that what readheres at one coefficient does so at every greater one."""
    some = limits[limits["limit_coefficient"].notna()]
    met = {
        f"not with a_0 {row.margin:g}, a_w {row.width:g}": bool(row.monotone)
        for row in some.itertuples()
    }
    return over_cases(
        "limit exists", "what readheres at one adhesion coefficient does so at every greater one", met,
        {"controllers with a limit": len(some), "of them not so": list(met.values()).count(False)}, METHOD,
    )  # fmt: skip


def _parabola(
    printed: dict[str, Finding], narrow_below: dict[str, Finding], narrow: dict[str, Finding],
    limits: pd.DataFrame, limits_narrow: pd.DataFrame,
) -> Statement:  # fmt: skip
    """The plant's way of narrowing the parabola where C = 40 makes no curve must not matter to the findings."""
    below, above = (
        [name for name in printed if printed[name].met != other[name].met]
        for other in (narrow_below, narrow)
    )
    both = limits.merge(limits_narrow, on=["margin", "width"], suffixes=("", "_narrow"))
    shift = (both["limit_coefficient_narrow"] - both["limit_coefficient"]).abs()
    largest = float(shift.max()) if shift.notna().any() else math.nan
    return decided(
        "parabola",
        "the findings do not depend on how the parabola is narrowed where C = 40 makes no curve "
        f"(mu_max < {EXISTS_FROM:.3f})",
        {"": not largest > SETTLED_BELOW} | {f"narrow there, changes: {name}": False for name in below},
        {
            "findings that change with a narrow parabola there": len(below),
            "findings that change with a narrow parabola at every mu_max": len(above),
            "largest shift of a limit adhesion coefficient": largest,
        },
        f"narrow enough for mu_max 0.02 against as wide as can be; bound of the shift {SETTLED_BELOW:g}; {METHOD}",
        {f"narrow at every mu_max, changes: {name}": False for name in above if name not in below},
    )  # fmt: skip
