"""`readhesion report`: its numbers are the stored ones, its replays the runs, it loads nothing, and nothing is run twice."""

import json
import math
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from alloc.metrics.use import headroom
from studies.comparison.summary import EFFORT, MOST_OVER, REFERENCE, SummaryLine
from studies.comparison.table import COLUMNS, tables
from studies.core.job import simulate_job
from studies.core.statement import Interval, mean_interval
from studies.core.study import study_folder
from studies.files.study_error import StudyError
from studies.patent.headroom_study import HEADROOM, measure
from studies.report import page
from studies.report.answer import (
    EQUAL,
    Gain,
    drawn_gains,
    forest,
    sentences,
    sign_of,
    signed,
    standings,
    table_rows,
    told_interval,
)
from studies.report.replay import KEPT, kept, pack, unpack
from studies.scenario.scenario import load_scenario
from tests.studies import report_pages
from tests.studies.conftest import SHORT
from tests.studies.test_plugins import plain  # noqa: F401

report_pages.need_packages()


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "short.toml").write_text(SHORT)
    return report_pages.make(load_scenario(folder / "short.toml"), folder / "results")


@pytest.fixture(scope="module")
def html(made):
    return page.rendered(made.material)


class Reader(HTMLParser):
    """Attributes of every tag, and the cells of the table of runs: by row, kind and column."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.rows = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.tags.append((tag, found))
        if tag == "tr" and "data-scenario" in found:
            self.rows.append((found, {}))
        elif tag == "td" and "data-number" in found and self.rows:
            kind = found["class"].split()[0] if found["class"] else ""
            number = found["data-number"]
            self.rows[-1][1][kind, found["data-column"]] = float(number) if number else math.nan


numbers = arrays(
    float,
    st.tuples(st.integers(1, 9), st.integers(0, 4)),
    elements=st.floats(-1e4, 1e4) | st.just(math.nan),
)


@given(numbers, st.floats(1e-4, 10.0))
@settings(max_examples=60, deadline=None)
def test_what_is_packed_comes_back_within_half_a_step(values, resolution):
    packed = pack({"one": (values, resolution), "two": (np.arange(len(values)), 1.0)})
    back = unpack(packed)
    assert back["one"].shape == values.shape
    assert (np.isnan(back["one"]) == np.isnan(values)).all()
    known = ~np.isnan(values)
    assert (
        np.abs(back["one"] - values)[known].max(initial=0.0) <= (0.5 + 1e-6) * packed.steps["one"]
    )
    np.testing.assert_array_equal(back["two"], np.arange(len(values)))


def test_a_replay_is_the_run_at_every_fifth_instant(made):
    cell = made.grid.jobs()[0]
    run = simulate_job(cell)
    found = next(one for one in made.material.replays if one.label == cell.label)
    back, steps = report_pages.unpacked(found)
    assert back.keys() == KEPT.keys()
    assert found.run["period"] == pytest.approx(5 * 0.01)
    for name, values in back.items():
        np.testing.assert_allclose(values, run[name].values[::5], rtol=0, atol=0.501 * steps[name])
    # a long run is thinned out
    long = run.isel(time=np.zeros(50_000, int)).assign_coords(time=0.01 * np.arange(50_000))
    assert kept(long)["instants"] <= 2000


def test_every_cell_of_the_table_is_the_mean_of_the_stored_rows(made, html):
    table, compared = made.rows, 0
    rows = Reader(html).rows
    assert len(rows) == 2 * len(report_pages.RULES) * len(report_pages.CONTROLLERS)
    for about, cells in rows:
        rule = about["data-rule"]
        same = (table["scenario"] == about["data-scenario"]) & (
            table["controller"] == about["data-controller"]
        )
        own = table[same & (table["rule"] == rule)].set_index("seed")
        base = table[same & (table["rule"] == REFERENCE)].set_index("seed")
        for (kind, metric), number in cells.items():
            if metric == "seeds":
                assert number == len(own) == report_pages.SEEDS
                continue
            wanted = own[metric].mean()
            if kind == "difference":
                paired = (own[metric] - base[metric]).mean()
                wanted = math.nan if rule == REFERENCE else paired
            near = pytest.approx(wanted, rel=1e-12, abs=1e-12, nan_ok=True)
            assert number == near, (about, kind, metric)
            compared += math.isfinite(number)
    assert compared > 150


def test_nothing_on_the_page_is_loaded_from_anywhere(html):
    tags = Reader(html).tags
    assert not [tag for tag, found in tags if "src" in found or (tag == "link" and "href" in found)]
    links = {found["href"] for tag, found in tags if tag == "a"}
    assert all(link.startswith(("#", "https://doi.org/", "https://arxiv.org/")) for link in links)
    policy = next(found["content"] for _, found in tags if found.get("http-equiv"))
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    style = re.search(r"<style>(.*?)</style>", html, re.S).group(1)
    assert "url(" not in style
    assert "@import" not in style


def test_what_a_scenario_says_ends_no_script_and_is_no_markup(html):
    text = re.search(r'id="content">(.*?)</script>', html, re.S).group(1)
    title = "a <!-- <script> or </script> of <b>two</b> & more"
    assert json.loads(text)["events"]["milder"]["title"] == title
    assert "<" not in text
    assert (
        "a &lt;!-- &lt;script&gt; or &lt;/script&gt; of &lt;b&gt;two&lt;/b&gt; &amp; more" in html
    )


def test_versions_hashes_seeds_and_sources_are_on_the_page(made, html):
    scenarios = {one.name: one.hash() for one in made.grid.scenarios}
    assert all(name in html and digest in html for name, digest in scenarios.items())
    assert all(code in html for code in made.rows["code_hash"])
    assert "0, 1, 2" in html
    assert "numba" in html
    sources = html[html.index('id="sources"') :]
    assert "JP 5484215" in sources  # the rule `exact` and the plant
    assert "@patent{JP4209318," in sources  # metrics
    assert "Zirek" not in sources  # a controller that was not run


def test_a_page_that_would_be_too_large_leaves_replays_out_and_says_so(made, html):
    whole = len(html.encode())
    small = page.rendered(made.material, whole - 1)
    assert len(small.encode()) < whole
    assert "1 run left out" in small
    with pytest.raises(StudyError, match="fewer events"):
        page.rendered(made.material, 1_000_000)


def evenly(value, half_width, count=3):
    """A mean with an interval that reaches as far up as down."""
    return Interval(value, value - half_width, value + half_width, count)


def line(rule, gain, half_width=math.nan, scenario="one", controller="none", over=0.0):
    """A line whose only metrics are the effort's, what exceeds the plan and, by none, the headroom."""
    metrics = {EFFORT: evenly(0.8, math.nan, 1), "headroom": evenly(0.02, math.nan, 1)}
    metrics["over_delivery"] = evenly(over, math.nan, 1)
    differences = dict.fromkeys(("slip_time", "damage", "jerk_rms"), evenly(1.0, 0.1, 1))
    differences |= {EFFORT: evenly(gain, half_width, 1)}
    if rule == REFERENCE:
        differences = {}
    return SummaryLine(scenario, rule, controller, 1, 0, 0, (), metrics, differences)


def test_a_difference_is_decided_by_its_interval_or_where_nothing_is_drawn():
    for gain, half_width, fixed, wanted in (
        (0.02, 0.01, False, 1), (-0.02, 0.01, False, -1), (0.02, 0.03, False, None), (0.02, math.nan, False, None),
        (0.02, math.nan, True, 1), (-0.02, math.nan, True, -1), (EQUAL / 2, math.nan, True, 0), (0.0, 0.0, False, 0),
    ):  # fmt: skip
        assert sign_of(line("exact", gain, half_width), EFFORT, {"one"} if fixed else ()) == wanted


def test_with_every_sign_turned_what_was_more_is_less():
    gains = {"a": 0.03, "b": -0.01, "c": 0.0, "d": 0.002}
    lines = [line("exact", gain, 0.005, name) for name, gain in gains.items()]
    turned = [line("exact", -gain, 0.005, name) for name, gain in gains.items()]
    (one,), (other,) = standings(lines, ()), standings(turned, ())
    assert (one.better, one.worse) == (other.worse, other.better) == (1, 1)
    assert one.better + one.worse + one.equal + one.undecided == len(gains)
    assert one.gain == pytest.approx(-other.gain)


def test_the_answer_has_intervals_over_five_events_or_more_and_a_picture_on_one_scale():
    gains = dict(zip("abcde", (0.01, 0.03, 0.02, 0.05, 0.04), strict=True))
    lines = [line(rule, way * gain, 0.005, name) for rule, way in (("exact", 1), ("greedy", -1))
             for name, gain in gains.items()]  # fmt: skip
    found = standings(lines, ())
    for one, way in zip(found, (1, -1), strict=True):
        mean = mean_interval(pd.Series([way * gain for gain in gains.values()]))
        assert one.differences[EFFORT] == mean
        assert (
            told_interval(mean, 100.0, 2)
            == f"[{signed(100 * mean.low, 2)}, {signed(100 * mean.high, 2)}]"
        )
    drawn = forest(found)
    scale = [drawn.zero + (drawn.rows[0][0] - drawn.zero) * x / 0.03 for x in
             [end for one in found for d in [one.differences[EFFORT]] for end in (d.value, d.low, d.high)]]  # fmt: skip
    np.testing.assert_allclose(np.ravel(drawn.rows), scale, atol=0.2)
    assert 0.0 < min(map(min, drawn.rows)) < max(map(max, drawn.rows)) < drawn.width
    few = standings(lines[:4], ())  # the picture of fewer has points
    assert told_interval(few[0].differences[EFFORT], 100.0, 2) == ""
    assert len(set(forest(few).rows[0])) == 1


def test_the_page_opens_where_the_best_rule_gains_most(made):
    shown = [one for one in made.material.replays if one.run]
    gains = [Gain(scenario, rule, "none", 0.1, gain) for scenario, rule, gain in (
        ("short", "exact", 0.01), ("milder", "exact", 0.02), ("short", "oracle", 0.5))]  # fmt: skip
    material = replace(
        made.material, gains=[*gains, Gain("short", "exact", "cut-and-ramp", 0.1, 0.3)]
    )
    best = standings([line(REFERENCE, 0.0), line("exact", 0.1)], ())[0]
    assert (best.rule, best.controller) == ("exact", "none")
    assert page._first(material, shown, best) == "milder/exact/none"
    assert page._first(material, shown, None) == "short/exact/cut-and-ramp"


def test_the_answer_names_the_best_rule_that_a_train_can_carry_out():
    lines = [line(REFERENCE, 0.0), line("greedy", 0.01), line("exact", 0.02), line("oracle", 0.05)]
    said = sentences(lines, standings(lines, {"one"}))
    assert "exact gains most (+2.00 under none)" in said[0]
    assert "1 of 1 events; exact gains +2.00 points there." in said[1]
    assert "Oracle, which knows the rail, gains +5.00" in said[2]
    losing = [line(REFERENCE, 0.0), line("exact", -0.02)]
    first = sentences(losing, standings(losing, {"one"}))[0]
    assert first == "Under none, no rule that a train can carry out gains anything over alone."
    assert "not among the rules" in sentences([line("exact", 0.1)], [])[0]
    assert "nothing to compare" in sentences([line(REFERENCE, 0.0)], [])[0]


def test_who_delivers_too_much_is_not_named_the_best_and_who_passes_the_oracle_is_warned_of():
    lines = [
        line(REFERENCE, 0.0), line("plan-times", 0.06, over=0.03), line("exact", 0.02, over=MOST_OVER),
        line("oracle", 0.05),
    ]  # fmt: skip
    found = standings(lines, {"one"})
    assert [(one.rule, one.ranked) for one in found] == [
        ("plan-times", False), ("oracle", False), ("exact", True),
    ]  # fmt: skip
    said = " ".join(sentences(lines, found))
    assert "carry out, exact gains most (+2.00 under none)" in said
    assert "Not ranked" in said
    assert "plan-times under none (3.0 %)" in said
    assert (
        "Warning: under none, plan-times uses more of the bound than oracle (+6.00 against" in said
    )
    # none is left to be named
    lines = [line(REFERENCE, 0.0), line("plan-times", 0.03, over=0.03), line("oracle", 0.05)]
    (said,) = sentences(lines, standings(lines, {"one"}))
    assert said.startswith("Not ranked")
    (group,) = tables(lines, {}, 200)
    notes = [str(one) for one in group.renderables if isinstance(one, str)]
    assert any("rank by effort: plan-times, none" in note for note in notes)


def test_gains_are_those_of_the_study_headroom(made):
    found = {(one.scenario, one.rule, one.controller): one for one in made.material.gains}
    assert {scenario for scenario, _, _ in found} == {"short"}
    assert len(found) == 2 * len(report_pages.CONTROLLERS)
    runs = {job.rule: simulate_job(job) for job in made.grid.jobs() if job.label.endswith("/cut-and-ramp/0")
            and job.scenario.name == "short"}  # fmt: skip
    one = found["short", "exact", "cut-and-ramp"]
    use = {rule: measure(run)["plan_use"] for rule, run in runs.items()}
    assert one.gain == pytest.approx(use["exact"] - use["alone"])
    assert one.headroom == pytest.approx(headroom(runs["oracle"]))


@pytest.mark.slow
def test_random_events_that_the_study_holds_stand_behind(tmp_path):
    # a folder without the study gives no gains and stays as it is
    assert drawn_gains(tmp_path, ("alone", "exact"), ("cut-and-ramp",)) == []
    assert not list(tmp_path.iterdir())
    table = HEADROOM.run(study_folder(tmp_path, "headroom"), 1)
    found = drawn_gains(tmp_path, ("alone", "exact"), ("cut-and-ramp", "mpc"))
    (one,) = found  # of one event, one rule beside alone, and the controller that the study has
    own = table[table["controller"] == "cut-and-ramp"].set_index("rule")
    assert one.drawn
    assert one.gain == pytest.approx(own.loc["exact", "plan_use"] - own.loc["alone", "plan_use"])
    assert one.headroom == pytest.approx(own.loc["oracle", "headroom"])


def row_of(columns, mean):
    """A row of the table whose metrics, and differences, are all this mean."""
    metrics = {one.metric: mean for one in columns}
    (row,) = table_rows(
        [SummaryLine("one", "exact", "none", 3, 0, 0, (), metrics, metrics)], columns
    )
    return row


def test_a_difference_is_tinted_by_the_side_that_is_better_and_its_text_has_the_headings_unit():
    columns = [one for one in COLUMNS if one.metric in ("effort_ratio", "slip_time", "headroom")]

    def tints(value, half_width):
        row = row_of(columns, evenly(value, half_width))
        return {one.metric: cell.tint for one, cell in zip(columns, row.differences, strict=True)}

    assert tints(0.2, 0.1) == {"effort_ratio": "better", "headroom": "other", "slip_time": "worse"}
    assert tints(-0.2, 0.1) == {"effort_ratio": "worse", "headroom": "other", "slip_time": "better"}
    for half_width in (0.3, math.nan):
        assert set(tints(0.2, half_width).values()) == {""}
    effort = [one for one in COLUMNS if one.metric == "effort_ratio"]
    for ends, texts in (
        ((0.9123, 0.9, 0.9246), ("91.2 ±1.2", "+91.23 ±1.23")),
        ((0.98, 0.9, 1.0), ("98.0 +2.0/-8.0", "+98.00 +2.00/-8.00")),
        ((-0.00001, math.nan, math.nan), ("0.0", "+0.00")),  # no minus zero
    ):
        row = row_of(effort, Interval(*ends, 3))
        assert (row.values[0].text, row.differences[0].text) == texts


RAISING = """
from alloc.onboard.host import HostedController, TorqueDecision, each_unit
from alloc.onboard.host import CONTROLLERS


class Raising:
    def __init__(self, context):
        pass

    def decide(self, sense):
        if sense.time > 0.4:
            raise RuntimeError("no </td> today")
        return TorqueDecision(sense.target, True, "ok", 0.0)


CONTROLLERS.register("raising", HostedController("raising", "breaks after a while", each_unit(Raising)))
"""


def test_a_second_call_runs_nothing_and_replaces_the_file_or_leaves_the_old_one(
    call, short_file, tmp_path, monkeypatch
):
    file, rows = tmp_path / "page.html", tmp_path / "results" / "rows"
    grid = (
        "--scenario", short_file, "--rules", "alone,exact", "--controllers", "none", "--seeds", 2, "--jobs", 1,
    )  # fmt: skip
    report = ("report", *grid, "--results", tmp_path / "results", "--out", file)
    # rows of a comparison are taken over
    call("compare", *grid, "--no-figures", "--json", "--out", tmp_path / "results")
    before = sorted(rows.iterdir())
    assert call(*report)[0] == 0
    assert sorted(rows.iterdir()) == before
    first = file.read_text()
    file.write_text("old")
    monkeypatch.setattr("studies.core.run.run_cell", None)
    code, out, _ = call(*report)
    assert code == 0
    assert "4 runs, 2 replays" in out
    pairs = zip(first.splitlines(), file.read_text().splitlines(), strict=True)
    assert all("<dt>made</dt>" in one for one, other in pairs if one != other)
    file.write_text("old")
    monkeypatch.setattr("studies.report.page.MOST_BYTES", 10)
    monkeypatch.setattr("studies.report.page.rendered.__defaults__", (10,))
    code, _, err = call(*report)
    assert code == 2
    assert "fewer events" in err
    assert file.read_text() == "old"


def test_runs_that_fail_are_shown_with_their_reason(call, short_file, tmp_path):
    plugin = tmp_path / "raising.py"
    plugin.write_text(RAISING)
    page = tmp_path / "page.html"
    code, out, _ = call(
        "--plugin", plugin, "report", "--scenario", short_file, "--rules", "alone", "--controllers", "none,raising",
        "--seeds", 1, "--jobs", 1, "--results", tmp_path / "results", "--out", page,
    )  # fmt: skip
    text = page.read_text()
    assert code == 0
    assert "1 failed" in out
    assert "1 of 1 failed" in text
    assert "RuntimeError: no &lt;/td&gt; today" in text
    assert 'data-replay="short/alone/none/0"' in text
    assert 'data-replay="short/alone/raising/0"' not in text
    assert "2 runs, of which 1 count" in text


def test_a_missing_package_is_named_before_anything_is_run(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "plotly", None)
    code, _, err = call("report", "--scenario", "wet-patch")
    assert code == 2
    assert "pip install -e '.[report]'" in err
    assert not list(tmp_path.iterdir())
