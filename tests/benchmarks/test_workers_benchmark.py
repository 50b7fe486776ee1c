"""What it costs to hand a task to another process, and how busy four workers are kept by short ones."""

import time
from contextlib import contextmanager

import pytest

from studies.core.cell import Task, key_of
from studies.core.runner import do_task
from studies.core.workers import cluster, processes

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
