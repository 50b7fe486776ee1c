"""Calibration tries sets in its ranges, comes near the best, says how narrow the good ones are; an ensemble gives ranges."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from studies.core.calibration import median_of, over_members, range_of
from studies.core.statement import CONDITIONS, FAILS, HOLDS, Statement, single
from studies.readhesion_paper import calibration
from studies.readhesion_paper.calibration import (
    LEAST_MET,
    MEMBERS,
    NOT_ASKED_OF_ALL,
    RANGES,
    best,
    best_of_units,
    draw,
    draw_near,
    from_unit_cube,
    fulfilling,
    members,
    to_unit_cube,
)
from studies.readhesion_paper.calibration_study import CALIBRATION, LEAST_SETS
from studies.readhesion_paper.findings import CLAIMS
from studies.readhesion_paper.paper import ASSUMED, CALIBRATED, RIVAL, UNITS
from tests.studies.made_tables import calibration_table

WANTED = np.array([0.7, 0.4, 0.5, 0.6])
"""Where in the unit cube the stub's objective is least."""
RADIUS = 0.3


def row_of_set(unprinted):
    return pd.Series({name: getattr(unprinted, name) for name in RANGES})


def inside(unprinted):
    return all(
        low * (1 - 1e-9) <= getattr(unprinted, name) <= high * (1 + 1e-9)
        for name, (low, high, _) in RANGES.items()
    )


@pytest.fixture
def stub(monkeypatch):
    """An objective that takes no time: distance from `WANTED`, nothing met in m/s2."""

    def row_of(unprinted):
        distance = float(np.sum((to_unit_cube(row_of_set(unprinted)) - WANTED) ** 2))
        good = unprinted.unit == "km/h/s" and distance < 0.3
        met = {f"met: {name}": good and name not in NOT_ASKED_OF_ALL for name in CLAIMS}
        values = {name: getattr(unprinted, name) for name in (*RANGES, "unit")}
        return {**values, "objective": 100.0 * distance, "met": sum(met.values()), **met}

    monkeypatch.setattr(calibration, "row_of", row_of)


def in_a_ball(unprinted):
    """Everything within `RADIUS` of the aim meets as many findings, in both units."""
    away = np.linalg.norm(to_unit_cube(row_of_set(unprinted)) - WANTED)
    missing = 2 if away <= RADIUS else 9
    met = {f"met: {name}": k >= missing for k, name in enumerate(CLAIMS)}
    values = {name: getattr(unprinted, name) for name in (*RANGES, "unit")}
    return {**values, "objective": 10.0 * away, "met": sum(met.values()), **met}


@given(st.lists(st.floats(0.0, 1.0), min_size=4, max_size=4), st.sampled_from(list(UNITS)))
def test_the_unit_cube_is_the_ranges(point, unit):
    unprinted = from_unit_cube(np.array(point), unit)
    assert inside(unprinted)
    assert unprinted.unit == unit
    np.testing.assert_allclose(to_unit_cube(row_of_set(unprinted)), point, atol=1e-9)


def test_samples_cover_every_range_in_both_units_and_known_sets_lie_in_them():
    drawn = draw(40, 0)
    assert all(inside(one) for one in (*drawn, ASSUMED, CALIBRATED, RIVAL))
    assert {one.unit for one in drawn} == set(UNITS)
    cube = np.array([to_unit_cube(row_of_set(one)) for one in drawn])
    for column in cube.T:  # a Latin hypercube: one sample in every fortieth of a range
        assert sorted(np.floor(column * 40).astype(int)) == list(range(40))
    assert draw(40, 0) == drawn
    assert draw(40, 1) != drawn


def test_each_unit_keeps_its_best_and_samples_near_them_are_near_and_inside():
    table = calibration_table()
    chosen = best_of_units(table, 3)
    for unit in UNITS:
        own = table[table["unit"] == unit]["objective"]
        kept = chosen[chosen["unit"] == unit]["objective"]
        assert sorted(kept) == sorted(own)[:3]
    drawn = draw_near(table, 30, 0, 1)
    assert all(inside(one) for one in drawn)
    parents = best_of_units(table, calibration.PARENTS // 2)
    assert {one.unit for one in drawn} == set(UNITS)
    cube = np.array([to_unit_cube(row) for _, row in parents.iterrows()])
    for k, one in enumerate(drawn):
        away = np.abs(to_unit_cube(row_of_set(one)) - cube[k % len(cube)])
        assert away.max() < 4.0 * calibration.NEARNESS[1]


def test_every_stage_comes_nearer_to_the_best(stub, tmp_path):
    table = CALIBRATION.run(tmp_path / "one", 60, refinements=15)
    least = table.groupby("stage")["objective"].min()
    assert least["refined"] < least["near"] < least["wide"]
    counts = table["stage"].value_counts()
    assert counts["assumed"] == 2
    assert counts["shipped"] == 1
    assert counts["wide"] + counts["near"] == 60
    assert counts["refined"] <= len(UNITS) * 15
    again = CALIBRATION.run(tmp_path / "two", 60, refinements=15)
    pd.testing.assert_frame_equal(again.drop(columns="wall_time"), table.drop(columns="wall_time"))


def test_under_the_other_reading_every_set_is_read_so(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(calibration, "row_of", lambda one: seen.append(one) or in_a_ball(one))
    table = CALIBRATION.run(tmp_path, 60, refinements=5, constant=True)
    assert all(one.constant for one in seen)
    assert set(table["stage"]) == {"assumed", "shipped", "wide", "near", "refined", "sampled"}
    assert (table["stage"] == "shipped").sum() == sum(len(sets) for sets in MEMBERS.values())


def test_the_best_is_among_those_that_fulfil():
    table = calibration_table()
    good = fulfilling(table)
    assert 0 < len(good) < len(table)
    assert (good["rise"] < 2.0).all()
    assert best(table)["objective"] == good["objective"].min()
    none = table.assign(**{"met: A readheres": False})
    assert len(fulfilling(none)) == 0
    assert best(none)["objective"] == table["objective"].min()


def test_what_the_cases_already_refute_is_not_asked_further(monkeypatch):
    monkeypatch.setattr(calibration, "search_limits", None)
    found = calibration.findings_of(calibration.Unprinted(rise=0.3, time_constant=0.02))
    assert not all(found[name].met for name in calibration.DECISIVE)
    assert "wide never" not in found
    row = calibration.row_of(calibration.Unprinted(rise=0.3, time_constant=0.02))
    assert np.isnan(row["misfit: wide never"])
    assert not row["met: wide never"]


def test_statements_say_how_narrow_the_good_sets_are_and_how_many():
    def said(table):
        return {statement.name: statement for statement in CALIBRATION.statements(table)}

    table = calibration_table()
    found, good = said(table), fulfilling(table)
    assert found["a set exists"].verdict == CONDITIONS
    assert len(found["a set exists"].conditions) == len(NOT_ASKED_OF_ALL)
    ranges = next(iter(found["narrow: rise"].numbers.values()))
    assert (ranges.low, ranges.high) == (good["rise"].min(), good["rise"].max())
    assert found["narrow: rise"].verdict == FAILS  # from 0.3 to 2 s
    assert found["unit"].verdict == HOLDS
    assert found["half-slip"].verdict == FAILS
    rivals = table["unit"] == "m/s2"
    table.loc[table[rivals].index[:2], "objective"] = 2.5
    undecided = said(table)["unit"]
    assert undecided.verdict == FAILS
    assert len(undecided.conditions) == len(CLAIMS)
    close = table[~table.index.isin(good.index) | (table["rise"] > 1.2)]
    assert said(close)["narrow: rise"].verdict == HOLDS
    none = said(calibration_table().assign(**{"met: A readheres": False}))
    assert {none[name].verdict for name in ("a set exists", "narrow: rise", "unit")} == {FAILS}
    ensemble = said(calibration_table(400))["ensemble"]
    assert (ensemble.verdict, ensemble.conditions) == (FAILS, ("not so many in m/s2: 0",))
    # too few sets let no walker go
    cells = calibration.walking_cells(0, 0, 40, calibration_table())
    assert [cell.label for cell in cells] == ["sampled/km/h/s/0"]
    assert len(cells[0].arguments[0]) <= calibration.MOST_WALKERS


def test_walkers_cover_what_meets_as_many_findings(tmp_path, monkeypatch):
    """In a ball about the aim everything meets 16: its members fill it, where refinement leaves a heap."""
    monkeypatch.setattr(calibration, "row_of", in_a_ball)
    table = CALIBRATION.run(tmp_path, 60, refinements=5)
    sampled = table[table["stage"] == "sampled"]
    assert set(sampled["unit"]) == set(UNITS)
    assert (sampled["met"] >= LEAST_MET).all()
    for unit in UNITS:
        rows = members(table, unit)
        assert not rows.duplicated(list(RANGES)).any()
        cube = np.array([to_unit_cube(row) for _, row in rows.iterrows()])
        away = np.linalg.norm(cube - WANTED, axis=1)
        assert away.max() <= RADIUS
        assert np.median(away) > 0.5 * RADIUS  # half of a ball in four dimensions lies beyond 0.84
    again = CALIBRATION.run(tmp_path / "two", 60, refinements=5)
    pd.testing.assert_frame_equal(again.drop(columns="wall_time"), table.drop(columns="wall_time"))


def test_members_are_those_of_the_calibration_and_the_drawn_ones_come_first():
    assert MEMBERS["km/h/s"][0] == CALIBRATED
    assert MEMBERS["m/s2"][0] == RIVAL
    for unit, sets in MEMBERS.items():
        assert len(set(sets)) == len(sets) >= LEAST_SETS
        assert all(inside(one) and one.unit == unit for one in sets)
        row = calibration.row_of(sets[-1])
        assert row["met"] >= LEAST_MET


def said(verdict, value):
    return Statement("name", "claim", verdict, {"number": single(value)})


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50))
def test_a_range_lies_within_the_members_and_what_is_not_known_does_not_count(values):
    found = range_of(values[0], values)
    assert min(values) <= found.low <= found.high <= max(values)
    inside = np.mean([found.low - 1e-6 <= one <= found.high + 1e-6 for one in values])
    assert inside >= 0.9 - 2.0 / len(values)
    assert found.low <= median_of(values).value <= found.high
    assert range_of(1.0, [math.nan, 2.0, 4.0]).count == 2
    assert range_of(1.0, []).count == median_of([math.nan]).count == 0


def test_a_verdict_needs_most_of_the_members():
    for own, others, verdict in (
        (HOLDS, [HOLDS] * 20, HOLDS),
        (HOLDS, [HOLDS] * 19 + [FAILS], HOLDS),
        (HOLDS, [HOLDS] * 18 + [FAILS] * 2, CONDITIONS),
        (CONDITIONS, [HOLDS] * 20, CONDITIONS),
        (FAILS, [HOLDS] * 20, FAILS),
    ):
        found = over_members(said(own, 1.0), [said(one, float(k)) for k, one in enumerate(others)])
        assert found.verdict == verdict
        share = found.numbers["share of the members with the same verdict"]
        assert share.value == np.mean([one == own for one in others])
        assert bool(found.conditions) == (share.value < 0.95)
        number = found.numbers["number"]
        assert (number.value, number.count) == (1.0, 20)
        assert 0.0 < number.low < number.high < 19.0
    own = said(HOLDS, 1.0)
    assert over_members(own, []) is own
