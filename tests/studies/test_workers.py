"""Those who do cells elsewhere: nothing is lost with a worker, and what is shared is prepared once."""

import logging
import multiprocessing
import os
import signal
import time
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

import studies.core.run
from alloc.metrics import METRICS
from alloc.rules.rule import RULES, Rule
from studies.command_line.main import run
from studies.comparison.summary import Grid
from studies.core.cell import Task
from studies.core.run import Workers, _tasks, cluster, processes, run_cells, workers
from studies.core.store import Store
from studies.core.study import Study
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario

needs_dask = pytest.mark.skipif(find_spec("distributed") is None, reason="no distributed")


def first_time(folder: str, name: str) -> bool:
    """Whether this is the first call with `name`, of any process."""
    try:
        os.close(os.open(Path(folder) / name, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return False
    return True


def square(k: int) -> dict[str, int]:
    return {"k": k, "square": k * k, "process": os.getpid()}


def mortal_square(k: int, folder: str) -> dict[str, int]:
    """The square; the first to ask for that of 3 is killed."""
    if k == 3 and first_time(folder, "killed"):
        os.kill(os.getpid(), signal.SIGKILL)
    return square(k)


def tasks(count: int, *arguments: str) -> list[Task]:
    function = mortal_square if arguments else square
    return [Task(f"{function.__name__}/{k}", function, (k, *arguments)) for k in range(count)]


@contextmanager
def local_cluster(count: int):
    """Address of a scheduler with so many workers on this machine."""
    from distributed import LocalCluster

    place = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}
    with LocalCluster(n_workers=count, threads_per_worker=1, **place) as made:
        yield made.scheduler_address


@pytest.fixture(scope="module")
def scheduler():
    """Address of a cluster of two workers on this machine."""
    with local_cluster(2) as address:
        yield address


def test_a_killed_process_ends_the_study_and_what_was_computed_is_kept(tmp_path):
    store = Store(tmp_path)
    cells = tasks(12, str(tmp_path))
    with pytest.raises(StudyError, match=r"a worker or its work was lost .* is kept"):
        run_cells(cells, store, 2)
    before = store.read()
    assert (before["status"] == "ok").all()
    table = run_cells(cells, store, 2)
    assert table["square"].tolist() == [k * k for k in range(12)]
    assert before["cell"].isin(table["cell"]).all()


@needs_dask
def test_what_a_killed_worker_of_a_cluster_had_to_do_is_done_by_another(tmp_path, scheduler):
    with cluster(scheduler) as others:
        assert others.count == 2
        table = run_cells(tasks(12, str(tmp_path)), Store(tmp_path), others)
    assert (tmp_path / "killed").exists()
    assert table["square"].tolist() == [k * k for k in range(12)]
    assert os.getpid() not in set(table["process"])


@needs_dask
def test_a_cluster_computes_the_same_numbers_as_this_process(short, tmp_path, scheduler):
    cells = Grid((short,), ("alone", "exact"), ("cut-and-ramp",), (0, 1)).jobs()
    here = run_cells(cells, Store(tmp_path / "here"))
    with cluster(scheduler) as others:
        there = run_cells(cells, Store(tmp_path / "there"), others)
    names = [name for name in METRICS if not name.startswith(("rule_time", "controller_"))]
    np.testing.assert_array_equal(here[names].to_numpy(float), there[names].to_numpy(float))


@needs_dask
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--executor", "dask", "--scheduler", "nonsense"], "missing port number"),
        (["--executor", "dask", "--scheduler", "tcp://127.0.0.1:1"], "nobody answers there"),
        (["--executor", "dask"], "give the --scheduler"),
        (["--executor", "dask", "--scheduler", "tcp://a:1", "--jobs", "2"], "no --jobs"),
        (["--scheduler", "tcp://127.0.0.1:8786"], "--scheduler is for --executor dask"),
    ],
)
def test_a_cluster_that_cannot_be_had_is_one_line(words, said, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(studies.core.run, "CONNECT_TIME", 0.2)
    assert run(["sweep", "claims", "--events", "1", "--out", str(tmp_path), *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


@needs_dask
def test_a_cluster_without_workers_is_one_line(monkeypatch):
    monkeypatch.setattr(studies.core.run, "CONNECT_TIME", 0.5)
    none = pytest.raises(StudyError, match="has no workers; start some: dask worker tcp://")
    with local_cluster(0) as address, none, cluster(address):
        pass


def test_processes_serve_all_stages_of_a_study(tmp_path, monkeypatch):
    counts = []
    monkeypatch.setattr(
        studies.core.run, "processes", lambda count: counts.append(count) or processes(count)
    )
    study = Study(
        name="squares", question="which", default_events=4, judge=lambda table: [],
        cells=lambda seed, events: tasks(events),
        later=(lambda seed, events, table: [Task(f"later/{k}", square, (k,)) for k in range(4)],),
    )  # fmt: skip
    table = study.run(tmp_path, 4, jobs=2)
    assert len(table) == 8
    assert counts == [2]
    assert len(set(table["process"]) - {os.getpid()}) <= 2


def test_one_cell_or_one_process_needs_no_other(tmp_path):
    with workers(1) as others:
        assert others is None
    refused = Workers(submit=lambda *_: pytest.fail("it was sent elsewhere"), count=2)
    assert run_cells(tasks(1), Store(tmp_path), refused)["process"].tolist() == [os.getpid()]


def test_all_rules_meet_one_event_that_is_made_once(short, tmp_path, monkeypatch):
    made = []
    event = Scenario.event
    monkeypatch.setattr(
        Scenario, "event", lambda self, seed=0: made.append(seed) or event(self, seed)
    )
    grid = Grid((short,), ("alone", "exact", "greedy"), ("none", "cut-and-ramp"), (0, 1))
    assert len(run_cells(grid.jobs(), Store(tmp_path))) == 12
    assert sorted(made) == [0, 1]


def test_a_rule_that_breaks_fails_its_own_row_alone(short, tmp_path, monkeypatch):
    def broken(problem):
        raise ZeroDivisionError("nothing to share")

    monkeypatch.setitem(RULES._parts, "qp", Rule("qp", "breaks", broken))
    table = run_cells(
        Grid((short,), ("alone", "qp", "exact"), ("none",), (0,)).jobs(), Store(tmp_path)
    )
    status = dict(zip(table["rule"], table["status"], strict=True))
    assert status == {"alone": "ok", "qp": "failed", "exact": "ok"}


def test_figures_of_the_same_rows_are_drawn_once(tmp_path, monkeypatch):
    from studies.core import gallery

    drawn = []

    class Drawing:
        def draw_comparison(self, table, store, out, asked):
            drawn.append(len(table))
            out.mkdir(exist_ok=True)
            (out / "one.pdf").touch()
            return ["one"]

    monkeypatch.setattr(gallery, "gallery", Drawing)
    rows = pd.DataFrame({"cell": ["a", "b"], "status": ["ok", "failed"]})
    out = tmp_path / "figures"
    for table in (rows, rows, rows[:1], rows.assign(status="ok"), rows.assign(status="ok")):
        assert gallery.draw_comparison(table, None, out) == ["one"]
    assert drawn == [2, 1, 2]
    (out / "one.pdf").unlink()
    gallery.draw_comparison(rows.assign(status="ok"), None, out)
    assert drawn == [2, 1, 2, 2]
    for _ in range(2):  # other words stand in them
        gallery.draw_comparison(rows.assign(status="ok"), None, out, gallery.Asked("other", True))
    assert drawn == [2, 1, 2, 2, 2]


class Named(NamedTuple):
    """As much of a cell as tells where it is done."""

    name: str
    group: str | None


def parts(groups: str, count: int, together: int = 1) -> list[str]:
    """Tasks of cells whose groups are letters, "-" for none."""
    cells = [Named(letter, None if letter == "-" else letter) for letter in groups]
    tasks = _tasks([(cell, None, False) for cell in cells], count, together)
    return ["".join(cell.name for cell, _, _ in task) for task in tasks]


def test_a_task_is_a_group_unless_workers_had_too_few_or_tasks_were_too_short():
    many = "ab" * 7
    assert parts(many, 0) == ["a" * 7, "b" * 7]
    assert parts(many, 1) == ["aaa", "aaa", "a", "bbb", "bbb", "b"]
    assert parts("abcdefgh" * 3, 2) == [3 * letter for letter in "abcdefgh"]
    assert parts("abcdefgh" * 3, 1, together=5) == ["aaabbb", "cccddd", "eeefff", "ggghhh"]
    assert parts("a--ab", 0) == ["aa", "-", "-", "b"]
    assert parts("-a-b", 0, together=9) == ["-", "a", "-", "b"]


def test_an_interrupt_ends_tasks_that_no_worker_was_given():
    futures = []

    def interrupted():
        with processes(1) as made:
            futures.extend(made.submit(time.sleep, 60.0) for _ in range(9))
            while not futures[0].running():
                time.sleep(0.01)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len(futures) == 9
    assert all(future.done() for future in futures)


def test_an_interrupt_ends_no_process_of_anybody_else():
    """Such as that of another pool, or of a part of one's own, whether it began before the workers or after them."""
    sleeping = [
        multiprocessing.get_context("fork").Process(target=time.sleep, args=(60.0,))
        for _ in range(2)
    ]
    before, after = sleeping

    def interrupted():
        before.start()
        with processes(1) as made:
            future = made.submit(os.getpid)
            after.start()
            assert future.result() not in (before.pid, after.pid)
            raise KeyboardInterrupt

    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
        assert all(one.is_alive() for one in sleeping)
    finally:
        for one in sleeping:
            one.kill()
            one.join()
