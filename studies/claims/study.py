"""The claims of JP5484215 put to the test by Monte Carlo: random events, every rule meets each of them."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from studies.claims.events import DURATION, drawn_table, event_jobs, event_name
from studies.claims.measures import measure
from studies.claims.statements import claim_statements
from studies.core.runner import run_jobs
from studies.core.statement import Statement
from studies.core.store import Store
from studies.core.stored_events import stored_events

DESCRIPTION = "claims (a) to (e) of JP5484215 over random events, all rules paired"
DEFAULT_EVENTS = 240
RULES = ("alone", "preset", "sharing", "greedy", "greedy-claim", "exact", "oracle")


def run(
    folder: Path,
    events: int,
    seed: int,
    jobs: int,
    on_row: Callable[[str, int, int], None] | None = None,
    duration: float = DURATION,
) -> pd.DataFrame:
    """One row per event and rule: metrics, measures (`studies.claims.measures`) and what was drawn.

    Rows that the store in `folder` holds are not run again. `duration` [s] shortens the events.
    """
    cells = event_jobs(seed, events, RULES, duration)
    table = run_jobs(cells, Store(folder), jobs, on_row=on_row, measure=measure)
    # "level" and the like are no columns of a run: the two tables share nothing but the event's name
    return table.merge(drawn_table(seed, events), on="scenario", how="left")


def stored(folder: Path, seed: int = 0) -> int:
    """Number of events, counted from the first, that a folder holds in full under the present code."""
    return stored_events(
        folder,
        lambda key: (key.scenario, key.rule),
        lambda k: {(event_name(seed, k), rule) for rule in RULES},
    )


def statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per claim, from the events in which every rule succeeded."""
    return claim_statements(complete(table))


def complete(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the events in which all rules succeeded: only those can be paired."""
    good = table[table["status"] == "ok"]
    rules = good.groupby("scenario")["rule"].nunique()
    return good[good["scenario"].isin(rules.index[rules == table["rule"].nunique()])]


__all__ = ["DEFAULT_EVENTS", "DESCRIPTION", "RULES", "complete", "run", "statements", "stored"]
