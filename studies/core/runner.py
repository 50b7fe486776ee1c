"""The grid scenario x rule x controller x seed: run what is missing, in parallel, and keep every row as it comes."""

import signal
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase

import joblib
import numpy as np
import pandas as pd
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import ProcessPoolExecutor, TerminatedWorkerError

from alloc.rules import AllocationProblem, find_rule
from alloc.simulation import CONTROLLERS
from studies.core.code_version import code_hash
from studies.core.controllers import HOSTED, rehearse, rehearse_plant
from studies.core.job import Job, Measure, Outcome, run_job, simulate_job
from studies.core.store import Store, select
from studies.core.study_error import StudyError
from studies.scenario.scenario import Scenario

FLUSH_INTERVAL = 2.0
"""Rows are written at least this often [s] while runs finish."""


@dataclass(frozen=True)
class Grid:
    """What a comparison consists of: the product of its parts, plus `extra` cells."""

    scenarios: tuple[Scenario, ...]
    rules: tuple[str, ...]
    controllers: tuple[str, ...]
    seeds: tuple[int, ...]
    extra: tuple[tuple[Scenario, str, str], ...] = ()
    """Cells (scenario, rule, controller) beyond the product, over the same seeds."""

    def jobs(self) -> list[Job]:
        """Every cell once: by scenario, then rule, controller, seed."""
        cells = [
            (scenario, rule, controller)
            for scenario in self.scenarios
            for rule in self.rules
            for controller in self.controllers
        ]
        jobs = [
            Job(scenario, rule, controller, seed)
            for scenario, rule, controller in dict.fromkeys([*cells, *self.extra])
            for seed in self.seeds
        ]
        names = {job.scenario.name: job.scenario for job in jobs}
        for job in jobs:
            if names[job.scenario.name] != job.scenario:
                raise StudyError(
                    f"two different scenarios are named {job.scenario.name!r}; rename one of the files"
                )
        order = {name: k for k, name in enumerate(names)}
        rules = {rule: k for k, rule in enumerate(dict.fromkeys(job.rule for job in jobs))}
        return sorted(jobs, key=lambda job: (order[job.scenario.name], rules[job.rule]))


def run_grid(
    grid: Grid,
    store: Store,
    jobs: int = 1,
    keep: Sequence[str] = (),
    retry_failed: bool = False,
    on_row: Callable[[str, int, int], None] | None = None,
) -> pd.DataFrame:
    """Run the cells of `grid` that `store` does not hold yet; returns the table of the whole grid.

    `jobs`: processes. `keep`: patterns such as ``wet-*/exact/*/0`` of runs (scenario/rule/controller/seed) to record as
    netCDF.
    Rows that failed are kept with their reason and not run again unless `retry_failed`. `on_row` is told the label of
    each finished cell, how many are finished and how many there are. On an interrupt what is computed is kept.
    """
    return run_jobs(grid.jobs(), store, jobs, keep, retry_failed, on_row)


def run_jobs(
    cells: Sequence[Job],
    store: Store,
    jobs: int = 1,
    keep: Sequence[str] = (),
    retry_failed: bool = False,
    on_row: Callable[[str, int, int], None] | None = None,
    measure: Measure | None = None,
) -> pd.DataFrame:
    """As `run_grid`, for cells of any choice; `measure` adds columns that no metric has to the rows (see `run_job`)."""
    succeeded = store.keys()
    present = succeeded if retry_failed else store.keys(failed_too=True)

    def wanted(job: Job) -> bool:
        return any(fnmatchcase(job.key.label, pattern) for pattern in keep)

    missing = [
        job
        for job in cells
        if job.key not in present
        or (job.key in succeeded and wanted(job) and not store.run_path(job.key).exists())
    ]
    done = len(cells) - len(missing)
    if on_row is not None:
        on_row("preparing (compiles on first use)" if missing else "", done, len(cells))
    # the slow cells first, so that no process is left alone with one at the end
    missing.sort(key=lambda job: job.controller not in HOSTED)
    if len(missing) > 1 and jobs > 1:
        warm_up(missing)
    pending: list[dict[str, object]] = []
    flushed = time.monotonic()
    outcomes = _outcomes([(job, wanted(job)) for job in missing], jobs, measure)
    try:
        with closing(outcomes):
            for outcome in outcomes:
                pending.append(outcome.row)
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
    return select(store.read(), [job.key for job in cells])


def _outcomes(
    work: Sequence[tuple[Job, bool]], jobs: int, measure: Measure | None
) -> Generator[Outcome, None, None]:
    if jobs == 1 or len(work) <= 1:
        for job, keep in work:
            yield run_job(job, keep, None, measure)
        return
    code = code_hash()
    with joblib.parallel_config("loky", initializer=_ignore_interrupt):
        parallel = joblib.Parallel(n_jobs=min(jobs, len(work)), return_as="generator_unordered")
    outcomes = parallel(joblib.delayed(run_job)(job, keep, code, measure) for job, keep in work)
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


def warm_up(jobs: Sequence[Job]) -> None:
    """Compile once what the workers will need, so that they load it from the cache.

    All compiled rules and controllers are one program, compiled here. Another process meanwhile compiles the plant, which
    that program takes from the cache when it gets to it, and then what hosted controllers need.
    """
    hosted = [name for name in dict.fromkeys(job.controller for job in jobs) if name in HOSTED]
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
        with suppress(ValueError, ArithmeticError, RuntimeError):
            simulate_job(Job(short, first.rule, next(iter(CONTROLLERS)), first.seed), {})
        for future in elsewhere:
            future.exception()
        interrupted = False
    finally:
        executor.shutdown(wait=True, kill_workers=interrupted)
