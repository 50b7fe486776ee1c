"""The sweep of the readhesion paper: what it runs, what it keeps, and what it states."""

import numpy as np
import pandas as pd
import pytest

from studies.core.statement import CONDITIONS, FAILS, HOLDS, VERDICTS
from studies.core.study import find_study
from studies.readhesion_paper import study
from studies.readhesion_paper.findings import CLAIMS
from studies.readhesion_paper.paper import GRADIENTS, PAPER_MARGINS, UNITS
from studies.readhesion_paper.study import NARROW, PRINTED, READHESION
from tests.studies.made_tables import limit_of, sweep_table

COARSE = 5e-4


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("readhesion")
    return READHESION.run(folder, 1, margins=(0.4,), widths=(0.2, 0.8), step=COARSE)


def test_every_parabola_meets_every_controller(swept):
    limits = swept[swept["part"] == "limit"]
    assert limits.groupby("parabola").size().to_dict() == {
        PRINTED: 2,
        NARROW: 2,
    }
    runs = swept[swept["part"] == "indices"]
    assert (runs.groupby(["parabola", "width"]).size() >= 15).all()
    assert not runs.duplicated(["parabola", "unit", "margin", "width", "limit"]).any()
    assert runs.groupby("unit").size().min() >= 30


def test_the_limit_separates_what_readheres(swept):
    limits = swept[swept["part"] == "limit"].set_index(["parabola", "width"])
    for key, runs in swept[swept["part"] == "indices"].groupby(["parabola", "width"]):
        good = runs["possible"].astype(bool)
        limit = limits.loc[key, "limit_coefficient"]
        if np.isnan(limit):
            assert not good.any()
        else:
            assert limit == pytest.approx(runs["limit"][good].min())
            assert (good == (runs["limit"] >= limit - 1e-9)).all() == limits.loc[key, "monotone"]


def test_what_a_folder_holds_is_not_run_again(tmp_path, monkeypatch):
    rows = sweep_table().iloc[:10].drop(columns="parabola").to_dict("records")
    asked = []
    monkeypatch.setattr(study, "searched_rows", lambda *how: asked.append(how) or rows)
    monkeypatch.setattr(study, "case_rows", lambda *_: [{"finding": "A readheres", "met": True}])
    READHESION.run(tmp_path, 1, widths=(0.2,))
    assert READHESION.held(tmp_path) == 0
    told = []
    whole = READHESION.run(tmp_path, 1, on_row=lambda *row: told.append(row))
    assert told[1:] == [
        (PRINTED, 4, 7), (NARROW, 5, 7), ("member/km/h/s/0", 6, 7), ("member/m/s2/0", 7, 7),
    ]  # fmt: skip  # cases and hills know no widths
    assert READHESION.held(tmp_path) == 1
    pd.testing.assert_frame_equal(READHESION.run(tmp_path, 1), whole)
    assert len(asked) == 8
    monkeypatch.setattr("studies.core.cell.code_hash", lambda *_: "other code")
    assert READHESION.held(tmp_path) == 0


def test_every_finding_has_its_statement(swept):
    found = {statement.name: statement for statement in READHESION.statements(swept)}
    assert set(CLAIMS) | {"limit exists", "parabola", "downhill"} == set(found)
    assert {statement.verdict for statement in found.values()} <= set(VERDICTS)
    assert find_study("readhesion") is READHESION


def test_a_table_as_the_paper_found_it_holds():
    found = READHESION.statements(sweep_table())
    assert {statement.verdict for statement in found} == {HOLDS}


def test_a_case_that_fails_is_said_to():
    table = sweep_table()
    table.loc[table["finding"] == "A period", "met"] = False
    verdicts = {statement.name: statement.verdict for statement in READHESION.statements(table)}
    assert [name for name, verdict in verdicts.items() if verdict != HOLDS] == ["A period"]


def test_a_limit_that_is_none_is_said_to_be():
    found = {s.name: s for s in READHESION.statements(sweep_table(monotone=False))}
    assert found["limit exists"].verdict == CONDITIONS
    assert found["limit exists"].conditions == ("not with a_0 0, a_w 0.2",)


def test_a_parabola_that_matters_is_said_to():
    def parabola(narrow_limit):
        found = READHESION.statements(sweep_table(narrow_limit))
        return next(statement for statement in found if statement.name == "parabola")

    assert parabola(lambda m, w: limit_of(m, w) - 0.012).verdict == FAILS
    assert parabola(lambda m, w: limit_of(m, w) - 0.002).verdict == HOLDS
    # a finding that changes where C = 40 makes a curve is a condition, one that changes elsewhere refutes
    wide = parabola(lambda m, w: limit_of(m, w) if w < 0.59 else 0.158)
    assert wide.verdict == CONDITIONS
    assert wide.conditions == ("not the same, narrow at every mu_max: wide never",)
    lower = parabola(lambda m, w: limit_of(m, w) if w < 0.59 else 0.148)
    assert lower.verdict == FAILS
    assert "not the same, narrow there: wide never" in lower.conditions


def test_room_downhill_is_what_gravity_adds(swept):
    """a_0 as large as gravity's part keeps the torque; each unit less costs 1/(commanded + a_w) of it."""
    rows = swept[swept["part"] == "downhill"].astype({"margin": float, "kept": float})
    assert len(rows) == len(UNITS) * len(PAPER_MARGINS) * len(GRADIENTS)
    for unit, own in rows.groupby("read_in"):
        sine = np.sin(np.arctan(-1e-3 * own["gradient"].to_numpy(dtype=float)))
        room = own["margin"] * UNITS[unit] - 9.80665 * sine / (1.0 + 155.01 / 0.43**2 / 20e3)
        asked = 3.0 / 3.6 + 0.2 * UNITS[unit]
        np.testing.assert_allclose(own["kept"], 1.0 + np.minimum(room / asked, 0.0), atol=2e-3)
        assert own["slip"].max() < 0.5
    room = sweep_table()
    room.loc[room["part"] == "downhill", ["kept", "expected"]] = 1.0
    found = {statement.name: statement for statement in READHESION.statements(room)}["downhill"]
    assert found.verdict == FAILS


def test_a_finding_of_one_unit_alone_holds_with_conditions():
    table = sweep_table()
    rows = (table["finding"] == "A period") & (table["unit"] == "m/s2")
    table.loc[rows, "met"] = False
    table.loc[rows, "value"] = 0.4
    found = {statement.name: statement for statement in READHESION.statements(table)}["A period"]
    assert found.verdict == CONDITIONS
    assert found.conditions == (
        "with a_0 and a_w in m/s2 it does not hold; of 2 sets there 0 say as here",
    )
    assert found.numbers["a_0 and a_w in m/s2: number"].value == 0.4
    assert found.numbers["number"].value == 1.0


def test_numbers_of_both_units_stand_side_by_side():
    for statement in READHESION.statements(sweep_table()):
        here = {
            words for words in statement.numbers if not words.startswith("a_0 and a_w in m/s2: ")
        }
        there = {words.partition(": ")[2] for words in set(statement.numbers) - here}
        if statement.name in CLAIMS:
            assert here == there
