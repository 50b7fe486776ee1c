"""The one procedure by which every readhesion controller is tuned: the same budget, the same events, one objective.

Candidates scale half of a controller's parameters, drawn, by factors of up to three; candidate 0 is the controller as it
ships. They meet events that judge nothing, where units act alone. A change ships if it wins on these and again on others.
"""

import math
from functools import cache

import numpy as np
import pandas as pd

from alloc.evaluation.metrics import evaluate
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.run.simulation import simulate
from alloc.schema.errors import InputError
from studies import run_cell
from studies.files.scenario import Scenario
from studies.population import population
from studies.runner.study import Cell, Row, Study

CANDIDATES, FACTOR = 40, 3.0
"""Candidates for each controller, and the greatest factor on a parameter."""
PRICE = 5.0
"""Points of the bound that a wheel damage e times as large is worth: 22 % more damage count as a point less."""
FIXED = ("seed", "late")
"""Parameters that are no knobs."""
LEFT_OUT = ("none", "mpc-casadi")
STEEP = ("polach-dry", "polach-by-friction")
"""Curves that take ten times the steps; tuning does without."""


@cache
def draw_candidates(name: str) -> list[Controller]:
    """The controller of this name as it ships, then with parameters changed."""
    shipped, candidates = CONTROLLERS[name], [CONTROLLERS[name]]
    g = np.random.default_rng([11, *name.encode()])
    while len(candidates) < CANDIDATES:
        values = {}
        for key in shipped.settings:
            usual = shipped.memory.columns[key].default
            if key in FIXED or not isinstance(usual, int | float) or g.random() < 0.5:
                continue
            scaled = usual * FACTOR ** g.uniform(-1.0, 1.0)
            values[key] = (
                max(1, round(scaled)) if isinstance(usual, int) else float(f"{scaled:.3g}")
            )
        try:
            candidates.append(shipped.tuned(**values))
        except InputError:  # beyond its bounds: draw again
            continue
    return candidates


def cells(events: int, seed: int) -> list[Cell]:
    """Every candidate of every controller under the first events whose curve is not steep."""
    names = [name for name in CONTROLLERS.shipped() if name not in LEFT_OUT]
    chosen = [k for k in range(2 * events + 10) if population.draw(seed, k)["curve"] not in STEEP]
    return [
        Cell(
            f"{scenario.name}/{name}/{j}",
            (scenario, name, j, k),
            {"scenario": scenario.name, "controller": name, "candidate": j},
        )
        for k, scenario in ((k, population.event(seed, k)) for k in chosen[:events])
        for name in names
        for j in range(CANDIDATES)
    ]


def run(scenario: Scenario, name: str, j: int, k: int) -> Row:
    """Use of the bound and wheel damage [kJ] of a candidate where units act alone."""
    metrics = evaluate(simulate(run_cell.event_of(scenario, k), "alone", draw_candidates(name)[j]))
    return {"bound_use": metrics["bound_use"], "damage": metrics["damage"]}


def objective(rows: pd.DataFrame) -> float:
    """Mean use of the bound [points], less `PRICE` times the logarithm of the damage of all events together."""
    return float(100.0 * rows["bound_use"].mean() - PRICE * math.log(rows["damage"].sum()))


HEADS = (
    "controller", "candidates", "events", "used [%]", "Q [kJ]", "place of the shipped",
    "best: objective over the shipped [points]", "used by the best [%]", "its parameters",
)  # fmt: skip


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """The controllers as they ship, and the best candidate of each: what it wins, and its parameters."""
    lines = []
    for name, runs in run_cell.complete(rows).groupby("controller", sort=False):
        by = {int(j): objective(part) for j, part in runs.groupby("candidate")}
        best = max(by, key=by.__getitem__)
        shipped, winner = (runs[runs["candidate"] == j] for j in (0, best))
        settings = CONTROLLERS[str(name)].settings
        usual, tuned = (draw_candidates(str(name))[j].memory.columns for j in (0, best))
        changed = [key for key in settings if tuned[key].default != usual[key].default]
        used = [f"{100.0 * part['bound_use'].mean():.2f}" for part in (shipped, winner)]
        damage = f"{shipped['damage'].mean():.0f}"
        place = sorted(by.values(), reverse=True).index(by[0]) + 1
        parameters = ", ".join(f"{key} {tuned[key].default}" for key in changed) or "as shipped"
        numbers = damage, place, f"{by[best] - by[0]:+.2f}", used[1], parameters
        lines.append((name, len(by), len(shipped), used[0], *numbers))
    return pd.DataFrame(lines, columns=list(HEADS))


QUESTION = "Which parameters of each readhesion controller serve it best at equal budget?"
STUDY = Study("tuning", QUESTION, cells, run, table, events=24, seed=population.TUNING)
