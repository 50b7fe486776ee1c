"""Thresholds of claims are frozen: a change is recorded here, and seen in the report of every seed drawn before it."""

import json
from itertools import product
from pathlib import Path

import pandas as pd
import pytest

from studies.claims.statements import ARMS, statement_name
from studies.claims.study import CLAIMS
from studies.claims.thresholds import POPULATIONS, TABLE, THRESHOLDS, bears, threshold_test
from studies.core.cell import Task
from studies.core.collection import all_studies
from studies.core.statement_report import about, frozen_words
from studies.core.study import EachEvent, Study
from studies.core.threshold import Threshold, fingerprint, freeze, frozen
from studies.core.union import unite
from tests.studies.sweep_tables import claim_table

RECORD = Path(__file__).with_name("claim_thresholds.json")
"""Every table of thresholds that there has been, oldest first, with the reason of its change."""
ROW = Threshold("x", "damage", "at most", 5.0, "why", "whence")


def rows(table):
    return {row.name: row._asdict() for row in table}


def recorded():
    return json.loads(RECORD.read_text(encoding="utf-8"))


def test_the_thresholds_are_those_recorded_last():
    last = {row["name"]: row for row in recorded()[-1]["thresholds"]}
    assert rows(TABLE) == last, (
        f"the thresholds of the claims have changed; append them to {RECORD.name} with the reason"
    )


def test_the_record_is_what_it_was():
    """Each entry's fingerprint is of its own rows; the first entries may not be written anew."""
    found = recorded()
    for entry in found:
        table = [Threshold(**row) for row in entry["thresholds"]]
        assert fingerprint(table) == entry["fingerprint"]
        assert entry["reason"]
    assert found[0]["fingerprint"] == "4d80201be3361008"
    assert len({entry["fingerprint"] for entry in found}) == len(found)


def test_every_threshold_is_named_once_and_reasoned():
    assert len(THRESHOLDS) == len(TABLE)
    assert all(row.metric and row.reason and row.source for row in TABLE)
    assert {name for names in POPULATIONS.values() for name in names} < set(THRESHOLDS)
    assert set(POPULATIONS) < set(THRESHOLDS)


def test_each_verdict_is_decided_by_its_row():
    found = {s.name: s for s in CLAIMS.statements(claim_table())}
    for name, arm in product("abcde", ARMS):
        test, row = found[statement_name(name, arm)].test, THRESHOLDS[name]
        assert (test.threshold, test.direction) == (row.value, row.direction), (name, arm)


def test_a_row_says_which_events_bear_and_which_side_is_claimed():
    events = pd.DataFrame({"over_time@greedy": [0.5, 1.0, 2.0], "unit_use_low@greedy": [0.8, 0.9, 1.0],
                           "jerk_rms@greedy": [0.2, 0.3, 0.4], "jerk_rms@sharing": [0.3, 0.3, 0.3]})  # fmt: skip
    assert bears("c over", "greedy", events).tolist() == [False, True, True]
    assert (threshold_test("b", "greedy").threshold, threshold_test("b", "greedy").wanted) == (
        0.9,
        1,
    )
    ride = threshold_test("d", "greedy")
    assert ride.wanted == -1
    assert ride.quantity(events).tolist() == pytest.approx([-0.1, 0.0, 0.1])


@pytest.mark.parametrize("field", Threshold._fields)
def test_nothing_can_change_without_the_fingerprint(field):
    other = ROW._replace(**{field: 5.1 if field == "value" else "other"})
    assert fingerprint([other]) != fingerprint([ROW])
    assert fingerprint([ROW]) == fingerprint([Threshold(*ROW)])
    assert fingerprint([ROW, other]) != fingerprint([other, ROW])


def row_of(k):
    return {"k": k}


def study(*table):
    cells = EachEvent(lambda seed, k: [Task(f"{seed}/{k}", row_of, (k,))])
    return Study("tiny", "what", 3, cells, lambda table: [], thresholds=table)


def test_a_seed_keeps_the_thresholds_under_which_it_was_drawn(tmp_path):
    now, then = study(ROW), study(ROW._replace(value=4.0))
    then.run(tmp_path, 2, seed=1)
    now.run(tmp_path, 2, seed=2)
    first, second = (fingerprint(one.thresholds) for one in (then, now))
    assert list(frozen(tmp_path, 1)) == [first]
    assert list(frozen(tmp_path, 2)) == [second]
    assert "CHANGED" not in frozen_words(now, tmp_path, 2)
    now.run(tmp_path, 3, seed=1)
    assert set(frozen(tmp_path, 1)) == {first, second}
    assert f"CHANGED: also judged by {first}" in frozen_words(now, tmp_path, 1)
    content = about(now, 3, 1, tmp_path, 3, 0)
    assert content["thresholds"] == second
    assert set(content["thresholds_since"]) == {first, second}


def test_thresholds_are_kept_before_the_first_event_is_run(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.core.study.run_cells", None)
    with pytest.raises(TypeError):
        study(ROW).run(tmp_path, 2, seed=3)
    (path,) = (tmp_path / "thresholds").glob("*.json")
    content = json.loads(path.read_text())
    assert content["thresholds"] == [ROW._asdict()]
    freeze(tmp_path, 3, [ROW])
    assert json.loads(path.read_text()) == content  # its time stays


def test_a_study_without_thresholds_leaves_no_trace(tmp_path):
    study().run(tmp_path, 1)
    assert not (tmp_path / "thresholds").exists()
    assert frozen_words(study(), tmp_path, 0) == ""
    assert about(study(), 1, 0, tmp_path, 1, 0)["thresholds"] is None


def test_a_union_of_shares_knows_the_thresholds_of_each(tmp_path):
    study(ROW).run(tmp_path / "one", 1)
    study(ROW._replace(value=4.0)).run(tmp_path / "two", 2)
    unite([tmp_path / "one", tmp_path / "two"], tmp_path / "all")
    assert len(frozen(tmp_path / "all", 0)) == 2


def test_the_claims_are_judged_by_their_table():
    assert all_studies()["claims"].thresholds is TABLE
