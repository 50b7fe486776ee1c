"""What studies cost: a flush, opening and reading of their table, and how busy short tasks keep four workers. `make bench`.

Of the table 100,000 rows; a million with READHESION_FULL=1.
"""

import os
import time
from contextlib import contextmanager
from functools import partial

import numpy as np
import pyarrow as pa
import pytest

from alloc.metrics import METRICS
from studies.core.cell import Key, Task, key_of
from studies.core.run import cluster, do_task, processes
from studies.core.store import FULL, Store

MANY = 1_000_000 if os.environ.get("READHESION_FULL") else 100_000


FLUSH = 80


"""Rows of two seconds at 40 rows per s."""


NUMBERS = [*METRICS, *(f"measured {k}" for k in range(54 - len(METRICS)))]


TEXTS = {"code_hash": 16 * "c", "scenario_hash": 16 * "5", "scenario": "random-0-0001", "rule": "exact",
         "controller": "cut-and-ramp", "status": "ok", "reason": "", "messages": "{}"}  # fmt: skip


"""As many columns as a row of the sweep `claims` has."""


rng = np.random.default_rng(1)


def columns(first: int, count: int) -> pa.Table:
    numbers = {name: rng.standard_normal(count) for name in NUMBERS}
    texts = {name: count * [text] for name, text in TEXTS.items()}
    cells = {
        "cell": [f"{k * 0x9E3779B97F4A7C15 % 2**64:016x}" for k in range(first, first + count)]
    }
    return pa.table(cells | texts | {"seed": np.arange(count)} | numbers)


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """Table by its number of rows."""
    folders = {rows: tmp_path_factory.mktemp(f"rows-{rows}") for rows in (0, MANY)}
    store = Store(folders[MANY])
    for first in range(0, MANY, FULL):
        store.parts.add(columns(first, FULL))
    return folders


@pytest.mark.parametrize("before", [0, MANY])
def test_flush(benchmark, filled, before):
    benchmark.group = f"flush of {FLUSH} rows"
    rows = iter([columns(10**8 + k, FLUSH).to_pylist() for k in range(0, 110 * FLUSH, FLUSH)])
    store = Store(filled[before])
    benchmark.pedantic(lambda: store.add(next(rows)), rounds=100, warmup_rounds=5)


def test_opening(benchmark, filled):
    benchmark.group = f"table of {MANY} rows"
    keys = [Key("", cell, "") for cell in columns(0, 40_000)["cell"].to_pylist()]
    found = benchmark.pedantic(lambda: Store(filled[MANY]).cells(keys), rounds=3)
    assert len(found) == 40_000


def test_reading_of_40000(benchmark, filled):
    benchmark.group = f"table of {MANY} rows"
    store = Store(filled[MANY])
    keys = [Key("", cell, "") for cell in columns(10_000, 40_000)["cell"].to_pylist()]
    store.cells(keys)
    assert len(benchmark.pedantic(partial(store.rows_of, keys), rounds=3)) == 40_000


WORKERS = 4


TASKS = 200


def pause(k: int, seconds: float) -> dict[str, int]:
    """A short task that needs no processor, so that four of them fit on two cores."""
    time.sleep(seconds)
    return {"k": k}


@contextmanager
def dask():
    from distributed import LocalCluster

    place = {"dashboard_address": "127.0.0.1:0", "silence_logs": 50}
    here = LocalCluster(n_workers=WORKERS, threads_per_worker=1, **place)
    with here, cluster(here.scheduler_address) as others:
        yield others


@pytest.mark.parametrize("seconds", [0.02, 0.1])
@pytest.mark.parametrize("made", [lambda: processes(WORKERS), dask], ids=["processes", "dask"])
def test_short_tasks_elsewhere(benchmark, made, seconds):
    if not benchmark.enabled:
        pytest.skip("measures time alone")
    cells = [Task(f"{k}", pause, (k, seconds)) for k in range(TASKS)]
    tasks = [[(cell, key_of(cell), False)] for cell in cells]

    with made() as others:

        def all_tasks():
            for future in [others.submit(do_task, task, "") for task in tasks]:
                future.result()

        all_tasks()  # processes begin, and import
        benchmark.pedantic(all_tasks, rounds=3)
    busy = seconds * TASKS / (WORKERS * benchmark.stats["min"])
    benchmark.extra_info["share of the workers' time in tasks"] = round(busy, 3)
    assert busy > 0.5
