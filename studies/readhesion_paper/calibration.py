"""Which values of the parameters that the readhesion paper does not print make its controller do what the paper says?

Unknown are mu_inf/mu_max, T_u, T_d, tau and whether a_0 and a_w are km/h/s or m/s2. Sets are drawn by a Latin hypercube over
wide ranges, then around the best of them, and the simplex method refines these. The objective is the sum of the misfits of
`studies.readhesion_paper.findings`. The sets found in this way are close to the best set. Walkers (`studies.core.walkers`)
then continue from there, in each unit, wherever as many findings are met, so that the sets cover what the paper leaves open.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import norm, qmc

from studies.core.cell import Task
from studies.core.walkers import needed, walk
from studies.readhesion_paper.findings import (
    CLAIMS,
    Finding,
    case_findings,
    grid_findings,
    objective,
)
from studies.readhesion_paper.paper import (
    ASSUMED,
    CALIBRATED,
    CASE_A,
    CASE_B,
    RIVAL,
    UNITS,
    Unprinted,
    run_cases,
)
from studies.readhesion_paper.sensitivity import Cases, grid_tables, search_limits

DEFAULT_SAMPLES = 300
WIDE_SHARE = 0.5
"""Share of the samples that are drawn over the whole ranges; the rest lie around the best so far, in generations."""
PARENTS, NEARNESS = 8, (0.10, 0.07, 0.05, 0.035)
"""Best samples, as many in each unit, around which more are drawn, and the standard deviation of their distance in each
generation, as a share of each range."""
REFINEMENTS = 20
"""Evaluations of the simplex method, which starts from the best sample in each unit."""
CALIBRATION_STEP = 2.5e-4
"""Step [s] of calibration runs, five of the paper's; indices agree with those at the paper's step to half a per cent."""
MARGINS, WIDTHS = (0.0, 0.4, 0.9), (0.2, 0.3, 0.5, 0.6)
"""a_0 and a_w of the grid that a sample is tried on: the ends, and both sides of the a_w from which all fails."""
DECISIVE = ("slips at the drop", "A readheres", "B first slip", "B diverges")
"""Findings without which the two cases are not those of the paper: the others are then not computed."""
MOST_WALKERS = 14
"""Walkers in each unit."""
LEAST_MET = 16
"""Findings that a set of the ensemble meets, of 18; no set meets more."""
GENERATIONS, WALKING_STEPS = 1, 8
"""Pieces of work of the walkers in each unit, and their steps in each."""
NOT_ASKED_OF_ALL = ("half-slip lasts", "half-slip costs")
"""Findings that no set has shown together with all others; `fulfilling` leaves them out."""

RANGES: dict[str, tuple[float, float, bool]] = {
    "residual_ratio": (0.1, 0.97, False),
    "rise": (0.3, 2.2, True),
    "fall": (0.01, 1.0, True),
    "time_constant": (0.02, 0.5, True),
}
"""Range of each parameter, and whether it is drawn on a logarithmic scale. T_u ends where the torque, which rises from 0 s,
no longer reaches 0.16 at 6 s: 6 s / ln(0.17/0.01) = 2.1 s."""


def findings_of(unprinted: Unprinted) -> dict[str, Finding]:
    """Findings of the paper under these values; only those of its cases A and B where they are not its own."""
    runs = run_cases(unprinted, [CASE_A, CASE_B], step=CALIBRATION_STEP)
    found = case_findings(runs)
    if not all(found[name].met for name in DECISIVE):
        return found
    cases = Cases(unprinted, step=CALIBRATION_STEP)
    search_limits(cases, grid_tables(MARGINS, WIDTHS))
    return {**found, **grid_findings(cases.table)}


def row_of(unprinted: Unprinted) -> dict[str, Any]:
    """Parameters, objective, misfit of every finding, how many are met; nan where it was not asked."""
    found = findings_of(unprinted)
    return {
        **{name: getattr(unprinted, name) for name in (*RANGES, "unit")},
        "objective": objective(found),
        "met": sum(finding.met for finding in found.values()),
        **{f"met: {name}": name in found and found[name].met for name in CLAIMS},
        **{f"misfit: {name}": found[name].misfit if name in found else math.nan for name in CLAIMS},
    }


def from_unit_cube(point: NDArray[np.float64], unit: str) -> Unprinted:
    """Values at a point of the unit cube, (4,)."""
    values = {}
    for x, (name, (low, high, logarithmic)) in zip(point, RANGES.items(), strict=True):
        share = float(np.clip(x, 0.0, 1.0))
        values[name] = low * (high / low) ** share if logarithmic else low + share * (high - low)
    return Unprinted(**values, unit=unit)  # type: ignore[arg-type]


def to_unit_cube(row: pd.Series) -> NDArray[np.float64]:
    """Where in the unit cube the values of a row lie, (4,)."""
    return np.array(
        [
            math.log(row[name] / low) / math.log(high / low)
            if logarithmic
            else (row[name] - low) / (high - low)
            for name, (low, high, logarithmic) in RANGES.items()
        ]
    )


def draw(samples: int, seed: int) -> list[Unprinted]:
    """Sets by a Latin hypercube over the ranges; the units in turn."""
    points = qmc.LatinHypercube(len(RANGES), rng=seed).random(samples)
    units = list(UNITS)
    return [from_unit_cube(point, units[k % len(units)]) for k, point in enumerate(points)]


def draw_near(table: pd.DataFrame, samples: int, seed: int, generation: int) -> list[Unprinted]:
    """Sets around the best `PARENTS` of the table in turn, normally distributed by a Latin hypercube.

    Half of them in each unit: what each leads to lies far apart, and neither is to crowd out the other.
    """
    parents = best_of_units(table, PARENTS // len(UNITS))
    points = qmc.LatinHypercube(len(RANGES), rng=[seed, 1 + generation]).random(samples)
    rows = [parents.iloc[k % len(parents)] for k in range(samples)]
    return [
        from_unit_cube(to_unit_cube(row) + NEARNESS[generation] * norm.ppf(point), row["unit"])
        for row, point in zip(rows, points, strict=True)
    ]


def best_of_units(table: pd.DataFrame, number: int) -> pd.DataFrame:
    """The best `number` rows of each unit."""
    ordered = table.sort_values("objective", kind="stable")
    return ordered.groupby("unit", sort=False).head(number)


def first_cells(seed: int, samples: int, refinements: int = REFINEMENTS) -> list[Task]:
    """What was assumed before, after trials by hand; the rival in the other unit; the set in use; sets over all ranges.

    A search of that unit alone found the rival. Few draws may miss either, so both are samples too. The set in use is tried
    like any other.
    """
    needed("emcee")  # of the last stage: better said before the first
    wide = draw(math.ceil(WIDE_SHARE * samples), seed)
    return [
        *_tried("assumed", [ASSUMED, RIVAL]),
        *_tried("shipped", [CALIBRATED]),
        *_tried("wide", wide),
    ]


def near_cells(
    generation: int, seed: int, samples: int, table: pd.DataFrame, refinements: int = REFINEMENTS
) -> list[Task]:
    """A generation of sets around the best of the table so far."""
    rest = samples - math.ceil(WIDE_SHARE * samples)
    part = rest // len(NEARNESS) + (generation < rest % len(NEARNESS))
    return _tried(f"near {generation}", draw_near(table, part, seed, generation))


def refining_cells(
    seed: int, samples: int, table: pd.DataFrame, refinements: int = REFINEMENTS
) -> list[Task]:
    """The simplex method from the best set in each unit."""
    return [
        Task(
            f"refined/{row['unit']}", refined_rows,
            (tuple(to_unit_cube(row).tolist()), row["unit"], refinements), (("stage", "refined"),),
        )
        for _, row in best_of_units(table, 1).iterrows()
    ]  # fmt: skip


def walking_cells(
    generation: int, seed: int, samples: int, table: pd.DataFrame, refinements: int = REFINEMENTS
) -> list[Task]:
    """Walkers in each unit, from the sets that meet enough; none where too few do."""
    cells = []
    for k, unit in enumerate(UNITS):
        latest = members(table, unit).tail(MOST_WALKERS)
        points = [tuple(to_unit_cube(row).tolist()) for _, row in latest.iterrows()]
        if len(points) >= 2 * len(RANGES):
            number = int(np.random.SeedSequence([seed, k, generation]).generate_state(1)[0] // 2)
            columns = (("stage", "sampled"), ("generation", generation))
            cells.append(
                Task(
                    f"sampled/{unit}/{generation}",
                    walked_rows,
                    (tuple(points), unit, number),
                    columns,
                )
            )
    return cells


def walked_rows(points: Sequence[Sequence[float]], unit: str, seed: int) -> list[dict[str, Any]]:
    """Rows of the sets that meet enough, of those that walkers come to from `points`: all such are equally likely."""
    rows: dict[bytes, dict[str, Any]] = {}

    def log_posterior(point: NDArray[np.float64]) -> float:
        if np.any((point < 0.0) | (point > 1.0)):
            return -np.inf
        row = row_of(from_unit_cube(point, unit))
        if row["met"] < LEAST_MET:
            return -np.inf
        rows[point.tobytes()] = row
        return 0.0

    walk(np.array(points), np.zeros(len(points)), log_posterior, seed, WALKING_STEPS)
    return list(rows.values())


def members(table: pd.DataFrame, unit: str) -> pd.DataFrame:
    """Distinct sets in this unit that meet `LEAST_MET` findings, in the order of the rows."""
    good = table[(table["unit"] == unit) & (table["met"] >= LEAST_MET)]
    return good.drop_duplicates(subset=list(RANGES))


def _tried(stage: str, sets: Sequence[Unprinted]) -> list[Task]:
    columns = (("stage", stage.partition(" ")[0]),)
    return [Task(f"{stage}/{k}", row_of, (one,), columns) for k, one in enumerate(sets)]


def fulfilling(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the sets that show every finding but `NOT_ASKED_OF_ALL`."""
    asked = [f"met: {name}" for name in CLAIMS if name not in NOT_ASKED_OF_ALL]
    return table[table[asked].all(axis=1)]


def best(table: pd.DataFrame) -> pd.Series:
    """Row of the best set: least objective among those that fulfil most."""
    good = fulfilling(table)
    chosen = good if len(good) else table
    return chosen.sort_values("objective", kind="stable").iloc[0]


def refined_rows(start: Sequence[float], unit: str, evaluations: int) -> list[dict[str, Any]]:
    """A row per set that the simplex method tries from `start`, a point of the unit cube."""
    rows: list[dict[str, Any]] = []

    def misfit(point: NDArray[np.float64]) -> float:
        rows.append(row_of(from_unit_cube(point, unit)))
        return float(rows[-1]["objective"])

    # towards the middle of the cube, so that no corner of the simplex is cut off
    first = np.asarray(start)
    inward = np.where(first > 0.5, -NEARNESS[-1], NEARNESS[-1])
    minimize(
        misfit, first, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(RANGES),
        options={"maxfev": evaluations, "initial_simplex": np.vstack([first, first + np.diag(inward)])},
    )  # fmt: skip
    return rows[:evaluations]
