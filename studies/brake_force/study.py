"""The RTRI report's running tests over many days: each finding, and which car did not deliver its allocated force."""

from collections.abc import Callable, Sequence
from pathlib import Path

import joblib
import pandas as pd

from studies.brake_force import faulty_car
from studies.brake_force import findings as brake_findings
from studies.brake_force import measurement as brake_measurement
from studies.brake_force import running_tests as brake_tests
from studies.brake_force.findings import SHORTFALLS, allocated_rows, driven_rows, row_of_test
from studies.brake_force.running_tests import TESTS, run_test
from studies.brake_force.statements import brake_force_statements
from studies.core.code_version import hash_with
from studies.core.statement import Statement
from studies.core.store import Store

DESCRIPTION = "what the RTRI report found of brake force per car, and whether a faulty car is found"
DEFAULT_EVENTS = 20
"""Days: other wagons, loads, rails and sensor errors on each."""

OnRow = Callable[[str, int, int], None]


def run(
    folder: Path,
    events: int,
    seed: int,
    jobs: int,
    on_row: OnRow | None = None,
    tests: Sequence[str] = tuple(TESTS),
    shortfalls: Sequence[float] = SHORTFALLS,
) -> pd.DataFrame:
    """Rows of `studies.brake_force.findings` for so many days, a file per day in `folder`; what it holds is not run again.

    `tests` and `shortfalls` other than all make a table that is not kept.
    """
    Store(folder)  # refuses a folder that cannot be written
    whole = (tuple(tests), tuple(shortfalls)) == (tuple(TESTS), SHORTFALLS)
    missing = [k for k in range(events) if not (whole and _path(folder, seed, k).exists())]
    if on_row is not None:
        on_row(
            "preparing (compiles on first use)" if missing else "", events - len(missing), events
        )
    found: dict[int, pd.DataFrame] = {}
    # the first alone, so that the others find what it compiled
    for part in (missing[:1], missing[1:]):
        days = joblib.Parallel(n_jobs=min(jobs, max(len(part), 1)), return_as="generator")(
            joblib.delayed(_day)(seed, k, tests, shortfalls) for k in part
        )
        for k, day in zip(part, days, strict=True):
            if whole:
                day.to_parquet(_path(folder, seed, k), index=False)
            found[k] = day
            if on_row is not None:
                on_row(f"day {k}", events - len(missing) + len(found), events)
    return pd.concat(
        [
            found[k] if k in found else pd.read_parquet(_path(folder, seed, k))
            for k in range(events)
        ],
        ignore_index=True,
    )


def stored(folder: Path, seed: int = 0) -> int:
    """Days, counted from the first, that a folder holds under the present code."""
    k = 0
    while _path(folder, seed, k).exists():
        k += 1
    return k


def statements(table: pd.DataFrame) -> list[Statement]:
    """Every finding of the report: whether it holds here, and the numbers."""
    return brake_force_statements(table)


def _day(seed: int, k: int, tests: Sequence[str], shortfalls: Sequence[float]) -> pd.DataFrame:
    draw = 10_000 * seed + k
    rows = [row_of_test(name, run_test(name, draw)) for name in tests]
    rows += [*allocated_rows(draw), *driven_rows(draw, shortfalls)]
    return pd.DataFrame(rows).assign(event=k)


def _path(folder: Path, seed: int, k: int) -> Path:
    return Path(folder) / f"day-{seed}-{k}-{_hash()}.parquet"


def _hash() -> str:
    modules = (brake_findings, brake_measurement, brake_tests, faulty_car)
    return hash_with(*(str(module.__file__) for module in modules))


__all__ = ["DEFAULT_EVENTS", "DESCRIPTION", "run", "statements", "stored"]
