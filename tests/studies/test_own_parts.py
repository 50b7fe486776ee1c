"""Faulty parts of one's own: each is refused in one line that names part and file, before anything is run."""

import importlib
import json

import pytest

from studies.command_line.main import run
from tests.studies.test_plugins import plain  # noqa: F401

RULE = """
import numpy as np
from alloc.rules import RULES, Allocation, Rule
from alloc.rules.problem import CASE_A, allocation
def answer(problem{more}):
    limit = np.clip(np.full(problem.n, problem.expected), *problem.box)
    {answer}
RULES.register("mine", {part})
"""
CONTROLLER = """
from alloc.onboard.host import CONTROLLERS
from alloc.onboard.host import HostedController, TorqueDecision, each_unit
class Mine:
    __slots__ = ()
    def __init__(self, context):
        pass
    def {decide}(self, sense):
        {answer}
CONTROLLERS.register("mine", {part})
"""
FIGURE = """
from paper_figs.drawing import figure
@figure("mine", "one of mine")
def mine():
    {answer}
"""
METRIC = """
from alloc.metrics.registry import metric
@metric("mine", "m", "mine", -1)
def mine(run):
    {answer}
"""
RULE_PART = 'Rule("mine", "one of mine", answer)'
CONTROLLER_PART = 'HostedController("mine", "one of mine", each_unit(Mine))'
OF_ONE_UNIT = CONTROLLER_PART.replace("each_unit(Mine)", "lambda contexts: Mine(contexts[0])")
GOOD_RULE = "return allocation(problem, limit, np.nan, CASE_A, 0.0)"
GOOD_TORQUE = 'return TorqueDecision(sense.target, True, "ok", 0.0)'


def rule(answer=GOOD_RULE, more="", part=RULE_PART):
    return "rule", RULE.format(answer=answer, more=more, part=part)


def controller(answer=GOOD_TORQUE, decide="decide", part=CONTROLLER_PART):
    return "controller", CONTROLLER.format(answer=answer, decide=decide, part=part)


FAULTS = {
    "another argument": (rule(more=", other"), "missing 1 required positional argument"),
    "limits of two units": (rule("return allocation(problem, limit[:2], 0.1, CASE_A, 0.0)"), "line 7"),
    "no answer": (rule("pass"), "returns None"),
    "an array": (rule("return limit"), "return allocation("),
    "no number": (rule(GOOD_RULE.replace("limit,", "limit * np.nan,")), "one finite limit each"),
    "case C": (rule("return Allocation(limit, 0.0, 'C', 0.0)"), "case = 'C' must be one of none, A, B in line 7"),
    "negative limits": (rule(GOOD_RULE.replace("limit,", "limit - 1.0,")), "none may be negative"),
    "raises": (rule("raise ValueError('no idea')"), "ValueError: no idea in line 7"),
    "ends the program": (rule("raise SystemExit(3)"), "SystemExit: 3"),
    "a function": (rule(part="answer"), "register Rule("),
    "a word for a colour": (rule(part=RULE_PART[:-1] + ", colour='red')"), "such as '#117733'"),
    "a torque": (controller("return sense.target"), "return TorqueDecision("),
    "no decision": (controller("pass"), "returns None"),
    "never a number": (controller(GOOD_TORQUE.replace("sense.target", "float('nan')")), "finite torque"),
    "torque of each axle": (controller(GOOD_TORQUE.replace("target", "omega")), "one number in N m"),
    "torque in words": (controller(GOOD_TORQUE.replace("sense.target", "'much'")), "one number in N m"),
    "breaks": (controller("return 1 / 0"), "ZeroDivisionError: division by zero in line 9"),
    "another name": (controller(decide="decides"), "no attribute 'decide'"),
    "a class": (controller(part="Mine"), "register HostedController("),
    "of one unit": (controller(GOOD_TORQUE.replace("sense.target", "0.0"), part=OF_ONE_UNIT), "one answer each"),
    "a metric in words": (("metric", METRIC.format(answer="return 'a'")), "could not convert"),
    "a metric that raises": (("metric", METRIC.format(answer="return run['x'].mean()")), "in line 5"),
}  # fmt: skip


def simulated(kind, file):
    parts = {"rule": ["--rule", "mine"], "controller": ["--controller", "mine"]}.get(kind, [])
    return run(["--plugin", str(file), "simulate", "wet-start", "--json", *parts])


@pytest.mark.parametrize("fault", FAULTS)
def test_a_faulty_part_is_refused_in_one_line(fault, tmp_path, capsys):
    (kind, source), words = FAULTS[fault]
    file = tmp_path / "own.py"
    file.write_text(source)
    assert simulated(kind, file) == 2
    out, err = capsys.readouterr()
    assert not out
    assert len(err.splitlines()) == 1
    assert f"{kind} 'mine' of {str(file)!r}" in err
    assert words in err


def test_one_that_is_right_runs_and_what_it_prints_is_no_result(tmp_path, capsys):
    file = tmp_path / "own.py"
    file.write_text("print('loaded')\n" + controller(f"print('asked'); {GOOD_TORQUE}")[1])
    assert simulated("controller", file) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["controller"] == "mine"
    assert {"loaded", "asked"} <= set(err.split())


def test_of_two_parts_of_one_name_both_files_are_named(tmp_path, capsys):
    files = [tmp_path / "first.py", tmp_path / "second.py"]
    for file in files:
        file.write_text(rule()[1])
    assert run(["--plugin", str(files[0]), "--plugin", str(files[1]), "list"]) == 2
    err = capsys.readouterr().err
    assert all(repr(str(file)) in err for file in files)


@pytest.mark.parametrize(
    ("answer", "words"), [("1 / 0", "ZeroDivisionError: division by zero in line 5"), ("pass", "returns a NoneType")]
)  # fmt: skip
def test_a_figure_that_cannot_be_drawn_is_named(answer, words, tmp_path, capsys, monkeypatch):
    figures = importlib.import_module("paper_figs.drawing").FIGURES
    list(figures)
    monkeypatch.setattr(figures, "_parts", dict(figures._parts))
    monkeypatch.setattr(figures, "_origins", dict(figures._origins))
    file = tmp_path / "own.py"
    file.write_text(FIGURE.format(answer=answer))
    assert run(["--plugin", str(file), "figures", "mine", "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    assert "figure 'mine'" in err
    assert words in err
    assert not (tmp_path / "out").exists()
