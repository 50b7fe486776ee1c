"""Thresholds of claims are frozen: a change is recorded here, and seen in the report of every seed drawn before it."""

import hashlib
import json
from dataclasses import fields, replace
from pathlib import Path

import pytest

from studies.core.cell import Task
from studies.core.claims import Claim, decisive, fingerprint, freeze, frozen
from studies.core.statement_report import about, frozen_words
from studies.core.store import unite
from studies.core.study import EachEvent, Study, all_studies
from studies.patent.claims_study import CLAIMS

RECORD = Path(__file__).with_name("claim_thresholds.json")
"""Every state of what decides the claims of the patent, oldest first, with the reason of its change."""
ROW = Claim("x", "damage is small", "damage@a", "at most", 5.0)


def recorded():
    return json.loads(RECORD.read_text(encoding="utf-8"))


def of_rows(rows):
    text = json.dumps(rows, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def test_the_thresholds_are_those_recorded_last():
    found, last = [[c.name, c.mean, c.side, c.value, c.only] for c in CLAIMS], recorded()[-1]
    assert (found, fingerprint(CLAIMS)) == (last["values"], last["fingerprint"]), (
        f"what decides the claims has changed; append it to {RECORD.name} with the reason"
    )


def test_the_record_is_what_it_was():
    """Each entry's fingerprint is of its own rows; the first entries may not be written anew."""
    found = recorded()
    assert of_rows(found[0]["thresholds"]) == found[0]["fingerprint"]
    assert all(entry["reason"] for entry in found)
    assert found[0]["fingerprint"] == "4d80201be3361008"
    assert len({entry["fingerprint"] for entry in found}) == len(found)


DECIDES = {
    "name": "y", "mean": "damage@b", "side": "at least", "value": 5.1, "tolerance": 0.1, "only": "x == 1",
    "parts": {"a": "x == 1"}, "cases": (ROW,), "each": "x", "some": True, "alike": True, "besides": (ROW,), "exact": True,
}  # fmt: skip


@pytest.mark.parametrize("field", DECIDES)
def test_nothing_that_decides_can_change_without_the_fingerprint(field):
    other = replace(ROW, **{field: DECIDES[field]})
    assert fingerprint([other]) != fingerprint([ROW])
    assert fingerprint([ROW, other]) != fingerprint([other, ROW])
    nested = [replace(ROW, besides=(one,)) for one in (ROW, other)]
    assert fingerprint(nested[:1]) != fingerprint(nested[1:])


def test_better_words_change_no_fingerprint():
    words = {
        "claim": "other",
        "reason": "why",
        "source": "whence",
        "method": "how",
        "numbers": {"n": "x"},
    }
    assert fingerprint([replace(ROW, **words)]) == fingerprint([ROW])
    assert set(DECIDES) | set(words) | {"show"} == {field.name for field in fields(Claim)}


def row_of(k):
    return {"k": k}


def study(*table):
    cells = EachEvent(lambda seed, k: [Task(f"{seed}/{k}", row_of, (k,))])
    return Study("tiny", "what", 3, cells, lambda table: [], claims=table)


def test_a_seed_keeps_the_thresholds_under_which_it_was_drawn(tmp_path):
    now, then = study(ROW), study(replace(ROW, value=4.0))
    then.run(tmp_path, 2, seed=1)
    now.run(tmp_path, 2, seed=2)
    first, second = (fingerprint(one.claims) for one in (then, now))
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
    assert content["thresholds"] == [decisive(ROW)]
    freeze(tmp_path, 3, [ROW])
    assert json.loads(path.read_text()) == content  # its time stays


def test_a_study_without_thresholds_leaves_no_trace(tmp_path):
    study().run(tmp_path, 1)
    assert not (tmp_path / "thresholds").exists()
    assert frozen_words(study(), tmp_path, 0) == ""
    assert about(study(), 1, 0, tmp_path, 1, 0)["thresholds"] is None


def test_a_union_of_shares_knows_the_thresholds_of_each(tmp_path):
    study(ROW).run(tmp_path / "one", 1)
    study(replace(ROW, value=4.0)).run(tmp_path / "two", 2)
    unite([tmp_path / "one", tmp_path / "two"], tmp_path / "all")
    assert len(frozen(tmp_path / "all", 0)) == 2


def test_the_claims_are_judged_by_their_table():
    assert all_studies()["claims"].claims is CLAIMS
