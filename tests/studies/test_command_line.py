"""The command as a user meets it: what it prints, what it writes, and one clear line for what cannot be."""

import errno
import io
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from pydantic import TypeAdapter

import alloc.rules.qp
from alloc.metrics import METRICS
from alloc.onboard.host import CONTROLLERS
from alloc.recording import load
from alloc.rules import RULES
from alloc.sources import ASIDE
from studies.command_line.main import run
from studies.command_line.options import command_of, settings_of
from studies.command_line.simulate import HEADLINES
from studies.core.plugins import VARIABLE
from studies.core.store import Store
from studies.core.study import EachEvent, Study, all_studies
from studies.files.study_error import StudyError
from studies.scenario.scenario import shipped_scenarios

PNG, PDF = b"\x89PNG", b"%PDF"


@pytest.fixture
def small(short_file, tmp_path):
    """Options of a comparison that takes no time."""
    return (
        "--scenario", short_file, "--rules", "alone", "exact", "--controllers", "none",
        "--jobs", 1, "--out", tmp_path / "out",
    )  # fmt: skip


def test_a_comparison_prints_a_table_and_writes_rows_and_figures(call, small, short_file, tmp_path):
    code, out, _ = call("compare", *small)
    assert code == 0
    assert "two slippery seconds" in out
    assert "10 runs" in out
    assert "less alone, paired over 5 seeds" in out
    table = Store(tmp_path / "out").read()
    assert sorted(table["rule"]) == ["alone"] * 5 + ["exact"] * 5
    assert set(METRICS) <= set(table.columns)
    told = (tmp_path / "out" / "figures" / "rule-comparison.txt").read_text()
    assert "Status: complete" in told
    assert f"--scenario {shlex.quote(str(short_file))}" in told
    stem = tmp_path / "out" / "figures" / "rule-comparison"
    assert stem.with_suffix(".png").read_bytes().startswith(PNG)
    assert stem.with_suffix(".pdf").read_bytes().startswith(PDF)


def test_figures_of_fewer_seeds_are_drafts_and_name_the_command_as_it_was_given(
    call, small, tmp_path
):
    """What they name runs as it stands, with the path and not with the event's name."""
    call("compare", *small, "--seeds", 2)
    told = (tmp_path / "out" / "figures" / "rule-comparison.txt").read_text()
    given = [str(word) for word in small if word not in ("--jobs", 1)]
    assert f"in full: {shlex.join(['readhesion', 'compare', *given])}\n" in told


def test_a_command_is_told_with_its_plug_ins_and_can_be_typed_again(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, f"{tmp_path / 'my rule.py'}:/elsewhere/other.py")
    told = command_of("compare", scenario=["a b.toml", "c.toml"], rules=None, out=["x"])
    assert shlex.split(told) == [
        "readhesion", "--plugin", "my rule.py", "--plugin", "/elsewhere/other.py", "compare",
        "--scenario", "a b.toml", "c.toml", "--out", "x",
    ]  # fmt: skip


def test_json_is_all_that_is_printed_holds_every_metric_and_a_second_call_runs_nothing(
    call, small, monkeypatch
):
    names = [option if option != "alone" else "alone,greedy" for option in small]
    code, out, _ = call("compare", *names, "--no-figures", "--json", "--seeds", 2)
    content = json.loads(out)
    assert code == 0
    assert [row["rule"] for row in content["rows"]] == ["alone", "greedy", "exact"]
    assert all(set(METRICS) <= set(row["metrics"]) for row in content["rows"])
    assert content["about"]["scenarios"]["short"]["case"] == "A"
    assert content["about"]["seeds"] == [0, 1]
    assert {"code", "cores", "version_numba", "git_revision"} <= set(content["about"])
    monkeypatch.setattr("studies.core.run.run_cell", None)
    assert call("compare", *names, "--no-figures", "--json", "--seeds", 2)[1] == out


def test_a_comparison_of_several_events_ends_with_its_answer_and_a_dry_run_makes_nothing(
    call, tmp_path, write_scenario
):
    files = [write_scenario(name=f"{name}.toml") for name in ("one", "two")]
    asked = ("compare", "--scenario", *files, "--rules", "alone", "exact", "--controllers", "none",
             "--seeds", 1, "--jobs", 1, "--no-figures", "--out", tmp_path / "out")  # fmt: skip
    assert "4 runs, of which 4 are to be made; no run is stored" in call(*asked, "--dry-run")[1]
    assert not list((tmp_path / "out").rglob("*.parquet"))
    code, out, _ = call(*asked)
    assert code == 0
    assert "all events: means" in out
    assert "two slippery seconds" not in out
    assert f"next: readhesion report --results {tmp_path / 'out'}" in " ".join(out.split())
    assert (tmp_path / "out" / "table.csv").read_text().startswith("scenario,rule,controller")
    assert "two slippery seconds" in call(*asked, "--all")[1]
    assert call(*asked, "--format", "latex")[1].startswith(r"\begin{tabular}")
    assert "of which 0 are to be made" in call(*asked, "--dry-run")[1]
    code, _, err = call(*asked, "--keep", "none/*")
    assert code == 2
    assert "--keep none/*: no run is called so; one is one/alone/none/0" in err


def test_chosen_runs_are_recorded(call, small, tmp_path):
    call("compare", *small, "--no-figures", "--keep", "short/exact/*/0")
    (path,) = (tmp_path / "out" / "runs").rglob("*.nc")
    assert load(path).attrs["rule"] == "exact"


def test_if_every_run_fails_the_exit_code_says_so(call, small, monkeypatch):
    def broken(*_, **__):
        raise RuntimeError("power cut")

    monkeypatch.setattr("studies.core.job.simulate", broken)
    code, out, _ = call("compare", *small)
    assert code == 1
    assert "RuntimeError: power cut (at tests/studies/test_command_line.py:" in out
    assert "10 failed" in out


def test_one_event_is_simulated_and_goes_out_as_a_run_a_figure_or_json(call, short_file, tmp_path):
    code, out, _ = call(
        "simulate", short_file, "--rule", "exact", "--out", tmp_path / "run.nc",
        "--figure", tmp_path / "run.png", "--all",
    )  # fmt: skip
    assert code == 0
    assert all(name in out for name in METRICS)
    assert load(tmp_path / "run.nc").attrs["rule"] == "exact"
    assert (tmp_path / "run.png").read_bytes().startswith(PNG)
    content = json.loads(call("simulate", short_file, "--json", "--seed", 3)[1])
    assert (content["scenario"], content["seed"]) == ("short", 3)
    assert set(content["metrics"]) == set(METRICS)
    assert content["metrics"]["coupler_peak"] is None
    texts = {kind: call("simulate", short_file, "--seed", 3, "--format", kind)[1]
             for kind in ("csv", "markdown", "latex")}  # fmt: skip
    shown = pd.read_csv(io.StringIO(texts["csv"]), index_col="metric")["value"]
    assert list(shown.index) == list(HEADLINES)
    wanted = [content["metrics"][name] for name in HEADLINES]
    np.testing.assert_allclose(shown, np.array(wanted, dtype=float))  # null is nan
    assert len(texts["markdown"].splitlines()) == 2 + len(HEADLINES)
    assert r"bound\_use & " in texts["latex"]


def test_a_figure_of_a_line_or_a_log_names_the_command_that_gives_it(call, short_file, tmp_path):
    place = tmp_path / "figure.png"

    def told(*arguments):
        assert call(*arguments, "--figure", place)[0] == 0
        return Image.open(place).text["Source"]

    log = tmp_path / "a log.csv"
    call("simulate", short_file, "--log", log)
    train = tmp_path / "a log.train.toml"
    source = told("analyse", log, "--train", train, "--slip-kmh", 1.0)
    words = shlex.join(
        ["readhesion", "analyse", str(log), "--train", str(train), "--slip-kmh", "1"]
    )
    assert source == f"as given; `{words}`"
    source = told("simulate", short_file, "--rule", "exact", "--seed", 2)
    assert f"readhesion simulate {shlex.quote(str(short_file))} --rule exact" in source


def test_everything_that_can_be_chosen_is_listed(call):
    code, out, _ = call("list", "--json")
    content = json.loads(out)
    assert code == 0
    assert list(content["scenarios"]) == shipped_scenarios()
    assert list(content["rules"]) == list(RULES)
    assert list(content["controllers"]) == list(CONTROLLERS)
    assert "[kJ]" in content["metrics"]["damage"]
    assert "axleN_torque_nm|knm" in content["columns of a log"]
    assert all(meaning for kind in content.values() for meaning in kind.values())
    _, printed, _ = call("list")
    assert "[kJ]" in printed


def test_options_of_a_sweep_are_the_arguments_of_its_cells_read_by_their_types():
    def cells(
        seed: int,
        k: int,
        gain: float = 1.0,
        rules: Sequence[str] | None = None,
        steps: tuple[int, ...] = (),
    ):
        return []

    study = Study("own", "is it?", 1, EachEvent(cells), lambda table: [])
    given = {"gain": ["0.5"], "rules": ["greedy,exact", "alone"], "steps": ["1,2"]}
    assert settings_of(study, given) == {
        "gain": 0.5,
        "rules": ["greedy", "exact", "alone"],
        "steps": (1, 2),
    }
    for bad, message in (
        ({"gain": ["x"]}, "--gain x: .*number"),
        ({"steps": ["1,2.5"]}, "--steps 1,2.5: .*integer"),
        (
            {"rule": ["greedy"]},
            "unknown option of the sweep own 'rule'; did you mean 'rules'?",
        ),
    ):
        with pytest.raises(StudyError, match=message):
            settings_of(study, bad)
    for shipped in all_studies().values():
        for kind in shipped.settings.values():
            TypeAdapter(kind)


def test_what_is_not_installed_or_drawn_is_named(call, short_file, write_scenario, monkeypatch):
    alloc.rules.qp.workspace.cache_clear()
    text = write_scenario.short.partition("[onboard")[0]
    fixed = write_scenario(text, ("scatter = 0.01", "scatter = 0.0"))
    for missing, words, *said in (
        ("osqp", (short_file, "--rules", "exact", "qp"), "osqp", "qp"),
        ("mpc.hosted", (short_file, "--controllers", "mpc"), "'mpc' needs something that is not installed"),
        ("none", (fixed, "--seeds", "3"), "--seeds 3: nothing in scenario 'own' depends on the seed"),
    ):  # fmt: skip
        with monkeypatch.context() as patched:
            patched.setitem(sys.modules, missing, None)
            code, out, err = call("compare", "--scenario", *words)
        (line,) = [line for line in err.splitlines() if line.strip()]
        assert (code, out) == (2, "")
        assert line.startswith("readhesion: ")
        assert all(one in line for one in said)


def process(*arguments: object, module="studies.command_line", **options) -> subprocess.Popen:
    command = [sys.executable, "-m", module]
    return subprocess.Popen(
        [*command, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


def test_the_package_of_figures_draws_by_name_and_a_wrong_name_is_one_sentence(tmp_path):
    for name, code, told in (
        ("adhesion-curve", 0, r"drawn in [\d.]+ s: adhesion-curve [\d.]+ s\n"),
        ("adhesion-curv", 2, r"readhesion: unknown figure 'adhesion-curv'; did you mean 'adhesion-curve'\?.*\n"),
    ):  # fmt: skip
        found = process(name, module="paper_figs", cwd=tmp_path)
        out, err = found.communicate()
        assert found.returncode == code
        assert re.fullmatch(told, err), err
        assert len(out.splitlines()) == (0 if code else 4)
    assert (tmp_path / "figures" / "adhesion-curve.pdf").read_bytes().startswith(PDF)


def test_a_file_that_cannot_be_finished_leaves_the_one_that_was_there(
    short_file, tmp_path, monkeypatch
):
    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    log, reports = tmp_path / "log.csv", tmp_path / "reports"
    assert run(["simulate", str(short_file), "--log", str(log)]) == 0
    analyse = ["analyse", str(log), "--train", str(tmp_path / "log.train.toml")]
    reports.mkdir()
    monkeypatch.setattr(os, "replace", refuse)
    for path, words in {
        tmp_path / "run.nc": ["simulate", str(short_file), "--out"],
        tmp_path / "new.csv": ["simulate", str(short_file), "--log"],
        tmp_path / "new.parquet": ["simulate", str(short_file), "--log"],
        tmp_path / "slips.csv": [*analyse, "--events"],
        reports / "log.csv.json": [*analyse, "--out"],
    }.items():
        path.write_text("before")
        assert run([*words, str(reports if path.parent == reports else path)]) == 2
        assert path.read_text() == "before"
    assert not list(tmp_path.rglob(f".*{ASIDE}*"))


def test_an_interrupt_is_one_line_also_while_it_imports_and_nothing_at_its_end(tmp_path):
    interrupt = "import os, signal; os.kill(os.getpid(), signal.SIGINT)\nraise ImportError\n"
    for module in ("cyclopts", "numba"):
        own = (tmp_path / module).with_suffix(".py")
        own.write_text(interrupt)
        path = os.pathsep.join([str(tmp_path), *sys.path])
        running = process("schema", env=os.environ | {"PYTHONPATH": path})
        _, err = running.communicate(timeout=60)
        assert (running.returncode, err.count("\n")) == (130, 1), err
        own.unlink()
    late = "import atexit, os, runpy; atexit.register(os.kill, os.getpid(), 2); "
    program = f"{late}runpy.run_module('studies.command_line', run_name='__main__')"
    ended = subprocess.run([sys.executable, "-c", program, "list"], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")


WAITING = """
import os
import time
from pathlib import Path

from alloc.metrics.registry import metric


@metric("waiting", "s", "waits for ever after the first two seeds", 0)
def waiting(run):
    if run.attrs["seed"] >= 2:
        Path(os.environ["WAITING"], str(os.getpid())).touch()
        time.sleep(3600.0)
    return 0.0
"""


@pytest.fixture
def waiting(short_file, tmp_path, monkeypatch):
    """A comparison whose first two rows are in the table, while two workers are busy; their numbers."""
    (tmp_path / "waiting.py").write_text(WAITING)
    (tmp_path / "busy").mkdir()
    monkeypatch.setenv("WAITING", str(tmp_path / "busy"))
    running = process(
        "--plugin", tmp_path / "waiting.py", "compare", "--scenario", short_file, "--rules", "alone",
        "--controllers", "none", "--seeds", 6, "--jobs", 2, "--no-figures", "--out", tmp_path / "out",
        start_new_session=True,
    )  # fmt: skip
    out, busy = tmp_path / "out", tmp_path / "busy"
    try:
        _wait_for(lambda: len(list(busy.iterdir())) == 2, running)
        _wait_for(lambda: out.exists() and len(Store(out).read()) == 2, running)
        yield running, [int(path.name) for path in busy.iterdir()]
    finally:
        running.kill()
        running.communicate()


LONG = 900.0
"""What never takes so long on any machine [s] has failed."""


def _wait_for(happened, running: subprocess.Popen | None = None) -> None:
    deadline = time.monotonic() + LONG
    while not happened():
        assert running is None or running.poll() is None, running.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _lives(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
def test_two_processes_in_one_folder_both_finish(short_file, tmp_path):
    words = (
        "compare", "--scenario", short_file, "--rules", "alone,exact", "--controllers", "none",
        "--seeds", 2, "--jobs", 1, "--keep", "*", "--no-figures", "--out", tmp_path,
    )  # fmt: skip
    both = [process(*words), process(*words)]
    for running in both:
        _, err = running.communicate()
        assert (running.returncode, err.strip()) == (0, "")
    store = Store(tmp_path)
    assert store.read()["status"].tolist() == 4 * ["ok"]
    kept = [path.name[:-20] for path in tmp_path.glob("runs/*/*.nc")]
    assert len(set(kept)) == 4  # both may have recorded one at the same time
    assert not list(tmp_path.rglob("*.broken*"))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize(("how", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGKILL", -9)])
def test_an_interrupted_comparison_keeps_its_rows_and_ends_its_workers(
    waiting, tmp_path, how, code
):
    running, workers = waiting
    assert all(map(_lives, workers))
    if how == "SIGINT":
        os.killpg(running.pid, signal.SIGINT)  # as the keyboard does: to every process
    else:
        running.send_signal(getattr(signal, how))
    _, err = running.communicate()
    assert running.returncode == code
    if how != "SIGKILL":
        assert (
            err.strip() == "readhesion: stopped; finished rows are kept, the same command goes on"
        )
    _wait_for(lambda: not any(map(_lives, workers)))
    kept = Store(tmp_path / "out").read()
    assert sorted(kept["seed"]) == [0, 1]
    assert (kept["status"] == "ok").all()


HEAVY = "[one for one in ('numpy', 'pandas', 'scipy', 'numba', 'xarray', 'pydantic') if one in sys.modules]"


def test_the_command_starts_without_the_libraries_that_take_a_second():
    """Each command imports what it needs when it runs; help and a wrong word are there at once."""
    asked = f"import sys, studies.command_line.main; print({HEAVY})"
    found = subprocess.run(
        [sys.executable, "-c", asked], capture_output=True, text=True, check=True
    )
    assert found.stdout.strip() == "[]"


def test_a_list_is_kept_and_imports_nothing_until_a_package_with_parts_changes(tmp_path):
    """Also one that is installed beside this project, and edited where it stands."""
    own, about = tmp_path / "own_part.py", tmp_path / "own_part-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Name: own-part\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[readhesion.curves]\nown = own_part:Own\n")
    asked = f"import sys; from studies.command_line.main import run; run(['list', '--json']); print({HEAVY})"
    path = os.pathsep.join([str(tmp_path), *sys.path])
    around = os.environ | {"PYTHONPATH": path, "READHESION_CACHE": str(tmp_path / "cache")}
    for meaning in ("First.", "Second."):
        own.write_text(f'class Own:\n    """{meaning}"""\n')
        fresh, kept = (
            subprocess.run(
                [sys.executable, "-c", asked], env=around, capture_output=True, text=True
            )
            for _ in range(2)
        )
        assert f'"own": "{meaning}"' in fresh.stdout, fresh.stderr
        (content, loaded), (again, nothing) = (one.stdout.rsplit("\n}\n") for one in (fresh, kept))
        assert again == content
        assert "numba" in loaded
        assert nothing.strip() == "[]"
