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
from studies.logs.measured_log import read_log
from studies.logs.measured_run import analyse_run
from studies.logs.simulated import log_table, rounded
from studies.logs.train import MeasuredTrain
from tests.simulation.slides import CLEANED_RAIL, TRAIN, braked, readhering


@pytest.fixture(scope="module")
def clean() -> Logged:
    """Three cars whose wheels slide and readhere, at 10 ms."""
    run: xr.Dataset = braked(readhering, rail=CLEANED_RAIL)
    return Logged(rounded(log_table(run, TRAIN)), MeasuredTrain.of(TRAIN), run)


def test_a_form_changes_nothing_that_the_analysis_finds(clean, tmp_path):
    found = {}
    for form, write in FORMS.items():
        log = read_log(write(clean.table, clean.train.radius, tmp_path / "log"), clean.train)
        found[form] = analyse_run(log.run, log.train).total_damage
    assert found == pytest.approx(dict.fromkeys(found, found[PLAIN]), rel=0.01)


def test_a_defect_is_in_the_log_or_in_what_the_reader_is_told(clean):
    # nearly to a stand: some defects are those of slow wheels
    slower = {speed: clean.table[speed] - 7.0 for speed in speeds_of(clean.table)}
    stop = clean._replace(table=clean.table.assign(**slower))
    before = stop.table.copy()
    for name, defect in DEFECTS.items():
        spoilt, again = (defect.spoil(stop, np.random.default_rng(4)) for _ in range(2))
        pd.testing.assert_frame_equal(stop.table, before, obj=name)
        pd.testing.assert_frame_equal(spoilt.table, again.table, obj=name)
        told = np.array_equal(spoilt.train.axle_load, clean.train.axle_load)
        assert not (told and spoilt.table.equals(before)), name


def test_a_run_gives_its_clean_log_first_and_defects_in_turn():
    rows = rows_of(5, 0, 2)
    assert [row["defect"] for row in rows] == [CLEAN, *list(DEFECTS)[:2]]
    assert (rows[0]["right"], rows[0]["form"], rows[0]["refused"]) == (1.0, PLAIN, False)
    assert rows[0]["error"] < 2e-3
    assert {row["damage_simulated"] for row in rows} == {rows[0]["damage_simulated"]}


GOOD = {
    "refused": False,
    "right": 1.0,
    "slips_right": 1.0,
    "proper": 0.0,
    "covered": 1.0,
    "named": 1.0,
    "remarked": 0.0,
    "silent": 0.0,
    "error": 0.001,
    "coupled": False,
}


REFUSED = GOOD | {"refused": True, "right": 0.0, "slips_right": 0.0, "error": np.nan}
REFUSED |= dict.fromkeys(("covered", "named", "remarked"), np.nan)


def table(spoilt=None, clean_log=None, coupled=None, every=None, times=800) -> pd.DataFrame:
    """A table in which logs are right but for what is changed: every second one with a defect, the clean ones, all.

    Every second train has couplers; of ten logs nine lie within twice the stated error.
    """
    rows = []
    for k in range(times):
        usual = {"form": PLAIN} | GOOD | {"covered": float(k % 10 > 0)} | (every or {})
        own = {"coupled": True} | (coupled or {}) if k % 2 else clean_log or {}
        rows.append(usual | {"defect": CLEAN} | own)
        form = {"form": PLAIN if k % 3 else "Japanese"}
        rows.append(usual | {"defect": "speed late"} | form | ((spoilt or {}) if k % 2 else {}))
    return pd.DataFrame(rows).assign(status="ok", event=np.arange(2 * times) // 2)


def verdicts(rows: pd.DataFrame) -> dict[str, str]:
    return {one.name: one.verdict for one in log_accuracy_statements(rows)}


FAULTS = {
    "right": ({"spoilt": {"right": 0.0}}, {"right"}),
    "slips": ({"spoilt": {"slips_right": 0.0}}, {"slips"}),
    "silent": ({"spoilt": {"right": 0.0, "silent": 1.0}}, {"right", "silent"}),
    "clean": ({"clean_log": {"right": 0.0}}, {"clean"}),
    "clean-coupled": ({"coupled": {"right": 0.0}}, {"clean-coupled"}),
    "errors too small": ({"every": {"covered": 0.0}}, {"stated"}),
    "errors too large": ({"every": {"covered": 1.0}}, {"stated"}),
    "refused": ({"spoilt": REFUSED}, {"right", "slips", "refused"}),
    "properly refused": ({"spoilt": REFUSED | {"proper": 1.0}}, set()),
    "nothing": ({}, set()),
}
"""What is changed, and the statements that then fail; all others hold."""


def test_each_statement_fails_for_its_own_reason_and_a_refusal_is_no_right_answer():
    for name, (change, failing) in FAULTS.items():
        found = verdicts(table(**change))
        expected = {one: FAILS if one in failing else HOLDS for one in found}
        assert found == expected, name


def test_the_study_is_listed_with_its_question():
    assert LOG_ACCURACY.default_events * 8 == 16 * len(DEFECTS)
