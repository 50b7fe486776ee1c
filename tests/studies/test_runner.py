"""The grid: in parallel as in a row, resumed as begun, and nothing lost on the way."""

import subprocess
import sys

import numpy as np
import pytest

import studies.core.run
from alloc.metrics import METRICS
from alloc.onboard.host import CONTROLLERS, HostedController, each_unit
from alloc.recording import load
from studies.comparison.summary import Grid
from studies.core.cell import key_of, run_cell
from studies.core.job import Job, simulate_job
from studies.core.run import run_cells
from studies.core.store import Store
from studies.files.study_error import StudyError

MEASURED = ("rule_time", "controller_median", "controller_p99")
"""Metrics that are wall times; all others follow from the event alone."""


@pytest.fixture
def grid(short):
    return Grid((short,), ("alone", "exact"), ("none", "cut-and-ramp"), (0, 1))


@pytest.fixture
def runs(monkeypatch):
    """Labels of the cells that are run in this process."""
    labels: list[str] = []

    def counted(cell, *rest):
        labels.append(cell.label)
        return run_cell(cell, *rest)

    monkeypatch.setattr(studies.core.run, "run_cell", counted)
    return labels


def broken_controller(context):
    raise RuntimeError("no\nbattery")


def numbers(table):
    return table[[name for name in METRICS if name not in MEASURED]].to_numpy(dtype=float)


def test_in_parallel_the_numbers_are_the_same(grid, tmp_path):
    serial = run_cells(grid.jobs(), Store(tmp_path / "serial"), jobs=1)
    parallel = run_cells(grid.jobs(), Store(tmp_path / "parallel"), jobs=2)
    assert (serial["status"] == "ok").all()
    assert (parallel["status"] == "ok").all(), parallel["reason"].tolist()
    assert serial[["rule", "controller", "seed"]].equals(parallel[["rule", "controller", "seed"]])
    np.testing.assert_array_equal(numbers(serial), numbers(parallel))


def test_what_differs_in_rule_or_controller_alone_meets_the_same_event(short):
    hashes = {
        simulate_job(Job(short, rule, controller, 1)).attrs["event_hash"]
        for rule, controller in (("alone", "none"), ("exact", "cut-and-ramp"))
    }
    other = simulate_job(Job(short, "alone", "none", 2)).attrs["event_hash"]
    assert len(hashes) == 1
    assert other not in hashes


def test_every_cell_runs_once_in_the_order_of_the_grid(short):
    other = short.changed(name="other")
    grid = Grid((short, other), ("exact", "alone"), ("none",), (0, 1), ("mpc",))
    labels = [job.label for job in grid.jobs()]
    assert labels == [
        "short/exact/none/0", "short/exact/none/1", "short/exact/mpc/0",
        "short/alone/none/0", "short/alone/none/1", "short/alone/mpc/0",
        "other/exact/none/0", "other/exact/none/1", "other/exact/mpc/0",
        "other/alone/none/0", "other/alone/none/1", "other/alone/mpc/0",
    ]  # fmt: skip


def test_two_scenarios_of_one_name_are_refused(short):
    with pytest.raises(StudyError, match="two different scenarios are named 'short'"):
        Grid((short, short.changed(duration_s=1.0)), ("exact",), ("none",), (0,)).jobs()


def test_rows_that_exist_are_not_run_again(grid, tmp_path, runs):
    first = run_cells(grid.jobs(), Store(tmp_path))
    assert len(runs) == 8
    second = run_cells(grid.jobs(), Store(tmp_path))
    assert len(runs) == 8
    np.testing.assert_array_equal(numbers(first), numbers(second))


def test_only_what_is_new_is_run(short, tmp_path, runs):
    run_cells(Grid((short,), ("alone",), ("none",), (0,)).jobs(), Store(tmp_path))
    run_cells(Grid((short,), ("alone", "exact"), ("none",), (0,)).jobs(), Store(tmp_path))
    changed = short.changed(duration_s=1.0)
    run_cells(Grid((changed,), ("alone",), ("none",), (0,)).jobs(), Store(tmp_path))
    assert runs == ["short/alone/none/0", "short/exact/none/0", "short/alone/none/0"]


def test_rows_of_other_code_do_not_count(short, tmp_path, runs, monkeypatch):
    grid = Grid((short,), ("alone",), ("none",), (0,))
    run_cells(grid.jobs(), Store(tmp_path))
    monkeypatch.setattr("studies.core.cell.code_hash", lambda *_: "other code")
    assert len(run_cells(grid.jobs(), Store(tmp_path))) == 1
    assert len(runs) == 2
    assert len(Store(tmp_path).read()) == 2


def test_a_worker_with_other_code_refuses(short):
    job = Job(short, "alone", "none", 0)
    (row,) = run_cell(job, key_of(job)._replace(code="older code")).rows
    assert row["status"] == "failed"
    assert "the sources changed while the study ran" in row["reason"]
    assert row["code_hash"] == "older code"


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_interrupt_keeps_what_is_finished(grid, tmp_path, jobs):
    def interrupt(label, done, total):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_cells(grid.jobs(), Store(tmp_path), jobs=jobs, on_row=interrupt)
    assert len(Store(tmp_path).cells()) == 3
    steps = []
    table = run_cells(grid.jobs(), Store(tmp_path), on_row=lambda *step: steps.append(step[1:]))
    assert steps == [(3, 8), (4, 8), (5, 8), (6, 8), (7, 8), (8, 8)]
    assert (table["status"] == "ok").all()


def test_a_failed_cell_becomes_a_row_with_its_reason_and_the_rest_goes_on(
    short, tmp_path, runs, monkeypatch
):
    monkeypatch.setitem(
        CONTROLLERS._parts, "mpc", HostedController("mpc", "breaks", broken_controller)
    )
    grid = Grid((short,), ("alone",), ("mpc", "none"), (0,))
    table = run_cells(grid.jobs(), Store(tmp_path), keep=["*"])
    assert table["status"].tolist() == ["failed", "ok"]
    reason = table.loc[0, "reason"]
    assert reason.startswith("RuntimeError: no battery (at tests/studies/test_runner.py:")
    assert " in broken_controller, from " in reason
    run_cells(grid.jobs(), Store(tmp_path), keep=["*"])
    assert len(runs) == 2
    idle = each_unit(lambda context: AlwaysIdle())
    monkeypatch.setitem(CONTROLLERS._parts, "mpc", HostedController("mpc", "idles", idle))
    mended = run_cells(grid.jobs(), Store(tmp_path), retry_failed=True)
    assert mended["status"].tolist() == ["ok", "ok"]
    assert len(runs) == 3


class AlwaysIdle:
    def decide(self, sense):
        from alloc.onboard.host import TorqueDecision

        return TorqueDecision(0.0, True, "ok", 1e-4)


@pytest.mark.skipif(sys.platform != "linux", reason="a setting of glibc")
def test_the_memory_of_a_run_is_used_again():
    code = (
        "import resource, numpy as np\n"
        "from studies.core.run import reuse_memory\n"
        "def faults():\n"
        "    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt\n"
        "    [np.ones(1_000_000) for _ in range(5)]\n"
        "    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before\n"
        "faults(); print(faults()); reuse_memory(); faults(); print(faults())"
    )
    anew, again = map(int, subprocess.check_output([sys.executable, "-c", code]).split())
    assert again < anew / 4


def test_runs_that_are_to_be_kept_are_recorded_even_if_their_row_exists(short, tmp_path):
    grid = Grid((short,), ("alone", "exact"), ("none",), (0,))
    store = Store(tmp_path)
    run_cells(grid.jobs(), store)
    run_cells(grid.jobs(), store, keep=["short/exact/*/0"])
    kept = [job for job in grid.jobs() if store.has_run(key_of(job))]
    assert [job.rule for job in kept] == ["exact"]
    run = load(store.run_path(key_of(kept[0])))
    assert run.identical(simulate_job(kept[0]).assign_attrs(wall_time_s=run.attrs["wall_time_s"]))


SCRIPT = """
import sys

from alloc.rules import RULES
from studies.core.cell import Task
from studies.core.run import run_cells
from studies.core.store import Store


def counted(k):
    return {"k": k, "rules": len(RULES)}


if __name__ == "__main__":
    cells = [Task(str(k), counted, (k,)) for k in range(4)]
    table = run_cells(cells, Store(sys.argv[1]), jobs=2)
    print(*table["status"], *table["reason"], len(set(table["cell"])))
"""


def test_a_script_runs_tasks_of_its_own_and_its_edit_runs_them_again(tmp_path):
    for edit in ("", "MORE = 1"):
        (tmp_path / "script.py").write_text(SCRIPT + edit)
        words = [sys.executable, str(tmp_path / "script.py"), str(tmp_path / "out")]
        done = subprocess.run(words, capture_output=True, text=True)
        assert done.stdout.split() == ["ok", "ok", "ok", "ok", "4"], done.stderr
    assert len(Store(tmp_path / "out").read()) == 8
