"""What a folder of rows and a run of many cells survive, and what a row depends on."""

import ast
import json
import logging
import os
import platform
import re
import signal
import subprocess
import sys
import textwrap
import threading
import time
from functools import partial
from itertools import pairwise
from pathlib import Path

import numba
import numpy as np
import pandas as pd
import pytest

from studies import StudyError, WorkerLost
from studies.runner import row_key, workers
from studies.runner.progress import VERBOSE, print_progress, show_progress, write_log
from studies.runner.provenance import describe_origin, find_commit, origin_line
from studies.runner.row_key import ROWS, folder_hash, hash_sources
from studies.runner.rows import append_rows, latex_table, markdown_table, read_rows, write_table
from studies.runner.study import run_study
from tests.studies import made_study
from tests.studies.made_study import make

CELLS = 60
WANTED = [float(k) for k in range(CELLS) if k != made_study.FAILS]
ROOT = Path(__file__).parents[2]
SCRIPT = """
import sys
from studies.runner.study import run_study
from tests.studies.made_study import make
if __name__ == "__main__":
    run_study(make(float(sys.argv[2])), sys.argv[1], int(sys.argv[3]), jobs=int(sys.argv[4]))
"""


def values(rows):
    return rows.loc[rows["status"] == "ok", "value"].tolist()


@pytest.fixture
def script(tmp_path):
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)

    def start(pause, jobs, folder=tmp_path / "rows"):
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        arguments = [sys.executable, str(path), str(folder), str(pause), str(CELLS), str(jobs)]
        # a shell's background jobs ignore what Ctrl-C sends
        heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
        return subprocess.Popen(
            arguments, env=environment, stderr=subprocess.DEVNULL, preexec_fn=heeds
        )

    return start


def test_a_cell_that_fails_is_a_row_and_runs_again_when_asked(tmp_path):
    rows = run_study(make(), tmp_path, CELLS, jobs=2)
    assert values(rows) == WANTED
    bad = rows[rows["status"] == "failed"]
    assert list(bad["k"]) == [made_study.FAILS]
    assert "ValueError: unlucky (at made_study.py:" in bad["reason"].iloc[0]
    written = (tmp_path / ROWS).read_bytes()
    run_study(make(), tmp_path, CELLS)
    assert (tmp_path / ROWS).read_bytes() == written
    run_study(make(), tmp_path, CELLS, retry_failed=True)
    assert (tmp_path / ROWS).read_bytes().count(b"cell") == CELLS + 1


def test_more_events_and_new_labels_run_nothing_again(tmp_path):
    before = run_study(make(), tmp_path, 5)
    rows = run_study(make(label="new"), tmp_path, 10)
    assert set(rows["label"]) == {"new"}
    assert list(rows["batch"][:5]) == list(before["batch"])


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("jobs", [1, 2])
def test_a_run_that_is_stopped_goes_on(tmp_path, script, sign, jobs):
    process = script(0.1, jobs)
    while not read_rows(tmp_path / "rows"):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(sign)
    process.wait(timeout=30)
    count = len(read_rows(tmp_path / "rows"))
    assert 0 < count < CELLS
    deadline = time.monotonic() + 30  # workers end with their parent
    while subprocess.run(["pgrep", "-f", str(tmp_path)], stdout=subprocess.DEVNULL).returncode == 0:
        assert time.monotonic() < deadline
        time.sleep(0.1)
    rows = run_study(make(0.1), tmp_path / "rows", CELLS, jobs=2)
    assert values(rows) == WANTED


def test_two_writers_at_once(tmp_path, script):
    both = [script(0.05, 2) for _ in range(2)]
    assert [writer.wait(timeout=120) for writer in both] == [0, 0]
    assert values(run_study(make(0.05), tmp_path / "rows", CELLS)) == WANTED


def test_workers_start_while_another_thread_computes(tmp_path):
    """A fork would inherit the locks that the thread holds, and wait for ever."""
    import readhesion

    thread = threading.Thread(target=readhesion.simulate, args=("wet-start", "alone", "none"))
    thread.start()
    assert values(run_study(make(), tmp_path, CELLS, jobs=2)) == WANTED
    thread.join()


def test_a_lost_worker_is_noticed_and_no_bad_input(tmp_path):
    with pytest.raises(WorkerLost, match="a worker was lost"):
        run_study(make(0.05, kill=True), tmp_path, CELLS, jobs=2)
    assert read_rows(tmp_path)


def test_rows_are_the_same_to_the_last_bit_and_two_folders_unite(tmp_path):
    value = {
        "x": np.float64(0.1) + 0.2,
        "n": np.int64(3),
        "nan": np.nan,
        "yes": np.bool_(True),
        "µ": "é",
    }
    for folder in ("a", "b"):
        append_rows(tmp_path / folder, {folder: [value, value]})
    row = read_rows(tmp_path / "a")["a"][1]
    assert b"NaN" not in (tmp_path / "a" / ROWS).read_bytes()  # no other language reads that
    assert np.isnan(row.pop("nan"))
    assert row == {"x": 0.1 + 0.2, "n": 3, "yes": True, "µ": "é"}
    with open(tmp_path / "a" / ROWS, "ab") as both:
        both.write((tmp_path / "b" / ROWS).read_bytes())
    assert set(read_rows(tmp_path / "a")) == {"a", "b"}


@pytest.mark.parametrize("length", [-1, -2, -30, 20])
def test_a_line_that_was_cut_off_is_run_again(tmp_path, length):
    run_study(make(), tmp_path, CELLS)
    path = tmp_path / ROWS
    path.write_bytes(path.read_bytes()[:length])
    assert len(read_rows(tmp_path)) < CELLS or length == -1
    assert values(run_study(make(), tmp_path, CELLS)) == WANTED


def test_a_full_disk(tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(small)]
    if os.getuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("nothing may be mounted here")
    try:
        (small / "fill").write_bytes(b"x" * 50_000)
        with pytest.raises(StudyError, match=r"rows cannot be written there.*No space"):
            run_study(make(), small, 5000)
        (small / "fill").unlink()
        assert values(run_study(make(), small, CELLS)) == WANTED
    finally:
        subprocess.run(["umount", str(small)], check=True)


def test_a_folder_that_is_none(tmp_path):
    (tmp_path / "folder").write_text("a file")
    with pytest.raises(StudyError, match="rows cannot be written there"):
        run_study(make(), tmp_path / "folder", 5)


def test_dask(tmp_path):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as cluster:
        rows = run_study(make(0.01), tmp_path, CELLS, scheduler=cluster.scheduler_address)
    assert values(rows) == WANTED
    assert os.getpid() not in set(rows["pid"].dropna())


def test_nobody_at_the_address(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "REACHED", 1)
    with pytest.raises(StudyError, match="nobody works there"):
        run_study(make(), tmp_path, 5, scheduler="tcp://127.0.0.1:1")


# what a row depends on

SOURCE = """
    import numpy as np
    from studies.runner.row_key import MOST_FILES as most

    SIZE = 2
    LABEL = "axis"

    class Rail:
        level: float = 0.1

    RULE = Rule("r", "what it does", colour="#000000", promise="effort")

    def helper(x, least=0.0):
        "Says something."
        total = max(x, least)
        for k in range(3):
            total += sum(k * part for part in range(k))
        return total * SIZE

    def run(k):
        return {"value": helper(k) + Rail.level + most, "rule": RULE}

    def figure(rows):
        return LABEL
"""


def key(monkeypatch, tmp_path, source):
    """The hash of `run` in a module of the project with this source."""
    monkeypatch.setattr(row_key, "FOLDER", None)
    path = tmp_path / f"{abs(hash(source))}.py"
    path.write_text(textwrap.dedent(source))
    name = f"studies.made_{path.stem}"
    monkeypatch.setattr("studies.runner.row_key.module_path",
                        lambda module: path if module == name else original(module))  # fmt: skip

    def run():
        """Stands for the one in the file."""

    run.__module__, run.__qualname__ = name, "run"
    return hash_sources(run)


original = sys.modules["studies.runner.row_key"].module_path


@pytest.mark.parametrize(("old", "new", "same"), [
    ('"axis"', '"other axis"', True),
    ("Says something", "Says more", True),
    ("return LABEL", "return LABEL + LABEL", True),
    ("total", "mass", True),
    ("part", "piece", True),
    ("#000000", "#ffffff", True),
    ("what it does", "what else it does", True),
    ("SIZE = 2", "SIZE = 3", False),
    ("total * SIZE", "SIZE * total", False),
    ("total +=", "total -=", False),
    ("least=0.0", "least=0.5", False),
    ("least", "lowest", False),
    ('"effort"', '"exact"', False),
    ("0.1", "0.2", False),
    ("MOST_FILES", "DATA", False),
])  # fmt: skip
def test_a_row_depends_on_what_its_function_names(monkeypatch, tmp_path, old, new, same):
    source = key(monkeypatch, tmp_path, SOURCE)
    assert (key(monkeypatch, tmp_path, SOURCE.replace(old, new)) == source) == same


@pytest.mark.parametrize(("edited", "part"), [
    ("alloc/evaluation/measured_series.py", "alloc.evaluation.measured_series"),
    ("alloc/conformance.py", "alloc.conformance"), ("alloc/plant/rail.py", "alloc"),
])  # fmt: skip
def test_what_no_run_uses_counts_where_it_is_named(monkeypatch, edited, part):
    """Estimations of measured runs, kits and citations stand apart."""
    parts = ("alloc", "mpc", *row_key.APART)
    before = {name: row_key._hash_package(name) for name in parts}
    read = row_key._read_syntax
    monkeypatch.setattr(
        row_key,
        "_read_syntax",
        lambda path: ast.parse("x = 1") if path.match(edited) else read(path),
    )
    row_key._hash_package.cache_clear()
    after = {name: row_key._hash_package(name) for name in parts}
    row_key._hash_package.cache_clear()
    assert [name for name in parts if before[name] != after[name]] == [part]


@pytest.mark.parametrize(("module", "counted"), [
    ("own_study", {"studies", "alloc", "mpc"}), ("studies.gradient", {"alloc", "mpc"}),
])  # fmt: skip
def test_behind_a_users_file_the_project_counts(monkeypatch, module, counted):
    """Its imports are not followed; behind a study of its own all studies count too."""
    names = []
    monkeypatch.setattr(row_key, "_hash_package", lambda name: names.append(name) or name)
    row_key._read_names(module, "run", [], True)
    assert counted == {*names} - {*row_key.APART}
    assert {*row_key.APART} < {*names}


def test_a_users_file_counts_with_its_folder(tmp_path):
    plugin = tmp_path / "own.py"
    plugin.write_text("import helper")
    hashes = []
    for name, text in (("helper.py", "A = 1"), ("helper.py", "A = 2"), ("curve.csv", "1,2"),
                       ("results/table.csv", "9"), ("deeper/more.py", "B = 1"), ("deeper/x.json", "1")):  # fmt: skip
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
        folder_hash.cache_clear()
        hashes.append(folder_hash(str(plugin)))
    assert [a == b for a, b in pairwise(hashes)] == [False, False, True, False, False]


def test_tables_as_files(tmp_path):
    table = pd.DataFrame({"a": [1.0], "b": ["x|y"]})
    table.attrs["statements"] = [object()]
    texts = {"md": markdown_table(table), "tex": latex_table(table)}
    assert texts["md"] == "| a | b |\n| --: | --- |\n| 1.000 | x\\|y |\n"
    write_table(table, tmp_path / "t.1", texts)
    for ending, text in texts.items():
        written = (tmp_path / f"t.1.{ending}").read_text()
        assert written.startswith(text)
        assert origin_line() in written
    stored = pd.read_parquet(tmp_path / "t.1.parquet")
    assert stored["a"].iloc[0] == 1.0
    assert stored.attrs == describe_origin()
    assert pd.read_csv(tmp_path / "t.1.csv")["b"].iloc[0] == "x|y"


def test_a_table_of_latex_has_as_many_cells_as_columns_and_no_letter_that_latex_lacks():
    entries = ["a & b_1 {x}", "[2, 3]", "*", "\N{MINUS SIGN}1.0 ± 2 % of 3 m/s²", "a\\b", "50 °"]
    text = latex_table(pd.DataFrame({"name": entries, "x [#]": np.arange(6.0)}))
    head, *rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert text.startswith("\\begin{tabular}{lr}\n\\toprule\nname & x {[}\\#] ")
    assert [len(re.split(r"(?<!\\)&", row)) for row in (head, *rows)] == [2] * 7
    assert text.isascii()
    assert not [
        row for row in rows if row[0] in "[*"
    ]  # they would belong to the end of the row above


def test_rows_say_what_computed_them(tmp_path, monkeypatch):
    run_study(make(), tmp_path, 3)
    origin, *cells = map(json.loads, (tmp_path / ROWS).read_text().splitlines())
    assert origin == {"origin": describe_origin()}
    assert len(cells) == 3
    assert platform.node() not in re.split("[ ,]", origin_line())
    monkeypatch.setattr("studies.runner.provenance.ROOT", tmp_path)  # in no repository of ours
    find_commit.cache_clear()
    assert find_commit() == ""
    find_commit.cache_clear()


def test_progress_where_stderr_is_no_terminal(monkeypatch, capsys):
    monkeypatch.setattr("studies.runner.progress.EVERY", 0.01)
    lines, deadline = "", time.monotonic() + 30
    with print_progress("made", False), show_progress("cells", 4, quiet=False) as advance:
        advance(1)
        while "cells (compiles at first): 1 of 4" not in lines:
            assert time.monotonic() < deadline
            time.sleep(0.01)
            lines += capsys.readouterr().err


def test_the_log_has_what_is_stored_computed_and_compiled(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv(VERBOSE, "")  # as it was, afterwards
    caplog.set_level(logging.INFO, "readhesion")
    write_log()
    for count in (3, 14):
        run_study(make(), tmp_path, count)
    numba.njit(lambda x: x + 1)(1)
    log = "\n".join(caplog.messages)
    assert "made: 3 runs, of which" in log
    assert f"made: 14 runs, of which {tmp_path} has 3\n" in log
    assert f"cell {made_study.FAILS}: failed in 0.00 s ValueError: unlucky" in log
    assert f"compiling {__name__}.test_the_log" in log
