"""Logs of simulated runs: the simulator's own numbers come back in every form; drawn defects are judged cell by cell.

The bounds are what was measured, rounded up; sampling and noise of the speeds are those of the logs that real trains have.
"""

import numpy as np
import pandas as pd
import pytest

from alloc.estimation.series import spans
from alloc.estimation.slip_events import SlipCriterion
from alloc.metrics import METRICS
from alloc.metrics.registry import SLIP_FACTOR
from studies.core.statement import FAILS, HOLDS
from studies.logs.defects import speeds_of
from studies.logs.log_accuracy_study import LOG_ACCURACY, log_accuracy_statements
from studies.logs.measured_log import check_log, read_log
from studies.logs.measured_run import Findings, analyse_run
from studies.logs.simulated import log_table, rounded
from studies.logs.spoiled_logs import CLEAN, DEFECTS, FORMS, PLAIN, Logged, rows_of
from tests.studies.logged_runs import logged


def exported(name: str, every: int = 1, noise_kmh: float = 0.0, without: str = "-"):
    """The checked log with a CSV file's decimals, every so many records, with white noise of all speeds."""
    one = logged(name)
    table = rounded(log_table(one.run, one.model, every))
    generator = np.random.default_rng(0)
    for column in table:
        if "speed" in column and noise_kmh > 0.0:
            table[column] += generator.normal(0.0, noise_kmh, len(table))
    table = table[[column for column in table if without not in column]]
    return check_log(table, one.train, "exported")


def found_in(name: str, *options, criterion: SlipCriterion | None = None) -> Findings:
    log = exported(name, *options)
    return analyse_run(log.run, log.train, criterion)


# run, every so many records of 10 ms, noise [km/h]; bounds: coefficient (rms), at onset (largest), Q (relative)
ERRORS = [
    ("patch", 1, 0.0, 0.0012, 0.008, 1e-4),
    ("patch", 5, 0.0, 0.0014, 0.008, 5e-3),
    ("patch", 10, 0.0, 0.0015, 0.020, 2e-2),
    ("patch", 1, 0.02, 0.0014, 0.008, 1e-2),
    ("patch", 1, 0.1, 0.0040, 0.008, 4e-2),
    ("coupled", 1, 0.0, 0.0003, 0.0002, 5e-5),
    ("coupled", 5, 0.0, 0.0003, 0.0004, 5e-4),
    ("coupled", 10, 0.0, 0.0010, 0.0010, 2e-3),
    ("coupled", 1, 0.02, 0.0008, 0.0025, 1e-3),
    ("coupled", 1, 0.1, 0.0040, 0.0300, 5e-3),
    ("driven", 1, 0.0, 0.0060, 0.005, 1e-3),
    ("driven", 5, 0.0, 0.0080, 0.005, 1e-2),
    ("driven", 10, 0.0, 0.0120, 0.005, 2e-2),
    ("driven", 1, 0.02, 0.0060, 0.008, 1e-3),
]


def test_coefficients_and_damage_come_back():
    wrong = {}
    for name, every, noise, *bounds in ERRORS:
        run, found = logged(name).run, found_in(name, every, noise)
        error = found.coefficient - run["coefficient"].values[::every]
        damage = METRICS["damage"].function(run)
        limit, time = run["adhesion_limit"].values, run["time"].values
        onsets = [
            event.onset_coefficient - limit[np.argmin(np.abs(time - event.onset_time)), event.axle]
            for event in found.events
        ]
        errors = (
            np.sqrt((error**2).mean()),
            np.abs(onsets).max(),  # of an onset without a coefficient too
            abs(1e-3 * found.total_damage / damage - 1.0),
        )
        if len(onsets) < 2 or not np.less(errors, bounds).all():
            wrong[name, every, noise] = errors
    assert not wrong
    for name in ("patch", "coupled", "driven"):  # without noise there is nothing to be remarked on
        assert exported(name).remarks == ()


def test_slips_found_are_those_of_the_simulators_own_measure():
    """Its measure counts a slip beyond twice the slip of the true curve's maximum, which no log knows."""
    criterion = SlipCriterion()
    for name in ("patch", "coupled", "driven"):
        run = logged(name).run
        slip = np.abs(run["slip_velocity"].values)
        relative, time = slip / run["peak_slip"].values, run["time"].values
        bound = criterion.bound(run["speed"].values[:, None], run["rim_speed"].values)

        def overlap(event, stretch, time=time):
            begin, end = stretch
            return event.start <= time[end - 1] + 0.11 and event.end >= time[begin] - 0.11

        for every in (1, 5, 10):
            found, within_bound = found_in(name, every), 0
            for axle in range(run.sizes["axle"]):
                own = [event for event in found.events if event.axle == axle]
                past = list(spans(relative[:, axle] > 0.8))
                assert all(any(overlap(event, stretch) for stretch in past) for event in own)
                for stretch in spans(relative[:, axle] > SLIP_FACTOR):
                    rows = slice(*stretch, every)
                    if np.any(slip[rows, axle] > 1.05 * bound[rows, axle]):
                        assert any(overlap(event, stretch) for event in own), (name, axle, stretch)
                    else:
                        within_bound += 1
            kind = "slide" if name == "coupled" else "slip"
            assert {event.kind for event in found.events} == {kind}
            if name == "patch":  # the rear cars creep at less than the bound
                assert within_bound > 0


def test_with_the_curve_known_the_time_in_slips_is_the_simulators():
    """The bound of a log can be put where the simulator has it, if the curve is known: 0.15 m/s on this rail."""
    run = logged("patch").run
    found = found_in("patch", criterion=SlipCriterion(0.15, 1e-4))
    measured = METRICS["slip_time"].function(run)
    # from half of the bound on
    assert found.slipping_time.sum() == pytest.approx(measured, rel=0.25)
    slipped = np.abs(run["slip_velocity"].values) > SLIP_FACTOR * run["peak_slip"].values
    more_than_a_moment = slipped.sum(axis=0) > 10
    assert set(np.flatnonzero(more_than_a_moment)) <= {event.axle for event in found.events}


def test_adhesion_used_in_slips_comes_back_as_far_as_the_rail_stays_what_it_was():
    """The coefficient at the onset stands for all of a slip: wrong where the rail changes meanwhile, as in "driven"."""
    for name, error in (("patch", 0.08), ("coupled", 0.03), ("driven", 0.25)):
        run, found = logged(name).run, found_in(name)
        time, limit = run["time"].values, (run["adhesion_limit"] * run["axle_load"]).values
        used = available = 0.0
        for event in found.events:
            inside = (time >= event.start) & (time <= event.end)
            used += np.abs(run["rail_force"].values[inside, event.axle]).sum()
            available += limit[inside, event.axle].sum()
        assert found.utilisation == pytest.approx(used / available, abs=error)


def test_brake_force_of_every_car_comes_back_with_each_cars_own_acceleration():
    """Of 24 kN a car, while all slide [N]."""
    run = logged("coupled").run
    car, force = run["axle_car"].values, run["rail_force"].values
    truth = -np.stack([force[:, car == k].sum(axis=1) for k in range(3)], 1)
    for every in (1, 5, 10):
        found = found_in("coupled", every).car_force
        np.testing.assert_allclose(found, truth[::every], atol=5.0)
    # what the RTRI report found: the train's acceleration leaves the cars' relative motion in the forces
    log = exported("coupled", without="acceleration")
    assert log.run.car_acceleration is None
    error = analyse_run(log.run, log.train).car_force - found_in("coupled").car_force
    assert np.sqrt((error**2).mean()) == pytest.approx(316.0, rel=0.1)
    assert np.abs(error.mean(axis=0)).max() < 2.0


@pytest.fixture(scope="module")
def clean() -> Logged:
    """Three cars whose wheels slide and readhere, at 10 ms."""
    one = logged("braked")
    return Logged(one.table, one.train, one.run)


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
