"""Commands about parts: `check` asks for their laws, `cite` names their documents, `export-controller` writes one as C."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from alloc.citations import CITATIONS, cited_in
from alloc.onboard.equipment import equipment
from alloc.onboard.host import CONTROLLERS, unit_contexts
from alloc.plant.sets import find_set
from alloc.rules import RULES
from alloc.rules.testing import drawn_cases
from mpc.export import export_unit
from studies.report.run_parts import ASSUMED, PARTLY, SOURCED, documents_of, values_of
from studies.scenario.scenario import load_scenario, shipped_scenarios
from tests.docs.pages import ROOT, blocks
from tests.studies.conftest import SHORT
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


def test_a_part_that_keeps_its_laws_and_ones_that_break_one(call, plugin):
    path = ROOT / "docs" / "plugins" / "weighted_rule.py"
    code, out, _ = call("--plugin", path, "check", "weighted")
    assert code == 0
    assert "gap to the exact level" in out
    code, out, _ = call("check", "rational", "--json")
    assert code == 0
    assert {law["kept"] for law in json.loads(out)["laws"]} == {True}
    code, out, _ = call(*plugin, "check", "more", "--json")
    assert code == 1
    broken = [law for law in json.loads(out)["laws"] if not law["kept"]]
    assert [law["law"] for law in broken] == ["from rest", "case"]
    assert broken[0]["counterexample"].startswith("AllocationProblem(cap=[")
    # what is broken stands below the table
    code, out, _ = call("check", "greedy-claim", "--promise", "reference")
    assert code == 1
    assert "reference: by" in out
    assert "counterexample: AllocationProblem(cap=[" in out


def test_what_cannot_be_checked_is_refused_in_one_line(call, plugin, monkeypatch):
    def said(*words):
        code, _, err = call(*words)
        assert code == 2
        assert len(err.splitlines()) == 1
        return err

    assert "give one of exact, reference, heuristic, baseline" in said(
        "check", "alone", "--promise", "best"
    )
    assert "of a rule" in said("check", "none", "--promise", "exact")
    assert "is no Rule" in said(*plugin, "check", "function")
    drawn_cases.cache_clear()
    monkeypatch.setitem(sys.modules, "hypothesis", None)
    assert "pip install -e '.[check]'" in said("check", "polach-wet")


def test_the_test_file_of_the_docs_passes(tmp_path):
    code = next(one.code for one in blocks("python") if "parametrize_with_checks" in one.code)
    file = Path(tmp_path, "test_mine.py")
    file.write_text(code)
    options = ["-q", "-p", "no:cacheprovider", "--rootdir", tmp_path, file]
    command = [sys.executable, "-m", "pytest", *options]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "19 passed" in done.stdout


NUMBERED = re.compile(r"\bJP ?(?:H\d\d-)?\d{6,}\b|arXiv \d+\.\d+|RSSB T\d+")
"""Names of documents that can be told by their number."""


def keys(scenario, rule="alone", controller="none"):
    return {one.document.key for one in documents_of(load_scenario(scenario), rule, controller)}


def test_every_numbered_document_that_a_source_names_can_be_cited():
    found = set()
    for layer in ("alloc", "mpc", "studies"):
        for path in (ROOT / layer).rglob("*.py"):
            found |= set(NUMBERED.findall(path.read_text(encoding="utf-8")))
    assert len(found) >= 6
    assert not {one for one in found if not cited_in(one)}


def test_keys_are_unique_and_entries_are_closed():
    assert len({one.key for one in CITATIONS}) == len(CITATIONS)
    for one in CITATIONS:
        text = one.bibtex
        assert text.startswith(f"@{one.kind}{{{one.key},\n")
        assert text.count("{") == text.count("}")
        assert all(one.fields.values()), one.key


def test_values_are_sourced_or_assumed_and_all_of_the_train_are_there():
    for name in shipped_scenarios():
        scenario = load_scenario(name)
        values = values_of(scenario)
        assert {one.standing for one in values} <= {SOURCED, ASSUMED, PARTLY}, name
        train = find_set(scenario.train)
        assert [one.name for one in values if one.of.startswith("train")] == list(train.sources)
        assert any(one.of.startswith("scenario") for one in values), name
        assert all(one.why for one in values), name


def test_another_rule_controller_curve_or_train_adds_its_own_documents(write_scenario):
    event = keys("wet-patch")
    for rule in RULES:
        assert keys("wet-patch", rule) >= event - keys("wet-patch", "alone") | {"JP4209318"}
    assert "JP4225233" in keys("wet-patch", "sharing") - event
    assert "JPH05276606" in keys("wet-patch", "preset") - event
    for controller in CONTROLLERS:
        assert keys("wet-patch", "alone", controller) >= event
    assert {"krstic2000", "soderstrom2007"} <= keys("wet-patch", "alone", "mpc") - event
    assert "arasaratnam2009" in keys("wet-patch", "alone", "cubature-seeking") - event
    assert "zirek2020" not in keys("wet-patch", "alone", "cubature-seeking")
    polach = write_scenario(SHORT + '\n[rail.curve]\nkind = "polach"\n')
    assert {"polach2005", "kalker"} <= keys(polach) - event
    assert "JP4209318" in keys(write_scenario(SHORT.replace("commuter-8car", "jp4209318-3car")))


def test_a_remark_makes_a_value_sourced_or_not():
    lines = [
        "# a = 1.0",
        "duration_s = 2.0",
        "[rail]",
        "level = 0.1  # readhesion paper, Table 2",
        "values = [1.0, 2.0]  # assumed, near JP5484215 (15)",
        'law = "none"  # JP5484215 (15)',
    ]
    found = [
        one for one in values_of(load_scenario("wet-patch"), lines) if one.of.startswith("scen")
    ]
    assert [(one.name, one.standing) for one in found] == [
        ("duration_s = 2.0", ASSUMED),
        ("rail.level = 0.1", SOURCED),
        ("rail.values = [1.0, 2.0]", ASSUMED),
    ]


def test_cite_reads_a_file_of_ones_own(call, short_file):
    code, out, _ = call("cite", short_file, "--json")
    content = json.loads(out)
    assert code == 0
    assert any(one["name"] == "rail.level = 0.05" for one in content["values"])
    assert all(one["bibtex"].startswith("@") and one["used_by"] for one in content["documents"])


def contexts_of(scenario):
    event = load_scenario(scenario).event()
    return unit_contexts(event.model, equipment(event.model, event.onboard), event.onboard, "mpc")


def memory_in(files):
    return int(re.search(r"MEMORY (\d+)", files["controller.h"].decode()).group(1))


def test_unit_processor_and_settings_of_the_scenario_count(call, tmp_path):
    own = tmp_path / "own.toml"
    own.write_text(f"{SHORT}\n[onboard.mpc]\nhorizon = 7\n")

    def exported(*arguments):
        out = tmp_path / f"unit {arguments[2]}"
        code, printed, err = call("export-controller", *arguments, "--out", out)
        assert (code, err) == (0, "")
        files = {path.name: path.read_bytes() for path in out.iterdir()}
        return files, " ".join(printed.split()), json.loads(files["made-from.json"])

    files, printed, _ = exported("uneven-load", "--unit", 1)
    context = contexts_of("uneven-load")[0]
    made = export_unit(context, context.settings, "x86-64", "unit 1 of uneven-load")
    assert files == made.contents
    assert f"{made.memory} bytes" in printed
    short, _, about = exported(own, "--unit", 4, "--target", "aarch64")
    assert about["unit"]["axle_load"] == contexts_of(own)[3].axle_load
    assert about["settings"]["horizon"] == 7
    assert "aarch64" in short["made-from.json"].decode()
    assert memory_in(short) < 0.5 * memory_in(files)


def test_what_cannot_be_exported_is_one_line(call, tmp_path):
    tram = (ROOT / "docs" / "plugins" / "tram.toml").read_text()
    (tmp_path / "car.toml").write_text(tram.replace('formation = "MTM"', 'formation = "TT"'))
    text = SHORT.replace("commuter-8car", "car.toml").replace("= 3.0", "= -3.0")
    text = text.replace("target_speed_kmh = 1.0", "initial_speed_kmh = 20.0")
    (tmp_path / "own.toml").write_text(text)
    for words, said in (
        (("wet-patch", "--unit", 2, "--target", "powerpc64"), "target = 'powerpc64' must be one of x86-64"),
        (("wet-patch", "--unit", 2, "--target", "x86-64-v9"), "target = 'x86-64-v9' must be one of x86-64"),
        ((tmp_path / "own.toml", "--unit", 1), "has no motors"),
    ):  # fmt: skip
        code, _, err = call("export-controller", *words, "--out", tmp_path / "c")
        assert code == 2
        assert said in " ".join(err.split())
        assert err.count("\n") == 1
        assert not (tmp_path / "c").exists()
