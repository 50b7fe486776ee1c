"""The sweep `learning`: same rails for every arm, memory across stations, and statements that follow from the table."""

from contextlib import nullcontext

import numpy as np
import pandas as pd
import pytest

from alloc.estimation.increments import DIRECTIONS, load_learning
from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW, VERDICTS
from studies.core.study import find_study
from studies.patent import learning_study as study
from studies.patent.learning_study import ARMS, LEARNING, PARTS, SERIES, TOLERANCE, per_series
from tests.studies.made_tables import falling, synthetic

SHORT = 2.0
"""Length of a start [s] in which the foremost units slip a few times."""


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("learning")
    return folder, LEARNING.run(folder, 4, duration=SHORT)


def named(table):
    return {statement.name: statement for statement in LEARNING.statements(table)}


def test_the_study_is_known_by_name():
    assert find_study("learning") is LEARNING
    assert len(LEARNING.question) > 20


def test_every_arm_meets_the_same_rails_and_others_meet_others(swept):
    _, table = swept
    assert len(table) == 4 * len(study.KINDS) * len(ARMS)
    for _, rows in table.groupby([*SERIES, "station"]):
        assert rows["arm"].tolist() == list(ARMS)
        assert rows["seed"].nunique() == rows["level"].nunique() == 1
    assert table["seed"].nunique() == len(table) / len(ARMS)
    assert table["level"].sub(study.LEVEL).abs().max() <= study.HALF_WIDTH


SAME = ("effort_ratio", "slip_time", "damage", "unit_detections")
"""What runs have in common that are one and the same."""


def test_before_anything_is_learnt_learners_do_what_no_learning_does(swept):
    """A running mean waits for ten data of a unit, and these starts are short."""
    _, table = swept
    first = table[table["station"] == 1].set_index("arm")
    for name in SAME:
        kept = first.loc["no learning", name].to_numpy()
        for arm in ("running mean", "running mean, held"):
            np.testing.assert_array_equal(first.loc[arm, name].to_numpy(), kept)


def test_the_reference_is_of_no_consequence_where_nothing_is_learnt(swept):
    _, table = swept
    arms = table.set_index("arm")
    for name in SAME:
        found = (arms.loc[arm, name].to_numpy() for arm in ("truth", "truth, held"))
        np.testing.assert_array_equal(*found)


def test_every_case_is_what_its_name_says():
    kinds = {kind.case: kind for kind in study.KINDS}
    lost, failed, reports, sound = (
        study.station_event(study.Series(kinds[case], "truth", 0, 1, 5, SHORT), "forward", 1)[0]
        for case in ("telegrams lost", "leader fails", "on reports", "sound")
    )
    assert [one.onboard.telegrams.loss for one in (lost, failed, reports, sound)] == [0.2, 0, 0, 0]
    triggers = [one.onboard.trigger for one in (lost, failed, reports, sound)]
    assert triggers == ["slip", "slip", "limited", "slip"]
    fails = [one.model.environment.failure_time.min() for one in (lost, failed, reports, sound)]
    assert fails == [np.inf, 5.0, np.inf, np.inf]
    assert failed.model.environment.failure_time[1:].min() == np.inf


def test_arms_that_do_not_learn_keep_what_they_believe(swept):
    _, table = swept
    assert np.all(table.loc[table["arm"].str.startswith("truth"), "error"] == 0.0)
    kept = table[table["arm"] == "no learning"].groupby(SERIES)["error"]
    assert np.all(kept.nunique() == 1)
    assert kept.first().min() > 0.02


def test_memory_is_kept_per_direction_in_the_trains_file(swept, tmp_path, monkeypatch):
    _, table = swept
    monkeypatch.setattr(study.tempfile, "TemporaryDirectory", lambda: nullcontext(str(tmp_path)))
    kind = study.Kind("even", "too high", "sound")
    study.series_rows(study.Series(kind, "Gaussian", 0, 2, 0, SHORT))
    known = load_learning(tmp_path / "learning.json", "commuter-8car")
    assert set(known) == set(DIRECTIONS)
    rows = table[(table["arm"] == "Gaussian") & (table[[*kind._fields]] == [*kind]).all(axis=1)]
    for direction in DIRECTIONS:
        last = rows[rows["direction"] == direction].iloc[-1]
        columns = [f"increment_{j}" for j in range(2, 5)]
        np.testing.assert_allclose(known[direction].increment[1:], last[columns].astype(float))


def test_what_a_folder_holds_is_not_run_again(swept, monkeypatch):
    folder, table = swept
    monkeypatch.setattr("studies.core.run.run_cell", None)
    pd.testing.assert_frame_equal(LEARNING.run(folder, 4, duration=SHORT), table)
    assert LEARNING.held(folder, duration=SHORT) == 0  # no series of all stations


def test_whole_trains_are_held(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "series_rows", lambda series: {"train": series.train})
    LEARNING.run(tmp_path, 2 * LEARNING.step)
    assert LEARNING.held(tmp_path) == 2 * LEARNING.step


def test_few_series_give_no_verdict(swept):
    found = named(swept[1])
    assert {statement.verdict for statement in found.values()} <= {*VERDICTS}
    assert found["learnt-patent"].verdict == TOO_FEW


def test_learnt_from_the_station_on_that_stays_within_the_tolerance():
    series = per_series(synthetic(falling))
    # 0.02 x 0.3^2 = 0.0018 is the first within 0.002
    assert np.all(series["stations, running mean"] == 2)
    assert np.all(series["coarse, running mean"] == 2)
    assert series["stations, no learning"].isna().all()
    bouncing = per_series(synthetic(lambda arm, station: 0.001 if station != 3 else 0.01))
    assert np.all(bouncing["stations, running mean"] == 4)


def test_learning_that_works_holds_and_learning_that_does_not_fails():
    found = named(synthetic(falling))
    assert found["learnt-patent"].verdict == HOLDS
    assert found["closer-patent"].verdict == HOLDS
    worse = named(synthetic(lambda arm, station: 0.03 if arm != "no learning" else 0.02))
    assert worse["learnt-patent"].verdict == FAILS
    assert worse["closer-patent"].verdict == FAILS
    assert len(worse["closer-patent"].conditions) == len(PARTS)


def test_gain_and_price_are_paired_differences_and_biased_data_are_named():
    arms = {"running mean": 0.02, "Gaussian, robust": -0.03}
    found = named(synthetic(falling, effort=arms, slip={"Gaussian, robust": -4.0}))
    assert found["gain-effort"].verdict == HOLDS
    gain = found["gain-effort"].numbers["effort_ratio, running mean minus no learning"]
    assert gain.value == pytest.approx(0.02, abs=1e-4)
    robust = found["robust"]
    assert robust.verdict == CONDITIONS  # slip is saved, but three points of effort are lost
    assert any("effort: more than 1% lost" in text for text in robust.conditions)
    cheap = named(synthetic(falling, slip={"Gaussian, robust": -4.0}, excess=3 * TOLERANCE))
    assert cheap["robust"].verdict == HOLDS
    assert (found["unbiased"].verdict, cheap["unbiased"].verdict) == (HOLDS, CONDITIONS)
    assert [text.split(":")[0] for text in cheap["unbiased"].conditions] == [
        "not with received reference, even rail",
        "not with received reference, scattered rail",
    ]
