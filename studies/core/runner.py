"""Run the cells that a store lacks, in parallel, and keep every row as it comes."""

import time
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import Future
from contextlib import closing
from fnmatch import fnmatchcase
from queue import Empty, SimpleQueue

import numpy as np
import pandas as pd
from joblib.externals.loky.process_executor import TerminatedWorkerError

from alloc.rules import AllocationProblem, find_rule
from studies.core import interruption
from studies.core.cell import Cell, Key, OnRow, Outcome, Row, Task, key_of, run_cell
from studies.core.controllers import is_hosted, rehearse, rehearse_plant
from studies.core.job import Job
from studies.core.processes import processes
from studies.core.store import Store
from studies.files.study_error import StudyError

FLUSH_INTERVAL = 2.0
"""Rows are written at least this often [s] while cells finish."""


def run_cells(
    cells: Sequence[Cell],
    store: Store,
    jobs: int = 1,
    keep: Sequence[str] = (),
    retry_failed: bool = False,
    on_row: OnRow | None = None,
) -> pd.DataFrame:
    """Run the cells that `store` does not hold yet; returns the rows of all, in their order.

    `jobs`: processes. `keep`: patterns of labels, such as ``wet-*/exact/*/0``, whose runs are recorded as netCDF. Cells
    that failed are kept with their reason and not run again unless `retry_failed`. On an interrupt what is computed is kept.
    """
    keys = [key_of(cell) for cell in cells]
    missing = _missing(cells, keys, store, keep, retry_failed)
    done = len(cells) - len(missing)
    if on_row is not None:
        on_row("preparing (compiles on first use)" if missing else "", done, len(cells))
    if len(missing) > 1 and jobs > 1:
        warm_up([cell for cell, _, _ in missing])
    pending: list[Row] = []
    flushed = time.monotonic()
    outcomes = _outcomes(missing, jobs)
    try:
        with closing(outcomes):
            for outcome in outcomes:
                if outcome is not None:
                    pending += outcome.rows
                    if outcome.run is not None:
                        store.save_run(outcome.key, outcome.run)
                    done += 1
                    if on_row is not None:
                        on_row(outcome.key.label, done, len(cells))
                if pending and time.monotonic() - flushed > FLUSH_INTERVAL:
                    store.add(pending)
                    pending, flushed = [], time.monotonic()
                interruption.check()
    except TerminatedWorkerError as error:
        raise StudyError(
            f"a worker process ended unexpectedly ({str(error).splitlines()[0]}); what was computed is "
            f"kept in {str(store.path)!r}; run again, with fewer --jobs if memory was short"
        ) from None
    finally:
        store.add(pending)
    return store.rows_of(keys)


Work = tuple[Cell, Key, bool]
"""A cell, its identity, and whether its recorded run is to be kept."""


def _missing(
    cells: Sequence[Cell],
    keys: Sequence[Key],
    store: Store,
    keep: Sequence[str],
    retry_failed: bool,
) -> list[Work]:
    """What is to be done; the slow cells first, so that no process is left alone with one at the end."""
    succeeded = store.cells(keys)
    work = []
    for cell, key in zip(cells, keys, strict=True):
        kept = any(fnmatchcase(key.label, pattern) for pattern in keep)
        done = succeeded.get(key.digest)  # None: not there
        again = kept and not store.has_run(key) if done else done is None or retry_failed
        if again:
            work.append((cell, key, kept))
    return sorted(
        work, key=lambda one: not (isinstance(one[0], Job) and is_hosted(one[0].controller))
    )


def _outcomes(work: Sequence[Work], jobs: int) -> Generator[Outcome | None]:
    """What becomes of the cells, as they finish; None where nothing did for a while."""
    if jobs == 1 or len(work) <= 1:
        for one in work:
            yield run_cell(*one)
        return
    first, followers = _followers(work)
    finished: SimpleQueue[Future[Outcome]] = SimpleQueue()
    with processes(min(jobs, len(work))) as executor:

        def submit(some: Sequence[Work]) -> None:
            for one in some:
                executor.submit(run_cell, *one).add_done_callback(finished.put)

        submit(first)
        left = len(work)
        while left:
            try:
                outcome = finished.get(timeout=FLUSH_INTERVAL).result()
            except Empty:
                yield None
                continue
            left -= 1
            submit(followers.get(outcome.key.digest, ()))
            yield outcome


def _followers(work: Sequence[Work]) -> tuple[list[Work], dict[str, list[Work]]]:
    """What can begin, and what waits for the cell of a digest: the first task of a function compiles for the others."""
    leaders: dict[object, str] = {}
    first: list[Work] = []
    followers: dict[str, list[Work]] = {}
    for one in work:
        cell, key, _ = one
        leader = leaders.setdefault(cell.function, key.digest) if isinstance(cell, Task) else ""
        (followers.setdefault(leader, []) if leader not in ("", key.digest) else first).append(one)
    return first, followers


def check_rules(rules: Iterable[str]) -> None:
    """Ask each rule for one small answer; raises `StudyError` where a rule is unknown or its solver is missing."""
    problem = AllocationProblem(cap=np.array([0.1, 0.2]), expected=0.15)
    for rule in rules:
        try:
            find_rule(rule)(problem)
        except (ValueError, ImportError) as error:
            raise StudyError(" ".join(str(error).split())) from None


def warm_up(cells: Sequence[Cell]) -> None:
    """Compile once what the workers will need, so that they load it from the cache.

    All compiled rules and controllers are one program, compiled here. Another process meanwhile compiles the plant, which
    that program takes from the cache when it gets to it, and then what hosted controllers need.
    """
    jobs = [cell for cell in cells if isinstance(cell, Job)]
    if not jobs:
        return
    hosted = [name for name in dict.fromkeys(job.controller for job in jobs) if is_hosted(name)]
    first = jobs[0]
    short = first.scenario.changed(duration_s=0.2)
    with processes(1) as executor:
        elsewhere = [executor.submit(rehearse_plant, short)]
        elsewhere += [executor.submit(rehearse, name) for name in hosted]
        check_rules(dict.fromkeys(job.rule for job in jobs))
        # a cell that fails here fails again as a row of its own, with its reason
        built_in = Job(short, first.rule, "none", first.seed)
        run_cell(built_in, key_of(built_in))
        for future in elsewhere:
            future.exception()
