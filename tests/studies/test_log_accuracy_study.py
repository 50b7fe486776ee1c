"""Logs with drawn defects: forms change nothing, defects change something, and statements cell by cell."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from studies.core.statement import FAILS, HOLDS
from studies.log_accuracy.defects import speeds_of
from studies.log_accuracy.drawn_defects import DEFECTS, Logged
from studies.log_accuracy.drawn_logs import CLEAN, PLAIN, rows_of
from studies.log_accuracy.forms import FORMS
from studies.log_accuracy.statements import log_accuracy_statements
from studies.log_accuracy.study import LOG_ACCURACY
from studies.logs.export import log_table, rounded
from studies.logs.known_train import MeasuredTrain
from studies.logs.measured_log import read_log
from studies.logs.measured_run import analyse_run
from tests.simulation.slides import CLEANED_RAIL, TRAIN, braked, readhering


@pytest.fixture(scope="module")
def clean() -> Logged:
    """Three cars whose wheels slide and readhere, at 10 ms."""
    run: xr.Dataset = braked(readhering, rail=CLEANED_RAIL)
    return Logged(rounded(log_table(run, TRAIN)), MeasuredTrain.of(TRAIN), run)


@pytest.fixture(scope="module")
def damage(clean, tmp_path_factory) -> float:
    path = FORMS[PLAIN](clean.table, clean.train.radius, tmp_path_factory.mktemp("log") / "log")
    log = read_log(path, clean.train)
    return analyse_run(log.run, log.train).total_damage


@pytest.mark.parametrize("form", FORMS)
def test_a_form_changes_nothing_that_the_analysis_finds(clean, damage, tmp_path, form):
    log = read_log(FORMS[form](clean.table, clean.train.radius, tmp_path / "log"), clean.train)
    assert analyse_run(log.run, log.train).total_damage == pytest.approx(damage, rel=0.01)


@pytest.mark.parametrize("name", DEFECTS)
def test_a_defect_is_in_the_log_or_in_what_the_reader_is_told(clean, name):
    # nearly to a stand: some defects are those of slow wheels
    slower = {speed: clean.table[speed] - 7.0 for speed in speeds_of(clean.table)}
    stop = clean._replace(table=clean.table.assign(**slower))
    before = stop.table.copy()
    spoilt, again = (DEFECTS[name].spoil(stop, np.random.default_rng(4)) for _ in range(2))
    pd.testing.assert_frame_equal(stop.table, before)
    pd.testing.assert_frame_equal(spoilt.table, again.table)
    told = np.array_equal(spoilt.train.axle_load, clean.train.axle_load)
    assert not (told and spoilt.table.equals(before))


def test_a_run_gives_its_clean_log_first_and_defects_in_turn():
    rows = rows_of(5, 0, 2)
    assert [row["defect"] for row in rows] == [CLEAN, *list(DEFECTS)[:2]]
    assert (rows[0]["right"], rows[0]["form"], rows[0]["refused"]) == (1.0, PLAIN, False)
    assert rows[0]["error"] < 2e-3
    assert {row["damage_simulated"] for row in rows} == {rows[0]["damage_simulated"]}


GOOD = {
    "refused": False,
    "right": 1.0,
    "covered": 1.0,
    "named": 1.0,
    "remarked": 0.0,
    "silent": 0.0,
    "error": 0.001,
    "coupled": False,
}


def table(spoilt=None, clean_log=None, coupled=None, times=320) -> pd.DataFrame:
    """A table in which logs are right but for what is changed, in every second one with a defect or in the clean ones.

    Every second train has couplers.
    """
    rows = []
    for k in range(times):
        own = {"coupled": True} | (coupled or {}) if k % 2 else clean_log or {}
        rows.append({"defect": CLEAN, "form": PLAIN} | GOOD | own)
        change = (spoilt or {}) if k % 2 else {}
        rows.append(
            {"defect": "speed late", "form": PLAIN if k % 3 else "Japanese"} | GOOD | change
        )
    return pd.DataFrame(rows).assign(status="ok", event=np.arange(2 * times) // 2)


def verdicts(rows: pd.DataFrame) -> dict[str, str]:
    return {one.name: one.verdict for one in log_accuracy_statements(rows)}


def test_all_hold_where_all_is_right():
    assert set(verdicts(table()).values()) == {HOLDS}


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"spoilt": {"right": 0.0}}, "right"),
        ({"spoilt": {"right": 0.0, "silent": 1.0}}, "silent"),
        ({"spoilt": {"refused": True} | dict.fromkeys(set(GOOD) - {"refused"}, np.nan)}, "refused"),
        ({"clean_log": {"right": 0.0}}, "clean"),
        ({"coupled": {"right": 0.0}}, "clean-coupled"),
    ],
)
def test_each_statement_fails_for_its_own_reason(change, name):
    found = verdicts(table(**change))
    assert found[name] == FAILS
    spared = set(found) - {name, "right" if name == "silent" else name}
    assert {found[one] for one in spared} == {HOLDS}


def test_units_that_cannot_be_may_be_refused():
    rows = table({"refused": True})
    rows.loc[rows["refused"], "defect"] = "forces in lbf called kN"
    assert verdicts(rows)["refused"] == HOLDS


def test_the_study_is_listed_with_its_question():
    assert LOG_ACCURACY.default_events * 8 == 16 * len(DEFECTS)
