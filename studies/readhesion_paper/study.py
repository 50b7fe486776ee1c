"""Sensitivity of the readhesion paper's controller (section 3.3) over a_0 and a_w, and what its ensemble leaves open.

Rows with a unit are those of the ensemble's members, in that unit of a_0 and a_w; those without are of the set in use.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import pandas as pd

from studies.core.calibration import over_members
from studies.core.cell import Task
from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction
from studies.core.statement import Statement
from studies.core.study import Study
from studies.readhesion_paper.calibration import CALIBRATION_STEP, MEMBERS, case_rows, searched_rows
from studies.readhesion_paper.findings import BOUNDS, CLAIMS, Finding, grid_findings
from studies.readhesion_paper.paper import (
    CALIBRATED,
    CASE_A,
    GRADIENTS,
    PAPER_LIMITS,
    PAPER_MARGINS,
    PAPER_WIDTHS,
    RIVAL,
    STEP,
    UNITS,
    Unit,
    Unprinted,
    downhill,
)

# Statements of the sweep `readhesion`: the paper's findings one by one, and the result of this plant's reading of them.

SETTLED_BELOW = 0.01
"""Largest change of a limit adhesion coefficient that leaves the paper's figures as they are: a step of its grid."""
EXISTS_FROM = 5.0**2 / (4.0 * 40.0)
"""Least mu_max at which g1 = 5 and C = 40 make a curve: (2) with mu_max, g1^2/(4 C)."""
UNIT_IN_USE = CALIBRATED.unit
METHOD = (
    "no randomness: each number is that of one run or of all runs of the grid; bounds in "
    "studies/readhesion_paper/findings.py"
)
FOUND = {
    name: Claim(
        name, claim, "met", AT_LEAST, 1.0, exact=True, reason="as the paper says", method=METHOD
    )
    for name, claim in CLAIMS.items()
}
LIMIT_EXISTS = Claim(
    "limit exists", "what readheres at one adhesion coefficient does so at every greater one", "monotone", AT_LEAST, 1.0,
    each="controller", some=True, exact=True, reason="section 3.2 takes it for granted", method=METHOD,
)  # fmt: skip
PARABOLA = Claim(
    "parabola",
    "the findings do not depend on how the parabola is narrowed where C = 40 makes no curve "
    f"(mu_max < {EXISTS_FROM:.3f})",
    "shift", AT_MOST, SETTLED_BELOW, exact=True, reason="a step of the paper's grid leaves its figures as they are",
    method=f"narrow enough for mu_max 0.02 against as wide as can be; bound of the shift {SETTLED_BELOW:g}; {METHOD}",
)  # fmt: skip
DOWNHILL = Claim(
    "downhill",
    f"a_0 needs room downhill: with that of case A the table takes torque off a wheel that does not slip, at up to "
    f"{-min(GRADIENTS):g} per mille",
    "taken", AT_LEAST, 0.01, exact=True, reason="section 4; a point of the torque is felt",
    cases=(
        Claim("no wheel slips", mean="slip", side=AT_MOST, value=0.99, exact=True, reason="below the curve's peak"),
        Claim("what remains is what table and gravity leave at rest", mean="off", side=AT_MOST, value=0.01, exact=True,
              reason="as above"),
    ),
    method="no randomness: mean torque of a run, when it has settled; gravity's part: g sin(slope) M/(M + J/r2)",
)  # fmt: skip
STATED = (*FOUND.values(), LIMIT_EXISTS, PARABOLA, DOWNHILL, *BOUNDS.values())
"""What is claimed, and the bounds that decide the findings."""


def readhesion_statements(table: pd.DataFrame, printed: str, narrow: str) -> list[Statement]:
    """Statements on `CLAIMS`, on the limit adhesion coefficient, and on the parabola (names of both in the table)."""
    own = table[table["unit"].isna()]
    indices, limits = (_by_parabola(own, part) for part in ("indices", "limit"))
    findings = {name: grid_findings(_typed(indices[name])) for name in (printed, narrow)}
    open_part = indices[narrow]["limit"].astype(float) < EXISTS_FROM
    kept_part = indices[printed]["limit"].astype(float) >= EXISTS_FROM
    mixed = pd.concat([indices[printed][kept_part], indices[narrow][open_part]])
    narrow_below = grid_findings(_typed(mixed))
    of_sets = {
        str(unit): [_of_a_set(one) for _, one in rows.groupby("member", sort=True)]
        for unit, rows in table[table["unit"].notna()].groupby("unit", sort=False)
    }
    return [
        *(
            in_both_units(_statement(name, finding), {unit: [one[name] for one in sets] for unit, sets in of_sets.items()})
            for name, finding in {**_cases(own[own["part"] == "case"]), **findings[printed]}.items()
        ),
        _limit_exists(limits[printed]),
        _parabola(findings[printed], narrow_below, findings[narrow], limits[printed], limits[narrow]),
        in_both_units(_downhill(table, UNIT_IN_USE), {RIVAL.unit: [_downhill(table, RIVAL.unit)]}),
    ]  # fmt: skip


def _downhill(table: pd.DataFrame, unit: Unit) -> Statement:
    """The paper's closing remark on a_0, and which a_0 and which gradient it means."""
    rows = table[(table["part"] == "downhill") & (table["read_in"] == unit)]
    kept = rows.set_index(["margin", "gradient"])["kept"].astype(float)
    steep, most, of_a = min(GRADIENTS), rows["margin"].max(), CASE_A.margin
    off = float((rows["kept"] - rows["expected"]).abs().max())
    found = {
        "taken": 1.0 - float(rows["kept"][rows["margin"] == of_a].min()),
        "slip": rows["slip"].max(),
        "off": off,
    }
    numbers = {
        f"a_0 that {-steep:g} per mille needs": rows["gravity"].max() / UNITS[unit],
        f"kept at {-steep:g} per mille with a_0 0": kept[0.0, steep],
        f"kept at {-steep:g} per mille with a_0 of case A": kept[of_a, steep],
        f"kept at {-steep:g} per mille with the paper's largest a_0": kept[most, steep],
        "kept at 25 per mille with a_0 of case A": kept[of_a, -25.0],
        "largest slip over that of the peak": found["slip"],
        "largest difference from the share at rest": off,
    }
    return conjunction(pd.DataFrame([found]), DOWNHILL, numbers=numbers, least_events=1)


def _of_a_set(rows: pd.DataFrame) -> dict[str, Statement]:
    """What is said of every set alike, by the names of the findings."""
    found = {
        **_cases(rows[rows["part"] == "case"]),
        **grid_findings(_typed(rows[rows["part"] == "indices"])),
    }
    return {name: _statement(name, finding) for name, finding in found.items()}


def in_both_units(own: Statement, members: Mapping[str, Sequence[Statement]]) -> Statement:
    """A finding of the set in use, with the range of its unit's members, and beside it the same in the other unit.

    The paper does not say which unit is meant. So a finding that holds in only one of them holds with conditions.
    """
    said = over_members(own, members.get(UNIT_IN_USE, []))
    numbers, conditions = dict(said.numbers), list[str]()
    for unit, others in members.items():
        if unit == UNIT_IN_USE:
            continue
        first = others[0]
        for quantity, interval in over_members(first, others).numbers.items():
            numbers[f"a_0 and a_w in {unit}: {quantity}"] = interval
        if first.verdict != own.verdict:
            same = sum(one.verdict == own.verdict for one in others)
            conditions.append(
                f"with a_0 and a_w in {unit} it {first.verdict}; of {len(others)} sets there {same} say as here"
            )
    return replace(said.conditioned(*conditions), numbers=numbers)


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
    return conjunction(
        pd.DataFrame({"met": [finding.met]}), FOUND[name], numbers=finding.numbers, least_events=1
    )


def _limit_exists(limits: pd.DataFrame) -> Statement:
    some = limits[limits["limit_coefficient"].notna()]
    some = some.assign(
        controller=[f"with a_0 {row.margin:g}, a_w {row.width:g}" for row in some.itertuples()]
    )
    without = int((~some["monotone"].astype(bool)).sum())
    numbers = {"controllers with a limit": len(some), "of them not so": without}
    return conjunction(some, LIMIT_EXISTS, numbers=numbers)


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
    return conjunction(
        pd.DataFrame({"shift": [0.0 if math.isnan(largest) else largest]}), PARABOLA,
        {f"the same, narrow there: {name}": False for name in below},
        {f"the same, narrow at every mu_max: {name}": False for name in above if name not in below},
        {
            "findings that change with a narrow parabola there": len(below),
            "findings that change with a narrow parabola at every mu_max": len(above),
            "largest shift of a limit adhesion coefficient": largest,
        },
        least_events=1,
    )  # fmt: skip


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
            Task(f"downhill/{one.unit}", downhill_rows, (one, step), (("part", "downhill"), ("read_in", one.unit)))
            for one in (unprinted, RIVAL)
        ),
        *(
            Task(
                f"member/{unit}/{k}", member_rows, (one, *grid, _step(step, one)),
                (("unit", unit), ("member", k)),
            )
            for unit, sets in MEMBERS.items()
            for k, one in enumerate(sets[:events])
        ),
    ]  # fmt: skip


def downhill_rows(unprinted: Unprinted, step: float) -> list[dict[str, Any]]:
    """Rows of `studies.readhesion_paper.paper.downhill`."""
    rows = downhill(unprinted, step=step).to_dict("records")
    return [{str(name): value for name, value in row.items()} for row in rows]


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
