"""The main comparison: laws of the table, what ties and marks say, and a small one in full."""

import json

import numpy as np
import pandas as pd
import pytest

from alloc.schema.errors import InputError
from studies import compare
from studies.compare import answer, as_json, frame, grid, lines, standings, study_of
from studies.files.scenario_files import load_scenario
from studies.run_cell import run
from studies.runner.study import run_study

RULES = ("alone", "cooperative", "greedy", "oracle")
START = load_scenario("wet-start")


def made(gains, events=8, seeds=2, spread=0.01, over=None):
    """Rows in which each rule uses so much more than `alone`, with events that differ more than rules do."""
    generator = np.random.default_rng(0)
    rows = []
    for event in range(events):
        level = generator.uniform(0.7, 0.9)
        for seed in range(seeds):
            for rule, gain in gains.items():
                used = level + gain + spread * generator.normal()
                rows.append({"scenario": f"event {event}", "seed": seed, "rule": rule, "controller": "perturb-observe",
                             "bound_use": used, "damage": 100.0 + 10.0 * used, "slip_time": 1.0, "rule_gap": np.nan,
                             "over_delivery": (over or {}).get(rule, 0.0), "status": "ok", "reason": ""})  # fmt: skip
    return pd.DataFrame(rows)


def by_rule(rows):
    return {one.rule: one for one in standings(rows)}


def test_differences_are_paired():
    found = by_rule(made({"alone": 0.0, "cooperative": 0.05}))
    gain = found["cooperative"].gain
    assert gain.low < 0.05 < gain.high
    assert gain.high - gain.low < 0.03 < found["alone"].used.high - found["alone"].used.low


def test_ties_and_marks():
    rows = made({"alone": 0.0, "cooperative": 0.05, "greedy": 0.0495, "sharing": 0.02, "oracle": 0.06, "uniform": 0.2},
                spread=0.001, over={"uniform": 0.02})  # fmt: skip
    found = by_rule(rows)
    assert [name for name, one in found.items() if one.tied] == ["cooperative", "greedy"]
    assert found["oracle"].mark == "°"
    assert found["uniform"].mark == "*"
    assert "cooperative, greedy cannot be told apart" in answer(list(found.values()))


def test_shifting_all_rules_alike_changes_no_difference():
    rows = made({"alone": 0.0, "cooperative": 0.05})
    a, b = by_rule(rows), by_rule(rows.assign(bound_use=rows["bound_use"] - 0.1))
    np.testing.assert_allclose(a["cooperative"].gain, b["cooperative"].gain, atol=1e-12)


def test_rows_that_failed_are_left_out_with_their_event():
    rows = made({"alone": 0.0, "cooperative": 0.05})
    rows.loc[rows.index[1], ["status", "bound_use"]] = ["failed", np.nan]
    found = by_rule(rows)
    assert found["cooperative"].mark == "†"
    assert found["alone"].used.events == 8  # the other seed of the event is left


@pytest.mark.parametrize(
    "gains", [{"alone": 0.0}, {"cooperative": 0.1}, {"alone": 0.0, "cooperative": 0.1}]
)
@pytest.mark.parametrize("events", [1, 8])
@pytest.mark.parametrize("seeds", [1, 3])
def test_the_table_is_whole_at_80_columns(gains, events, seeds):
    found = standings(made(gains, events, seeds))
    told = lines(found)
    assert max(map(len, told)) <= 80
    assert not any("…" in line or "nan" in line for line in told)
    assert answer(found)
    assert set(frame(found)["events"]) == {events}
    assert set(frame(found)["runs"]) == {events * seeds}


def test_the_default_table_fits_80_columns():
    rules = [name for name in compare.RULES if name not in compare.LEFT_OUT]
    rows = made({rule: 0.001 * k for k, rule in enumerate(rules)}, events=14)
    rows["damage"] *= 50.0 * (1.0 + rows["bound_use"])
    assert max(map(len, lines(standings(rows)))) <= 80


def test_the_default_grid():
    chosen = grid()
    cells = chosen.cells()
    assert {"alone", "greedy", "cooperative", "oracle"} < set(chosen.rules)
    assert len(cells) == 14 * len(chosen.rules) * 3 * 5
    assert len({cell.name for cell in cells}) == len(cells)


@pytest.mark.parametrize(("parts", "words"), [
    ({"rules": ["gredy"]}, "gredy.*greedy"),
    ({"controllers": ["pertub-observe"]}, "perturb-observe"),
    ({"seeds": 0}, "seeds = 0"),
    ({"scenarios": [START, START.changed(duration_s=3.0)]}, "two scenarios are named"),
])  # fmt: skip
def test_bad_parts(parts, words):
    with pytest.raises(InputError, match=words):
        grid(**parts)


def test_the_gap_of_a_solver_is_the_greatest_of_its_runs():
    event = load_scenario("uneven-load").changed(duration_s=8.0)
    solved, exact = (run(event, rule, "perturb-observe", 0) for rule in ("qp", "cooperative"))
    assert 0.0 < solved["rule_gap"] < 1e-6  # its answers are OSQP's own, within the tolerance
    assert np.isnan(exact["rule_gap"])
    rows = made({"alone": 0.0, "qp": 0.05})
    rows.loc[rows["rule"] == "qp", "rule_gap"] = [np.nan, 3e-9, *[1e-12] * 14]
    table = compare.frame(standings(rows)).set_index("rule")
    assert dict(table["gap"]) == {"qp": "3e-09", "alone": ""}


def test_a_small_comparison(tmp_path):
    event = load_scenario("wet-front").changed(duration_s=8.0)
    study = study_of(grid([event], RULES, ["perturb-observe"], 2))
    rows = run_study(study, tmp_path)
    assert list(rows["status"].unique()) == ["ok"]
    assert len(rows) == len(RULES) * 2
    told = as_json(rows)
    assert json.loads(json.dumps(told)) == told
    assert {row["rule"] for row in told["rows"]} == set(RULES)
    used = {row["rule"]: row["metrics"]["bound_use"]["mean"] for row in told["rows"]}
    assert used["oracle"] > used["cooperative"] > used["alone"]
    assert study.table(rows)["rule"].iloc[0] == "oracle"
    assert study.figure(rows).axes[0].get_xlabel() == "points over alone"
