"""A slip event under a rule and a readhesion controller as a cell of a study, and rows paired by event."""

from collections.abc import Callable, Iterable
from functools import lru_cache

import pandas as pd
import xarray as xr

from alloc.evaluation.metrics import METRICS, evaluate
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from alloc.run.event import Event
from alloc.run.simulation import simulate
from studies.files.scenario import Scenario
from studies.runner.rows import BOOKKEEPING
from studies.runner.study import Cell, Row

MOST_FAILURES = 0.05
"""Share of its calls in which the solver of a rule or a controller may fail in a run that counts. Beyond, the run is also
a run of what answers in its place: its row is degraded, and enters no mean."""

Measure = Callable[[xr.Dataset], Row]
"""A function of a module that adds columns from a recorded run."""


def cell(
    scenario: Scenario,
    rule: str,
    controller: str,
    seed: int,
    measure: Measure | None = None,
    **columns: object,
) -> Cell:
    """A run as a cell; its rows say the event, the rule, the controller, the seed, and `columns`."""
    return Cell(
        f"{scenario.name}/{rule}/{controller}/{seed}",
        (scenario, rule, controller, seed, measure),
        {"scenario": scenario.name, "rule": rule, "controller": controller, "seed": seed} | columns,
        sources(scenario, rule, controller),
    )


def sources(scenario: Scenario, rule: str, controller: str) -> tuple[str, ...]:
    """Modules of the parts of a run, see `Cell.sources`."""
    origins = {RULES.origin(rule), CONTROLLERS.origin(controller), *scenario.sources}
    return tuple(sorted(origins | METRICS.origins()))


def run(
    scenario: Scenario, rule: str, controller: str, seed: int, measure: Measure | None = None
) -> Row:
    """The row of a run: every metric, what `measure` adds, and whether rule and controller worked.

    `rule_gap` is how far the answers of the rule's solver were from the certified ones, over the plan; nan without a solver.
    """
    record = recorded(scenario, rule, controller, seed)
    row = evaluate(record) | {"rule_gap": record.attrs["rule_gap"]}
    return row | (measure(record) if measure else {}) | status(record)


def recorded(scenario: Scenario, rule: str, controller: str, seed: int) -> xr.Dataset:
    """The recorded run."""
    return simulate(event_of(scenario, seed), rule, controller)


@lru_cache(maxsize=4)
def event_of(scenario: Scenario, seed: int) -> Event:
    """One for all rules that meet it; they are neighbours in a list of cells."""
    return scenario.event(seed)


def status(record: xr.Dataset) -> Row:
    """Whether rule and controller worked in a run: nothing, or degraded with the reason."""
    for part in ("rule", "controller"):
        calls, failures = record.attrs[f"{part}_calls"], record.attrs[f"{part}_failures"]
        if failures > MOST_FAILURES * calls:
            reason = f"the solver of the {part} failed in {failures / calls:.1%} of {calls} calls"
            return {"status": "degraded", "reason": reason}
    return {}


# rows paired by event


def complete(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows of the events in which nothing failed: only those can be paired."""
    failed = rows.loc[rows["status"] != "ok", "scenario"]
    return rows[~rows["scenario"].isin(failed)]


def paired(
    rows: pd.DataFrame,
    controller: str,
    rule: str,
    compared: Iterable[str],
    drawn: Iterable[str] = (),
) -> pd.DataFrame:
    """One row per event: what was `drawn`, the numbers of `rule`, and the numbers of each rule `compared` as number_rule.

    A number that `rule` has under another controller is not among them: rows of one event and one controller are paired.
    """
    under = rows[rows["controller"] == controller].set_index("scenario")
    numbers = under.select_dtypes("number").columns.difference([*drawn, *BOOKKEEPING, "seed"])
    parts = [under.loc[under["rule"] == rule, [*drawn, *numbers]]]
    parts += [under.loc[under["rule"] == name, numbers].add_suffix(f"_{name}") for name in compared]
    return pd.concat(parts, axis=1)
