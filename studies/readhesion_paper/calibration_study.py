"""The calibration of what the readhesion paper does not print: does a set do as it says, how narrow is it, which unit?"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import pandas as pd

from studies.core.calibration import RANGE, median_of
from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction
from studies.core.statement import Interval, Statement, in_words, unmet
from studies.core.study import Study, study_folder
from studies.readhesion_paper.calibration import (
    COLUMNS,
    DEFAULT_SAMPLES,
    FILE,
    GENERATIONS,
    LEAST_MET,
    NEARNESS,
    NOT_ASKED_OF_ALL,
    RANGES,
    best,
    first_cells,
    fulfilling,
    members,
    near_cells,
    refining_cells,
    walking_cells,
)
from studies.readhesion_paper.findings import BOUNDS, CLAIMS
from studies.readhesion_paper.paper import UNITS

NARROW = 2.0
"""A parameter is narrowly determined where the largest value that fulfils all is at most this multiple of the least."""
LEAST_SETS = 50
"""Distinct sets in a unit that make an ensemble."""
NEAR_BEST = 1.5
"""Sets whose objective is at most this multiple of the best one's are as good for all that the paper prints."""
WORDS = {
    "residual_ratio": "mu_inf over mu_max",
    "rise": "T_u [s]",
    "fall": "T_d [s]",
    "time_constant": "tau [s]",
}
"""Name of each parameter, with its unit."""


EXISTS = Claim(
    "a set exists", "some values of what is not printed make the controller do all that the paper says", "met", AT_LEAST,
    1.0, each="finding", exact=True, reason="the paper says all of it",
    method=f"Latin hypercube and simplex method; fulfils: all findings but {', '.join(NOT_ASKED_OF_ALL)}",
)  # fmt: skip
ENSEMBLE = Claim(
    "ensemble",
    f"in both units of a_0 and a_w at least {LEAST_SETS} sets meet {LEAST_MET} of the paper's {len(CLAIMS)} findings",
    cases=tuple(
        Claim(f"so many in {unit}", mean=f"'{unit}'", value=LEAST_SETS, exact=True, show=in_words("{:.0f}"),
              reason="so many make an ensemble")
        for unit in UNITS
    ),
    method=f"walkers over all sets that meet as many, all of them equally likely; {RANGE}",
)  # fmt: skip
NARROWED = {
    name: Claim(
        f"narrow: {name}", f"the paper's findings determine {words} to within a factor of {NARROW:g}", "factor",
        AT_MOST, NARROW, exact=True, reason="narrowly",
        method=f"limits are ranges, not confidence; near: the same unit, objective up to {NEAR_BEST:g} times the best one's",
    )
    for name, words in WORDS.items()
}  # fmt: skip
UNIT = Claim(
    "unit", "a_0 and a_w are meant in one unit: in the other no set comes near", "near", AT_MOST, exact=True,
    reason="a set that comes near would do as well",
    method=f"near: objective up to {NEAR_BEST:g} times that of the best set that fulfils most",
)  # fmt: skip
AT_ONCE = Claim(
    "half-slip", "the half-slip at mu_lim 0.16 goes together with the other findings", "most findings met with both",
    AT_LEAST, len(CLAIMS), exact=True, reason="all of them",
)  # fmt: skip
STATED = (EXISTS, ENSEMBLE, *NARROWED.values(), UNIT, AT_ONCE, *BOUNDS.values())
"""What is claimed, and the bounds that decide the findings."""


def calibration_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on a table of `CALIBRATION`."""
    good, chosen = fulfilling(table), best(table)
    near = table[table["objective"] <= NEAR_BEST * chosen["objective"]]
    same, other = (near[near["unit"] == chosen["unit"]], near[near["unit"] != chosen["unit"]])
    return [
        _exists(table, good, chosen),
        _ensemble(table),
        *(_narrow(name, chosen, good, same) for name in RANGES),
        _unit(table, good, chosen, other),
        _all_at_once(table),
    ]


def _exists(table: pd.DataFrame, good: pd.DataFrame, chosen: pd.Series) -> Statement:
    met = [bool(chosen[f"met: {name}"]) for name in CLAIMS]
    findings = pd.DataFrame({"finding": [f"met: {one}" for one in CLAIMS.values()], "met": met})
    wide = table[table["stage"] == "wide"].index
    numbers = {
        f"findings met by the best set, of {len(CLAIMS)}": sum(met),
        "its objective": chosen["objective"],
        "objective of the values assumed": table.loc[table["stage"] == "assumed", "objective"].head(1).min(),
        "share of wide samples that fulfil all but the half-slip": pd.Series(wide.isin(good.index)),
    }  # fmt: skip
    return conjunction(findings, EXISTS, numbers=numbers, partly=len(good) > 0)


def _ensemble(table: pd.DataFrame) -> Statement:
    """How many sets there are in each unit, and how far apart they lie: side by side, since the paper names no unit."""
    numbers: dict[str, Any] = {
        "free parameters, beside the unit": len(RANGES),
        f"findings; a set of the ensemble meets {LEAST_MET}": len(CLAIMS),
    }
    counts = {unit: members(table, unit) for unit in UNITS}
    for unit, rows in counts.items():
        numbers[f"distinct sets in {unit}"] = len(rows)
        numbers |= {
            f"{words}, {unit}: median and range": median_of(rows[name])
            for name, words in WORDS.items()
        }
    found = pd.DataFrame([{unit: len(rows) for unit, rows in counts.items()}])
    return conjunction(found, ENSEMBLE, numbers=numbers, least_events=1)


def _range(value: float, rows: pd.DataFrame, name: str) -> Interval:
    """A value with the range of a column; not of confidence."""
    return Interval(float(value), float(rows[name].min()), float(rows[name].max()), len(rows))


def _narrow(name: str, chosen: pd.Series, good: pd.DataFrame, near: pd.DataFrame) -> Statement:
    fulfil = _range(chosen[name], good, name)
    numbers = {
        f"{WORDS[name]}: best; range of the sets that fulfil": fulfil,
        f"{WORDS[name]}: best; range near the best objective": _range(chosen[name], near, name),
    }
    found = pd.DataFrame({"factor": [fulfil.high / fulfil.low]})
    return conjunction(found, NARROWED[name], {"": fulfil.count > 1}, numbers=numbers, least_events=0)  # fmt: skip


def _unit(
    table: pd.DataFrame, good: pd.DataFrame, chosen: pd.Series, near: pd.DataFrame
) -> Statement:
    """`near`: sets in the other unit that come near the best objective."""
    others = table[table["unit"] != chosen["unit"]]
    numbers: dict[str, Any] = {"sets near the best objective in the other unit": len(near)}
    missing: list[str] = []
    if len(others):
        rival = others.sort_values("objective", kind="stable").iloc[0]
        missing = [
            unmet(f"met in {rival['unit']}: {claim}")
            for name, claim in CLAIMS.items() if not rival[f"met: {name}"]
        ]  # fmt: skip
        numbers |= {
            f"objective of the best set in {row['unit']}": row["objective"]
            for row in (chosen, rival)
        }
        numbers |= {
            f"{words} of the best set in {rival['unit']}; range of those near": _range(
                rival[name], near, name
            )
            for name, words in WORDS.items()
        }
    stated = replace(
        UNIT,
        claim=f"a_0 and a_w are meant in {chosen['unit']}: in the other unit no set comes near",
    )
    found = pd.DataFrame({"near": [len(near)]})
    judged = conjunction(found, stated, {"": len(good) > 0}, numbers=numbers, least_events=1)
    return replace(judged, conditions=tuple(missing))


def _all_at_once(table: pd.DataFrame) -> Statement:
    """The half-slip stands apart: by how much other findings must give way to it."""
    shown = table[[f"met: {name}" for name in NOT_ASKED_OF_ALL]]
    both, one = table["met"][shown.all(axis=1)], table["met"][shown.any(axis=1)]
    found = pd.DataFrame({AT_ONCE.mean: [both.max()]})
    numbers = {
        "sets with both its findings": len(both), "most findings met with both": both.max(),
        "most findings met with one of them": one.max(),
    }  # fmt: skip
    return conjunction(found, AT_ONCE, numbers=numbers, least_events=0)


CALIBRATION = Study(
    name="calibration",
    question="what the readhesion paper does not print, calibrated on what it does, and how narrowly",
    default_events=DEFAULT_SAMPLES,  # sets drawn
    step=DEFAULT_SAMPLES,  # a Latin hypercube of more sets has none of these
    cells=first_cells,
    later=(
        *(partial(near_cells, k) for k in range(len(NEARNESS))),
        refining_cells,
        *(partial(walking_cells, k) for k in range(GENERATIONS)),
    ),
    finish=lambda table, seed, samples: table.assign(seed=seed, samples=samples),
    judge=calibration_statements,
    claims=STATED,
    whole=True,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the members from the table of the calibration, whose missing rows are run first."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count())
    parser.add_argument("--out", type=Path, default=FILE)
    given = parser.parse_args(arguments)
    folder = study_folder(given.results, CALIBRATION.name)
    table = CALIBRATION.run(folder, CALIBRATION.default_events, given.seed, given.jobs)
    # those tried because they are in use come first
    order = table["stage"].map({"shipped": 0, "assumed": 1}).fillna(2)
    ordered = table.loc[order.sort_values(kind="stable").index]
    parts = [members(ordered, unit) for unit in UNITS]
    pd.concat(parts)[list(COLUMNS)].to_csv(given.out, index=False)
    print(", ".join(f"{unit}: {len(part)} sets" for unit, part in zip(UNITS, parts, strict=True)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
