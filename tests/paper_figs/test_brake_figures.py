"""Figures of the running tests show what was measured, estimated and true."""

import numpy as np
import pytest

from paper_figs.brake_force import (
    FAULT,
    brake_cut_out,
    brake_emergency,
    brake_locomotive_only,
    faulty_car,
)
from paper_figs.registry import FIGURES
from paper_figs.source import Source
from studies.brake_force.faulty_car import allocated_stops
from studies.brake_force.running_tests import BRAKED_AT, estimate, run_test
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


def test_the_emergency_brake_is_shown_beside_its_theory():
    result = run_test("all", 2)  # six cars are drawn as eighteen are, and sooner run
    found = estimate(result)
    sums, _, single, _ = brake_emergency(result).axes
    np.testing.assert_allclose(sums.get_lines()[0].get_ydata(), found.wagons / 1e3)
    np.testing.assert_allclose(sums.get_lines()[1].get_ydata(), 5 * found.theory / 1e3)
    np.testing.assert_allclose(single.get_lines()[1].get_ydata(), found.theory / 1e3)


def test_the_line_is_that_of_the_means():
    axes = brake_cut_out(brake_table()).axes[0]
    line = next(one for one in axes.get_lines() if "line" in str(one.get_label()))
    assert np.diff(line.get_ydata())[0] / np.diff(line.get_xdata())[0] == pytest.approx(
        33.0, abs=0.5
    )


def test_bars_are_means_over_the_stop_and_the_accused_stand_out():
    (stop,) = allocated_stops(FAULT, 2)
    table = brake_table()
    bars = faulty_car([stop], table[table["part"] == "driven"]).axes[0]
    allocated, *found = bars.containers[:3]
    w = stop.window
    np.testing.assert_allclose(
        [b.get_height() for b in allocated], stop.allocated[w].mean(axis=0) / 1e3
    )
    accused = [round(b.get_x() + 0.19 - 0.2) - 1 for b in found[1]]
    assert sorted(accused) == sorted(stop.shortfalls().accused)
    assert FAULT.car in accused


def test_the_shares_are_the_sweeps_where_it_was_run(tmp_path, monkeypatch):
    monkeypatch.setattr(Study, "held", lambda self, folder: 7)
    asked = []
    monkeypatch.setattr(
        Study, "run", lambda self, folder, days, *_: asked.append(days) or brake_table()
    )
    FIGURES["brake-cut-out"].make(Source(Store(tmp_path)))
    assert asked == [7]
