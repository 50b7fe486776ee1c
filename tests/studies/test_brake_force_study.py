"""The sweep `brake-force`: what it runs, what it keeps, and verdicts that follow from the numbers."""

import pytest

from studies.brake_force import study
from studies.brake_force.statements import brake_force_statements
from studies.brake_force.study import BRAKE_FORCE
from studies.core.statement import CONDITIONS, FAILS, HOLDS, TOO_FEW
from tests.studies.brake_tables import BELIEFS, brake_table


def verdict(table, name):
    return next(one for one in brake_force_statements(table) if one.name == name)


def changed(test, belief=None, beliefs=(), **values):
    """Rows of one test, or kind or shortfall, changed: as measured, or of the estimator that errs by `belief`."""

    def change(row):
        named = row.get("test", row.get("kind", row.get("missing")))
        return row | values if named == test and row.get("belief") == belief else row

    return brake_table(change=change, beliefs=beliefs)


def test_a_table_as_the_report_found_it_holds_and_few_days_give_no_verdict():
    found = brake_force_statements(brake_table(beliefs=BELIEFS))
    assert {one.name: one.verdict for one in found} == {one.name: HOLDS for one in found}
    assert len({one.name for one in found}) == len(found) == 15 + 13
    found = brake_force_statements(brake_table(days=4))
    assert {one.verdict for one in found} == {TOO_FEW}
    numbers = verdict(brake_table(), "linear in the wagons braked").numbers
    assert numbers["force per wagon [kN]"].value == pytest.approx(33.0, abs=0.5)


CHANGES = [
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
    ("stated uncertainty", "emergency", {"covered_own": False}, FAILS),
    ("stated uncertainty", "all", {"covered_smooth": 1.0}, HOLDS),
    ("sliding trailer not accused", "another's brake cut out", {"sliding_accused": 0.6}, FAILS),
    ("sliding trailer not accused", "another's brake cut out", {"first": 0.6}, CONDITIONS),
    ("faulty car found under allocation", "trailer, brake cut out", {"first": 0.5}, FAILS),
    ("faulty car found under allocation", "sound", {"wrong": 0.9}, CONDITIONS),
    ("smallest shortfall found", 0.1, {"found": 0.6}, CONDITIONS),
]  # fmt: skip
"""Statement, the test (kind, shortfall) whose rows are changed, the change, and the verdict that follows."""


def test_what_does_not_hold_is_said_not_to():
    wrong = []
    for name, test, values, expected in CHANGES:
        one = verdict(changed(test, **values), name)
        if one.verdict != expected or bool(one.conditions) != (expected != HOLDS):
            wrong.append((name, test, values, one.verdict, one.conditions))
    for which in ("covered", "covered_own", "covered_smooth"):
        # intervals that are too wide fail like those that are too narrow
        one = verdict(brake_table(change=lambda row, w=which: row | {w: 1.0}), "stated uncertainty")
        if (one.verdict, len(one.conditions)) != (FAILS, 1):
            wrong.append((which, one.verdict, one.conditions))
    assert not wrong


def test_the_budget_names_what_a_finding_does_not_survive_and_nothing_else():
    wrong = "friction +20%"
    table = changed("emergency", wrong, BELIEFS, sum_over_theory=1.2)
    found = {one.name: one for one in brake_force_statements(table)}
    budget = found["budget: wagons' sum follows theory"]
    assert (budget.verdict, budget.conditions) == (CONDITIONS, (f"not with {wrong}",))
    assert found["wagons' sum follows theory"].verdict == HOLDS
    others = {one.verdict for name, one in found.items() if one is not budget}
    assert others == {HOLDS}
    every = brake_table(
        change=lambda row: row | {"sum_over_theory": 1.2} if "belief" in row else row,
        beliefs=BELIEFS,
    )
    assert verdict(every, "budget: wagons' sum follows theory").verdict == FAILS


def test_a_finding_with_conditions_did_not_survive_and_dry_stops_count_who_is_missed_and_accused():
    for test, values, name, condition in (
        ("emergency", {"wagon_theory_off": 0.3}, "first wagon follows theory", ""),
        (0.1, {"found": 0.0}, "smallest shortfall found", ": a tenth missing is found"),
        (0.0, {"wrong": 1.0}, "smallest shortfall found", ": sound cars accused seldom"),
    ):
        one = verdict(changed(test, "friction +20%", BELIEFS, **values), f"budget: {name}")
        assert one.conditions == (f"not with friction +20%{condition}",)


def test_a_day_has_all_its_parts(tmp_path, monkeypatch):
    monkeypatch.setattr(study, "allocated_rows", lambda seed: [{"part": "allocated"}])
    monkeypatch.setattr(study, "sliding_rows", lambda seed: [{"part": "sliding"}])
    monkeypatch.setattr(study, "budget_dry_rows", lambda seed, beliefs: [{"part": "budget dry"}])
    beliefs = ("resistance +20%", "gradient +10 per mille, by speeds")
    table = BRAKE_FORCE.run(tmp_path, 1, 3, tests=("all",), shortfalls=(0.2,), beliefs=beliefs)
    assert table["part"].tolist() == [
        "test",
        "allocated",
        "driven",
        "sliding",
        "budget",
        "budget",
        "budget dry",
    ]
    plain, resistance, gradient = table.set_index("part").loc[["test", "budget"], "mean"]
    # 20 % of some 6 kN are found less; uphill 5 wagons of 59 t seem to brake by their weight's share more
    assert -2.5 < resistance - plain < -0.5
    assert gradient - plain == pytest.approx(
        5 * 59.0 * 9.81 * 0.01, rel=0.25
    )  # it stops elsewhere on the speed curve
    found = BRAKE_FORCE.statements(
        table[~table["part"].isin(["allocated", "sliding", "budget dry"])]
    )
    assert {one.verdict for one in found} == {TOO_FEW}
