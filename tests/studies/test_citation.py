"""`readhesion cite`: every document that a run's parts name, and where each value comes from."""

import json
import re
from pathlib import Path

import pytest

from alloc.citations import CITATIONS, cited_in
from alloc.onboard.host import CONTROLLERS
from alloc.plant.sets import SETS, find_set
from alloc.rules import RULES
from studies.citation.run_parts import ASSUMED, PARTLY, SOURCED, documents_of, values_of
from studies.command_line.main import run
from studies.scenario.loading import load_scenario, shipped_scenarios

ROOT = Path(__file__).parents[2]
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


@pytest.mark.parametrize("name", shipped_scenarios())
def test_values_are_sourced_or_assumed_and_all_of_the_train_are_there(name):
    scenario = load_scenario(name)
    values = values_of(scenario)
    assert {one.standing for one in values} <= {SOURCED, ASSUMED, PARTLY}
    train = find_set(scenario.train)
    assert [one.name for one in values if one.of.startswith("train")] == list(train.sources)
    assert any(one.of.startswith("scenario") for one in values)
    assert all(one.why for one in values)


def test_another_rule_or_controller_adds_its_own_documents_and_drops_none_of_the_event():
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


def test_curve_and_train_of_the_event_count(write_scenario):
    from tests.studies.conftest import SHORT

    polach = write_scenario(SHORT + '\n[rail.curve]\nkind = "polach"\n')
    assert {"polach2005", "kalker"} <= keys(polach) - keys("wet-patch")
    heavy = write_scenario(SHORT.replace("commuter-8car", "jp4209318-3car"))
    assert "JP4209318" in keys(heavy)
    assert "jp4209318-3car" in SETS


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


def test_the_command_reads_a_file_of_ones_own(short_file, capsys):
    assert run(["cite", str(short_file), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert any(one["name"] == "rail.level = 0.05" for one in content["values"])
    assert all(one["bibtex"].startswith("@") and one["used_by"] for one in content["documents"])
    assert run(["cite", "wet-patch", "--rule", "gredy"]) == 2
    assert "greedy" in capsys.readouterr().err
