"""The sweep `slide-protection`: its table from runs, and what its statements make of a table."""

from itertools import islice

import numpy as np
import pytest

from studies.core.statement import CONDITIONS, FAILS, HOLDS, VERDICTS
from studies.core.study import find_study
from studies.slides import study
from studies.slides.jp4209318 import TABLE_3, TABLE_4, TARGETS, front
from studies.slides.study import SLIDE_PROTECTION, slide_statements, tables
from tests.studies.made_tables import slide_table


@pytest.fixture
def table():
    return slide_table()


def verdicts(table):
    return {statement.name: statement.verdict for statement in slide_statements(table)}


def test_the_sweep_is_known_by_name():
    assert find_study("slide-protection") is SLIDE_PROTECTION


def test_what_is_as_printed_holds(table):
    found = verdicts(table)
    assert set(found.values()) <= set(VERDICTS)
    for name in ("Table 3", "Table 4", "held out", "first axle", "even axles", "further back",
                 "short trains", "no lock", "step", "jitter", "computing", "electric brake"):  # fmt: skip
        assert found[name] == HOLDS, name
    assert found["members"] == found["beyond"] == found["logarithm"] == HOLDS


def test_numbers_carry_the_range_of_the_ensemble(table):
    chosen = (table["member"] == 2) & (table["part"] == "tables") & (table["cars"] == 1)
    table.loc[chosen, "distance"] = 459.3
    found = {one.name: one for one in slide_statements(table)}
    (number,) = [n for words, n in found["Table 3"].numbers.items() if "1 cars" in words]
    assert (number.value, number.count) == (458.1, 3)
    assert number.low == 458.1 < number.high < 459.3
    assert found["Table 3"].verdict == HOLDS


def test_what_few_members_show_holds_with_conditions(table):
    table.loc[table["member"].isin([1, 2]) & (table["part"] == "tables"), "slip_3"] = 0.2
    (statement,) = [one for one in slide_statements(table) if one.name == "first axle"]
    assert statement.verdict == CONDITIONS
    assert statement.conditions == (
        "of the ensemble's 3 members it holds of 1, does not hold of 2",
    )


def test_members_that_disagree_beyond_the_tables_are_said_to(table):
    rows = (table["member"] == 2) & (table["stop"] == "8 cars")
    table.loc[rows, "distance"] = 500.0
    (statement,) = [one for one in slide_statements(table) if one.name == "beyond"]
    assert statement.verdict == CONDITIONS
    assert [words[:31] for words in statement.conditions] == ["not about the distance 8 cars: "]


def test_the_targets_numbers_are_the_tables(table):
    found = tables(table[table["member"].isna()])
    assert {cars: found[f"distance {cars}"] for cars in (1, 2, 3)} == TABLE_3
    assert found["Q high"] == pytest.approx(TABLE_4["high"][1] / TABLE_4["medium"][1])
    assert set(found) == set(TARGETS)


def _change(table, column, value, **where):
    chosen = np.ones(len(table), dtype=bool)
    for key, wanted in where.items():
        chosen &= (table[key] == wanted).to_numpy()
    table.loc[chosen, column] = value
    return table


@pytest.mark.parametrize(
    ("name", "verdict", "column", "value", "where"),
    [
        ("Table 3", CONDITIONS, "distance", 470.0, {"part": "tables", "cars": 1}),
        ("Table 4", CONDITIONS, "damage", 900.0, {"part": "tables", "setting": "high"}),
        ("held out", FAILS, "distance 2", 420.0, {"part": "held out"}),
        ("logarithm", FAILS, "distance 2", 410.0, {"part": "held out"}),
        ("members", FAILS, "distance 1", 420.0, {"part": "member", "member": 1}),
        ("held out", CONDITIONS, "distance 3", 399.0, {"part": "held out"}),
        ("first axle", CONDITIONS, "slip_3", 0.2, {"part": "tables", "setting": "high"}),
        ("even axles", FAILS, "slip_2", 0.2, {"part": "tables"}),
        ("further back", FAILS, "slip_11", 0.4, {"part": "tables"}),
        ("short trains", FAILS, "distance", 380.0, {"part": "tables", "cars": 2}),
        ("no lock", FAILS, "locked_time", 0.1, {"part": "tables"}),
        ("no lock", CONDITIONS, "locked_time", 0.1, {"part": "pareto"}),
        ("step", CONDITIONS, "distance", 392.0, {"part": "halved", "setting": "high"}),
        ("step", CONDITIONS, "damage", 550.0, {"part": "halved", "setting": "high"}),
        ("computing", FAILS, "computing", 12.0, {"part": "tables"}),
        ("electric brake", CONDITIONS, "distance", 470.0, {"part": "electric", "group": "1C4M"}),
        ("electric brake", FAILS, "distance", 470.0, {"part": "electric"}),
    ],
)
def test_a_statement_follows_its_numbers(table, name, verdict, column, value, where):
    assert verdicts(_change(table, column, value, **where))[name] == verdict


def test_jitter_of_one_distance_is_a_condition(table):
    rows = table["part"] == "jitter"
    table.loc[rows, "distance 1"] += np.linspace(-0.3, 0.3, rows.sum())
    (statement,) = [one for one in slide_statements(table) if one.name == "jitter"]
    assert statement.verdict == CONDITIONS
    assert statement.conditions == ("not of distance 1",)


def test_the_front_is_what_nothing_beats_in_both(table):
    own = front(table[table["part"] == "pareto"])
    assert np.all(np.diff(own["distance"]) > 0.0)
    assert np.all(np.diff(own["damage"]) < 0.0)


def test_thresholds_are_judged_at_equal_q(table):
    (statement,) = [one for one in slide_statements(table) if one.name == "threshold"]
    assert statement.verdict == CONDITIONS
    assert statement.conditions == ("not with hold 0.01, release 0.02",)


def test_a_table_is_made_once_and_an_interrupted_one_goes_on(tmp_path, monkeypatch):
    few = list(islice(study.stops(), 2))
    monkeypatch.setattr(study, "stops", lambda *_: iter(few))
    monkeypatch.setattr(study, "STOPS", {})
    monkeypatch.setattr(study, "MEMBERS", study.MEMBERS[:1])
    monkeypatch.setattr(study, "HELD_OUT", study.HELD_OUT[:1])
    monkeypatch.setattr(study, "electric_tasks", lambda: [("1C4M", "cut-and-ramp")])
    cells = 6
    seen = []

    def told(*row):
        seen.append(row)
        if len(seen) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        SLIDE_PROTECTION.run(tmp_path, 1, on_row=told)
    assert SLIDE_PROTECTION.held(tmp_path) == 0
    made = SLIDE_PROTECTION.run(tmp_path, 1, on_row=told)
    assert seen[1:4] == [
        ("electric/1C4M/cut-and-ramp", 1, cells), ("tables/1/medium", 2, cells), ("tables/2/medium", 3, cells),
    ]  # fmt: skip
    assert [row[1] for row in seen[4:]] == list(range(3, cells + 1))
    assert made["part"].tolist() == [
        "electric", "tables", "tables", "jitter", "member", "noise", "noise", "tables", "tables", "electric",
        "held out",
    ]  # fmt: skip
    assert made["member"].dropna().tolist() == [0] * 6
    again = SLIDE_PROTECTION.run(tmp_path, 1, on_row=told)
    assert seen[-1] == ("", cells, cells)
    assert again.equals(made)
    assert SLIDE_PROTECTION.held(tmp_path) == 1
