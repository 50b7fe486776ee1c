"""The figures of the patent show the numbers that its statements are made from, and what was learnt."""

import numpy as np
import pytest

from paper_figs.drawing import FIGURES, Source
from paper_figs.patent import (
    CLAIM_TABLE,
    FEW_CLAIMS,
    FEW_EVENTS,
    LEARNERS,
    LOOKS,
    claim_verdicts,
    claim_verdicts_search,
    learning,
)
from paper_figs.rules import differences
from studies.core.drawn_events import COMPARED, Arm
from studies.core.statement import FAILS, HOLDS
from studies.core.store import Store
from studies.core.study import Study
from studies.patent.claims_study import CLAIM_STUDY, LAYERS
from studies.patent.differences_study import DIFFERENCES
from studies.patent.learning_study import TOLERANCE
from tests.studies.learning_tables import falling
from tests.studies.learning_tables import synthetic as learning_table
from tests.studies.sweep_tables import claim_table as synthetic


def test_the_table_of_claims_is_the_sweeps_and_what_it_lacks_is_run(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(Study, "run", lambda self, *arguments: asked.append(arguments))
    source = Source(Store(tmp_path), None, 2)
    CLAIM_TABLE(source)
    monkeypatch.setattr(Study, "held", lambda self, folder: 300)
    CLAIM_TABLE(source)
    assert [arguments[1] for arguments in asked] == [FEW_CLAIMS, 300]
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
    for module in ("studies.patent.claims_study", "paper_figs.patent"):
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


def test_learning_shows_each_series_their_mean_and_how_many_are_within_the_tolerance():
    table = learning_table(falling, trains=3)
    table.loc[(table["train"] == 2) & (table["arm"] == "Gaussian"), "error"] = 0.01
    sound = table[table["case"] == "sound"]
    kinds = list(sound[["rail", "stored"]].drop_duplicates().itertuples(index=False, name=None))
    panels = np.reshape(learning(table).axes, (len(kinds), len(LEARNERS)))
    for (rail, stored), row in zip(kinds, panels, strict=True):
        rows = sound[(sound["rail"] == rail) & (sound["stored"] == stored)]
        for arm, axes in zip(LEARNERS, row, strict=True):
            own = rows[rows["arm"] == arm]
            lines = {line.get_label(): line for line in axes.get_lines()}
            np.testing.assert_allclose(
                lines["_mean"].get_ydata(), own.groupby("station")["error"].mean()
            )
            ends = own[own["station"] == own["station"].max()]["error"]
            series = [line for line in axes.get_lines() if line.get_label() == "_train"]
            assert sorted(line.get_ydata()[-1] for line in series) == sorted(ends)
            within = int((ends <= TOLERANCE).sum())
            assert f"{within} of {len(ends)} within" in [text.get_text() for text in axes.texts]
            assert set(lines["tolerance"].get_ydata()) == {TOLERANCE}


def test_the_table_is_the_sweeps(tmp_path, monkeypatch):
    asked = []

    def run(self, *arguments):
        asked.append(arguments)
        return learning_table(falling, trains=1)

    monkeypatch.setattr(Study, "run", run)
    FIGURES["learning"].make(Source(Store(tmp_path), None, 2))
    assert asked == [(tmp_path / "sweeps" / "learning", FEW_EVENTS, 0, 2, None)]
