"""The same events on rails of several curves, and statements on which conclusions keep their sign."""

import numpy as np
import pandas as pd
import pytest

from studies.core.drawn_events import START_SPEED as REFERENCE_SPEED
from studies.core.statement import (
    CONDITIONS,
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
    mean_interval,
)
from studies.ladder.curves_study import (
    BASE,
    CURVE_STUDY,
    CURVES,
    METRICS,
    PAIRS,
    RULES,
    SEEKING,
    curve_statements,
    paired_difference,
    scenario,
)
from studies.patent.claim_events import draw
from studies.patent.claim_events import scenario as claim_event
from tests.studies.ladder_tables import curve_table

SHORT = 2.5


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("curves")
    return folder, CURVE_STUDY.run(folder, 1, duration=SHORT)


def verdict(table, name):
    return next(s for s in curve_statements(table) if s.name == name)


def test_every_arm_meets_every_curve(swept):
    _, table = swept
    assert (table["status"] == "ok").all(), table["reason"].tolist()
    assert len(table) == len(CURVES) * (len(RULES) + 2)
    assert set(table["curve"]) == set(CURVES)
    for curve, rows in table.groupby("curve"):
        assert rows["scenario_hash"].nunique() == 1, curve
        assert set(rows["controller"]) == {"cut-and-ramp", *SEEKING}
    assert {"held_effort", "utilisation", "event"} <= set(table)


def test_a_second_sweep_runs_nothing(swept, monkeypatch):
    folder, table = swept
    monkeypatch.setattr("studies.core.run.run_cell", None)
    pd.testing.assert_frame_equal(CURVE_STUDY.run(folder, 1, duration=SHORT), table)
    assert CURVE_STUDY.held(folder, duration=SHORT) == 1
    assert CURVE_STUDY.held(folder, seed=2, duration=SHORT) == 0


@pytest.mark.parametrize("k", range(4))
@pytest.mark.parametrize("curve", CURVES)
def test_rails_differ_in_their_curve_and_not_in_their_peak(curve, k):
    base, other = claim_event(0, k), scenario(0, k, curve)
    rail, same = other.event(k).model.rail, base.event(k).model.rail
    assert (rail.scatter, rail.seed, rail.increments) == (same.scatter, same.seed, same.increments)
    assert rail.patches == same.patches
    # where adhesion falls with speed, the level is a factor on a law: only its ratio can be compared
    adhesion = draw(0, k)["level"]
    friction = adhesion * rail.level / same.level
    model = other.event(k).model
    found = rail.curve.limit(friction, REFERENCE_SPEED, model.environment.contact)[0]
    # force over weight: with a stiffness from load, heavier axles find another coefficient
    mean = np.average(
        np.broadcast_to(found, model.layout.axles), weights=model.structure.static_load
    )
    assert mean == pytest.approx(adhesion)
    assert other.event(k).onboard.belief.curve == base.event(k).onboard.belief.curve


@pytest.mark.parametrize("curve", [c for c in CURVES if "flat" in c])
def test_a_flat_curve_hardly_falls_beyond_its_peak(curve):
    rail = scenario(0, 0, curve).event(0).model.rail
    top, slip = (float(v) for v in rail.curve.limit(0.13, 5.0))
    beyond = float(rail.curve.coefficient(slip + 2.0, 0.13, 5.0))
    assert beyond > 0.98 * top


def test_a_conclusion_with_the_same_sign_under_every_curve_stands():
    found = {s.name: s for s in curve_statements(curve_table())}
    assert list(found) == [f"{pair.name}: {text}" for pair in PAIRS for text in METRICS.values()]
    assert {s.verdict for s in found.values()} == {HOLDS}
    assert all(s.agreement == 1.0 for s in found.values())


def changed(metric, curve, factor):
    def change(row):
        hit = row["curve"] == curve and row["rule"] == "greedy"
        return row | ({metric: row[metric] * factor} if hit else {})

    return curve_table(change=change)


def test_an_opposite_sign_under_one_curve_breaks_it_and_an_unknown_one_is_a_condition():
    name = f"greedy less alone: {METRICS['damage']}"
    opposite = verdict(changed("damage", "Polach wet", 0.95), name)
    assert opposite.verdict == FAILS
    assert opposite.conditions == ("not with Polach wet: the other way round",)
    unknown = verdict(changed("damage", "Polach wet", 1.0 / 1.01), name)
    assert unknown.verdict == CONDITIONS
    assert "Polach wet" in unknown.conditions[0]
    none = verdict(changed("damage", BASE, 1.0 / 1.01), name)
    assert none.verdict == UNDECIDED
    assert "not with Polach wet: more" in none.conditions


def test_few_events_give_no_verdict():
    name = f"mpc less cut-and-ramp: {METRICS['damage']}"
    assert verdict(curve_table(events=8), name).verdict == TOO_FEW
    assert verdict(curve_table(events=24), name).verdict == HOLDS


def test_differences_are_paired_by_event():
    def shifted(row):
        return row | {"damage": row["damage"] + 1000.0 * row["event"]}

    plain, spread = (
        mean_interval(paired_difference(table, BASE, PAIRS[0], "damage"))
        for table in (curve_table(), curve_table(change=shifted))
    )
    assert spread.value == pytest.approx(plain.value)
    assert spread.high - spread.low == pytest.approx(plain.high - plain.low)


def test_a_controller_that_fails_on_every_rail_of_a_curve_gives_no_verdict():
    table = curve_table()
    failed = (table["curve"] == "Polach wet") & (table["controller"] == "mpc")
    for one in curve_statements(table[~failed]):
        assert one.verdict == (TOO_FEW if one.name.startswith("mpc") else HOLDS), one.name
