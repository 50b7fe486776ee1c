"""`readhesion check`: what it prints of parts that keep their laws and of those that do not, and its exit codes."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from alloc.rules.testing import drawn_cases
from tests.docs.pages import ROOT, blocks
from tests.studies.test_plugins import plain  # noqa: F401

MORE = """
import numpy as np
from alloc.rules import RULES, Rule
from alloc.rules.problem import CASE_B, allocation
def answer(problem):
    limit = np.clip(np.full(problem.n, 1.3 * problem.expected), *problem.rate_box)
    return allocation(problem, limit, np.nan, CASE_B, 0.0)
RULES.register("more", Rule("more", "the plan times 1.3", answer))
RULES.register("function", answer)
"""


@pytest.fixture
def plugin(tmp_path):
    path = tmp_path / "more.py"
    path.write_text(MORE)
    return "--plugin", path


def test_a_part_that_keeps_its_laws(call):
    path = ROOT / "docs" / "plugins" / "weighted_rule.py"
    code, out, _ = call("--plugin", path, "check", "weighted")
    assert code == 0
    assert "gap to the exact level" in out
    code, out, _ = call("check", "rational", "--json")
    assert code == 0
    assert {law["kept"] for law in json.loads(out)["laws"]} == {True}


def test_a_part_that_breaks_one_is_told_law_worst_value_and_counterexample(call, plugin):
    code, out, _ = call(*plugin, "check", "more", "--json")
    assert code == 1
    broken = [law for law in json.loads(out)["laws"] if not law["kept"]]
    assert [law["law"] for law in broken] == ["from rest", "case"]
    assert broken[0]["counterexample"].startswith("AllocationProblem(cap=[")


def test_what_is_broken_stands_below_the_table(call):
    code, out, _ = call("check", "greedy-claim", "--promise", "reference")
    assert code == 1
    assert "reference: by" in out
    assert "counterexample: AllocationProblem(cap=[" in out


def test_bad_input_is_refused_in_one_line(call, plugin, monkeypatch):
    for words, said in (
        (("check", "gredy"), "did you mean 'greedy'?"),
        (("check", "alone", "--promise", "best"), "give one of exact, reference, heuristic"),
        (("check", "none", "--promise", "exact"), "of a rule"),
        ((*plugin, "check", "function"), "is no Rule"),
    ):
        code, _, err = call(*words)
        assert code == 2
        assert said in err
        assert len(err.splitlines()) == 1
    drawn_cases.cache_clear()
    monkeypatch.setitem(sys.modules, "hypothesis", None)
    code, _, err = call("check", "polach-wet")
    assert code == 2
    assert "pip install 'readhesion[check]'" in err


def test_the_test_file_of_the_docs_passes(tmp_path):
    code = next(one.code for one in blocks("python") if "parametrize_with_checks" in one.code)
    file = Path(tmp_path, "test_mine.py")
    file.write_text(code)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "--rootdir",
        tmp_path,
        file,
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "19 passed" in done.stdout
