"""The readhesion paper's controller in its scenario (Tables 1 and 2), many cases at once.

What the paper does not print (`Unprinted`) is calibrated on what it does print, by `studies.readhesion_paper.calibration`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal, NamedTuple

import joblib
import numpy as np
import pandas as pd

from alloc.estimation.series import spans
from alloc.event import DriverCommand
from alloc.metrics.search import (
    Signals,
    limit_cycle,
    readhesion_possible,
    used_coefficient,
    utilisation,
)
from alloc.onboard.controllers.simple import TorqueTable
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.laws import gradient_force
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from studies.readhesion_paper.lanes import TableRuns, simulate_tables

Unit = Literal["km/h/s", "m/s2"]
UNITS: dict[Unit, float] = {"km/h/s": 1.0 / 3.6, "m/s2": 1.0}
"""Units in which the paper's a_0 and a_w may be meant; it prints none."""

BEGIN, DROP, RECOVERY, END = -1.0, 6.0, 14.0, 15.0
"""Times [s] of Table 2."""
PATCH_FADE = 0.02
"""Time [s] over which the rail changes. The paper steps; a smooth edge keeps the integrator's order. Assumed."""
LOW_END = 16.0
"""End [s] of a run whose rail stays low, for readhesion possibility (`alloc.metrics.search`)."""
CASES_TOGETHER = 32
"""Cases of one piece of parallel work."""
COMMAND = DriverCommand((0.0,), (3.0 / 3.6,))
MOST_RATIO = 0.97
"""Largest mu_inf over mu_max."""
STEP = 5e-5
"""Step [s] of the paper, which is the controller's period here."""


@dataclass(frozen=True)
class Unprinted:
    """What the paper does not print."""

    residual_ratio: float = PiecewiseCurve().residual_ratio
    """mu_inf over mu_max; over that of cases A and B where mu_inf is constant."""
    rise: float = TorqueTable().rise
    """T_u [s]."""
    fall: float = TorqueTable().fall
    """T_d [s]."""
    time_constant: float = TorqueTable().time_constant
    """tau [s] of the pseudo-differentiator."""
    unit: Unit = "km/h/s"
    """Unit of a_0 and a_w."""
    constant: bool = False
    """Whether mu_inf is what it is in cases A and B at every mu_max, instead of proportional to mu_max."""

    @property
    def curve(self) -> PiecewiseCurve:
        """The adhesion curve. A constant mu_inf is at most `MOST_RATIO` of mu_max: below it there is no peak."""
        if not self.constant:
            return PiecewiseCurve(residual_ratio=self.residual_ratio)
        constant = self.residual_ratio * CASE_A.limit
        return PiecewiseCurve(residual_ratio=MOST_RATIO, constant_residual=constant)

    def table(self, margin: float, width: float) -> TorqueTable:
        """The controller for a_0 and a_w in the paper's numbers."""
        scale = UNITS[self.unit]
        return TorqueTable(margin * scale, width * scale, self.rise, self.fall, self.time_constant)


ASSUMED = Unprinted()
"""The defaults of `TorqueTable` and `PiecewiseCurve`."""
CALIBRATED = Unprinted(residual_ratio=0.94, rise=1.89, fall=0.213, time_constant=0.194)
"""The best set of `studies.readhesion_paper.calibration` among those that fulfil all findings but the half-slip's."""
RIVAL = Unprinted(residual_ratio=0.45, rise=1.35, fall=0.02, time_constant=0.16, unit="m/s2")
"""A set that meets as many findings and comes nearer in the sum: the half-slip of a_w = 0.3 costs adhesion as printed, but
a_w = 0.5 never readheres. The paper does not decide between the two."""


class Case(NamedTuple):
    """a_0 and a_w in the paper's numbers, and mu_lim."""

    margin: float = 0.4
    width: float = 0.2
    limit: float = 0.12


CASE_A = Case(0.4, 0.2, 0.12)
CASE_B = Case(0.4, 0.8, 0.12)
PAPER_LIMITS = tuple(round(0.16 - 0.01 * k, 2) for k in range(15))
"""mu_lim of section 3.3: 0.16 down to 0.02 by 0.01."""
PAPER_MARGINS = tuple(round(0.1 * k, 1) for k in range(10))
PAPER_WIDTHS = tuple(round(0.1 * k, 1) for k in range(1, 11))


def rail(limit: float, until: float = RECOVERY, curve: PiecewiseCurve | None = None) -> Rail:
    """Table 2: coefficient 0.18, `limit` (mu_lim) from 6 s after the command at 0 s until it recovers."""
    patch = Patch(limit / 0.18, begin=DROP, until=until, fade=PATCH_FADE)
    return Rail(0.18, patches=(patch,), curve=curve or PiecewiseCurve())


def run_cases(
    unprinted: Unprinted,
    cases: Sequence[Case],
    recovers: bool = False,
    step: float = STEP,
    top_curvature: float | None = None,
) -> TableRuns:
    """Runs of the scenario, a lane per case; `top_curvature` replaces the C that the paper prints.

    With `recovers` the rail is that of Table 2 until its end at 15 s. Without, it stays low until 16 s, as the criterion
    of readhesion possibility needs; both are the same until 14 s.
    """
    curve = unprinted.curve
    if top_curvature is not None:
        curve = replace(curve, top_curvature=top_curvature)
    until = RECOVERY if recovers else 2.0 * LOW_END
    rails = [rail(case.limit, until, curve) for case in cases]
    tables = [unprinted.table(case.margin, case.width) for case in cases]
    end = END if recovers else LOW_END
    return simulate_tables(find_set("one-axle"), rails, tables, COMMAND, BEGIN, end, step)


DRY = 0.35
"""Adhesion coefficient of the dry rail, on which no wheel slips. Assumed: about 0.3, Nagase as the paper cites it."""
GRADIENTS = tuple(5.0 * k - 35.0 for k in range(8))
"""Gradients [per mille] of the downhill runs; Japanese main lines have up to 35."""
HILL_END, SETTLED_FROM = 20.0, 12.0
"""Instants [s] between which the torque that remains is averaged: the torque has risen for six T_u."""


def downhill(
    unprinted: Unprinted, margins: Sequence[float] = PAPER_MARGINS, step: float = STEP
) -> pd.DataFrame:
    """What the table leaves of the commanded torque downhill, on a dry rail: a row per a_0 (its own unit) and gradient.

    `kept`: mean torque over the plan. `gravity` [m/s2]: what gravity adds to the commanded acceleration, g sin(slope)
    M/(M + J/r2). `expected`: share at which the table comes to rest, 1 - (gravity - a_0)/(commanded + a_w) where gravity
    exceeds a_0. `slip`: largest slip velocity over that of the curve's peak.
    """
    train, rail = find_set("one-axle"), Rail(DRY, curve=unprinted.curve)
    cases = list(product(margins, GRADIENTS))
    tables = [unprinted.table(margin, CASE_A.width) for margin, _ in cases]
    grades = [1e-3 * gradient for _, gradient in cases]
    runs = simulate_tables(
        train, [rail] * len(cases), tables, COMMAND, 0.0, HILL_END, step, grades=grades
    )
    s = build(train, rail).structure
    mass, turning = float(s.body_mass[0]), float(s.inertia[0] / s.radius[0] ** 2)
    settled = runs.time >= SETTLED_FROM
    found = pd.DataFrame(cases, columns=["margin", "gradient"])
    found["kept"] = runs.torque[settled].mean(axis=0) / runs.plan
    found["gravity"] = -gradient_force(mass, np.array(grades)) / (mass + turning)
    excess = found["gravity"] - [table.margin for table in tables]
    found["expected"] = 1.0 - (excess / (COMMAND.accelerations[0] + tables[0].width)).clip(0.0, 1.0)
    found["slip"] = (runs.slip / runs.peak_slip).max(axis=0)
    return found


def signals_of(runs: TableRuns) -> Signals:
    """What the indices are computed from."""
    return Signals(runs.time, runs.torque, runs.slip, runs.peak_slip, runs.coefficient, runs.plan)


def assess(
    unprinted: Unprinted,
    cases: Sequence[Case],
    jobs: int = 1,
    step: float = STEP,
    top_curvature: float | None = None,
) -> pd.DataFrame:
    """The paper's indices of each case, one row each in their order, from runs in `jobs` processes.

    possible; used_coefficient (10), utilisation (11); period [s], slip_swing [m/s], torque_swing (share of the plan) and
    slips_before of the limit cycle; longest_slip: longest time [s] in macro slip between 6 s and 14 s.
    """
    parts = [cases[k : k + CASES_TOGETHER] for k in range(0, len(cases), CASES_TOGETHER)]
    done = joblib.Parallel(n_jobs=min(jobs, max(len(parts), 1)))(
        joblib.delayed(_assess)(unprinted, part, step, top_curvature) for part in parts
    )
    return pd.concat(done, ignore_index=True)


def _assess(
    unprinted: Unprinted, cases: Sequence[Case], step: float, top_curvature: float | None
) -> pd.DataFrame:
    runs = run_cases(unprinted, cases, step=step, top_curvature=top_curvature)
    signals = signals_of(runs)
    table = pd.DataFrame(cases, columns=list(Case._fields))
    table["possible"] = readhesion_possible(signals, DROP, RECOVERY)
    table["used_coefficient"] = used_coefficient(runs.time, runs.coefficient, DROP, RECOVERY)
    table["utilisation"] = utilisation(table["used_coefficient"], table["limit"])
    lanes = range(len(cases))
    cycles = [limit_cycle(signals, lane, drop=DROP) for lane in lanes]
    for name in ("period", "slip_swing", "torque_swing", "slips_before"):
        table[name] = [getattr(cycle, name) for cycle in cycles]
    table["torque_swing"] /= runs.plan
    table["longest_slip"] = [longest_slip(runs, lane) for lane in lanes]
    return table


def slip_spans(runs: TableRuns, lane: int, end: float = RECOVERY) -> np.ndarray:
    """Begin and end [s] of every time in macro slip between the drop and `end` [s], (slips, 2)."""
    inside = (runs.time >= DROP) & (runs.time <= end)
    macro = runs.slip[inside, lane] >= runs.peak_slip[inside, lane]
    time = runs.time[inside]
    return np.asarray(time[np.minimum(spans(macro), time.size - 1)])


def longest_slip(runs: TableRuns, lane: int) -> float:
    """Longest time [s] in macro slip while the rail is low, 0 where there is none."""
    found = slip_spans(runs, lane)
    return float(np.diff(found, axis=1).max(initial=0.0))
