"""Drawn blended stops: what is drawn, what is measured, what is said."""

from math import gcd

import numpy as np
import pandas as pd
import pytest

from alloc.metrics import evaluate
from alloc.metrics.use import locked_time
from alloc.plant.laws import GRAVITY
from alloc.plant.model import axle_contacts, structure_of
from alloc.simulation import simulate
from studies.core.statement import FAILS, HOLDS, TOO_FEW
from studies.stops.blended_events import (
    CURVES,
    EVENTS,
    LEAST_LEVEL,
    LEAST_SPEED,
    REFERENCE_SPEED,
    ROLLING,
    SOURCES,
    TRAINS,
    WITHIN,
    asked_of,
    locked_driven,
    measure,
    peak_of,
    reference_error,
    scenario,
    train_of,
    unit_use,
)
from studies.stops.blended_study import (
    ARMS,
    BLENDED,
    CONTROLLERS,
    PAIRS,
    PARTS,
    RULES,
    SHARERS,
    TRUTH,
    blended_statements,
    pairs_of,
)
from tests.studies.blended_tables import blended_table

STOPS = range(42)
SHORT = ROLLING + 1.5
"""Length of an event [s] in which the brakes come up."""
EACH_TRAIN = range(len(TRAINS))


def test_a_stop_follows_from_seed_and_number_whatever_else_is_drawn():
    few, many = EVENTS.table(3, 4), EVENTS.table(3, 9)
    pd.testing.assert_frame_equal(few, many[:4])
    assert EVENTS.draw(3, 2) != EVENTS.draw(4, 2)
    assert scenario(3, 2).hash() == scenario(3, 2).hash() != scenario(4, 2).hash()


def test_every_train_meets_every_curve():
    assert gcd(len(TRAINS), len(CURVES)) == 1
    assert len(STOPS) == len(TRAINS) * len(CURVES) == BLENDED.default_events
    met = {(d["train"], d["curve"]) for d in (EVENTS.draw(0, k) for k in STOPS)}
    assert len(met) == len(STOPS)


def test_rails_offer_the_drawn_share_of_what_the_driver_asks_for():
    seed = 6
    for k in STOPS:
        d, event = EVENTS.draw(seed, k), scenario(seed, k).event(1)
        train = train_of(d["train"])
        rail, structure = event.model.rail, structure_of(train)[0]
        contact = axle_contacts(rail.curve, structure)
        limit = np.broadcast_to(
            rail.curve.limit(rail.level, REFERENCE_SPEED, contact)[0], structure.static_load.shape
        )
        offered = float(limit @ structure.static_load / structure.static_load.sum())
        expected = max(LEAST_LEVEL, d["share"] * asked_of(d) / GRAVITY)
        assert offered == pytest.approx(expected, rel=1e-6), d["curve"]
        assert 0.3 < asked_of(d) < 1.12
        assert peak_of(seed, k) > 0.0


@pytest.mark.parametrize("k", STOPS)
def test_a_stop_is_one_of_motors_and_air_on_rail_that_carries_every_axle(k):
    event = scenario(0, k).event(EVENTS.draw(0, k)["day"])
    model, rail = event.model, event.model.rail
    assert model.layout.units > 0
    assert all(car.air_brake is not None for car in model.train.cars)
    assert all(car.motors is None or car.motors.brake.peak > 0.0 for car in model.train.cars)
    assert event.onboard.braking.blended
    assert event.command.accelerations[0] == pytest.approx(-asked_of(EVENTS.draw(0, k)))
    assert event.command.times == (ROLLING,)
    assert rail.increments is not None
    growth = np.array(rail.increments)
    assert growth.mean() == pytest.approx(0.0, abs=1e-12)
    assert rail.level + growth.min() > 0.4 * rail.level
    assert 0.0 <= event.onboard.sensors.radius_error <= 0.005


def test_the_two_arms_of_a_stop_differ_in_their_reference_speed_alone():
    estimate, truth = (scenario(1, 5, source) for source in SOURCES)
    assert truth.event(1).onboard.reference.source == TRUTH
    changed = truth.changed(
        name=estimate.name,
        onboard=truth.onboard.model_dump(exclude_unset=True)
        | {"reference": {"source": SOURCES[0]}},
    )
    assert changed.hash() == estimate.hash() != truth.hash()


def run_of(k, source=SOURCES[0], controller="cut-and-ramp", duration=SHORT):
    return simulate(scenario(0, k, source, duration).event(3), "alone", controller)


@pytest.mark.parametrize("k", EACH_TRAIN)
def test_the_true_speed_has_no_error_and_the_estimate_has_one(k):
    told, own = run_of(k, TRUTH), run_of(k)
    assert not reference_error(told)[0].any()
    found = measure(told)
    assert found["reference_error"] == found["reference_rms"] == found["reference_bias"] == 0.0
    assert np.isnan(found["reference_ratio"])
    assert np.isnan(found["reference_within"])
    found = measure(own)
    assert 0.0 < abs(found["reference_bias"]) <= found["reference_rms"] <= found["reference_error"]
    assert 0.0 <= found["reference_within"] <= 1.0


@pytest.mark.parametrize("error", [0.3, -0.1])
def test_a_constant_error_is_found_whole_and_compared_with_its_deviation(error):
    run = run_of(0, TRUTH)
    run["reference_speed"] = run["speed"] + error
    for ratio in (0.5, WITHIN + 0.1):
        run["reference_deviation"] = run["speed"] * 0.0 + abs(error) / ratio
        found = measure(run)
        assert found["reference_bias"] == pytest.approx(error)
        assert found["reference_error"] == pytest.approx(abs(error))
        assert found["reference_rms"] == pytest.approx(abs(error))
        assert found["reference_ratio"] == pytest.approx(ratio)
        assert found["reference_within"] == float(ratio <= WITHIN)


def test_errors_near_a_stand_do_not_count():
    run = run_of(0, TRUTH)
    slow = run["speed"].values < np.median(run["speed"].values)
    run["reference_speed"] = run["speed"] + 0.5 * slow
    run["reference_deviation"] = run["speed"] * 0.0 + 0.1
    assert measure(run)["reference_error"] == pytest.approx(0.5)
    run["speed"] = run["speed"].where(~slow, 0.5 * LEAST_SPEED)
    run["reference_speed"] = run["speed"] + 0.5 * slow
    assert measure(run)["reference_error"] == 0.0
    assert measure(run)["reference_within"] == 1.0


def test_the_weakest_unit_uses_no_more_than_all_short_ones_together():
    run = run_of(0, duration=ROLLING + 5.0)
    uses = unit_use(run)
    together = evaluate(run)["utilisation_short"]
    assert np.nanmin(uses) <= together <= np.nanmax(uses)
    found = measure(run)
    assert found["least_unit_use"] == np.nanmin(uses) == uses[int(found["least_unit"]) - 1]
    own = run["axle_unit"].values == 2
    run["rail_force"] = run["rail_force"] * np.where(own, 0.0, 1.0)
    assert measure(run)["least_unit"] == 3.0
    assert measure(run)["least_unit_use"] == 0.0


def test_locked_driven_wheels_are_those_that_have_motors():
    run = run_of(0)
    assert locked_driven(run) == 0.0
    driven = run["axle_unit"].values >= 0
    run["rim_speed"] = run["rim_speed"] * np.where(driven, 1.0, 0.0)
    assert locked_driven(run) == 0.0 < locked_time(run)
    run["rim_speed"] = run["rim_speed"] * 0.0
    share = float(driven.mean())
    assert locked_driven(run) == pytest.approx(share * locked_time(run))


def test_every_arm_meets_the_same_stop_on_the_same_day(tmp_path):
    table = BLENDED.run(tmp_path, 1, duration=ROLLING + 0.5)
    assert (table["status"] == "ok").all(), table["reason"].tolist()
    assert len(table) == len(ARMS) * len(SOURCES)
    assert table["seed"].nunique() == 1
    for source, rows in table.groupby("source"):
        assert rows["scenario_hash"].nunique() == 1, source
        assert set(zip(rows["rule"], rows["controller"], strict=True)) == set(ARMS)
    assert (table.loc[table["source"] == TRUTH, "reference_error"] == 0.0).all()
    assert {"event", "train", "curve", "peak", "radius_error"} <= set(table)
    pd.testing.assert_frame_equal(BLENDED.run(tmp_path, 1, duration=ROLLING + 0.5), table)


def said(table):
    return {one.name: one for one in blended_statements(table)}


def test_a_table_in_which_all_is_well_holds_but_for_the_worse_rule():
    found = said(blended_table())
    kinds = ("estimate", "damage", "error", "deviation", "locked")
    assert len(found) == len(kinds) * len(CONTROLLERS) + len(SHARERS) * len(CONTROLLERS) + len(
        PAIRS
    )
    worse = {name for name, one in found.items() if one.verdict == FAILS}
    assert worse == {f"sharing: exact, {controller}" for controller in CONTROLLERS}
    assert {one.verdict for name, one in found.items() if name not in worse} == {HOLDS}


def test_what_one_controller_misses_is_said_of_it_alone():
    def changed(row):
        if row["controller"] != "mpc":
            return row
        if row["source"] == TRUTH:
            return row | {"bound_use": row["bound_use"] + 0.03, "damage": 0.7 * row["damage"]}
        within = row["reference_within"] - 0.1
        missed = {"reference_error": 0.25, "locked_driven": float(row["event"] == 7)}
        return row | missed | {"reference_within": within}

    found = said(blended_table(change=changed))
    for kind in ("estimate", "damage", "error", "deviation", "locked"):
        verdicts = {one: found[f"{kind}: {one}"].verdict for one in CONTROLLERS}
        assert verdicts == dict.fromkeys(CONTROLLERS, HOLDS) | {"mpc": FAILS}, kind


def test_a_run_that_failed_takes_its_stop_out_of_every_arm():
    def failing(row):
        bad = (row["event"], row["rule"], row["controller"]) == (4, RULES[0], "mpc-train")
        return row | ({"status": "degraded"} if bad else {})

    events = pairs_of(blended_table(change=failing))
    assert sorted(set(range(24)) - set(events["event"])) == [4]


def test_parts_come_in_pairs_and_every_stop_is_in_one_of_each():
    events = pairs_of(blended_table())
    parts = [events.eval(part) for part in PARTS.values()]
    for one, other in zip(parts[::2], parts[1::2], strict=True):
        assert (one ^ other).all()
        assert 0 < one.sum() < len(one)


def test_few_stops_give_no_verdict():
    assert {one.verdict for one in said(blended_table(events=6)).values()} == {TOO_FEW}
