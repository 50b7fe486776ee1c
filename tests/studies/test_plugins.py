"""Parts of one's own from files: listed, run in parallel, run again when the file is edited, refused where faulty."""

import json
import os
import shutil
import sys
import tomllib
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from alloc import sources
from alloc.metrics import METRICS
from alloc.onboard.host import CONTROLLERS, HostedController
from alloc.plant.adhesion import CURVES
from alloc.plant.sets import SETS
from alloc.records import quantity
from alloc.rules import RULES
from paper_figs.drawing import FIGURES
from studies.command_line.main import run
from studies.core.cell import key_of
from studies.core.job import Job
from studies.core.plugins import VARIABLE, load_plugins, module_name, use_plugins
from studies.files.study_error import StudyError
from studies.scenario.file_kinds import reference_page, schema_of_kind
from studies.scenario.scenario import SCENARIOS, load_scenario
from tests.studies.conftest import SHORT
from tests.test_sources import forget

EXAMPLES = Path(__file__).parents[2] / "docs" / "plugins"
REGISTRIES = (RULES, CONTROLLERS, CURVES, SETS, METRICS, SCENARIOS, FIGURES)
SCENARIO = """
title = "a tram pulls away on the double exponential"
train = "tram"
duration_s = 3.0
record_period_s = 0.02

[rail]
level = 0.1
increments = { law = "logarithmic" }
curve = { kind = "double-exponential", a = 0.6 }

[belief]
curve = { kind = "piecewise" }

[[command]]
time_s = 0.0
acceleration_kmhs = 4.0
"""


@contextmanager
def registries_as_they_were():
    """Registries, modules and environment are taken back."""
    with pytest.MonkeyPatch.context() as patched:
        for registry in REGISTRIES:
            list(registry)
            patched.setattr(registry, "_parts", dict(registry._parts))
            patched.setattr(registry, "_origins", dict(registry._origins))
        patched.delenv(VARIABLE, raising=False)
        known = set(sys.modules)
        yield
        os.environ.pop(VARIABLE, None)
        for name in set(sys.modules) - known:
            if name.startswith(sources.PLUGIN_PREFIX):
                del sys.modules[name]
        forget()


@pytest.fixture(autouse=True)
def plain():
    with registries_as_they_were():
        yield


@pytest.fixture
def examples(tmp_path):
    """Copies of the plug-ins of the docs."""
    return {path.name: Path(shutil.copy(path, tmp_path)) for path in sorted(EXAMPLES.iterdir())}


def options(examples):
    return [word for path in examples.values() for word in ("--plugin", str(path))]


def test_the_examples_have_at_most_30_lines_and_every_kind_is_listed(examples, capsys):
    assert len(examples) >= 5
    for path in examples.values():
        assert len(path.read_text().splitlines()) <= 30
    assert run(["list", "--json", *options(examples)]) == 0
    content = json.loads(capsys.readouterr().out)
    for kind, name in (
        ("rules", "weighted"), ("controllers", "slip-limit"), ("adhesion curves", "double-exponential"), ("trains", "tram"),
        ("metrics", "slip_distance"), ("figures", "use-against-slip"),
    ):  # fmt: skip
        assert content[kind][name].strip()


def test_curves_trains_and_controllers_stand_in_the_schema(examples):
    @dataclass(frozen=True)
    class Settings:
        """How long it waits."""

        share: float = quantity(0.5, "1")

    content = tomllib.loads(SCENARIO)
    content["rail"]["curve"]["a"] = 0.7
    content["onboard"] = {"patient": {"share": 0.7}}
    before = Draft202012Validator(schema_of_kind("scenario"))
    assert {error.json_path for error in before.iter_errors(content)} == {
        "$.train", "$.rail.curve", "$.onboard",
    }  # fmt: skip
    use_plugins(examples.values())
    CONTROLLERS.register("patient", HostedController("patient", "waits", list, settings=Settings))
    after = Draft202012Validator(schema_of_kind("scenario"))
    assert not list(after.iter_errors(content))
    content["rail"]["curve"]["e"] = 0.7
    content["onboard"]["patient"]["shares"] = 0.7
    assert len(list(after.iter_errors(content))) == 2
    assert "| `a` | number | s/m | `0.54` | Decay over" in reference_page()


def test_all_of_them_run_together_in_two_processes(examples, tmp_path, capsys):
    event = tmp_path / "tram-start.toml"
    event.write_text(SCENARIO)
    command = ["compare", "--scenario", str(event), "--rules", "weighted", "exact", "--controllers", "slip-limit",
               "cut-and-ramp", "--jobs", "2", "--out", str(tmp_path / "out"), "--no-figures", "--json"]  # fmt: skip
    assert run([*command, *options(examples)]) == 0
    content = json.loads(capsys.readouterr().out)
    assert len(content["rows"]) == 4
    for row in content["rows"]:
        assert row["failed"] == 0, row["reasons"]
        assert row["metrics"]["slip_distance"]["mean"] > 0.0


def test_an_edited_plugin_runs_its_rows_again_and_no_others(examples):
    use_plugins(examples.values())
    scenario = load_scenario("wet-start")
    tram = scenario.changed(train="tram", load_t=None)
    jobs = {
        "weighted": Job(scenario, "weighted", "none", 0),
        "alone": Job(scenario, "alone", "none", 0),
        "tram": Job(tram, "alone", "none", 0),
    }

    def edited(name, old, new):
        path = examples[name]
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))
        forget()
        before, found = keys.copy(), {of: key_of(job).digest for of, job in jobs.items()}
        keys.update(found)
        return {of for of in jobs if found[of] != before.get(of)}

    keys: dict[str, str] = {}
    assert edited("weighted_rule.py", "share", "share") == set(jobs)
    comment = "# a comment says nothing new\n"
    assert edited("weighted_rule.py", "RULES.register(", f"{comment}RULES.register(") == set()
    assert edited("weighted_rule.py", "share = min(", "share = 0.5 * min(") == {"weighted"}
    assert edited("tram.toml", "mass_t = 14.0", "mass_t = 15.0") == {"tram"}
    # every row holds every metric
    assert edited("slip_distance.py", ".sum(axis=1)", ".max(axis=1)") == set(jobs)


def test_a_scenario_of_a_plugin_is_found_by_name(tmp_path):
    (tmp_path / "mine.toml").write_text(SCENARIO.replace('"tram"', '"one-axle"').replace(
        'curve = { kind = "double-exponential", a = 0.6 }', ""))  # fmt: skip
    plugin = tmp_path / "scenarios.py"
    plugin.write_text(
        "from pathlib import Path\nfrom studies.scenario.scenario import SCENARIOS\n"
        "SCENARIOS.register('mine', Path(__file__).with_name('mine.toml'))\n"
    )
    use_plugins([plugin])
    assert load_scenario("mine").train == "one-axle"


def test_worker_processes_load_what_the_environment_names(examples):
    use_plugins([examples["weighted_rule.py"]])
    name = module_name(str(examples["weighted_rule.py"].resolve()))
    del sys.modules[name]
    RULES._parts.pop("weighted")
    load_plugins()
    assert "weighted" in RULES
    assert RULES.origin("weighted") == name


FILES = [
    ("nothing.py", None, "is no file"),
    ("part.txt", "", "is no file"),
    ("broken.py", "import nowhere_at_all", "ModuleNotFoundError in line 1: No module named"),
    ("syntax.py", "def f(:\n", "SyntaxError"),
    ("taken.py", "from alloc.rules import RULES\nRULES.register('greedy', 1)", "'greedy' exists already"),
    ("train.toml", "name = 'x'", "keys 'formation', 'car', 'planned_acceleration_kmhs' are missing"),
    ("letter.toml", (EXAMPLES / "tram.toml").read_text().replace("MTM", "MXM"), "has a car 'X'"),
]  # fmt: skip
"""Files that cannot be loaded: name, text, and what is said."""
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


def figure(answer):
    return "figure", FIGURE.format(answer=answer)


UNDRAWN = {
    "breaks": (figure("1 / 0"), "ZeroDivisionError: division by zero in line 5"),
    "nothing": (figure("pass"), "returns a NoneType"),
}


def asked(kind, file, out):
    """The command that asks for the own part of a file."""
    if kind == "figure":
        return ["--plugin", str(file), "figures", "mine", "--out", str(out)]
    parts = {"rule": ["--rule", "mine"], "controller": ["--controller", "mine"]}.get(kind, [])
    event = file.with_name("short.toml")
    event.write_text(SHORT)
    return ["--plugin", str(file), "simulate", str(event), "--json", *parts]


def test_what_is_faulty_is_refused_in_one_line_that_names_part_and_file(tmp_path, capsys):
    wrong = {}

    def check(name, command, *words):
        with registries_as_they_were():
            code = run(command)
        out, err = capsys.readouterr()
        missing = [one for one in words if one not in err]
        if code != 2 or out or len(err.strip().splitlines()) != 1 or missing:
            wrong[name] = (code, missing, out, err)

    for name, text, reason in FILES:
        path = tmp_path / name
        if text is not None:
            path.write_text(text)
        check(name, ["list", "--plugin", str(path)], str(path), reason)
    for k, (name, ((kind, source), words)) in enumerate((FAULTS | UNDRAWN).items()):
        file, out = tmp_path / f"own{k}.py", tmp_path / f"out{k}"
        file.write_text(source)
        named = () if kind == "figure" else (f"of {str(file)!r}",)
        check(name, asked(kind, file, out), f"{kind} 'mine'", words, *named)
        assert not out.exists()
    files = [tmp_path / "first.py", tmp_path / "second.py"]
    for file in files:
        file.write_text(rule()[1])
    both = [word for file in files for word in ("--plugin", str(file))]
    check("one name twice", [*both, "list"], *(repr(str(file)) for file in files))
    assert not wrong


def test_one_that_is_right_runs_and_what_it_prints_is_no_result(tmp_path, capsys):
    file = tmp_path / "own.py"
    file.write_text("print('loaded')\n" + controller(f"print('asked'); {GOOD_TORQUE}")[1])
    assert run(asked("controller", file, None)) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["controller"] == "mine"
    assert {"loaded", "asked"} <= set(err.split())


def test_a_faulty_plugin_leaves_no_half_module(tmp_path):
    path = tmp_path / "broken.py"
    path.write_text("raise RuntimeError('half way')")
    with pytest.raises(StudyError, match="half way"):
        use_plugins([path])
    assert module_name(str(path.resolve())) not in sys.modules
