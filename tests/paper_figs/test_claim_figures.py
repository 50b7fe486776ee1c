"""The figures of the claims show the numbers that the statements are made from."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from paper_figs.claims import (
    CLAIM_TABLE,
    CONTROLLER,
    FEW_EVENTS,
    RULE,
    claim_a,
    claim_b,
    claim_c,
    claim_d,
    claim_e,
    claim_verdicts,
    claim_verdicts_search,
)
from paper_figs.differences import differences
from paper_figs.source import Source
from paper_figs.verdicts import LOOKS
from studies.claims.statements import LAYERS, statement_name
from studies.claims.study import CLAIMS as CLAIM_STUDY
from studies.core.arms import COMPARED, Arm
from studies.core.statement import FAILS, HOLDS
from studies.core.store import Store
from studies.core.study import Study
from studies.differences.study import DIFFERENCES
from tests.studies.sweep_tables import claim_table as synthetic

CLAIMS = {"a": claim_a, "b": claim_b, "c": claim_c, "d": claim_d, "e": claim_e}


def whole(axes) -> float:
    """Value of the first mark of a forest: all events."""
    return next(float(c.lines[0].get_xdata()[0]) for c in axes.containers)


def test_the_forest_starts_with_the_number_of_the_statement():
    table = synthetic(80)
    statements = {one.name: one for one in CLAIM_STUDY.statements(table)}
    for claim, draw in CLAIMS.items():
        axes = draw(table).axes[1]
        numbers = statements[statement_name(claim, Arm(RULE, CONTROLLER))].numbers
        factor = 1.0 if claim == "d" else 100.0
        assert whole(axes) == pytest.approx(factor * next(iter(numbers.values())).value), claim
        assert axes.get_yticklabels()[0].get_text().startswith("all (")
        assert not draw(synthetic(4)).axes[1].containers  # few events leave marks out


def test_a_part_that_fails_stands_on_the_other_side():
    def change(row):
        worse = row["rule"] == RULE and row["season"] == "winter"
        return row | {"jerk_rms": 0.6} if worse else row

    axes = claim_d(synthetic(120, change)).axes[1]
    names = [label.get_text().split(" (")[0] for label in axes.get_yticklabels()]
    marks = {names[round(c.lines[0].get_ydata()[0])]: c for c in axes.containers}
    ends = {
        name: next(part for part in c.lines[2] if isinstance(part, LineCollection)).get_segments()[
            0
        ]
        for name, c in marks.items()
    }
    assert ends["winter"][:, 0].min() > 0.0 > ends["summer"][:, 0].max()


def test_the_table_is_the_sweeps_and_what_it_lacks_is_run(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(Study, "run", lambda self, *arguments: asked.append(arguments))
    source = Source(Store(tmp_path), None, 2)
    CLAIM_TABLE(source)
    monkeypatch.setattr(Study, "held", lambda self, folder: 300)
    CLAIM_TABLE(source)
    assert [arguments[1] for arguments in asked] == [FEW_EVENTS, 300]
    assert asked[0][0] == tmp_path / "sweeps" / "claims"


def test_differences_show_the_quartiles_of_the_problems(tmp_path):
    table = DIFFERENCES.run(tmp_path, 30, 0, 1, duration=2.5)
    axes = differences(table).axes[0]
    chosen = table[(table["part"] == "problem") & (table["kind"] == "plain")]
    rows = chosen[(chosen["rule"] == "greedy") & chosen["within_reach"].astype(bool)]
    median = np.quantile(100 * (rows["over"] - rows["short"]), 0.5)
    assert axes.get_lines()[2].get_xdata()[0] == pytest.approx(median)


def test_verdicts_are_drawn_over_their_thresholds(monkeypatch):
    """Dots are the estimates in the colour of the verdict; the line is the threshold; the shade the side claimed."""
    for module in ("studies.claims.statements", "paper_figs.claims"):
        monkeypatch.setattr(f"{module}.ARMS", (Arm("greedy", "cut-and-ramp"),))
    table = synthetic(
        120, lambda row: row | ({"unit_use_low": 0.8} if row["rule"] == "greedy" else {})
    )
    found = {s.name: s for s in CLAIM_STUDY.statements(table)}
    figure = claim_verdicts(table)
    assert [axes.get_title(loc="left")[1] for axes in figure.axes] == list("abcde")
    for axes, statement in zip(figure.axes, found.values(), strict=True):
        factor, test = 1.0 if statement.name == "d" else 100.0, statement.test
        look = LOOKS[statement.verdict]
        (dot,) = [line for line in axes.lines if line.get_marker() == look["marker"]]
        assert dot.get_xdata()[0] == pytest.approx(factor * test.estimate.value)
        assert dot.get_color() == look["color"]
        threshold = factor * test.threshold
        assert any(list(line.get_xdata()) == [threshold, threshold] for line in axes.lines)
        (shade,) = axes.patches
        ends = sorted((shade.get_x(), shade.get_x() + shade.get_width()))
        assert ends[0 if test.direction == "at least" else 1] == pytest.approx(threshold)
        low, high = axes.get_xlim()
        ends = [factor * end for end in (test.adjusted.low, test.adjusted.high)]
        assert low < min(*ends, threshold)
        assert high > max(*ends, threshold)
        (words,) = axes.texts
        assert words.get_text().startswith(f"{statement.verdict}, n = {test.estimate.count}\n")
    assert found["b"].verdict == FAILS


def test_verdicts_on_few_events_say_so():
    figure = claim_verdicts(synthetic(4))
    assert all(axes.texts[0].get_text().startswith("too few events") for axes in figure.axes)


def test_each_controller_has_its_own_verdicts():
    """The claims hold under the one, and under the other claim (b) fails, in its own figure alone."""
    table = synthetic(
        120, lambda row: row | ({"unit_use_low": 0.8} if row["controller"] == COMPARED[1] else {})
    )
    for draw, verdict in ((claim_verdicts, HOLDS), (claim_verdicts_search, FAILS)):
        axes = draw(table).axes[1]
        assert [label.get_text() for label in axes.get_yticklabels()] == list(LAYERS)
        assert [words.get_text().partition(",")[0] for words in axes.texts] == [verdict] * 4
