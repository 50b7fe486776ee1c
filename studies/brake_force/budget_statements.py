"""The error budget: which finding survives which error of the estimator alone."""

from collections.abc import Callable, Mapping, Sequence

import pandas as pd

from studies.brake_force.beliefs import AS_PLANT
from studies.core.statement import Statement
from studies.core.verdict import Bound, over_cases, survives

SURE, RARE = 0.95, 0.05
"""Share of stops in which a car that lacks a tenth must be found, and in which a sound one may be accused."""
Judge = Callable[[Mapping[str, pd.DataFrame]], Sequence[Statement]]


def tests_of(rows: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Rows of each running test by its name, with the days as index."""
    if not len(rows):
        return {}
    return {str(name): own.set_index("event") for name, own in rows.groupby("test")}


def budget_statements(
    table: pd.DataFrame, found: Sequence[Statement], judge: Judge
) -> list[Statement]:
    """A statement per finding; `found`: those of the estimator that believes as the plant is, `judge` makes them."""
    rows = table[table["part"] == "budget"]
    dry = table[table["part"] == "budget dry"]
    arms = {
        str(belief): {one.name: one for one in judge(tests_of(own))}
        for belief, own in (rows.groupby("belief", sort=False) if len(rows) else ())
    }
    known = [one for one in found if arms and all(one.name in arm for arm in arms.values())]
    return [
        *(_survival(one, {belief: arm[one.name] for belief, arm in arms.items()}) for one in known),
        *([_dry_stops(dry)] if len(dry) else []),
    ]


def _survival(finding: Statement, arms: Mapping[str, Statement]) -> Statement:
    return survives(
        f"budget: {finding.name}",
        f"it is found too where the estimator errs: {finding.claim}",
        finding,
        arms,
        AS_PLANT,
        f"verdict no worse than that of the estimator that believes as the plant is ({finding.verdict}); numbers are the "
        "first of the finding; conditions are the errors with which it is worse",
    )


def _dry_stops(rows: pd.DataFrame) -> Statement:
    """Neither friction nor pressures are read for it."""
    met: dict[str, Bound] = {}
    for belief, own in rows.groupby("belief", sort=False):
        lacking, every = own[own["missing"] > 0.0], own.groupby("event")["wrong"].mean()
        found = lacking.set_index("event")["found"].astype(float)
        met[f"with {belief}: a tenth missing is found"] = Bound("", found, least=SURE)
        met[f"with {belief}: sound cars accused seldom"] = Bound("", every, most=RARE)
    return over_cases(
        "budget: smallest shortfall found",
        "a tenth of one car's brake force is found, and nobody accused wrongly, also where the estimator errs",
        met,
        {
            words.removeprefix("with ").removesuffix(" seldom"): bound.values
            for words, bound in met.items()
        },
        "dry stops; found in at least 95 % of them, sound cars accused in at most 5 %",
    )
