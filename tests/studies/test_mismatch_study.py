"""Rails of five curves with one peak, the settings of the MPC that meet them, and statements cell by cell."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from alloc.simulation import simulate
from studies.core.drawn_events import START_SPEED as REFERENCE_SPEED
from studies.core.statement import FAILS, HOLDS
from studies.ladder.events import draw
from studies.ladder.mismatch_study import (
    DELAYED,
    EVERYWHERE,
    GIVEN,
    MIDDLE,
    MISMATCH,
    NOISES,
    OWN,
    RAILS,
    REFERENCE,
    RIGHT,
    SAME_BELIEF,
    SEARCHER,
    SHARES,
    SOUGHT,
    Place,
    cells,
    meant,
    mismatch_statements,
    scenario,
    settings_at,
)
from tests.studies.mismatch_tables import mismatch_table


def place(curve, k=0, noise=MIDDLE):
    return Place(3, k, curve, noise)


@pytest.mark.parametrize("curve", RAILS)
def test_rails_differ_in_their_curve_and_offer_the_drawn_adhesion(curve):
    rail = scenario(place(curve), SOUGHT).event(0).model.rail
    base = scenario(place("piecewise"), SOUGHT).event(0).model.rail
    assert (rail.scatter, rail.patches, rail.increments) == (
        base.scatter,
        base.patches,
        base.increments,
    )
    found = float(rail.curve.limit(rail.level, REFERENCE_SPEED)[0])
    assert found == pytest.approx(draw(3, 0)["level"], rel=0.03)


def test_the_double_exponential_is_that_of_the_example_of_a_plug_in():
    # in a process of its own: to import the example registers it
    source = """
from docs.plugins.double_exponential import DoubleExponential
from alloc.plant.adhesion import ExponentialDifference

assert (ExponentialDifference().q == DoubleExponential().q).all()
"""
    subprocess.run([sys.executable, "-c", source], check=True, cwd=Path(__file__).parents[2])


def test_settings_reach_the_controller():
    rail = place("Polach wet")
    event = scenario(rail, DELAYED).event(0)
    assert event.onboard.hosted["mpc"].computing_delay == 1
    assert event.onboard.hosted["mpc"].search.seek
    for setting, share in zip(GIVEN, SHARES, strict=False):
        event = scenario(rail, setting).event(0)
        search = event.onboard.hosted["mpc"].search
        assert (search.seek, search.given_share) == (False, share)
        assert event.onboard.belief.curve == event.model.rail.curve
    quiet = scenario(place("Polach wet", noise=0.0), REFERENCE).event(0)
    assert quiet.onboard.sensors.speed_noise == 0.0


def test_only_multiple_units_are_met():
    trains = [draw(3, place("piecewise", k).number)["train"] for k in range(6)]
    assert set(trains) == {"one inverter per car", "one inverter per axle"}


def test_every_cell_is_met_and_no_run_twice():
    labels = [job.label for job in cells(3, 1)]
    runs = {(job.scenario.hash(), job.controller) for job in cells(3, 1)}
    # what the train believes is part of an event, whatever comes of it
    assert len(labels) == len(set(labels)) == len(runs)
    for curve in RAILS:
        for noise in NOISES:
            met = {one.name for one in settings_at(curve, noise)}
            assert {one.name for one in EVERYWHERE} <= met
        assert RIGHT in {one.name for one in settings_at(curve, MIDDLE)}


def test_belief_makes_no_difference_where_slip_is_sought_and_one_where_it_is_given():
    rail = place("piecewise")
    wrong = next(one for one in GIVEN if one.believed == "Polach wet")
    right = next(one for one in GIVEN if one.believed == OWN and one.name == RIGHT)
    duration = draw(3, rail.number)["drop_begin_s"] + 0.5

    def slip(setting):
        run = simulate(scenario(rail, setting, duration).event(0), "alone", setting.controller)
        return float(run["slip_velocity"].values[-20:].max())

    assert slip(SAME_BELIEF[0]) == slip(SOUGHT)
    assert slip(wrong) > 1.5 * slip(right)


def test_rows_say_what_they_are_and_a_curve_named_is_the_rails_own():
    jobs = cells(3, 0)
    rows = pd.DataFrame([{"scenario": job.scenario.name, "status": "ok"} for job in jobs])
    table = meant(rows, 3, 1)
    assert len(table) == len(jobs) + 3
    middle = table[table["noise"] == MIDDLE]
    for setting in GIVEN:
        assert set(middle.loc[middle["setting"] == setting.name, "curve"]) == set(RAILS)
    assert table[["event", "curve", "noise", "setting"]].notna().all().all()


def test_a_loss_in_one_cell_and_another_digit_under_another_belief_are_said_and_nothing_else():
    found = {one.name: one for one in MISMATCH.statements(mismatch_table())}
    assert len(found) == 2 * len(RAILS) + len(GIVEN) + 1
    assert {one.verdict for one in found.values()} == {HOLDS}

    def lossy(row):
        hit = (row["curve"], row["noise"], row["setting"]) == (
            "slip ratio",
            NOISES[-1],
            DELAYED.name,
        )
        if row["setting"] == SAME_BELIEF[0].name and row["event"] == 2:
            return row | {"damage": row["damage"] * (1.0 + 1e-12)}
        return row | ({"utilisation_short": row["utilisation_short"] - 0.05} if hit else {})

    bad = {one.name: one for one in mismatch_statements(mismatch_table(change=lossy))}
    fallen = {name for name, one in bad.items() if one.verdict == FAILS}
    assert fallen == {"belief", *(f"slip ratio: mpc, {one.name}" for one in (REFERENCE, SEARCHER))}
    assert bad[f"slip ratio: mpc, {REFERENCE.name}"].conditions == (
        f"not with {DELAYED.name}, {NOISES[-1]:g} km/h of noise",
    )
