"""Run the cells that a store lacks, in parallel, and keep every row as it comes."""

import signal
import time
import warnings
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from fnmatch import fnmatchcase

import joblib
import numpy as np
import pandas as pd
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import ProcessPoolExecutor, TerminatedWorkerError

from alloc.rules import AllocationProblem, find_rule
from studies.core.cell import Cell, Key, OnRow, Outcome, Row, key_of, run_cell
from studies.core.controllers import is_hosted, rehearse, rehearse_plant
from studies.core.job import Job
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
                pending += outcome.rows
                if outcome.run is not None:
                    store.save_run(outcome.key, outcome.run)
                done += 1
                if on_row is not None:
                    on_row(outcome.key.label, done, len(cells))
                if time.monotonic() - flushed > FLUSH_INTERVAL:
                    store.add(pending)
                    pending, flushed = [], time.monotonic()
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
    succeeded = store.cells()
    present = succeeded if retry_failed else store.cells(failed_too=True)
    work = []
    for cell, key in zip(cells, keys, strict=True):
        kept = any(fnmatchcase(key.label, pattern) for pattern in keep)
        unrecorded = kept and key.digest in succeeded and not store.run_path(key).exists()
        if key.digest not in present or unrecorded:
            work.append((cell, key, kept))
    return sorted(
        work, key=lambda one: not (isinstance(one[0], Job) and is_hosted(one[0].controller))
    )


def _outcomes(work: Sequence[Work], jobs: int) -> Generator[Outcome, None, None]:
    if jobs == 1 or len(work) <= 1:
        for one in work:
            yield run_cell(*one)
        return
    with joblib.parallel_config("loky", initializer=_ignore_interrupt):
        parallel = joblib.Parallel(n_jobs=min(jobs, len(work)), return_as="generator_unordered")
    outcomes = parallel(joblib.delayed(run_cell)(*one) for one in work)
    try:
        for outcome in outcomes:  # noqa: UP028 (a close must not reach joblib, which warns of unused results)
            yield outcome
    except (GeneratorExit, KeyboardInterrupt):
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            outcomes.close()
        get_reusable_executor().shutdown(wait=True, kill_workers=True)
        raise


def _ignore_interrupt() -> None:
    # an interrupt from the keyboard reaches every process; the parent alone decides what happens then
    signal.signal(signal.SIGINT, signal.SIG_IGN)


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
    # not the pool that runs the cells: that one belongs to joblib
    executor = ProcessPoolExecutor(1, initializer=_ignore_interrupt)
    interrupted = True
    try:
        first = jobs[0]
        short = first.scenario.changed(duration_s=0.2)
        elsewhere = [executor.submit(rehearse_plant, short)]
        elsewhere += [executor.submit(rehearse, name) for name in hosted]
        check_rules(dict.fromkeys(job.rule for job in jobs))
        # a cell that fails here fails again as a row of its own, with its reason
        built_in = Job(short, first.rule, "none", first.seed)
        run_cell(built_in, key_of(built_in))
        for future in elsewhere:
            future.exception()
        interrupted = False
    finally:
        executor.shutdown(wait=True, kill_workers=interrupted)
