"""A sweep runs what is missing, lets all rules meet the same events, and is asked for by name."""

import json
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from alloc.rules import RULES
from studies.core.drawn_events import COMPARED
from studies.core.job import Job, simulate_job
from studies.core.run import ALL
from studies.core.statement import LEAST_EVENTS, VERDICTS, Interval, Statement
from studies.core.study import all_studies, find_study, study_folder
from studies.files.study_error import StudyError
from studies.patent.claim_events import (
    EXCESS_EDGES,
    QUANTITIES,
    draw,
    drawn_table,
    excess_column,
    measure,
    scenario,
)
from studies.patent.claims_study import ARMS, CLAIM_STUDY, statement_name
from studies.patent.claims_study import RULES as CLAIM_RULES

SHORT = 3.0
"""Length of an event [s] that is just long enough for the measures."""


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("claims")
    return folder, CLAIM_STUDY.run(folder, 2, duration=SHORT)


def test_every_rule_meets_every_event(swept):
    _, table = swept
    assert (table["status"] == "ok").all(), table["reason"].tolist()
    assert len(table) == 2 * len(COMPARED) * len(CLAIM_RULES)
    for _, event in table.groupby("scenario"):
        assert event["rule"].tolist() == len(COMPARED) * list(CLAIM_RULES)
        assert event["scenario_hash"].nunique() == event["seed"].nunique() == 1
    assert table.groupby("scenario")["seed"].first().tolist() == [0, 1]


def test_rows_have_what_was_drawn_and_what_was_measured(swept):
    _, table = swept
    assert set(QUANTITIES) <= set(table)
    assert {"held_effort", "reach_low", "over_share", excess_column(0)} <= set(table)
    drawn = drawn_table(0, 2).set_index("scenario")["level"]
    assert (table.groupby("scenario")["level"].first() == drawn).all()


def test_a_second_sweep_runs_nothing_and_a_longer_one_only_the_rest(swept, monkeypatch):
    folder, table = swept
    monkeypatch.setattr("studies.core.run.run_cell", None)
    pd.testing.assert_frame_equal(CLAIM_STUDY.run(folder, 2, duration=SHORT), table)
    asked = []

    def noted(cell, *_):
        asked.append(cell.scenario.name)
        raise KeyboardInterrupt

    monkeypatch.setattr("studies.core.run.run_cell", noted)
    with pytest.raises(KeyboardInterrupt):
        CLAIM_STUDY.run(folder, 3, duration=SHORT)
    assert asked == ["random-0-0002"]


def test_what_a_folder_holds_is_counted_by_whole_events(swept, tmp_path):
    folder, _ = swept
    assert CLAIM_STUDY.held(folder, duration=SHORT) == 2
    assert CLAIM_STUDY.held(folder, 1, duration=SHORT) == 0
    assert CLAIM_STUDY.held(tmp_path, duration=SHORT) == 0
    assert CLAIM_STUDY.held(folder) == 0  # events of their whole length


def test_a_few_events_give_statements_without_a_verdict_of_their_own(swept):
    _, table = swept
    found = CLAIM_STUDY.statements(table)
    assert [s.name for s in found] == [statement_name(c, arm) for arm in ARMS for c in "abcde"]
    assert {s.verdict for s in found} <= set(VERDICTS)


def test_an_event_follows_from_its_number_alone():
    assert draw(0, 5) == draw(0, 5)
    assert draw(0, 5) != draw(0, 6)
    assert draw(0, 5) != draw(1, 5)
    assert scenario(0, 5).hash() == scenario(0, 5).hash()


def test_draws_keep_within_their_bounds():
    table = drawn_table(3, 200)
    assert table["level"].between(0.06, 0.20).all()
    assert table["slope"].between(0.0, 0.0332).all()
    assert table["tilt"].abs().max() <= 0.8
    assert 60 < (table["season"] == "winter").sum() < 140
    assert all(q.distribution and q.reason for q in QUANTITIES.values())


@pytest.mark.parametrize("k", range(8))
def test_drawn_events_can_be_run(k):
    found = scenario(0, k).event(k)
    assert found.duration == 12.0
    speed_law = scenario(0, k).rail.speed_law
    assert speed_law in ("none", "curtius-kniffler", "shinkansen")


@pytest.mark.parametrize(("seed", "k"), [(1, 4), (1, 819)])
def test_a_draw_smaller_than_a_file_may_state_is_none_at_all(seed, k):
    assert (
        min(scenario(seed, k).load_t) == 0.0
        or scenario(seed, k).onboard.sensors.speed_noise_kmh == 0.0
    )


def test_measures_are_shares_of_what_there_is():
    run_ = simulate_job(Job(scenario(0, 0, 5.0), "greedy", "cut-and-ramp", 0))
    found = measure(run_)
    assert 0.0 < found["unit_use_low"] <= found["unit_use_mean"] < 1.0
    assert found["reach_low"] <= found["reach_high"]
    assert 0.0 <= found["over_share"] <= 1.0
    # the same events by hand: use where greedy's limit is up to 5 % too high
    late = run_.sel(time=slice(2.0, None))
    units = late["axle_unit"].values
    force, can, mean = (
        np.stack([values[:, units == j].sum(axis=1) / by for j in range(4)], axis=1)
        for values, by in (
            (late["rail_force"].values, 1),
            (late["adhesion_limit"].values * late["axle_load"].values, 1),
            (late["adhesion_limit"].values, 4),
        )
    )
    excess = late["limit"].values / mean - 1.0
    chosen = (excess > 0.0) & (excess <= EXCESS_EDGES[1]) & (late["case"].values > 0)[:, None]
    if chosen.any():
        assert found[excess_column(0)] == pytest.approx(force[chosen].sum() / can[chosen].sum())
    else:
        assert np.isnan(found[excess_column(0)])


def test_without_slip_the_plan_is_delivered_in_full():
    dry = scenario(0, 0, 5.0).changed(
        rail={"level": 0.4, "increments": {"law": "logarithmic"}}, line={}, belief={}
    )
    found = measure(simulate_job(Job(dry, "alone", "cut-and-ramp", 0)))
    assert found["held_effort"] == pytest.approx(1.0, abs=0.01)
    assert found["over_share"] == 0.0


@pytest.fixture
def stub(monkeypatch):
    """A study that takes no time, in the place of `claims`; gives the calls that it met."""
    calls = []

    def study_run(folder, events, seed, jobs, on_row, shard):
        assert shard == ALL
        calls.append((folder, events, seed, jobs))
        return pd.DataFrame({"status": ["ok"] * events})

    statement = Statement(
        "x",
        "water is wet",
        "holds",
        {"wetness [-]": Interval(1.0, 0.9, float("nan"), 3)},
        ("on rails",),
    )
    study = SimpleNamespace(
        name="claims", default_events=7, run=study_run, statements=lambda _: [statement],
        settings={}, shown={}, claimed=lambda **_: (),
    )  # fmt: skip
    monkeypatch.setattr("studies.core.study.find_study", {"claims": study}.__getitem__)
    return calls


def test_the_command_prints_statements(call, stub, tmp_path):
    code, out, _ = call("sweep", "claims", "--out", tmp_path, "--jobs", 1)
    assert code == 0
    assert "water is wet: holds" in out
    assert "on rails" in out
    assert stub == [(tmp_path / "sweeps" / "claims", 7, 0, None)], "one process is this one"


def test_the_command_prints_json(call, stub, tmp_path):
    _, out, _ = call(
        "sweep", "claims", "--out", tmp_path, "--events", 3, "--seed", 2, "--jobs", 1, "--json"
    )
    content = json.loads(out)
    assert (content["events"], content["seed"], content["rows"]) == (3, 2, 3)
    (statement,) = content["statements"]
    assert statement["verdict"] == "holds"
    assert statement["numbers"]["wetness [-]"]["high"] is None
    asked = ("sweep", "claims", "--out", tmp_path, "--jobs", 1, "--format")
    assert call(*asked, "csv")[1].splitlines()[1] == "x,holds,wetness [-],1.0,0.9,,3"
    assert call(*asked, "markdown")[1].endswith("| x | holds | wetness [-] | 1 | 0.9 | – | 3 |\n")
    assert stub[0][1:3] == (3, 2)


def test_sweeps_are_listed(call):
    _, out, _ = call("list", "--json")
    listed = json.loads(out)["sweeps"]
    assert {"claims", "differences"} <= set(listed)
    assert all(listed.values())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["claim"], "unknown sweep 'claim'; did you mean 'claims'?"),
        (["claims", "--events", "0"], "--events 0"),
        (["claims", "--events", "2.5"], "'2.5' is not a whole number"),
        (["claims", "--seed", "-1"], "--seed -1"),
        (["claims", "--jobs", "0"], "--jobs 0"),
        ([], "name"),
    ],
)
def test_bad_input_is_one_clear_line(call, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    code, out, err = call("sweep", *arguments)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1
    assert words.lower() in err.lower()
    assert not list(tmp_path.iterdir())


def test_every_study_of_the_collection_is_one():
    for name, study in all_studies().items():
        assert find_study(name) is study
        assert study.name == name
        assert study.question
        # the readhesion paper's scenario has nothing random in it; the ensemble's events are places to seek from
        few = ("readhesion", "slide-calibration")
        assert (1 if name in few else LEAST_EVENTS) <= study.default_events
        assert study.default_events % study.step == 0
    assert set(CLAIM_RULES) <= set(RULES)
    with pytest.raises(StudyError, match="unknown sweep"):
        find_study("nothing")
    assert study_folder("out", "claims").parts == ("out", "sweeps", "claims")
