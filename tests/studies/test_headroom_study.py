"""The events with headroom have what they are drawn for, and their statements count right."""

import numpy as np
import pandas as pd
import pytest

from alloc.metrics import evaluate
from alloc.simulation import simulate
from studies.core.claims import quantity
from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW
from studies.files.study_error import StudyError
from studies.patent.headroom_study import (
    BOUND,
    HEADROOM,
    NEEDED,
    OWN,
    RULES,
    STRATA,
    TRAINS,
    WANTED,
    draw,
    headroom_statements,
    in_stratum,
    pairs_of,
    scenario,
    share_gained,
)
from tests.studies.headroom_tables import headroom_table

SHORT = 3.0
"""Length of an event [s] that is just long enough for the metrics."""


def verdict(rows, name):
    return next(s.verdict for s in headroom_statements(rows) if s.name == name)


def test_every_event_lies_in_one_stratum():
    events = pairs_of(headroom_table(), "perturb-observe")
    assert sum(in_stratum(events, name).astype(int) for name in STRATA).eq(1).all()
    assert [in_stratum(events, name).sum() for name in STRATA] == [10, 10, 10, 10]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_the_share_gained_is_that_of_the_headroom(share):
    assert quantity(
        pairs_of(headroom_table(share), "perturb-observe"), share_gained(OWN)
    ).mean() == pytest.approx(share)


def test_verdicts_follow_gain_and_cost():
    rows = headroom_table(1.0)
    assert verdict(rows, "cooperative, perturb-observe") == HOLDS
    assert verdict(rows, "bound, perturb-observe") == HOLDS
    assert verdict(rows, "headroom gained, perturb-observe") == HOLDS
    assert verdict(headroom_table(1.0, slip=2.0), "bound, perturb-observe") == CONDITIONS
    assert verdict(headroom_table(0.5), "headroom gained, perturb-observe") == FAILS
    assert verdict(headroom_table(1.0, events=8), "cooperative, perturb-observe") == TOO_FEW


def test_rows_of_each_controller_are_judged_apart():
    rows = pd.concat([headroom_table(1.0), headroom_table(0.0, controller="cut-and-ramp")])
    assert verdict(rows, "bound, perturb-observe") == HOLDS
    assert verdict(rows, "bound, cut-and-ramp") == FAILS


def test_a_controller_in_python_meets_the_rules_of_the_goals_alone():
    assert [job.rule for job in HEADROOM.cells(1, 1, controllers=["mpc"])] == list(NEEDED)
    rows = headroom_table(1.0, controller="mpc")
    rows = rows[rows["rule"].isin(NEEDED)]
    names = [s.name for s in headroom_statements(rows)]
    assert names == ["cooperative, mpc", "bound, mpc", "headroom gained, mpc"]
    assert verdict(rows, "headroom gained, mpc") == HOLDS


def test_trains_take_turns_and_more_is_wanted_in_turn():
    drawn = [draw(0, k) for k in range(len(TRAINS) * len(WANTED))]
    assert len({(d["train"], d["wanted"] > WANTED[1][1]) for d in drawn}) == 2 * len(TRAINS)
    with pytest.raises(AssertionError):
        assert draw(0, 3) == draw(1, 3)
    assert draw(0, 3) == draw(0, 3)


def test_what_is_drawn_for_headroom_makes_it():
    """Of the events of the last class, which want most, the median has more than 3 points; of the first, less than 1."""
    found = {0: [], 15: []}
    for first, values in found.items():
        for k in range(first, first + len(TRAINS)):
            run = simulate(scenario(5, k).event(k), BOUND, "perturb-observe")
            values.append(evaluate(run)["headroom"])
    assert np.median(found[0]) < 0.01
    assert np.median(found[15]) > 0.03


def test_all_rules_meet_the_same_event_under_the_controllers_asked_for(tmp_path):
    swept = HEADROOM.run(tmp_path, 1, duration=SHORT, controllers=["cut-and-ramp"])
    assert (swept["status"] == "ok").all(), swept["reason"].tolist()
    assert swept["rule"].tolist() == list(RULES)
    assert swept["scenario_hash"].nunique() == 1
    assert set(swept["controller"]) == {"cut-and-ramp"}
    assert (swept["plan_use"] <= 1.0).all()
    assert HEADROOM.held(tmp_path, duration=SHORT, controllers=["cut-and-ramp"]) == 1
    with pytest.raises(StudyError, match="nobody"):
        HEADROOM.run(tmp_path, 1, controllers=["nobody"])
