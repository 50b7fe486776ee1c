"""The ladder's events and measures do what they say, and its statements count right."""

import numpy as np
import pandas as pd
import pytest

from alloc.plant.adhesion import POLACH_WET
from alloc.plant.model import build, level_for
from alloc.plant.rail import Rail
from alloc.simulation import CONTROLLERS, simulate
from studies.core.drawn_events import START_SPEED as REFERENCE_SPEED
from studies.core.drawn_events import complete
from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW, UNDECIDED
from studies.ladder.events import (
    INTERVAL,
    QUANTITIES,
    TRAINS,
    draw,
    measure,
    scenario,
    train_of,
)
from studies.ladder.ladder_study import (
    LADDER,
    LADDER_STUDY,
    LOCOMOTIVE,
    RULE,
    SEARCHING,
    ladder_statements,
)
from studies.ladder.published_study import PUBLISHED
from tests.studies.ladder_tables import ladder_table

SHORT = 1.5


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ladder")
    return folder, LADDER_STUDY.run(folder, 2, duration=SHORT)


def statements(table):
    return {one.name: one for one in ladder_statements(complete(table))}


def verdict(table, name):
    return statements(table)[name]


@pytest.fixture(scope="module")
def found():
    """Statements of the table as it is."""
    return statements(ladder_table())


def test_the_ladder_and_the_published_ones_are_all_controllers_of_a_single_unit():
    together = {"mpc-car", "mpc-train", "mpc-train-ideal", "mpc-opti"}  # and a slow reference
    assert not set(LADDER) & set(PUBLISHED)
    known = [name for name in CONTROLLERS if name not in together]
    assert list(LADDER) == [name for name in known if name not in PUBLISHED]
    assert list(PUBLISHED) == [name for name in known if name not in LADDER]


def test_controllers_meet_the_same_events(swept):
    _, table = swept
    assert (table["status"] == "ok").all(), table["reason"].tolist()
    for _, event in table.groupby("scenario"):
        assert event["controller"].tolist() == list(LADDER)
        assert event["scenario_hash"].nunique() == event["seed"].nunique() == 1
    assert set(QUANTITIES) | {"search_time", "torque_fluctuation", "steps_still"} <= set(table)
    assert set(table["rule"]) == {RULE}


def test_a_second_sweep_runs_nothing(swept, monkeypatch):
    folder, table = swept
    monkeypatch.setattr("studies.core.run.run_cell", None)
    pd.testing.assert_frame_equal(LADDER_STUDY.run(folder, 2, duration=SHORT), table)
    assert LADDER_STUDY.held(folder, duration=SHORT) == 2
    assert LADDER_STUDY.held(folder, seed=1, duration=SHORT) == 0


def test_an_event_follows_from_its_number_and_trains_and_curves_take_turns():
    assert draw(0, 5) == draw(0, 5)
    assert draw(0, 5) != draw(1, 5)
    for block in range(3):
        drawn = [draw(0, 6 * block + k) for k in range(6)]
        met = {(d["train"], d["curve"]) for d in drawn}
        assert met == {(train, curve) for train in TRAINS for curve in ("piecewise", "polach")}


@pytest.mark.parametrize(("k", "axles"), [(0, 4), (1, 1), (2, 1)])
def test_units_are_cars_or_axles_as_drawn(k, axles):
    structure = scenario(0, k).event(k).model.structure
    assert set(structure.unit_axles.astype(int)) == {axles}


def test_the_locomotive_has_no_free_axle_and_the_multiple_unit_has():
    for k, free in ((0, True), (2, False)):
        structure = scenario(0, k).event(k).model.structure
        first = structure.axle_body == structure.axle_body[structure.axle_unit >= 0][0]
        assert bool(np.any(structure.axle_unit[first] < 0)) == free


@pytest.mark.parametrize("adhesion", [0.08, 0.13, 0.19])
def test_rails_of_both_curves_offer_the_same_peak(adhesion):
    for name in TRAINS:
        level = level_for(POLACH_WET, adhesion, REFERENCE_SPEED, train_of(name))
        model = build(train_of(name), Rail(level, curve=POLACH_WET))
        found = POLACH_WET.limit(level, REFERENCE_SPEED, model.environment.contact)[0]
        load = model.structure.static_load
        assert float(found @ load / load.sum()) == pytest.approx(adhesion, rel=1e-9)
        assert np.ptp(found) < 0.03 * adhesion


def test_steps_of_slip_towards_the_peak_are_right_and_away_from_it_wrong():
    event = scenario(0, 0, 4.0).event(0)
    run = simulate(event, "alone", "none")
    time, shape = run["time"].values, run["slip_velocity"].shape
    run["torque_target"] = run["torque_target"] * 0.0 + 1e5  # short of adhesion throughout
    run["driver_command"] = run["driver_command"] * 0.0 + 0.8
    run["adhesion_limit"] = run["adhesion_limit"] * 0.0 + 0.1
    run["peak_slip"] = run["peak_slip"] * 0.0 + 0.5
    steps = np.floor(time / INTERVAL + 1e-9)
    for way, wrong in ((0.01, 0.0), (-0.01, 1.0)):  # from 0.2 m/s up, and down
        slip = np.broadcast_to((0.2 + way * steps)[:, None], shape)
        run["slip_velocity"] = (("time", "axle"), slip)
        found = measure(run)
        assert found["wrong_steps_still"] == wrong
        assert found["steps_still"] > 0
        assert found["steps_changing"] == 0.0
        assert np.isnan(found["wrong_steps_changing"])


def test_yardsticks_are_held_by_who_uses_more(found):
    assert found["90%: perturb-observe"].verdict == HOLDS
    assert found["95%: mpc"].verdict == HOLDS
    assert found["95%: pi-creep"].verdict == FAILS
    assert found["90%: table"].verdict == FAILS


def test_a_yardstick_missed_by_one_train_holds_with_that_condition():
    def worse(row):
        low = row["train"] == LOCOMOTIVE and row["controller"] == "mpc"
        return row | ({"utilisation_short": 0.85} if low else {})

    found = verdict(ladder_table(events=90, change=worse), "90%: mpc")
    assert found.verdict == CONDITIONS
    assert any("locomotive" in text for text in found.conditions)


def test_every_rung_is_above_the_one_below(found):
    reverse = statements(
        ladder_table(change=lambda row: row | {"utilisation_short": 1.0 - row["utilisation_short"]})
    )
    rungs = [f"rung: {name}" for name in LADDER[1:]]
    assert [found[name].verdict for name in rungs] == [HOLDS] * len(rungs)
    assert [reverse[name].verdict for name in rungs] == [FAILS] * len(rungs)


@pytest.mark.parametrize("name", SEARCHING)
def test_a_weakness_is_found_where_it_is(found, name):
    claims = {
        "slow": ("search_time", 2.0, UNDECIDED),
        "restless": ("torque_fluctuation", 0.08, FAILS),  # its threshold is not 0
        "misled": ("wrong_steps_changing", 0.8, UNDECIDED),
    }
    given = {metric: value for metric, value, _ in claims.values()}
    weak = statements(
        ladder_table(change=lambda row: row | (given if row["controller"] == name else {}))
    )
    for claim, (*_, without) in claims.items():
        assert found[f"{claim}: {name}"].verdict == without, claim
        assert weak[f"{claim}: {name}"].verdict == HOLDS, claim
        assert all(one.count > 0 for one in weak[f"{claim}: {name}"].numbers.values())
        others = [f"{claim}: {other}" for other in SEARCHING if other != name]
        assert all(weak[other].verdict == without for other in others), claim


def test_few_events_give_no_verdict_and_failed_ones_are_left_out():
    assert verdict(ladder_table(events=6), "90%: mpc").verdict == TOO_FEW
    table = ladder_table(events=20)
    table.loc[table.index[3], "status"] = "failed"
    name = table.loc[table.index[3], "scenario"]
    assert name not in set(complete(table)["scenario"])
    assert complete(table)["scenario"].nunique() == 19
