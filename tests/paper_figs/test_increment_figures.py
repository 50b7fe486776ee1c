"""Figures of detection and increments show what was recorded and computed."""

import numpy as np
import pytest

from alloc.estimation import increments
from alloc.estimation.increments import SYNTHETIC_TABLE, SlideCounts, read_slide_counts
from alloc.onboard.parameters import Detector
from alloc.plant.rail import logarithmic_increments
from paper_figs.adhesion import PLANNED, planned, planned_curves
from paper_figs.events import UNIT, slip_detection
from paper_figs.increments import (
    AXLES,
    DRIVES,
    FEW_EVENTS,
    LEARNERS,
    axle_shifts,
    learning,
    unit_increments,
)
from paper_figs.registry import FIGURES
from paper_figs.source import Source
from studies.core.store import Store
from studies.core.study import Study
from studies.learning.series import TOLERANCE
from tests.studies.learning_tables import falling, synthetic


@pytest.fixture
def run(runs):
    return runs[0]


def test_detection_shows_the_recorded_acceleration_between_the_thresholds(run):
    detector = Detector()
    axes = slip_detection(run, detector).axes
    line, on, off = axes[0].get_lines()[:3]
    time = np.asarray(line.get_xdata())
    recorded = run["computed_acceleration"].sel(time=time).values[:, UNIT]
    np.testing.assert_array_equal(line.get_ydata(), recorded)
    assert (on.get_ydata()[0], off.get_ydata()[0]) == (detector.on, detector.off)
    signal = np.asarray(axes[2].get_lines()[0].get_ydata())
    assert 0.0 < signal.mean() < 1.0
    # the signal goes on where one of the two thresholds is passed
    slip = np.asarray(axes[1].get_lines()[0].get_ydata())
    onset = np.flatnonzero(np.diff(signal) > 0) + 1
    assert np.all((recorded[onset] > detector.on) | (slip[onset] > 0.9 * detector.speed_on))


def test_a_unit_that_never_slips_is_drawn_too(run):
    quiet = run.copy()
    quiet["slipping"] = 0 * run["slipping"]
    assert len(slip_detection(quiet, Detector()).axes) == 3


def test_planned_curves_are_the_laws():
    # JP5484215 (12) by hand: 13.6 / (100 + 85); Curtius and Kniffler: 7.5 / 144 + 0.161
    assert planned("shinkansen", np.array([100.0]))[0] == pytest.approx(13.6 / 185)
    law = planned("curtius-kniffler", np.array([100.0]))[0]
    assert law == pytest.approx(7.5 / 144 + 0.161)
    left, right = planned_curves().axes
    assert len(left.get_lines()) == len(PLANNED)
    ratio = np.asarray(right.get_lines()[0].get_ydata())
    assert np.all(np.diff(ratio) > 0.0)  # the Shinkansen's curve falls faster


def test_shifts_are_the_tables_and_labelled_synthetic():
    counts = read_slide_counts(SYNTHETIC_TABLE)
    figure = axle_shifts(counts)
    left, right = figure.axes
    assert figure.get_suptitle().startswith("SYNTHETIC")
    assert [bar.get_height() for bar in left.patches] == counts.slides.tolist()
    points = right.containers[0].lines[0].get_ydata()
    np.testing.assert_array_equal(points, increments.axle_shifts(counts).shift)
    fit = increments.fit_increments(increments.axle_shifts(counts)).increments()
    assert any(np.array_equal(line.get_ydata(), fit) for line in right.get_lines())


def test_counts_that_were_measured_are_not_called_synthetic():
    measured = SlideCounts(np.array([50, 48, 40, 40, 30, 30, 25, 20]), "brakings of one winter")
    assert axle_shifts(measured).get_suptitle() == ""


def test_a_units_line_spans_its_axles_at_its_increment():
    left, right = unit_increments().axes
    per_axle = logarithmic_increments(AXLES)
    for line, (axles, *_) in zip(left.get_lines(), DRIVES.values(), strict=True):
        level = np.asarray(line.get_ydata())[::3]
        expected = increments.unit_increments(per_axle, np.arange(AXLES) // axles)
        np.testing.assert_allclose(level, expected)
        spans = np.asarray(line.get_xdata()).reshape(-1, 3)[:, :2]
        assert np.all(np.diff(spans, axis=1) < axles)
    ends = [float(np.asarray(line.get_ydata())[-1]) for line in right.get_lines()]
    assert ends == sorted(ends)  # the correction grows with speed


def test_learning_shows_each_series_their_mean_and_how_many_are_within_the_tolerance():
    table = synthetic(falling, trains=3)
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
        return synthetic(falling, trains=1)

    monkeypatch.setattr(Study, "run", run)
    FIGURES["learning"].make(Source(Store(tmp_path), None, 2))
    assert asked == [(tmp_path / "sweeps" / "learning", FEW_EVENTS, 0, 2, None)]
