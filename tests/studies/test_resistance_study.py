"""The sweep of running resistance: what it draws, what it keeps, and what it states."""

import numpy as np
import pandas as pd
import pytest

from studies.core.statement import FAILS, HOLDS, TOO_FEW, VERDICTS
from studies.core.study import find_study
from studies.resistance import study
from studies.resistance.driven_cases import EXACT, LEARNED, RIGHT, WRONGLY
from studies.resistance.events import WRONG_BY, column, draw, drawn_route
from studies.resistance.study import MOUTH, RESISTANCE
from tests.studies.resistance_tables import resistance_table


def verdicts(table):
    return {statement.name: statement.verdict for statement in RESISTANCE.statements(table)}


def test_an_event_follows_from_its_number_alone_and_keeps_within_its_bounds():
    assert draw(0, 3) == draw(0, 3)
    assert draw(0, 3) != draw(0, 4)
    assert draw(0, 3) != draw(1, 3)
    drawn = [draw(2, k) for k in range(60)]
    assert {one["route"] for one in drawn} == {"commuter", "high-speed"}
    assert {one["control"] for one in drawn} == {"P", "PI"}
    for one in drawn:
        assert all(abs(abs(x - 1.0) - WRONG_BY) < 1e-12 for x in one["wrong"])
        assert len(one["loads"]) == 8
        of = drawn_route(one)
        # places lie so far apart that the train has settled, and are all reached
        assert min(np.diff([point.position for point in of.points])) > 2.0 * of.length
        speed, _ = of.command.at(np.arange(0.0, of.duration, 0.1))
        assert 0.1 * speed.sum() > of.points[-1].position + of.length + 10.0 * speed[-1]


def test_a_table_as_the_source_would_have_it_holds():
    assert set(verdicts(resistance_table()).values()) == {HOLDS}
    assert find_study("resistance") is RESISTANCE


@pytest.mark.parametrize(
    ("changed", "value", "broken"),
    [
        (column("jerk_peak", MOUTH, RIGHT), 3.0, "1, 2: jerk, peak, mouth"),
        (column("speed_peak", MOUTH, WRONGLY), 0.1, "wrong coefficients, mouth"),
        (column("speed_peak", MOUTH, LEARNED), 0.5, "3, 4: learned, mouth"),
        (f"feedback_share@{EXACT}", 0.2, "true weights, no feedback"),
        ("W1@least squares, 3", 2.2, "W1 is air resistance"),
        ("W3@gradient (5), 3", 0.7, "W3 converges: gradient (5)"),
        (f"W3@{LEARNED}", 0.8, "W3 converges while compensating"),
        ("falsely learned@5", 1.0, "excitation detected"),
        ("use share", 0.2, "5: learn, then use"),
        ("use as printed speed error", 3.0, "5 as printed holds the speed"),
        ("mass@five weights", 0.2, "mass after boarding"),
        ("acceleration@dry@mass learned", 0.8, "load compensation, dry rail"),
        ("acceleration@slippery@mass learned", 0.8, "load compensation, slippery rail"),
    ],
)
def test_a_claim_that_does_not_hold_is_said_not_to(changed, value, broken):
    found = verdicts(resistance_table(**{changed: value}))
    assert [name for name, verdict in found.items() if verdict != HOLDS] == [broken]
    assert found[broken] == FAILS


def test_few_events_have_no_verdict():
    found = RESISTANCE.statements(resistance_table().head(4))
    assert {statement.verdict for statement in found} == {TOO_FEW}
    assert {TOO_FEW, HOLDS, FAILS} < set(VERDICTS)


def test_events_are_kept_and_not_run_again(tmp_path, monkeypatch):
    ran = []

    def row(seed, event):
        ran.append((seed, event))
        return {"event": event, "value": 10.0 * seed + event}

    monkeypatch.setattr(study, "event_row", row)
    assert RESISTANCE.held(tmp_path) == 0
    first = RESISTANCE.run(tmp_path, 2)
    assert first["value"].tolist() == [0.0, 1.0]
    told = []
    more = RESISTANCE.run(tmp_path, 3, on_row=lambda *one: told.append(one))
    other = RESISTANCE.run(tmp_path, 1, 4)
    assert ran == [(0, 0), (0, 1), (0, 2), (4, 0)]
    assert told[1:] == [("0/2", 3, 3)]
    assert more["value"].tolist() == [0.0, 1.0, 2.0]
    assert other["value"].tolist() == [40.0]
    pd.testing.assert_frame_equal(RESISTANCE.run(tmp_path, 3), more)
    assert len(ran) == 4
    assert (RESISTANCE.held(tmp_path), RESISTANCE.held(tmp_path, 4)) == (3, 1)
    monkeypatch.setattr("studies.core.cell.code_hash", lambda *_: "other code")
    assert RESISTANCE.held(tmp_path) == 0
