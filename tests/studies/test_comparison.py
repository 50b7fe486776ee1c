"""A comparison: what it consists of when nothing is said, means over seeds, the printed table, and the JSON."""

import io
import json
import math
from collections import Counter
from fnmatch import fnmatchcase

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from alloc.metrics import METRICS
from alloc.metrics.registry import UNLIMITED
from alloc.onboard.controllers.collection import BUILT_IN
from alloc.onboard.host import CONTROLLERS
from alloc.rules import RULES
from studies.comparison.pooled import (
    is_marked,
    notes,
    pooled,
    pooled_table,
    printed,
)
from studies.comparison.summary import (
    DEFAULT_SEEDS,
    KEPT_RUNS,
    LEFT_OUT,
    MOST_OVER,
    RULE_CALL_TIME,
    SLOW_CONTROLLER,
    default_grid,
    make_grid,
    means_of,
    summarise,
    to_json,
)
from studies.comparison.table import tables
from studies.core.drawn_events import COMPARED
from studies.core.job import check_controller, is_hosted
from studies.core.statement import mean_interval
from studies.scenario.scenario import load_scenario, shipped_scenarios


def test_by_default_every_scenario_but_those_of_faults_meets_every_rule_but_the_slow_ones():
    grid = default_grid()
    shipped = [load_scenario(name) for name in shipped_scenarios()]
    wanted = [scenario.name for scenario in shipped if scenario.in_default_comparison]
    assert [scenario.name for scenario in grid.scenarios] == wanted
    assert 8 <= len(wanted) < len(shipped)
    assert set(grid.rules) == set(RULES) - set(LEFT_OUT)
    assert grid.seeds == tuple(range(DEFAULT_SEEDS))
    assert DEFAULT_SEEDS >= 5
    assert not grid.fixed
    cells = Counter((job.scenario.name, job.rule, job.controller) for job in grid.jobs())
    seeds = dict.fromkeys(COMPARED, DEFAULT_SEEDS) | {SLOW_CONTROLLER: 1}
    assert cells == {
        (name, rule, controller): count
        for name in wanted
        for rule in grid.rules
        for controller, count in seeds.items()
    }


def test_every_pattern_of_runs_to_keep_matches_a_cell():
    labels = [job.label for job in default_grid().jobs()]
    for pattern in KEPT_RUNS:
        assert any(fnmatchcase(label, pattern) for label in labels)


def test_named_controllers_are_all_that_is_run():
    """The slow one meets the first seed, and all where it is named; slow rules run when they are asked for."""
    scenario = load_scenario("wet-start")
    grid = make_grid([scenario], ["exact", "exact"], ["none"], 2)
    assert [job.label for job in grid.jobs()] == [
        "wet-start/exact/none/0",
        "wet-start/exact/none/1",
    ]
    grid = make_grid([scenario], ["exact"], None, 2)
    assert {job.seed for job in grid.jobs() if job.controller == SLOW_CONTROLLER} == {0}
    named = make_grid([scenario], ["exact"], [SLOW_CONTROLLER], 2)
    assert [job.seed for job in named.jobs()] == [0, 1]
    assert make_grid([scenario], ["qp-cvxpy"], ["none"], 1).rules == ("qp-cvxpy",)


def test_built_in_and_hosted_controllers_stand_in_one_collection():
    hosted = ["mpc", "mpc-car", "mpc-opti", "mpc-train", "mpc-train-ideal"]
    assert list(CONTROLLERS) == [*BUILT_IN, *hosted]
    assert [name for name in CONTROLLERS if is_hosted(name)] == hosted
    for name in hosted:
        assert CONTROLLERS[name].name == name
        assert CONTROLLERS.origin(name) == "mpc.hosted"
        check_controller(name)


FAULT_HEADINGS = {"fallbacks": "backs", "blinded": "blinded", "telegrams_lost": "telegr."}
"""Counts of faults, and a word of the heading of each."""


def rows(scenario="event", rule="exact", controller="none", seeds=3, **values) -> list[dict]:
    return [
        dict.fromkeys(METRICS, 0.5)
        | {"over_delivery": 0.005}
        | {"scenario": scenario, "rule": rule, "controller": controller, "seed": seed}
        | {"status": "ok", "reason": ""}
        | {
            name: value[seed] if isinstance(value, list) else value
            for name, value in values.items()
        }
        for seed in range(seeds)
    ]


def render(table: pd.DataFrame, width: int) -> str:
    screen = Console(file=io.StringIO(), width=width)
    for item in tables(summarise(table), {"event": "a [strange] title"}, width):
        screen.print(item)
    return screen.file.getvalue()


STUDENTS = 4.303 / math.sqrt(3)
"""Half-width of the interval of the mean of 1, 2, 3: s = 1, and t(0.975, 2) = 4.303 from tables."""


def mean_of(values, within=UNLIMITED):
    (mean,) = means_of(np.array(values)[:, None], [within])
    return mean


def test_the_interval_of_a_mean_of_few_seeds_is_students_of_those_to_which_the_metric_applies():
    mean = mean_of([1.0, 2.0, 3.0])
    assert (mean.value, mean.count) == (2.0, 3)
    assert [2.0 - mean.low, mean.high - 2.0] == pytest.approx([STUDENTS, STUDENTS], rel=1e-3)
    mean = mean_of([1.0, np.nan, 3.0])
    assert (mean.value, mean.count) == (2.0, 2)
    assert mean_of([np.nan]).count == 0
    assert math.isnan(mean_of([1.0]).low)


def test_an_interval_ends_where_the_range_of_its_metric_does():
    values = [0.92, 0.99, 0.995]
    assert mean_of(values).high > 1.0
    assert mean_of(values, METRICS["bound_use"].within).high == 1.0
    assert mean_of(values, METRICS["bound_use"].within).low == mean_of(values).low
    (line,) = summarise(pd.DataFrame(rows(utilisation=values, damage=[0.0, 1.0, 9.0])))
    assert line.metrics["utilisation"].high == 1.0
    assert line.metrics["damage"].low == 0.0
    for name, mean in line.metrics.items():
        least, most = METRICS[name].within if name in METRICS else UNLIMITED
        assert mean.count == 0 or least <= mean.low <= mean.high <= most


def test_all_means_at_once_are_those_one_by_one():
    values = np.random.default_rng(0).random((12, 5)) ** 3
    values[3, 1] = values[:2, 4] = np.nan
    for one, column in zip(means_of(values, [UNLIMITED] * 5), values.T, strict=True):
        alone = mean_interval(pd.Series(column))
        assert (one.count, one.low) == (alone.count, pytest.approx(alone.low, rel=1e-12))
        assert one.high == pytest.approx(alone.high, rel=1e-12)


def test_the_time_of_a_call_follows_from_time_and_calls():
    (line,) = summarise(pd.DataFrame(rows(rule_time=[2.0, 4.0, 0.0], rule_calls=[4.0, 4.0, 0.0])))
    assert line.metrics[RULE_CALL_TIME].value == pytest.approx(0.75)


def test_json_holds_every_metric_of_every_line_and_no_nan():
    def forbidden(constant):
        raise AssertionError(f"{constant} is not JSON")

    table = pd.DataFrame(rows(coupler_peak=np.nan) + rows(rule="qp", seeds=1))
    content = json.loads(to_json(summarise(table), {"seeds": [0]}), parse_constant=forbidden)
    assert set(METRICS) <= set(content["metrics"])
    for row in content["rows"]:
        assert set(METRICS) <= set(row["metrics"])
    one, other = (row["metrics"] for row in content["rows"])
    assert one["coupler_peak"] == dict.fromkeys(("mean", "low", "high"))
    assert other["damage"] == {"mean": 0.5, "low": None, "high": None}
    assert content["metrics"]["damage"]["unit"] == "kJ"


def test_tables_and_differences_fit_the_terminal():
    large = dict.fromkeys(FAULT_HEADINGS, 0.0)
    large |= {"energy": 123.4, "telegrams": 1200.0, "damage": 98765.0, "coupler_peak": 1234.0}
    table = pd.DataFrame(rows(rule="greedy-claim", controller="cut-and-ramp", seeds=1, **large))
    names = {
        "effort_ratio": [0.1, 0.2, 0.6],
        "damage": [1.0, 90.0, 9.0],
        "controller": "cut-and-ramp",
    }
    other = rows(rule="alone") + rows(rule="greedy-claim", **names) + rows(rule="alone", **names)
    for width in (95, 120, 200):
        text = render(table, width)
        assert ("not shown for want of width: telegrams" in text) == (width < 200)
        assert "98765" in text
        (_, _, below) = render(pd.DataFrame(other), width).partition("less alone")
        assert "+0.00" in below
        for shown in (text, below):
            assert all(len(line.rstrip()) <= width for line in shown.splitlines())
            assert "…" not in shown


def test_a_line_is_named_once_per_rule_and_shows_its_interval():
    text = render(pd.DataFrame(rows(damage=[1.0, 2.0, 3.0]) + rows(controller="mpc")), 170)
    assert text.count("exact") == 1
    assert "2 ±2" in text
    assert "a [strange] title" in text


def test_failures_are_shown_with_their_reason():
    some = rows(rule="exact", status=["ok", "failed", "ok"], reason=["", "lost [its] way", ""])
    every = rows(rule="qp", status="failed", reason="no solver", seeds=1)
    text = render(pd.DataFrame(some + every), 170)
    assert "exact, none: 1 of 3 runs failed: lost [its] way" in text
    assert "qp, none: 1 of 1 runs failed: no solver" in text
    assert "failed" in next(line for line in text.splitlines() if line.strip().startswith("qp"))


def test_differences_are_paired_by_seed_under_the_same_controller():
    # by hand: 2 - 1, 5 - 3, 9 - 6 are 1, 2, 3, of which s = 1; the seed that failed has no pair
    table = pd.DataFrame(
        rows(rule="alone", seeds=4, damage=[1.0, 3.0, 6.0, 0.0])
        + rows(rule="alone", controller="mpc", damage=50.0)
        + rows(seeds=4, damage=[2.0, 5.0, 9.0, 77.0], status=["ok", "ok", "ok", "failed"])
        + rows(rule="qp", controller="mpc", seeds=1, damage=40.0)
        + rows(controller="table")
    )
    table = table.sample(frac=1.0, random_state=1)  # pairs do not rest on the order of rows
    lines = {(line.rule, line.controller): line for line in summarise(table)}
    found = lines["exact", "none"].differences["damage"]
    assert (found.value, found.count) == (2.0, 3)
    assert found.high - 2.0 == pytest.approx(STUDENTS, rel=1e-3)
    assert lines["qp", "mpc"].differences["damage"].value == -10.0
    assert math.isnan(lines["qp", "mpc"].differences["damage"].low)
    assert lines["alone", "none"].differences == lines["exact", "table"].differences == {}


def test_differences_are_printed_beside_the_table_and_in_the_json():
    table = pd.DataFrame(
        rows(rule="alone", damage=[1.0, 3.0, 6.0])
        + rows(damage=[4.0, 9.0, 15.0])
        + rows(rule="qp", seeds=1)
    )
    text = render(table, 100)
    (_, _, below) = text.partition("less alone, paired over 3 seeds")
    (line,) = (line for line in below.splitlines() if line.split()[:1] == ["exact"])
    assert "+6 ±7" in line
    assert "qp" not in below  # one pair has no interval
    content = json.loads(to_json(summarise(table), {}))
    by_rule = {row["rule"]: row["differences"] for row in content["rows"]}
    assert content["reference"] == "alone"
    assert by_rule["alone"] == {}
    assert by_rule["exact"]["damage"]["mean"] == 6.0
    assert by_rule["exact"]["damage"]["high"] == pytest.approx(6.0 + 3.0 * STUDENTS, rel=1e-3)
    assert by_rule["qp"]["damage"] == {"mean": -0.5, "low": None, "high": None}


def test_degraded_runs_are_counted_apart_and_enter_no_mean():
    table = pd.DataFrame(
        rows(
            damage=[1.0, 50.0, 70.0],
            status=["ok", "degraded", "failed"],
            reason=["", "often", "broke"],
        )
    )
    (line,) = summarise(table)
    assert (line.seeds, line.failed, line.degraded, line.metrics["damage"].value) == (3, 1, 1, 1.0)
    assert "exact, none: 1 of 3 runs failed, 1 of 3 runs degraded: often" in render(table, 170)
    (row,) = json.loads(to_json([line], {}))["rows"]
    assert (row["failed"], row["degraded"], row["reasons"]) == (1, 1, ["often", "broke"])
    every = render(
        pd.DataFrame(rows(status="degraded", reason="often") + rows(rule="qp", seeds=1)), 170
    )
    assert "degraded" in next(
        line for line in every.splitlines() if line.strip().startswith("exact")
    )


def test_columns_that_apply_to_nothing_are_left_out():
    rigid = pd.DataFrame(rows(coupler_peak=np.nan, controller_median=0.0))
    text = render(rigid, 250)
    assert "coupler" not in text
    assert "control" not in text.replace("controller", "")


def test_faults_are_shown_where_there_are_any_and_only_there():
    none = dict.fromkeys(FAULT_HEADINGS, 0.0)
    plain = render(pd.DataFrame(rows(**none)), 200)
    for metric in FAULT_HEADINGS:
        some = pd.DataFrame([*rows(**(none | {metric: 7.0})), *rows(rule="alone", **none)])
        shown = render(some, 200)
        headings = {name for name, heading in FAULT_HEADINGS.items() if heading in shown}
        assert headings == {metric}
        assert FAULT_HEADINGS[metric] not in plain
        line = next(line for line in shown.splitlines() if line.split()[:1] == ["exact"])
        assert " 7 " in line


def events(rule="exact", shift=0.0, count=6, controller="none", **values):
    """A run of `rule` in each of so many events, which differ."""
    return [
        row
        for k in range(count)
        for row in rows(
            f"event {k}", rule, controller, 2, bound_use=0.9 + 0.01 * k + shift,
            damage=100.0 + k * (1.0 + shift), over_delivery=0.0, **values,
        )
    ]  # fmt: skip


def test_pooled_lines_are_means_over_the_events_that_all_rules_have_paired_by_event():
    table = pd.DataFrame([*events("alone"), *events("exact", 0.02), *events("greedy", 0.01, 5)])
    found = pooled(summarise(table))
    assert [line.rule for line in found] == ["exact", "greedy", "alone"]  # by capped effort
    common = [0.90, 0.91, 0.92, 0.93, 0.94]  # the sixth event lacks a rule
    for line, shift in zip(found, (0.02, 0.01, 0.0), strict=True):
        assert line.seeds == len(common)
        assert line.metrics["bound_use"].value == pytest.approx(np.mean(common) + shift)
    less = found[0].differences["damage"]
    alone = found[2].metrics["damage"]
    assert less.value == pytest.approx(0.02 * 2.0)
    assert less.low < less.value < less.high
    assert less.high - less.low < alone.high - alone.low  # pairing takes away what events share


def test_a_rule_that_delivers_beyond_the_plan_is_marked_and_never_named_the_best():
    table = pd.DataFrame([*events("alone"), *events("exact", 0.01), *events("greedy", 0.04)])
    table.loc[table["rule"] == "greedy", "over_delivery"] = 1.1 * MOST_OVER
    table.loc[table["rule"] == "exact", "over_delivery"] = 0.9 * MOST_OVER
    found = pooled(summarise(table))
    assert [is_marked(line) for line in found] == [True, False, False]
    assert "greedy *" in printed(found, "markdown")
    assert notes(found)[0].startswith("* delivers more than 1%")


def test_the_pooled_table_is_text_to_paste_in_each_format():
    table = pd.DataFrame([*events("alone"), *events("exact", -0.02)])
    found = pooled(summarise(table))
    content = pd.read_csv(io.StringIO(printed(found, "csv")))
    assert content["bound_use_less_alone"].iloc[1] == pytest.approx(-0.02)
    marked = printed(found, "markdown").splitlines()
    assert len(marked) == 2 + len(found)
    assert {line.count("|") for line in marked} == {marked[0].count("|")}
    assert "−2.00" in printed(found, "markdown")
    tex = printed(found, "latex").splitlines()
    assert {line.count("&") for line in tex if line.endswith(r"\\")} == {marked[0].count("|") - 2}
    assert r"\% of bound" in printed(found, "latex")
    screen = Console(file=io.StringIO(), width=170)
    screen.print(pooled_table(found))
    assert max(map(len, screen.file.getvalue().splitlines())) <= 170
