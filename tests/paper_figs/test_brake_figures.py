"""Figures of the running tests show what was measured, estimated and true."""

import numpy as np
import pytest
from matplotlib.colors import to_hex

from paper_figs.brake_force import (
    ACCUSED,
    FAULT,
    brake_cut_out,
    brake_emergency,
    brake_locomotive_only,
    faulty_car,
)
from paper_figs.registry import FIGURES
from paper_figs.source import Source
from studies.brake_force.faulty_car import allocated_stops
from studies.brake_force.running_tests import BRAKED_AT, estimate, run_test, smooth
from studies.brake_force.statements import CUT_OUT
from studies.core.store import Store
from studies.core.study import Study
from tests.studies.brake_tables import brake_table


def test_a_running_test_is_shown_as_it_was_measured():
    result = run_test("locomotive", 2)
    m, found = result.measured, estimate(result)
    speed, _, coupler, force = brake_locomotive_only(result).axes
    np.testing.assert_allclose(speed.get_lines()[0].get_xdata(), m.time - BRAKED_AT)
    np.testing.assert_allclose(coupler.get_lines()[0].get_ydata(), m.coupler_force[:, 0] / 1e3)
    wagons, locomotive, *true = (np.asarray(line.get_ydata()) for line in force.get_lines())
    np.testing.assert_allclose(wagons, found.wagons / 1e3)
    np.testing.assert_allclose(locomotive, found.locomotive / 1e3)
    np.testing.assert_allclose(true[1], result.true_force[:, 0] / 1e3)


def test_the_emergency_brake_is_held_against_the_truth():
    result = run_test("all", 2)  # six cars are drawn as eighteen are, and sooner run
    found, smoothed = estimate(result), smooth(result)
    panels = np.reshape(brake_emergency(result).axes, (4, 2))
    true = result.true_force[:, 1:].sum(axis=1), result.true_force[:, 1]
    for axes, truth, theory in zip(panels[0], true, (5 * found.theory, found.theory), strict=True):
        lines = {line.get_label(): np.asarray(line.get_ydata()) for line in axes.get_lines()}
        np.testing.assert_allclose(lines["truth"], truth / 1e3)
        np.testing.assert_allclose(lines["theory"], theory / 1e3)
    estimates = (
        (found.wagons, found.wagon),
        (found.wagons_own, found.wagon),
        (smoothed.total(slice(1, None))[0], smoothed.force[:, 1]),
    )
    for row, forces in zip(panels[1:], estimates, strict=True):
        for axes, force, truth in zip(row, forces, true, strict=True):
            error = (force - truth) / 1e3
            np.testing.assert_allclose(axes.get_lines()[1].get_ydata(), error)
            size = np.sqrt(np.mean(error[result.window] ** 2))
            assert axes.get_title(loc="left").endswith(f"{size:.3g} kN rms")


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
