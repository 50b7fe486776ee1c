"""What turns on each setting of the MPC: half and double of its value, over the same events.

Units act alone; the events are of a seed on which nothing is judged.
"""

from functools import cache
from typing import Any

import pandas as pd

from alloc.evaluation.metrics import evaluate
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.run.simulation import simulate
from alloc.schema.units import UNITS
from studies import run_cell
from studies.files.scenario import Scenario
from studies.population import population
from studies.runner.study import Cell, Row, Study
from studies.standing import GAIN
from studies.statistics import in_digits

Change = tuple[str, float]
"""Name of a setting, and by what its value is multiplied."""
HALF, DOUBLE = 0.5, 2.0
AS_IT_SHIPS: Change = "", 1.0
LATE = {HALF: 0.0, DOUBLE: 2.0}
"""Control periods that computing takes; none as the MPC ships, which half and double leave."""


@cache
def change_settings() -> dict[Change, Controller]:
    """The MPC as it ships, and with each setting at half and at double its value."""
    mpc = CONTROLLERS["mpc"]
    changed = {AS_IT_SHIPS: mpc}
    for name in mpc.settings:
        usual: Any = mpc.memory.columns[name].default
        for factor in (HALF, DOUBLE):
            value = LATE[factor] if name == "late" else type(usual)(factor * usual)
            if value != usual:
                changed[name, factor] = mpc.tuned(**{name: value})
    return changed


def cells(events: int, seed: int) -> list[Cell]:
    """Each event under the MPC with every change."""
    return [
        Cell(
            f"{event.name}/{name} x {factor}",
            (event, (name, factor), k),
            {"scenario": event.name, "setting": name, "factor": factor},
            (CONTROLLERS.origin("mpc"),),
        )
        for k in range(events)
        for event in [population.event(seed, k)]
        for name, factor in change_settings()
    ]


def run(scenario: Scenario, change: Change, k: int) -> Row:
    """What is used of the bound, and Q, in one event."""
    controller = change_settings()[change]
    metrics = evaluate(simulate(run_cell.event_of(scenario, k), "alone", controller))
    return {name: metrics[name] for name in (GAIN.metric, "damage")}


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Of each setting its value and meaning, and by how much half and double of it change use [points] and Q of all [%]."""
    good, lines = run_cell.complete(rows), []
    runs = {
        change: part.set_index("scenario") for change, part in good.groupby(["setting", "factor"])
    }
    mpc, whole = CONTROLLERS["mpc"], runs[AS_IT_SHIPS]
    symbols = {u.si: u.symbol for u in UNITS if u.factor == 1.0} | {"rad s-1": "rad/s"}
    for name in mpc.settings:
        column = mpc.memory.columns[name]
        unit = "" if column.unit == "1" else f" {symbols.get(column.unit, column.unit)}"
        line: Row = {"setting": f"`{name}`", "value": f"{column.default:g}{unit}"}
        line["meaning"] = column.meaning
        for prefix, factor in (("half", HALF), ("double", DOUBLE)):
            changed = runs.get((name, factor))
            texts = "", ""
            if changed is not None:
                more = 100.0 * (changed["damage"].sum() / whole["damage"].sum() - 1.0)
                texts = GAIN.text(changed, whole), in_digits(more, 0, True)
            line |= dict(zip((f"{prefix} [points]", f"{prefix}: Q [%]"), texts, strict=True))
        lines.append(line)
    return pd.DataFrame(lines)


QUESTION = "What turns on each setting of the MPC, at half and at double its value?"
STUDY = Study("mpc_settings", QUESTION, cells, run, table, events=24, seed=7101)
