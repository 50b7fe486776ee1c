"""The sweep `brake-force`: what it runs, what it keeps, and verdicts that follow from the numbers."""

import pytest

from studies.brake_force import study
from studies.brake_force.running_tests import TESTS
from studies.brake_force.statements import brake_force_statements
from studies.brake_force.study import BRAKE_FORCE
from studies.core.collection import find_study
from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW
from tests.studies.brake_tables import brake_table


def verdict(table, name):
    return next(one for one in brake_force_statements(table) if one.name == name)


def changed(test, **values):
    def change(row):
        return row | values if row.get("test", row.get("kind", row.get("missing"))) == test else row

    return brake_table(change=change)


def test_a_table_as_the_report_found_it_holds():
    found = brake_force_statements(brake_table())
    assert {one.name: one.verdict for one in found} == {one.name: HOLDS for one in found}
    assert len({one.name for one in found}) == len(found) == 14


def test_few_days_give_no_verdict():
    found = brake_force_statements(brake_table(days=4))
    assert {one.verdict for one in found if one.name != "stated uncertainty"} == {TOO_FEW}


@pytest.mark.parametrize(
    ("name", "test", "values", "expected"),
    [
        ("compressive shock", "locomotive", {"shock_ratio": 1.05}, FAILS),
        ("compressive shock", "locomotive", {"swing_late": 3.0}, CONDITIONS),
        ("locomotive steady at once", "locomotive", {"locomotive_before": 9.0}, FAILS),
        ("wagons' sum settles at zero", "locomotive", {"wagons_mean_after": 8.0}, FAILS),
        ("wagons' sum settles at zero", "locomotive", {"wagons_before": 8.0}, CONDITIONS),
        ("couplers free when all brake", "all", {"coupler_median": 20.0}, FAILS),
        ("locomotive equal in both tests", "all", {"locomotive": 50.0}, FAILS),
        ("wagons' sum varies with the spikes", "all", {"error_in_spikes": 5.0}, FAILS),
        ("linear in the wagons braked", "3 wagons", {"mean": 140.0}, FAILS),
        ("wagons' sum follows theory", "emergency", {"sum_over_theory": 1.1}, FAILS),
        ("first wagon follows theory", "emergency", {"wagon_theory_off": 0.3}, CONDITIONS),
        ("oscillation grows with the train", "emergency", {"error_first": 5.0}, FAILS),
        ("remedies", "all", {"error_own": 14.0}, CONDITIONS),
        ("stated uncertainty", "all", {"covered": False}, FAILS),
        ("faulty car found under allocation", "trailer, brake cut out", {"first": 0.5}, FAILS),
        ("faulty car found under allocation", "sound", {"wrong": 0.9}, CONDITIONS),
        ("smallest shortfall found", 0.1, {"found": 0.6}, CONDITIONS),
    ],
)  # fmt: skip
def test_what_does_not_hold_is_said_not_to(name, test, values, expected):
    one = verdict(changed(test, **values), name)
    assert one.verdict == expected
    assert one.conditions or name == "stated uncertainty"


def test_intervals_that_are_too_wide_are_said_to_be():
    one = verdict(brake_table(change=lambda row: row | {"covered": True}), "stated uncertainty")
    assert one.verdict == CONDITIONS
    assert "wider than need be" in one.conditions[0]


def test_slope_per_wagon_is_that_of_the_table():
    numbers = verdict(brake_table(), "linear in the wagons braked").numbers
    assert numbers["force per wagon [kN]"].value == pytest.approx(33.0, abs=0.5)


@pytest.fixture
def quick(monkeypatch):
    """Days that take no time; gives the cells that were run."""
    table = brake_table(days=3)
    asked = []

    def rows(part, day, **own):
        asked.append((day, part, *own.values()))
        chosen = table[(table["part"] == part) & (table["event"] == day)]
        for name, value in own.items():
            chosen = chosen[chosen[name] == value]
        return chosen.dropna(axis=1, how="all").to_dict("records")

    monkeypatch.setattr(study, "running_test_row", lambda name, day: rows("test", day, test=name))
    monkeypatch.setattr(study, "allocated_rows", lambda day: rows("allocated", day))
    monkeypatch.setattr(study, "driven_rows", lambda day, shortfalls: rows("driven", day))
    return asked


CELLS_PER_DAY = len(TESTS) + 2


def test_days_that_are_stored_are_not_run_again(tmp_path, quick):
    told = []
    one = BRAKE_FORCE.run(tmp_path, 2, on_row=lambda *row: told.append(row))
    assert [row[1:] for row in told] == [
        (k, 2 * CELLS_PER_DAY) for k in range(2 * CELLS_PER_DAY + 1)
    ]
    assert (BRAKE_FORCE.held(tmp_path), BRAKE_FORCE.held(tmp_path, 1)) == (2, 0)
    more = BRAKE_FORCE.run(tmp_path, 3)
    assert [day for day, *_ in quick] == [k for k in range(3) for _ in range(CELLS_PER_DAY)]
    for column in ("mean", "found", "missing"):
        assert (
            more[more["event"] < 2][column].fillna(-1.0).tolist()
            == one[column].fillna(-1.0).tolist()
        )


def test_only_whole_days_count_and_an_interrupted_one_goes_on(tmp_path, quick):
    BRAKE_FORCE.run(tmp_path, 1, tests=("all",))
    assert BRAKE_FORCE.held(tmp_path) == 0

    def interrupt(label, done, total):
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        BRAKE_FORCE.run(tmp_path, 1, on_row=interrupt)
    assert len(quick) == 5
    BRAKE_FORCE.run(tmp_path, 1)
    assert BRAKE_FORCE.held(tmp_path) == 1
    assert len(quick) == len(set(quick)) == CELLS_PER_DAY


def test_a_day_has_all_its_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "allocated_rows", lambda seed: [{"part": "allocated"}])
    table = BRAKE_FORCE.run(tmp_path, 1, 3, tests=("all",), shortfalls=(0.2,))
    assert table["part"].tolist() == ["test", "allocated", "driven"]
    found = BRAKE_FORCE.statements(table[table["part"] != "allocated"])
    assert {one.verdict for one in found} == {TOO_FEW}
    assert find_study("brake-force") is BRAKE_FORCE
