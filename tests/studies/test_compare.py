"""The main comparison: laws of the table, what ties and marks say, and a small one in full."""

import json

import numpy as np
import pandas as pd
import pytest

from alloc.schema.errors import InputError
from studies import compare
from studies.files.scenario_files import load_scenario
from studies.run_cell import run
from studies.runner.study import run_study
from studies.standing import Statistic

RULES = ("alone", "cooperative", "greedy", "oracle")
START = load_scenario("wet-start")


def draw_rows(gains, events=8, seeds=2, spread=0.01, over=None):
    """Rows in which each rule uses so much more than `alone`, with events that differ more than rules do."""
    generator = np.random.default_rng(0)
    rows = []
    for event in range(events):
        level = generator.uniform(0.7, 0.9)
        for seed in range(seeds):
            for rule, gain in gains.items():
                used = level + gain + spread * generator.normal()
                metrics = {column.metric: 0.1 for column in compare.COLUMNS.values()}
                rows.append(metrics | {
                             "scenario": f"event {event}", "seed": seed, "rule": rule, "controller": "perturb-observe",
                             "bound_use": used, "damage": 100.0 + 10.0 * used, "slip_time": 1.0, "rule_gap": np.nan,
                             "over_delivery": (over or {}).get(rule, 0.0), "status": "ok", "reason": ""})  # fmt: skip
    return pd.DataFrame(rows)


def by_rule(rows):
    return {standing.rule: standing for standing in compare.rank_rules(rows)}


def numbers(rows, name):
    return {rule: standing.numbers[name] for rule, standing in by_rule(rows).items()}


def test_differences_are_paired():
    rows = draw_rows({"alone": 0.0, "cooperative": 0.05})
    gain, used = numbers(rows, "gain")["cooperative"], numbers(rows, "used")["alone"]
    assert gain.low < 0.05 < gain.high
    assert gain.high - gain.low < 0.03 < used.high - used.low


def test_ties_and_marks():
    rows = draw_rows({"alone": 0.0, "cooperative": 0.05, "greedy": 0.0495, "sharing": 0.02, "oracle": 0.06, "uniform": 0.2},
                spread=0.001, over={"uniform": 0.02})  # fmt: skip
    found = by_rule(rows)
    assert [name for name, one in found.items() if one.tied] == ["cooperative", "greedy"]
    assert found["oracle"].mark == "°"
    assert found["uniform"].mark == "*"
    assert "cooperative, greedy cannot be told apart" in compare.summarise_standings(
        list(found.values())
    )


def test_shifting_all_rules_alike_changes_no_difference():
    rows = draw_rows({"alone": 0.0, "cooperative": 0.05})
    less = rows.assign(bound_use=rows["bound_use"] - 0.1)
    before, after = (numbers(drawn, "gain")["cooperative"] for drawn in (rows, less))
    np.testing.assert_allclose(before, after, atol=1e-12)


def test_rows_that_failed_are_left_out_with_their_event():
    rows = draw_rows({"alone": 0.0, "cooperative": 0.05})
    rows.loc[rows.index[1], ["status", "bound_use"]] = ["failed", np.nan]
    found = by_rule(rows)
    assert found["cooperative"].mark == "†"
    assert numbers(rows, "used")["alone"].events == 8  # the other seed of the event is left


@pytest.mark.parametrize(
    "gains", [{"alone": 0.0}, {"cooperative": 0.1}, {"alone": 0.0, "cooperative": 0.1}]
)
@pytest.mark.parametrize("events", [1, 8])
@pytest.mark.parametrize("seeds", [1, 3])
def test_the_table_is_whole_at_80_columns(gains, events, seeds):
    found = compare.rank_rules(draw_rows(gains, events, seeds))
    told = compare.format_standings(found)
    assert max(map(len, told)) <= 80
    assert not any("…" in line or "nan" in line for line in told)
    assert compare.summarise_standings(found)
    assert set(compare.tabulate_standings(found)["events"]) == {events}
    assert set(compare.tabulate_standings(found)["runs"]) == {events * seeds}


@pytest.mark.parametrize(("seeds", "interval"), [(1, False), (8, True)])
def test_a_metric_joins_all_tables_by_one_column(monkeypatch, seeds, interval):
    jerk = Statistic("jerk_rms", 2, heading="jerk m/s3")
    monkeypatch.setitem(compare.COLUMNS, "jerk", jerk)
    rows = draw_rows({"alone": 0.0, "cooperative": 0.05}, events=1, seeds=seeds)
    standings = compare.rank_rules(rows.assign(jerk_rms=rows["bound_use"]))
    lines = compare.format_standings(standings)
    assert lines[2].endswith(jerk.heading)
    assert ("95 % intervals" in lines[1]) == interval == ("[" in "".join(lines))
    table = compare.tabulate_standings(standings)
    assert {"jerk", "jerk_low", "jerk_high"} < set(table)
    assert table["jerk"].tolist() == table["gain"].tolist()


def test_the_default_table_fits_80_columns():
    rules = [name for name in compare.RULES if name not in compare.LEFT_OUT]
    rows = draw_rows({rule: 0.001 * k for k, rule in enumerate(rules)}, events=14)
    rows["damage"] *= 50.0 * (1.0 + rows["bound_use"])
    assert max(map(len, compare.format_standings(compare.rank_rules(rows)))) <= 80


def test_the_default_grid():
    chosen = compare.choose_grid()
    cells = chosen.cells()
    assert {"alone", "greedy", "cooperative", "oracle"} < set(chosen.rules)
    assert len(cells) == 14 * len(chosen.rules) * 3 * 2
    assert len({cell.name for cell in cells}) == len(cells)


@pytest.mark.parametrize(("parts", "words"), [
    ({"rules": ["gredy"]}, "gredy.*greedy"),
    ({"controllers": ["pertub-observe"]}, "perturb-observe"),
    ({"seeds": 0}, "seeds = 0"),
    ({"scenarios": [START, START.changed(duration_s=3.0)]}, "two scenarios are named"),
])  # fmt: skip
def test_bad_parts(parts, words):
    with pytest.raises(InputError, match=words):
        compare.choose_grid(**parts)


def test_the_gap_of_a_solver_is_the_greatest_of_its_runs():
    event = load_scenario("uneven-load").changed(duration_s=8.0)
    solved, exact = (run(event, rule, "perturb-observe", 0) for rule in ("qp", "cooperative"))
    assert 0.0 < solved["rule_gap"] < 1e-6  # its answers are OSQP's own, within the tolerance
    assert np.isnan(exact["rule_gap"])
    rows = draw_rows({"alone": 0.0, "qp": 0.05})
    rows.loc[rows["rule"] == "qp", "rule_gap"] = [np.nan, 3e-9, *[1e-12] * 14]
    table = compare.tabulate_standings(compare.rank_rules(rows)).set_index("rule")
    assert dict(table["gap"]) == {"qp": "3e-09", "alone": ""}


def test_a_small_comparison(tmp_path):
    event = load_scenario("wet-front").changed(duration_s=8.0)
    study = compare.make_study(compare.choose_grid([event], RULES, ["perturb-observe"], 2))
    rows = run_study(study, tmp_path)
    assert list(rows["status"].unique()) == ["ok"]
    assert len(rows) == len(RULES) * 2
    told = compare.export_comparison(rows)
    assert json.loads(json.dumps(told)) == told
    assert {row["rule"] for row in told["rows"]} == set(RULES)
    used = {row["rule"]: row["metrics"]["bound_use"]["mean"] for row in told["rows"]}
    assert used["oracle"] > used["cooperative"] > used["alone"]
    assert study.table(rows)["rule"].iloc[0] == "oracle"
    assert study.figure(rows).axes[0].get_xlabel() == "points over alone"
