"""Every code block of README and pages: Python runs, files are read, commands run or are at least understood."""

import json
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from alloc.metrics import METRICS
from alloc.rules import RULES
from alloc.simulation import CONTROLLERS
from paper_figs.drawing import FIGURES
from studies.command_line.main import app, run
from studies.core.study import all_studies
from studies.files.strict import parse
from studies.lines.named_files import TRAINS, shipped
from studies.logs.mapping import read_mapping
from studies.scenario.line_file import read_line
from studies.scenario.scenario import Scenario, load_scenario, shipped_scenarios
from studies.scenario.train_file import read_train_file
from tests.docs.pages import ROOT, Block, blocks

LANGUAGES = {"sh", "python", "toml", "json", "text", "math"}
PYTHON = blocks("python")
FILES = blocks("toml")
COMMANDS = [
    (block, " ".join(line.split()))
    for block in blocks("sh")
    for line in block.code.replace("\\\n", " ").splitlines()
    if line.strip() and not line.startswith("#")
]
"""Lines of shell blocks, continued ones as one."""
PROGRAM = re.compile(r"readhesion (.*)")
OTHER_PROGRAMS = ("dask ", "srun ")
"""Beginnings of lines that no test here understands: they need a cluster."""
RUN = {
    "simulate wet-patch --rule exact --format markdown",
    "list",
    "check greedy",
    "cite wet-patch --rule greedy --controller mpc",
    "simulate wet-patch --rule cooperative --controller perturb-observe --figure event.png",
    "compare --scenario wet-patch --rules alone cooperative --controllers perturb-observe --seeds 3",
    "simulate wet-patch --log event.csv",
    "analyse event.csv --train event.train.toml --figure log.png",
    "simulate my-event.toml --rule cooperative --controller perturb-observe",
    "compare --scenario wet-start --rules greedy --json",
    "export-controller wet-patch --unit 1 --out ./controller",
    "export-fmu wet-patch --out plant.fmu",
    "export-fmu wet-patch --unit 1 --out controller.fmu",
    "simulate wet-stop --log stop.csv",
    "analyse stop.csv --train stop.train.toml",
    "analyse stop.csv --train stop.train.toml --map log.toml",
    "analyse stop.csv --train stop.train.toml --mapping log.toml",
    "simulate my-event.toml --rule cooperative --figure my-event.png",
    "figures allocation-bars slip-event",
    "new-scenario my-patch --like wet-patch",
    "new-scenario my-start",
    "schema train --out train.json",
    "schema scenario --out scenario.schema.json",
    "run-line --train ic2 --coasting 30 --figure line.png",
}
"""Commands that are run as they stand, in their order. Of the others names and options are checked."""
NOT_RUN = {
    "a study takes minutes to hours; tests of its folder run it with few events": ("sweep ", "merge "),
    "the default comparison takes minutes; tests/studies run smaller ones": ("compare ", "report"),
    "tests/studies/test_plugins.py runs the plug-ins": ("--plugin ", "list --plugin "),
    "runs a scenario twice in Python; tests/studies run a short one": ("export-qps",),
    "needs files of the reader; tests/studies have such files": (
        "analyse monday.csv.gz ", "run-line --line path.yaml ", "report --scenario wet-patch own.toml ",
    ),
    "another run over the line like the one above; each compiles and takes a minute": ("run-line",),
    "a second file of the same run; tests/studies and tests/paper_figs write such files": (
        "simulate wet-patch --rule exact --figure event.png --out event.nc",
        "simulate my-event.toml --rule cooperative --figure my-event.gif",
    ),
    "draws what `sweep ladder` computed; tests/paper_figs draw it from a table": ("figures ladder",),
}  # fmt: skip
"""Why a command of a page is not run -> how such commands begin."""


def named(some: list[Block]) -> list[str]:
    return [f"{one.page}:{k}" for k, one in enumerate(some)]


def test_every_block_is_of_a_kind_that_is_checked():
    others = {one.language for one in blocks()} - LANGUAGES
    assert not {one for one in others if not one.startswith("{")}
    assert len(PYTHON) >= 4
    assert len(COMMANDS) >= 20


@pytest.mark.parametrize("block", PYTHON, ids=named(PYTHON))
def test_python_runs(block, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    list(METRICS)  # those that ship are registered
    monkeypatch.setattr(METRICS, "_parts", dict(METRICS._parts))
    monkeypatch.setattr(METRICS, "_origins", dict(METRICS._origins))
    exec(compile(block.code, block.page, "exec"), {"__name__": "block"})
    if "def test_" in block.code:
        path = tmp_path / "test_block.py"
        path.write_text(block.code)
        asked = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(path)]
        told = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False)
        assert told.returncode == 0, told.stdout
    shown = capsys.readouterr().out
    for value in re.findall(r"print\(.*\)  # (.*?)\.\.\.$", block.code, re.MULTILINE):
        assert value in shown
    if block.shown:
        assert shown.splitlines() == block.shown.splitlines()


READ = {
    "command": load_scenario,
    "sections": read_line,
    "columns": read_mapping,
    "car": read_train_file,
}
"""What reads a file, by a key that it must have."""


@pytest.mark.parametrize("block", FILES, ids=named(FILES))
def test_files_are_read(block, tmp_path):
    """What is no whole file is a part of a scenario's, whose keys fit into one that ships."""
    content = tomllib.loads(block.code)
    path = tmp_path / "block.toml"
    path.write_text(block.code)
    for key, read in READ.items():
        if key in content:
            assert read(str(path) if read is not read_mapping else path)
            return
    start = load_scenario("wet-start")
    keys = start.model_dump(exclude_unset=True)
    for table, values in content.items():
        known = keys.get(table)
        keys[table] = (
            known | values if isinstance(known, dict) and isinstance(values, dict) else values
        )
    assert parse(Scenario, keys, block.page).event().duration > 0.0


def test_json_is_read():
    for block in blocks("json"):
        json.loads(block.code)


def test_commands_are_understood():
    for block, line in COMMANDS:
        understood(block.page, line)


def understood(page, line):
    if line == "source .venv/bin/activate":
        return
    if line.startswith("make "):
        target = shlex.split(line, comments=True)[1]
        assert re.search(rf"^{target}: ", (ROOT / "Makefile").read_text(), re.MULTILINE), line
        return
    found = PROGRAM.fullmatch(line)
    if found is None:
        assert line.startswith(OTHER_PROGRAMS), f"{page}: {line}"
        return
    words = shlex.split(found[1], comments=True)
    if "--plugin" in words:
        k = words.index("--plugin")
        assert (ROOT / words[k + 1]).exists()
        del words[k : k + 2]
    app.parse_args(words, exit_on_error=False, print_error=False)
    names = {*RULES, *CONTROLLERS, *FIGURES, *all_studies(), *shipped_scenarios(), *shipped(TRAINS)}
    for option in ("--rules", "--rule", "--controllers", "--controller", "--scenario"):
        for name in _after(words, option):
            assert name in names | {"weighted"} or name.endswith(".toml"), line
    if words[0] in ("sweep", "simulate"):
        assert words[1] in names or words[1].endswith(".toml"), line


def _after(words: list[str], option: str) -> list[str]:
    """Values of an option."""
    if option not in words:
        return []
    rest = words[words.index(option) + 1 :]
    end = next((k for k, word in enumerate(rest) if word.startswith("--")), len(rest))
    return rest[:end]


def test_commands_that_are_said_to_run_stand_on_pages():
    stand = {
        " ".join(shlex.split(PROGRAM.fullmatch(line)[1], comments=True))
        for _, line in COMMANDS
        if PROGRAM.fullmatch(line)
    }
    assert not RUN - stand
    reasoned = tuple(one for some in NOT_RUN.values() for one in some)
    assert not [line for line in stand - RUN if not line.startswith(reasoned)]
    unused = [one for one in reasoned if not any(line.startswith(one) for line in stand - RUN)]
    assert not unused


def test_cheap_commands_run(capsys, monkeypatch, tmp_path):
    """A block's text is what its last command prints, or a part of it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    for block in FILES:
        first = block.code.partition("\n")[0]
        if first.startswith("# ") and first.endswith(".toml"):
            Path(first.removeprefix("# ")).write_text(block.code)
    for block, line in COMMANDS:
        found = PROGRAM.fullmatch(line)
        words = shlex.split(found[1], comments=True) if found else []
        if " ".join(words) in RUN:
            code, (out, err) = run(words), capsys.readouterr()
            assert code == 0, f"{line}: {err}"
            assert "--out" in words or out.strip(), line
            for part in block.shown.splitlines() if line == dict(COMMANDS)[block] else ():
                assert plain(part) in plain(out), f"{line}: {part}"


def plain(text: str) -> str:
    """The words without what draws a table."""
    return " ".join(re.findall(r"[^\s│┃━─]+", text))
