"""The command line as a user meets it: what is printed, exit codes, and one line for each mistake."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from functools import partial

import pandas as pd
import pytest

from studies.command import command_line as cli
from studies.command.command_line import run
from studies.runner.provenance import find_commit
from studies.runner.workers import TOGETHER
from tests.cases import looped

ROOT = cli.Path(cli.__file__).parents[2]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}
PATHS = {"PATH": f"{cli.Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
strict = partial(json.loads, parse_constant=pytest.fail)

SMALL = ["--scenario", "wet-patch", "--rules", "alone", "cooperative", "--controllers", "perturb-observe", "--seeds", "2",
         "--jobs", "1"]  # fmt: skip
OWN_RULE = """
import numpy as np
from alloc.rules import RULES, Rule

def even(problem):
    return np.full(problem.n, problem.expected)

RULES.register("even", Rule("even", "everybody the plan", answer=even, promise="exact"))
"""
OWN_STUDY = """
import pandas as pd
from helper import FACTOR
from studies.runner.study import Cell, Study

def run(k):
    return {"value": FACTOR * k}

def cells(events, seed):
    return [Cell(f"number {k}", (k,)) for k in range(events)]

STUDY = Study("own", "what is twice a number?", cells, run, lambda rows: rows[["value"]], events=4)
"""


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("studies.runner.progress.EVERY", 1e6)  # no lines on a slow machine
    return tmp_path


def printed(capsys, *arguments):
    """What a command that ends well prints."""
    assert run(arguments) == 0
    return capsys.readouterr().out


def test_compare_and_again(capsys, elsewhere):
    output = printed(capsys, "compare", *SMALL)
    assert output.startswith("Under perturb-observe, cooperative")
    assert max(map(len, output.splitlines()[1:])) <= 80
    assert "next: readhesion report\n" in output
    files = sorted(path.name for path in (elsewhere / "results" / "compare").iterdir())
    assert files == [
        "figure.pdf",
        "rows.jsonl",
        "rows.parquet",
        *(f"table.{kind}" for kind in ("csv", "md", "parquet")),
    ]
    assert printed(capsys, "compare", *SMALL) == output
    assert printed(capsys, "compare", *SMALL, "--dry-run") == "4 runs, of which 0 are to be made\n"
    output = strict(printed(capsys, "compare", *SMALL, "--json"))
    assert {row["rule"] for row in output["rows"]} == {"alone", "cooperative"}
    assert "bound_use" in output["metrics"]
    assert output["about"]["machine"]
    printed(capsys, "compare", *SMALL, "--format", "tex")
    assert r"\toprule" in (elsewhere / "results" / "compare" / "table.tex").read_text()


def test_simulate(capsys, elsewhere):
    output = printed(capsys, "simulate", "wet-patch", "--out", "run.nc", "--figure", "run.png")
    assert "bound_use" in output
    assert (elsewhere / "run.nc").stat().st_size > 1e5
    assert (elsewhere / "run.png").stat().st_size > 1e4
    every = strict(printed(capsys, "simulate", "wet-patch", "--json"))
    assert every["metrics"]["headroom"] > 0.0
    output = printed(capsys, "simulate", "wet-patch", "--all")
    assert len(output.splitlines()) == len(every["metrics"]) + 1


@pytest.mark.slow
@looped("command", [
    "sweep claims --events 1", "benchmark --events 1", "rank none --events 1", "check greedy", "simulate wet-stop",
])  # fmt: skip
def test_json_is_strict(capsys, command):
    assert strict(printed(capsys, *command.split(), "--json"))


def test_names(capsys):
    output = strict(printed(capsys, "list", "--json"))
    kinds = "scenarios rules controllers beliefs curves trains studies figures metrics"
    assert set(kinds.split()) == set(output)
    assert all(meaning for names in output.values() for meaning in names.values())
    assert "wear " in printed(capsys, "list", "rules")
    assert "Polach" in printed(capsys, "cite")
    first = printed(capsys, "cite", "--bibtex").partition("\n}\n")[0]
    assert first.startswith("@software{readhesion,")
    lines = re.findall(
        r'^[ -]*(?:date-)?(\w+): "?([^"\n]+)',
        (ROOT / "CITATION.cff").read_text("utf-8"),
        re.MULTILINE,
    )
    by, title, number, terms = (dict(lines)[key] for key in ("name", "title", "version", "license"))
    assert all(f"{{{field}}}" in first for field in (by, title, terms))
    commit = f", commit {find_commit()}" if find_commit() else ""
    assert f"version = {{{number}{commit}}}" in first
    assert number == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    year = dict(lines)["released"][:4]
    assert printed(capsys, "cite").startswith(
        f"{by}. {title}. {year}, {number}{commit}, {terms}.\n"
    )


def test_own_rule(capsys, elsewhere):
    (elsewhere / "even.py").write_text(OWN_RULE)
    output = printed(capsys, "--plugin", "even.py", "compare", "--scenario", "wet-start", "--rules", "alone", "even",
                   "--controllers", "cut-and-ramp", "--seeds", "1", "--jobs", "2")  # fmt: skip
    assert "even=" in output
    assert run(["--plugin", "even.py", "check", "even"]) == 1  # it promises the optimum
    output = capsys.readouterr()
    assert output.err.startswith("readhesion: even breaks the law 'optimal'")
    assert output.out.count("allowed 1e-06\n") == 9 == len(re.findall("kept|broken", output.out))


def test_a_slow_rule_is_told(capsys, elsewhere):
    slow = OWN_RULE.replace("    return np", "    __import__('time').sleep(0.03)\n    return np")
    (elsewhere / "slow.py").write_text(slow.replace('"even"', '"slow"'))
    command = "--plugin slow.py compare --scenario wet-patch --rules slow --controllers none --seeds 1 --jobs 1"
    assert run(command.split()) == 0
    pattern = r"rule 'slow' takes \d\d ms a call, .*\n.*these 1 runs take about \d\.\d min\n"
    assert re.search(pattern, capsys.readouterr().err)


def test_a_line_is_wrapped_where_a_terminal_ends(capsys, monkeypatch):
    whole = printed(capsys, "list", "metrics")
    monkeypatch.setenv("COLUMNS", "70")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    narrow = printed(capsys, "list", "metrics")
    assert max(map(len, narrow.splitlines())) <= 70
    assert narrow.split() == whole.split()


def test_own_study_counts_with_its_folder(capsys, elsewhere):
    (elsewhere / "study.py").write_text(OWN_STUDY)
    for factor in (2, 3):
        (elsewhere / "helper.py").write_text(f"FACTOR = {factor}\n")
        command = [
            sys.executable,
            "-m",
            "studies.command.command_line",
            "sweep",
            "study.py",
            "--jobs",
            "2",
        ]
        subprocess.run(command, check=True, env=ENVIRONMENT, capture_output=True)
        rows = pd.read_parquet(elsewhere / "results" / "own" / "rows.parquet")
        assert list(rows["value"]) == [0, factor, 2 * factor, 3 * factor]


def test_files_to_begin_with(capsys, elsewhere):
    assert "runs as it stands" in printed(capsys, "new-scenario", "mine", "--like", "wet-patch")
    assert "scenario.schema.json" in (elsewhere / "mine.toml").read_text()
    assert json.loads(printed(capsys, "schema"))["title"]
    assert "bound_use" in printed(capsys, "simulate", "mine.toml")


def test_remarks(capsys, elsewhere):
    printed(capsys, "new-scenario", "late", "--like", "wet-start")
    path = elsewhere / "late.toml"
    path.write_text(
        path.read_text()
        .replace("time_s = 0.0", "time_s = 99.0")
        .replace("time_s = 0\n", "time_s = 99\n")
    )
    assert run(["simulate", "late.toml"]) == 0
    assert "command: none asks for an acceleration" in capsys.readouterr().err


@pytest.mark.parametrize(("arguments", "message"), [
    ("compare --scenario wet-ptch", "wet-patch"),
    ("compare --rules gredy", "greedy"),
    ("compare --controllers mcp", "mpc"),
    ("compare --seeds 1.5", "not a whole number"),
    ("compare --seeds 0", "seeds = 0"),
    ("compare --jobs 0", "--jobs: 0"),
    ("compare wet-patch", "no option takes this"),
    ("compare --rules ,", "--rules: it has no name"),
    ("compare --rules", "--rules requires"),
    ("compare --scheduler tcp://127.0.0.1:1 --scenario wet-start --rules alone --controllers none", "nobody works there"),
    ("simulate wet-patch --seed -1", "--seed: -1"),
    ("simulate wet-patch --rule gredy", "greedy"),
    ("simulate wet-patch --controller nobody", "nobody"),
    ("simulate wet-patch --out run.txt", "ending"),
    ("simulate wet-patch --out nowhere/run.nc", "cannot be written"),
    ("simulate /dev/zero", "no regular file"),
    ("simulate nothing.toml", "nothing.toml"),
    ("simulate population-65-2", "population-65-0000"),
    ("sweep barking", "braking"),
    ("sweep claims --events 0", "--events: 0"),
    ("sweep nothing.py", "nothing.py"),
    ("benchmark --store rows.csv", "ending"),
    ("rank nothing.py", "nothing.py"),
    ("rank gredy", "greedy"),
    ("rank greedy --under none", "--under none"),
    ("figures slip-evnt", "slip-event"),
    ("figures --source jp99", "jp99"),
    ("figures limits --style nothing", "nothing"),
    ("figures limits --width 0", "--width"),
    (f"figures limits --style {ROOT}/README.md", "no setting"),
    ("list ruls", "rules"),
    ("check nobody", "nobody"),
    ("report", "readhesion compare"),
    ("schema train --out x.txt", "ending"),
    ("new-scenario a/b", "name"),
    ("nothing", "nothing"),
    ("--plugin nothing.py list", "nothing.py"),
])  # fmt: skip
def test_a_mistake_is_one_line(capsys, monkeypatch, arguments, message):
    monkeypatch.setattr("studies.runner.workers.REACHED", 1)
    assert run(arguments.split()) == 2
    output = capsys.readouterr().err
    assert output.startswith("readhesion: ")
    assert output.count("\n") == 1
    assert message in output


@pytest.mark.parametrize(("source", "message"), [
    ("x = 1", "registers no part"),
    ("x = (", "was never closed"),
    ("raise ValueError('no')", "in line 1: no"),
    (OWN_RULE.replace("return np", "np"), "rule 'even'"),
    (OWN_RULE.replace("problem.n,", "4,"), "rule 'even'"),
    (OWN_RULE.replace('"even", Rule', '"greedy", Rule'), "exists already"),
])  # fmt: skip
def test_a_faulty_plugin_is_one_line(capsys, elsewhere, source, message):
    (elsewhere / "own.py").write_text(source)
    arguments = ["--plugin", "own.py", "compare", "--scenario", "wet-start", "--rules", "even"]
    assert run([*arguments, "--controllers", "none"]) == 2
    output = capsys.readouterr().err
    assert message in output
    assert output.count("\n") == 1


def test_a_command_that_is_stopped_keeps_its_rows_and_goes_on(elsewhere):
    command = ["compare", "--rules", "alone", "--controllers", "none", "--jobs", "2"]
    program = [sys.executable, "-m", "studies.command.command_line", *command]
    process = subprocess.Popen(program, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
    stored = elsewhere / "results" / "compare" / "rows.jsonl"
    # until some rows are counted, and others added
    while not stored.exists() or len(stored.read_bytes().splitlines()) <= TOGETHER:
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    output = process.communicate(timeout=60)[1]
    if process.returncode:  # else it had just ended
        assert process.returncode == 130
        assert "finished rows are kept" in output
    assert run(command) == 0


def test_nobody_reads_on(elsewhere):
    command = f"{sys.executable} -m studies.command.command_line list | head -1"
    shell = ["bash", "-c", f"set -o pipefail; {command}"]
    process = subprocess.run(shell, env=ENVIRONMENT, capture_output=True, text=True)
    assert not [line for line in process.stderr.splitlines() if "at work" not in line]
    assert process.returncode in (0, 141)


@pytest.mark.slow
def test_a_comment_on_a_rule(elsewhere):
    """The script of a pull request: laws and place of a rule that keeps them, and of one that does not."""
    for promise, code in (("baseline", 0), ("exact", 1)):
        (elsewhere / "even.py").write_text(OWN_RULE.replace("exact", promise))
        command = [ROOT / ".ci" / "rank-rule", "even.py", "2"]
        process = subprocess.run(command, env=ENVIRONMENT | PATHS, capture_output=True, text=True)
        assert process.returncode == code, process.stderr
        title, *_, last = process.stdout.splitlines()
        assert title == "### even on the first 2 events of the benchmark"
        assert last == "```"
        assert "even minus alone" in process.stdout
