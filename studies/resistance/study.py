"""Running resistance (JP H07-322414): does compensation steady the train, do the weights converge, does the mass help?"""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
from joblib import Parallel, delayed

from studies.core.code_version import hash_with
from studies.core.statement import Statement
from studies.core.store import Store
from studies.core.stored_events import stored_table
from studies.resistance import driven_cases as speed_control
from studies.resistance import events as resistance_events
from studies.resistance import learners as resistance_learning
from studies.resistance import routes as speed_routes
from studies.resistance.events import event_row
from studies.resistance.statements import resistance_statements

DESCRIPTION = "compensation and learning of running resistance by line position (JP H07-322414)"
DEFAULT_EVENTS = 12
TABLE = "resistance.parquet"


def run(
    folder: Path,
    events: int,
    seed: int,
    jobs: int,
    on_row: Callable[[str, int, int], None] | None = None,
) -> pd.DataFrame:
    """One row per event, drawn from `seed`, kept in `folder`; events that it holds are not run again."""
    store = Store(folder)
    known = stored(folder)
    own = known[known["seed"] == seed] if known is not None else None
    missing = [k for k in range(events) if own is None or k not in set(own["event"])]
    rows = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(event_row)(seed, k) for k in missing
    )
    for count, row in enumerate(rows):
        if on_row is not None:
            on_row(f"event {row['event']}", count, len(missing))
        new = pd.DataFrame([row]).assign(seed=seed, code_hash=_hash())
        known = new if known is None else pd.concat([known, new], ignore_index=True)
        known.to_parquet(store.folder / TABLE, index=False)
    assert known is not None
    mine = known[(known["seed"] == seed) & (known["event"] < events)]
    return mine.sort_values("event", ignore_index=True)


def stored(folder: Path) -> pd.DataFrame | None:
    """The table that a folder holds, of all seeds; None if there is none or it comes from other code."""
    return stored_table(folder, TABLE, _hash())


def statements(table: pd.DataFrame) -> list[Statement]:
    """Every claim and effect: whether it holds, and the numbers."""
    return resistance_statements(table)


def _hash() -> str:
    modules = (resistance_learning, speed_control, speed_routes, resistance_events)
    return hash_with(*(str(module.__file__) for module in modules))


__all__ = ["DEFAULT_EVENTS", "DESCRIPTION", "run", "statements", "stored"]
