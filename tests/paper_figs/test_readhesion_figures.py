"""Figures of the readhesion paper show its runs and its sweep."""

import numpy as np
import pytest

from paper_figs.drawing import FIGURES, Source
from paper_figs.readhesion_paper import (
    case_runs,
    margin_sweep,
    on_coefficient_scale,
    readhesion_slip,
    readhesion_torque,
    readhesion_trajectory,
    width_sweep,
)
from studies.core.store import Store
from studies.core.study import Study
from studies.readhesion_paper.paper import DROP, RECOVERY
from studies.readhesion_paper.study import MOST_MEMBERS
from tests.paper_figs import small_figures
from tests.studies.readhesion_tables import limit_of, sweep_table


@pytest.fixture(scope="module")
def both():
    """Runs of the set of each unit."""
    return small_figures.cases()


@pytest.fixture(scope="module")
def runs(both):
    return both[0]


def data(line):
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def test_torque_and_coefficient_lie_on_each_other_until_the_wheel_slips(runs):
    held = (runs.time > 3.0) & (runs.time < DROP - 0.1)
    for lane in range(2):
        torque = on_coefficient_scale(runs, lane)
        np.testing.assert_allclose(torque[held], runs.coefficient[held, lane], rtol=2e-3)


def test_slip_and_torque_are_those_of_the_runs_in_both_units(both):
    axes = np.reshape(readhesion_slip(*both).axes, (3, 2)).T
    for column, runs in zip(axes, both, strict=True):
        for one, lane in zip(column, (0, 1, 1), strict=True):
            np.testing.assert_array_equal(data(one.get_lines()[0])[1], runs.slip[:, lane])
            np.testing.assert_array_equal(data(one.get_lines()[1])[1], runs.peak_slip[:, lane])
    axes = np.reshape(readhesion_torque(*both).axes, (2, 2)).T
    for column, runs in zip(axes, both, strict=True):
        for lane, one in enumerate(column):
            np.testing.assert_array_equal(data(one.get_lines()[1])[1], runs.coefficient[:, lane])


def test_trajectories_end_before_the_rail_recovers(both):
    axes = np.reshape(readhesion_trajectory(*both).axes, (2, 2)).T
    for column, runs in zip(axes, both, strict=True):
        shown = (runs.time >= DROP) & (runs.time < RECOVERY - 0.02)
        for lane, one in enumerate(column):
            slip, torque = data(one.get_lines()[0])
            np.testing.assert_array_equal(slip, runs.slip[shown, lane])
            np.testing.assert_array_equal(torque, on_coefficient_scale(runs, lane)[shown])


@pytest.mark.parametrize(("figure", "over"), [(margin_sweep, "margin"), (width_sweep, "width")])
def test_a_sweep_shows_what_readheres_in_both_units(figure, over):
    for axes in figure(sweep_table()).axes[:2]:
        good, bad, limits = (data(line) for line in axes.get_lines()[:3])
        for mu, value in zip(*good, strict=True):
            assert mu >= (limit_of(value, 0.2) if over == "margin" else limit_of(0.4, value))
        for mu, value in zip(*bad, strict=True):
            assert mu < (limit_of(value, 0.2) if over == "margin" else limit_of(0.4, value))
        assert len(good[0]) + len(bad[0]) == 150
        assert np.isfinite(limits[0]).sum() == (10 if over == "margin" else 5)


def test_a_sweep_shows_between_which_limits_the_members_lie():
    table = sweep_table()
    chosen = (table["unit"] == "m/s2") & (table["member"] == 1)
    table.loc[chosen, "limit_coefficient"] += 0.01
    left, right = (
        [data(line) for line in axes.get_lines()[3:]] for axes in width_sweep(table).axes[:2]
    )
    assert all(np.ptp(mu) == 0.0 for mu, _ in left if mu.size)
    assert all(np.ptp(mu) == pytest.approx(0.009) for mu, _ in right if mu.size)


def test_data_come_from_the_sweeps_of_the_results(tmp_path, monkeypatch):
    source, asked = Source(Store(tmp_path), jobs=2), []

    def run(self, folder, events, seed, jobs, on_row):
        asked.append((folder.name, events, seed, jobs))
        return sweep_table()

    monkeypatch.setattr(Study, "run", run)
    for name in ("margin-sweep", "width-sweep"):
        assert len(FIGURES[name].make(source).axes) >= 3
    assert asked == [("readhesion", MOST_MEMBERS, 0, 2)] * 2


def test_runs_are_made_once(monkeypatch):
    calls = []
    monkeypatch.setattr("paper_figs.readhesion_paper.run_cases", lambda *a, **k: calls.append(a))
    case_runs.cache_clear()
    case_runs()
    case_runs()
    assert len(calls) == 1
    case_runs.cache_clear()
