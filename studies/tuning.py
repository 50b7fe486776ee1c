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
from studies import run_cell as runs
from studies.files.scenario import Scenario
from studies.population import population
from studies.runner.study import Cell, Row, Study

CANDIDATES, FACTOR = 40, 3.0
"""Candidates for each controller, and the greatest factor on a parameter."""
PRICE = 5.0
"""Points of the bound that a wheel damage e times as large is worth: 22 % more damage count as a point less."""
FIXED = ("seed", "late")
"""Parameters that are no knobs."""
LEFT_OUT = ("none", "mpc-opti")
STEEP = ("polach-dry", "polach-by-friction")
"""Curves that take ten times the steps; tuning does without."""


@cache
def candidates(name: str) -> list[Controller]:
    """The controller of this name as it ships, then with parameters changed."""
    own, found = CONTROLLERS[name], [CONTROLLERS[name]]
    g = np.random.default_rng([11, *name.encode()])
    while len(found) < CANDIDATES:
        values = {}
        for key in own.settings:
            usual = own.memory.columns[key].default
            if key in FIXED or not isinstance(usual, int | float) or g.random() < 0.5:
                continue
            scaled = usual * FACTOR ** g.uniform(-1.0, 1.0)
            values[key] = (
                max(1, round(scaled)) if isinstance(usual, int) else float(f"{scaled:.3g}")
            )
        try:
            found.append(own.tuned(**values))
        except InputError:  # beyond its bounds: draw again
            continue
    return found


def cells(events: int, seed: int) -> list[Cell]:
    """Every candidate of every controller under the first events whose curve is not steep."""
    names = [name for name in CONTROLLERS.shipped() if name not in LEFT_OUT]
    chosen = [k for k in range(2 * events + 10) if population.draw(seed, k)["curve"] not in STEEP]
    return [
        Cell(f"{one.name}/{name}/{j}", (one, name, j, k), {"scenario": one.name, "controller": name, "candidate": j})
        for k in chosen[:events]
        for one in [population.event(seed, k)]
        for name in names
        for j in range(CANDIDATES)
    ]  # fmt: skip


def run(scenario: Scenario, name: str, j: int, k: int) -> Row:
    """Use of the bound and wheel damage [kJ] of a candidate where units act alone."""
    found = evaluate(simulate(runs.event_of(scenario, k), "alone", candidates(name)[j]))
    return {"bound_use": found["bound_use"], "damage": found["damage"]}


def objective(rows: pd.DataFrame) -> float:
    """Mean use of the bound [points], less `PRICE` times the logarithm of the damage of all events together."""
    return float(100.0 * rows["bound_use"].mean() - PRICE * math.log(rows["damage"].sum()))


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """The controllers as they ship, and the best candidate of each: what it wins, and its parameters."""
    lines = []
    for name, own in runs.complete(rows).groupby("controller", sort=False):
        by = {int(j): objective(part) for j, part in own.groupby("candidate")}
        best = max(by, key=by.__getitem__)
        shipped, other = (own[own["candidate"] == j] for j in (0, best))
        controllers = CONTROLLERS[str(name)], candidates(str(name))[best]
        usual, tried = (one.memory.columns for one in controllers)
        changed = [
            f"{key} {tried[key].default}"
            for key in controllers[0].settings
            if tried[key].default != usual[key].default
        ]
        lines.append({
            "controller": name, "candidates": len(by), "events": len(shipped),
            "used [%]": f"{100.0 * shipped['bound_use'].mean():.2f}", "Q [kJ]": f"{shipped['damage'].mean():.0f}",
            "place of the shipped": sorted(by.values(), reverse=True).index(by[0]) + 1,
            "best: objective over the shipped [points]": f"{by[best] - by[0]:+.2f}",
            "used by the best [%]": f"{100.0 * other['bound_use'].mean():.2f}",
            "its parameters": ", ".join(changed) or "as shipped",
        })  # fmt: skip
    return pd.DataFrame(lines)


QUESTION = "Which parameters of each readhesion controller serve it best at equal budget?"
STUDY = Study("tuning", QUESTION, cells, run, table, events=24, seed=population.TUNING)
