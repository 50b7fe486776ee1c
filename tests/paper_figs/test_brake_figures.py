"""Figures of brake force show what was measured and estimated, and who is accused."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from paper_figs.brakes import ACCUSED, FAULT, brake_cut_out, faulty_car
from paper_figs.drawing import FIGURES, Source
from studies.brake_force.faulty_car import allocated_stops
from studies.brake_force.statements import CUT_OUT
from studies.core.store import Store
from studies.core.study import Study
from tests.studies.brake_tables import brake_table


def test_the_line_is_that_of_the_means_and_each_day_is_off_it_by_what_is_drawn():
    table = brake_table()
    forces, off = brake_cut_out(table).axes
    line, means = (np.transpose(one.get_data()) for one in forces.get_lines())
    slope = (line[1, 1] - line[0, 1]) / (line[1, 0] - line[0, 0])
    assert slope == pytest.approx(33.0, abs=0.5)
    drawn = np.transpose(off.containers[0].lines[0].get_data())
    rows = table[table["test"].isin(list(CUT_OUT))]
    expected = rows["mean"] - (line[0, 1] + slope * rows["test"].map(CUT_OUT))
    np.testing.assert_allclose(sorted(drawn[:, 1]), sorted(expected), atol=1e-6)
    # days stand beside each other, nearer to their own number of wagons than to another
    count = means[np.abs(drawn[:, [0]] - means[:, 0]).argmin(axis=1), 0]
    assert sorted(count) == sorted(rows["test"].map(CUT_OUT))
    assert len({round(x, 6) for x in drawn[:, 0]}) == len(drawn)


def test_bars_are_shortfalls_and_the_accused_stand_out():
    (stop,) = allocated_stops(FAULT, 2)
    table, found = brake_table(), stop.shortfalls()
    axes = faulty_car([stop], table[table["part"] == "driven"]).axes[0]
    bars = axes.containers[0]
    np.testing.assert_allclose(
        [bar.get_height() for bar in bars], np.nan_to_num(found.shortfall) / 1e3
    )
    accused = [k for k, bar in enumerate(bars) if to_hex(bar.get_facecolor()) == ACCUSED]
    assert accused == sorted(found.accused)
    assert FAULT.car in accused
    words = " ".join(text.get_text() for text in axes.texts)
    assert f"car {FAULT.car + 1} is accused" in words
    assert words.count("not judged") == np.isnan(found.shortfall).sum()


def test_the_shares_are_the_sweeps_where_it_was_run(tmp_path, monkeypatch):
    monkeypatch.setattr(Study, "held", lambda self, folder: 7)
    asked = []
    monkeypatch.setattr(
        Study, "run", lambda self, folder, days, *_: asked.append(days) or brake_table()
    )
    FIGURES["brake-cut-out"].make(Source(Store(tmp_path)))
    assert asked == [7]
