"""Which values of the parameters that the readhesion paper does not print make its controller do what the paper says?

Unknown are mu_inf/mu_max, T_u, T_d, tau and whether a_0 and a_w are km/h/s or m/s2. Sets are drawn by a Latin hypercube over
wide ranges, then around the best of them, and the simplex method refines these. The objective is the sum of the misfits of
`studies.readhesion_paper.findings`. The sets found in this way are close to the best set. Walkers
(`studies.core.calibration`) then continue from there, in each unit, wherever as many findings are met, so that the sets
cover what the paper leaves open.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import norm, qmc

from alloc.metrics.search import LimitSearch, limit_coefficient
from studies.core.calibration import needed, walk
from studies.core.cell import Task
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
    MOST_RATIO,
    PAPER_LIMITS,
    PAPER_MARGINS,
    PAPER_WIDTHS,
    RIVAL,
    STEP,
    UNITS,
    Case,
    Unit,
    Unprinted,
    assess,
    run_cases,
)

# The ensemble of the readhesion paper's calibration: sets that meet as many findings as any, in both units of a_0 and
# a_w. `members.csv` holds what `readhesion sweep calibration` found; `python -m
# studies.readhesion_paper.calibration_study` writes it again.

FILE = Path(__file__).with_name("members.csv")
COLUMNS = ("residual_ratio", "rise", "fall", "time_constant", "unit")


def _sets(unit: Unit) -> tuple[Unprinted, ...]:
    table = pd.read_csv(FILE, dtype=str)
    found = []
    for row in table.loc[table["unit"] == unit, list(COLUMNS[:-1])].to_numpy():
        residual_ratio, rise, fall, time_constant = (float(value) for value in row)
        found.append(Unprinted(residual_ratio, rise, fall, time_constant, unit))
    return tuple(found)


MEMBERS: dict[Unit, tuple[Unprinted, ...]] = {unit: _sets(unit) for unit in UNITS}
"""Sets by unit; the first of each is the one that figures draw."""


# The readhesion paper's sensitivity grid (section 3.3): mu_lim by 0.01, then by 0.002 near the limit, then bisection.

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
    "residual_ratio": (0.1, MOST_RATIO, False),
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


def first_cells(
    seed: int, samples: int, refinements: int = REFINEMENTS, constant: bool = False
) -> list[Task]:
    """What was assumed before, after trials by hand; the rival in the other unit; the set in use; sets over all ranges.

    A search of that unit alone found the rival. Few draws may miss either, so both are samples too. The set in use is tried
    like any other. `constant`: all sets are read with a constant mu_inf (`Unprinted.curve`), and those of the ensemble,
    which is of the other reading, are tried too.
    """
    needed("emcee")  # of the last stage: better said before the first
    wide = draw(math.ceil(WIDE_SHARE * samples), seed)
    return [
        *_tried("assumed", [ASSUMED, RIVAL], constant),
        *_tried("shipped", sum(MEMBERS.values(), ()) if constant else [CALIBRATED], constant),
        *_tried("wide", wide, constant),
    ]


def near_cells(
    generation: int, seed: int, samples: int, table: pd.DataFrame, refinements: int = REFINEMENTS,
    constant: bool = False,
) -> list[Task]:  # fmt: skip
    """A generation of sets around the best of the table so far."""
    rest = samples - math.ceil(WIDE_SHARE * samples)
    part = rest // len(NEARNESS) + (generation < rest % len(NEARNESS))
    return _tried(f"near {generation}", draw_near(table, part, seed, generation), constant)


def refining_cells(
    seed: int,
    samples: int,
    table: pd.DataFrame,
    refinements: int = REFINEMENTS,
    constant: bool = False,
) -> list[Task]:
    """The simplex method from the best set in each unit."""
    return [
        Task(
            f"refined/{row['unit']}", refined_rows,
            (tuple(to_unit_cube(row).tolist()), row["unit"], refinements, constant),
            (("stage", "refined"),),
        )
        for _, row in best_of_units(table, 1).iterrows()
    ]  # fmt: skip


def walking_cells(
    generation: int, seed: int, samples: int, table: pd.DataFrame, refinements: int = REFINEMENTS,
    constant: bool = False,
) -> list[Task]:  # fmt: skip
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
                    (tuple(points), unit, number, constant),
                    columns,
                )
            )
    return cells


def walked_rows(
    points: Sequence[Sequence[float]], unit: str, seed: int, constant: bool
) -> list[dict[str, Any]]:
    """Rows of the sets that meet enough, of those that walkers come to from `points`: all such are equally likely."""
    rows: dict[bytes, dict[str, Any]] = {}

    def log_posterior(point: NDArray[np.float64]) -> float:
        if np.any((point < 0.0) | (point > 1.0)):
            return -np.inf
        row = row_of(replace(from_unit_cube(point, unit), constant=constant))
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


def _tried(stage: str, sets: Sequence[Unprinted], constant: bool) -> list[Task]:
    columns = (("stage", stage.partition(" ")[0]),)
    return [
        Task(f"{stage}/{k}", row_of, (replace(one, constant=constant),), columns)
        for k, one in enumerate(sets)
    ]


def fulfilling(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the sets that show every finding but `NOT_ASKED_OF_ALL`."""
    asked = [f"met: {name}" for name in CLAIMS if name not in NOT_ASKED_OF_ALL]
    return table[table[asked].all(axis=1)]


def best(table: pd.DataFrame) -> pd.Series:
    """Row of the best set: least objective among those that fulfil most."""
    good = fulfilling(table)
    chosen = good if len(good) else table
    return chosen.sort_values("objective", kind="stable").iloc[0]


def refined_rows(
    start: Sequence[float], unit: str, evaluations: int, constant: bool
) -> list[dict[str, Any]]:
    """A row per set that the simplex method tries from `start`, a point of the unit cube."""
    rows: list[dict[str, Any]] = []

    def misfit(point: NDArray[np.float64]) -> float:
        rows.append(row_of(replace(from_unit_cube(point, unit), constant=constant)))
        return float(rows[-1]["objective"])

    # towards the middle of the cube, so that no corner of the simplex is cut off
    first = np.asarray(start)
    inward = np.where(first > 0.5, -NEARNESS[-1], NEARNESS[-1])
    minimize(
        misfit, first, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(RANGES),
        options={"maxfev": evaluations, "initial_simplex": np.vstack([first, first + np.diag(inward)])},
    )  # fmt: skip
    return rows[:evaluations]
