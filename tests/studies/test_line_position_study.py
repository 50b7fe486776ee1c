"""The sweep of position and map with errors: what it draws, drives and states."""

import numpy as np
import pytest

from studies.core.collection import find_study
from studies.core.statement import CONDITIONS, FAILS, HOLDS
from studies.files.study_error import StudyError
from studies.resistance.driven_cases import CARS, LEARNED, RIGHT, TAUGHT
from studies.resistance.events import column
from studies.resistance.line_errors import AIR, ALL, ARMS, LADDER, NONE, ODOMETER, PLACES, rung
from studies.resistance.line_position_study import LINE_POSITION, cells
from studies.resistance.position_events import draw
from studies.resistance.position_statements import CLAIMS, KINDS
from tests.studies.position_tables import position_table


def test_a_route_follows_from_its_number_alone_and_its_places_lie_apart():
    assert draw(3, 2) == draw(3, 2)
    assert draw(3, 2) != draw(4, 2)
    drawn = [draw(1, k) for k in range(24)]
    assert {one.route.name for one in drawn} == {"commuter", "high-speed"}
    assert len({(one.route.name, one.control) for one in drawn[:4]}) == 4
    assert len({tuple(point.kind for point in one.route.points) for one in drawn}) == 3
    for one in drawn:
        of = one.route
        places = [point.position for point in of.points]
        assert len(places) == 6
        assert min(np.diff(places)) > 2.0 * of.length
        assert of.stations[0] <= 0.0
        assert of.stations[-1] >= places[-1]
        speed, _ = of.command.at(np.arange(0.0, of.duration, 0.1))
        assert 0.1 * speed.sum() > places[-1] + of.length + 10.0 * speed[-1]
        reached = of.command.times[0] + (speed[-1] - speed[0]) / of.command.acceleration
        assert 0.1 * speed[: int(10.0 * reached)].sum() < places[0]  # the cruise has begun


def test_all_arms_of_an_event_are_cells_and_fewer_are_the_same_cells():
    every = cells(0, 5)
    assert [task.label for task in every] == [f"0/5/{arm}" for arm in (*ARMS, *map(rung, LADDER))]
    assert cells(0, 5, arms=(ODOMETER,)) == [task for task in every if task.label == "0/5/odometer"]
    with pytest.raises(StudyError, match="odometr"):
        cells(0, 0, arms=("odometr",))
    assert find_study("line-position") is LINE_POSITION


def test_a_table_in_which_every_claim_holds_survives_every_error():
    found = {
        statement.name: statement.verdict
        for statement in LINE_POSITION.statements(position_table())
    }
    assert set(found.values()) == {HOLDS}
    assert sum(name.startswith("survives: ") for name in found) == len(CLAIMS[NONE])


BROKEN = (
    (PLACES, column("speed_peak", KINDS[0], RIGHT), 3.0, "1, 2: speed"),
    (ODOMETER, column("acceleration_peak", KINDS[1], CARS), 2.5, "1, 2: ride, car by car"),
    (rung(0.04), column("jerk_peak", KINDS[1], CARS), 2.5, "1, 2: jerk, car by car"),
    (AIR, column("speed_peak", KINDS[0], TAUGHT), 0.4, "learning mends"),
    (ODOMETER, column("speed_peak", KINDS[0], LEARNED), 2.0, "3, 4: as steady as true ones"),
    (ODOMETER, f"W3@{LEARNED}", 0.9, "3, 4: mass"),
    (ALL, "use share", 0.1, "5: in use"),
    (PLACES, "W3@least squares, 3", 1.1, "6, 7: mass"),
)
"""Arm, column and value that break the claim in that arm alone."""


@pytest.fixture(scope="module")
def broken():
    changes = {(arm, name): value for arm, name, value, _ in BROKEN}
    changes |= {(NONE, column("jerk_peak", kind, RIGHT)): 4.0 for kind in KINDS}
    return {one.name: one for one in LINE_POSITION.statements(position_table(changes=changes))}


@pytest.mark.parametrize(("arm", "claim"), [(arm, claim) for arm, _, _, claim in BROKEN])
def test_an_error_that_breaks_a_claim_is_named_as_what_it_does_not_survive(broken, arm, claim):
    assert broken[f"{claim} ({arm})"].verdict == FAILS
    if claim != "learning mends":  # without errors there is nothing to mend
        survival = broken[f"survives: {claim}"]
        assert survival.verdict == (
            FAILS if claim == "5: in use" else CONDITIONS
        )  # of one error, or of several
        assert survival.conditions == (f"not with {arm}",)


def test_nothing_else_breaks_and_what_fails_without_errors_has_nothing_to_survive(broken):
    claims = {name: one for name, one in broken.items() if not name.startswith("survives: ")}
    failed = {name for name, one in claims.items() if one.verdict == FAILS}
    assert failed == {f"{claim} ({arm})" for arm, _, _, claim in BROKEN} | {"1, 2: jerk (none)"}
    assert "survives: 1, 2: jerk" not in broken
    assert broken["survives: 1, 2: ride"].verdict == HOLDS
