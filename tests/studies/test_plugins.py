"""Parts of one's own from files: listed, run in parallel, and run again when the file is edited."""

import json
import os
import shutil
import sys
import tomllib
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
from studies.scenario.loading import SCENARIOS, load_scenario
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


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    """Registries, modules and environment as they were."""
    for registry in REGISTRIES:
        list(registry)
        monkeypatch.setattr(registry, "_parts", dict(registry._parts))
        monkeypatch.setattr(registry, "_origins", dict(registry._origins))
    monkeypatch.delenv(VARIABLE, raising=False)
    known = set(sys.modules)
    yield
    os.environ.pop(VARIABLE, None)
    for name in set(sys.modules) - known:
        if name.startswith(sources.PLUGIN_PREFIX):
            del sys.modules[name]
    forget()


@pytest.fixture
def examples(tmp_path):
    """Copies of the plug-ins of the docs."""
    return {path.name: Path(shutil.copy(path, tmp_path)) for path in sorted(EXAMPLES.iterdir())}


def options(examples):
    return [word for path in examples.values() for word in ("--plugin", str(path))]


def test_the_examples_have_at_most_30_lines(examples):
    assert len(examples) >= 5
    for path in examples.values():
        assert len(path.read_text().splitlines()) <= 30


def test_every_kind_is_listed(examples, capsys):
    assert run(["list", "--json", *options(examples)]) == 0
    content = json.loads(capsys.readouterr().out)
    for kind, name in (
        ("rules", "weighted"),
        ("controllers", "slip-limit"),
        ("adhesion curves", "double-exponential"),
        ("trains", "tram"),
        ("metrics", "slip_distance"),
        ("figures", "use-against-slip"),
    ):
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


def test_an_edited_plugin_runs_its_rows_again_and_no_others(examples, monkeypatch):
    use_plugins(examples.values())
    scenario = load_scenario("wet-start")
    path = examples["weighted_rule.py"]
    before = [key_of(Job(scenario, rule, "none", 0)).digest for rule in ("weighted", "alone")]
    assert key_of(Job(scenario, "weighted", "none", 0)).digest == before[0]
    path.write_text(path.read_text().replace("# ", "## ") + "\n# a comment says nothing new\n")
    forget()
    assert [
        key_of(Job(scenario, rule, "none", 0)).digest for rule in ("weighted", "alone")
    ] == before
    path.write_text(path.read_text().replace("share = min(", "share = 0.5 * min("))
    forget()
    changed = [key_of(Job(scenario, rule, "none", 0)).digest for rule in ("weighted", "alone")]
    assert changed[0] != before[0]
    assert changed[1] == before[1]
    metric = examples["slip_distance.py"]  # every row holds every metric
    metric.write_text(metric.read_text().replace(".sum(axis=1)", ".max(axis=1)"))
    forget()
    assert key_of(Job(scenario, "alone", "none", 0)).digest != before[1]


def test_an_edited_train_file_runs_its_rows_again(examples):
    use_plugins([examples["tram.toml"]])
    scenario = load_scenario("wet-start").changed(train="tram", load_t=None)
    before = key_of(Job(scenario, "alone", "none", 0)).digest
    path = examples["tram.toml"]
    path.write_text(path.read_text().replace("mass_t = 14.0", "mass_t = 15.0"))
    forget()
    assert key_of(Job(scenario, "alone", "none", 0)).digest != before


def test_a_scenario_of_a_plugin_is_found_by_name(tmp_path):
    (tmp_path / "mine.toml").write_text(SCENARIO.replace('"tram"', '"one-axle"').replace(
        'curve = { kind = "double-exponential", a = 0.6 }', ""))  # fmt: skip
    plugin = tmp_path / "scenarios.py"
    plugin.write_text(
        "from pathlib import Path\nfrom studies.scenario.loading import SCENARIOS\n"
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


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("nothing.py", None, "is no file"),
        ("part.txt", "", "is no file"),
        ("broken.py", "import nowhere_at_all", "ModuleNotFoundError: No module named"),
        ("syntax.py", "def f(:\n", "SyntaxError"),
        ("taken.py", "from alloc.rules import RULES\nRULES.register('greedy', 1)", "'greedy' exists already"),
        ("train.toml", "name = 'x'", "key 'formation' is missing"),
        ("letter.toml", (EXAMPLES / "tram.toml").read_text().replace("MTM", "MXM"), "has a car 'X'"),
    ],
)  # fmt: skip
def test_a_faulty_plugin_is_refused_in_one_line(tmp_path, capsys, name, text, reason):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    assert run(["list", "--plugin", str(path)]) == 2
    said = capsys.readouterr().err
    assert reason in said
    assert str(path) in said
    assert len(said.strip().splitlines()) == 1


def test_a_faulty_plugin_leaves_no_half_module(tmp_path):
    path = tmp_path / "broken.py"
    path.write_text("raise RuntimeError('half way')")
    with pytest.raises(StudyError, match="half way"):
        use_plugins([path])
    assert module_name(str(path.resolve())) not in sys.modules
