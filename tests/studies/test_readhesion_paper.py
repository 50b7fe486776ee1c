"""The readhesion paper's scenario in lanes, its findings, the search for its limits, and the model reduced from it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.event import DriverCommand
from alloc.metrics.search import readhesion_possible
from alloc.onboard.controllers.simple import TorqueTable
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from studies.readhesion_paper import calibration as readhesion_grid
from studies.readhesion_paper.calibration import FINE_STEP, Cases, grid_tables, search_limits
from studies.readhesion_paper.findings import (
    CLAIMS,
    UNMET,
    WORST,
    Finding,
    case_findings,
    grid_findings,
    objective,
)
from studies.readhesion_paper.lanes import simulate_tables
from studies.readhesion_paper.limit_cycle import (
    SLIP,
    critical_gain,
    critical_width,
    growth,
    reduced_model,
)
from studies.readhesion_paper.paper import (
    CALIBRATED,
    CASE_A,
    CASE_B,
    DROP,
    PAPER_LIMITS,
    RECOVERY,
    RIVAL,
    Case,
    Unprinted,
    assess,
    longest_slip,
    rail,
    run_cases,
    signals_of,
    slip_spans,
)
from tests.cases import looped
from tests.plant.numpy_plant import compiled_rate
from tests.studies.made_tables import index_rows, limit_of

COARSE = 5e-4
"""Step [s] at which a run is cheap and its indices are still the same to some per cent."""


@pytest.fixture(scope="module")
def low():
    return run_cases(CALIBRATED, [CASE_A, CASE_B], step=COARSE)


def test_a_case_depends_neither_on_its_company_nor_on_what_the_rail_does_later(low):
    recovering = run_cases(CALIBRATED, [CASE_A, CASE_B], recovers=True, step=COARSE)
    before = recovering.time < RECOVERY - 0.02
    rows = np.flatnonzero(before)
    for name in ("slip", "torque", "coefficient", "factor"):
        np.testing.assert_array_equal(getattr(recovering, name)[rows], getattr(low, name)[rows])
    assert (recovering.peak[-1] == 0.18).all()
    np.testing.assert_allclose(low.peak[-1], 0.12)
    alone = run_cases(CALIBRATED, [CASE_B], step=COARSE)
    np.testing.assert_array_equal(alone.slip[:, 0], low.slip[:, 1])


@looped("one", [CALIBRATED, RIVAL])
def test_cases_a_and_b_do_not_tell_a_constant_mu_inf_from_a_proportional_one(one):
    """Both have mu_lim 0.12; at another one the curves differ beyond the peak alone."""
    cases = [CASE_A, CASE_B]
    either = [run_cases(replace(one, constant=c), cases, step=COARSE) for c in (False, True)]
    found, other = (case_findings(runs) for runs in either)
    assert {name: f.met for name, f in found.items()} == {name: f.met for name, f in other.items()}
    both = one.curve, replace(one, constant=True).curve
    for peak in (0.16, 0.08):
        micro, macro = (curve.coefficient([0.01, 5.0], peak) for curve in both)
        assert micro[0] == macro[0]
        assert (macro[1] < micro[1]) == (peak > CASE_A.limit)


def test_numbers_in_another_unit_are_another_table():
    per_hour, si = (Unprinted(unit=unit).table(0.36, 0.72) for unit in ("km/h/s", "m/s2"))
    assert (si.margin, si.width) == (0.36, 0.72)
    assert per_hour.margin == pytest.approx(0.1)
    assert per_hour.width == pytest.approx(0.2)


def test_rows_are_in_the_order_of_the_cases():
    cases = [Case(0.4, 0.2, mu) for mu in (0.16, 0.04)] + [Case(0.4, 0.8, 0.12)]
    table = assess(CALIBRATED, cases, step=COARSE)
    assert list(table[["margin", "width", "limit"]].itertuples(index=False, name=None)) == cases
    np.testing.assert_allclose(table["utilisation"], table["used_coefficient"] / table["limit"])
    assert (table["utilisation"] < 1.0).all()
    assert table["possible"].tolist() == [True, False, False]


def test_slips_end_with_the_window(low):
    spans = slip_spans(low, 1)
    assert (np.diff(spans, axis=1) > 0.0).all()
    assert spans[0, 0] >= DROP
    assert spans[-1, 1] == pytest.approx(RECOVERY, abs=2e-3)
    assert longest_slip(low, 1) == max(end - begin for begin, end in spans)
    assert longest_slip(replace(low, slip=0.0 * low.slip), 1) == 0.0


def test_the_calibrated_set_shows_the_cases_of_the_paper_and_in_the_wrong_place_they_are_not_those(
    low,
):
    assert readhesion_possible(signals_of(low)).tolist() == [True, False]
    found = case_findings(low)
    assert [name for name, finding in found.items() if not finding.met] == []
    found = case_findings(low, lane_a=1, lane_b=0)
    for name in ("A readheres", "A period", "B diverges", "B factor rests"):
        assert not found[name].met
        assert found[name].misfit > 0.0


def test_what_the_paper_found_is_found_in_its_grid_and_another_grid_loses_a_finding():
    found = grid_findings(index_rows())
    assert {name for name, finding in found.items() if not finding.met} == set()
    assert all(finding.misfit == 0.0 for finding in found.values())
    for changed, lost in (
        (lambda m, w: 0.1, {"wide never", "width raises limit", "margin lowers limit", "width is steeper"}),
        (lambda m, w: limit_of(m, w) if w < 0.45 else np.inf, {"narrow somewhere"}),
        (lambda m, w: limit_of(0.9 - m, w), {"margin lowers limit"}),
        (lambda m, w: limit_of(8.0 * m - 3.0, 0.15 + 0.25 * w) if w < 0.59 else np.inf, {"width is steeper"}),
    ):  # fmt: skip
        found = grid_findings(index_rows(changed))
        assert lost <= {name for name, finding in found.items() if not finding.met}
    # a half-slip is told by its time and its cost
    table = index_rows()
    assert not grid_findings(table.assign(longest_slip=0.4))["half-slip lasts"].met
    cheap = table.assign(used_coefficient=table["limit"])
    assert not grid_findings(cheap)["half-slip costs"].met


@given(st.lists(st.tuples(st.booleans(), st.floats(0.0, WORST)), max_size=len(CLAIMS)))
def test_the_objective_grows_with_what_is_missing(parts):
    names = list(CLAIMS)
    found = {
        name: Finding(met, misfit, {}) for name, (met, misfit) in zip(names, parts, strict=False)
    }
    asked = sum(m for _, m in parts) + UNMET * sum(not met for met, _ in parts)
    rest = (WORST + UNMET) * (len(CLAIMS) - len(parts))
    assert objective(found) == pytest.approx(asked + rest)
    assert objective({name: Finding(True, 0.0, {}) for name in names}) == 0.0


@pytest.fixture
def asked(monkeypatch):
    """Cases that would have been run; the synthetic controller answers instead."""
    calls = []

    def stub(unprinted, cases, jobs, step, top_curvature):
        calls.extend(cases)
        table = pd.DataFrame(cases, columns=list(Case._fields))
        table["possible"] = [mu >= limit_of(margin, width) for margin, width, mu in cases]
        return table

    monkeypatch.setattr(readhesion_grid, "assess", stub)
    return calls


def test_limits_are_found_on_the_papers_grid_and_beyond(asked):
    tables = grid_tables((0.0, 0.4, 0.9), (0.2, 0.5, 0.8))
    cases = Cases(CALIBRATED)
    found = search_limits(cases, tables, tolerance=5e-4)
    truth = np.array([limit_of(*table) for table in tables])
    known = np.isfinite(truth)
    assert np.isnan(found.limit[~known]).all()
    assert np.all((found.limit >= truth)[known] & (found.fails_at < truth)[known])
    assert np.all((found.limit - found.fails_at)[known] <= 5e-4 * (1 + 1e-6))
    for table in tables:
        tried = {case.limit for case in asked if case[:2] == table}
        assert {round(mu, 9) for mu in PAPER_LIMITS} <= tried
    own = [case.limit for case in asked if case[:2] == (0.4, 0.2)]
    by_fine_step = round(0.11 + FINE_STEP, 9)  # the limit of this one lies between 0.11 and 0.12
    assert by_fine_step in own
    assert len(asked) == len(set(asked)) == len(cases.table)


def test_a_case_is_run_once(asked):
    cases = Cases(CALIBRATED)
    first = cases.rows([CASE_A, CASE_B, CASE_A])
    assert asked == [CASE_A, CASE_B]
    again = cases.rows([CASE_B, Case(0.1 + 0.3, 0.2, 0.12)])  # the sum is not quite 0.4
    assert asked == [CASE_A, CASE_B]
    assert first["possible"].tolist() == [True, False, True]
    assert again["possible"].tolist() == [False, True]


ACCELERATION = 3.0 / 3.6
NARROW, WIDE = TorqueTable(width=0.2 / 3.6), TorqueTable(width=0.8 / 3.6)
LAG = 5e-3


@pytest.fixture(scope="module")
def train():
    return find_set("one-axle")


def model(train, table, peak=0.12, curve=None):
    return reduced_model(train, table, curve or PiecewiseCurve(), peak, ACCELERATION)


@pytest.fixture(scope="module")
def runs(train):
    """The paper's cases A and B, simulated."""
    return simulate_tables(
        train, [rail(0.12)] * 2, [NARROW, WIDE], DriverCommand((0.0,), (ACCELERATION,)), 0.0, 14.0
    )


def test_slip_accelerates_as_in_the_plant(train):
    """On a rail good enough for the parabola to begin late, the micro-slip line is the plant's own curve."""
    peak, torque, speed = 0.4, 700.0, 5.0
    plant = build(train, Rail(peak))
    s, n = plant.structure, plant.layout
    reduced = model(train, NARROW, peak)
    for slip in (0.003, 0.02):
        state = plant.initial_state(speed)
        state[n.omega], state[n.torque] = (speed + slip) / s.radius[0], torque
        slope, _ = compiled_rate(plant, state, plant.zero_inputs())
        rate = s.radius[0] * slope[n.omega][0] - slope[n.speed][0]
        point = np.array([slip, torque, 0.0, 0.0, 1.0])
        assert reduced.rates(reduced.mode(point))[SLIP] @ point == pytest.approx(rate, rel=1e-9)


def test_critical_gain_of_one_filter_time_is_that_of_hurwitz_and_of_two_lies_between():
    """(1 + a s)(1 + b s)(1 + c s) + L has its roots on the imaginary axis at 1 + L = (a + b + c)(1/a + 1/b + 1/c)."""
    for lag, tau, filter_time in ((5e-3, 0.18, 0.25), (0.02, 0.1, 1.0)):
        table = TorqueTable(rise=filter_time, fall=filter_time, time_constant=tau)
        times = np.array([lag, tau, filter_time])
        expected = times.sum() * (1.0 / times).sum() - 1.0
        assert critical_gain(table, lag) == pytest.approx(expected, rel=2e-3)
    fast, both, slow = (
        critical_gain(TorqueTable(rise=rise, fall=fall, time_constant=0.18), LAG)
        for rise, fall in ((0.25, 0.25), (1.8, 0.25), (1.8, 1.8))
    )
    assert fast < both < slow
    sizes = [growth(NARROW, LAG, gain) for gain in (50.0, 100.0, 200.0, 400.0, 800.0)]
    assert sizes == sorted(sizes)
    assert sizes[0] < 1.0 < sizes[-1]


def test_the_critical_width_has_the_critical_gain(train):
    width = critical_width(model(train, NARROW))
    at_width = model(train, TorqueTable(width=width))
    assert at_width.gain == pytest.approx(critical_gain(NARROW, at_width.lag), rel=1e-6)


def test_wheels_run_away_at_the_predicted_factor(train, runs):
    """Case B: the factor settles, and far out on the curve's tail it is the one of the equilibrium."""
    predicted = model(train, WIDE).runaway()
    late = (runs.time > 12.0) & (runs.time < 13.9)
    assert runs.slip[late, 1].min() > 1.0
    assert predicted.slip_rate > 0.0
    assert runs.factor[late, 1] == pytest.approx(predicted.factor, abs=5e-3)
    growth_rate = np.gradient(runs.slip[late, 1], runs.time[late])
    assert growth_rate == pytest.approx(predicted.slip_rate, rel=0.05)


def test_the_limit_cycle_is_about_as_simulated(train, runs):
    """Case A. The reduced curve has a corner for its peak, which costs several per cent of the period."""
    predicted = model(train, NARROW).limit_cycle()
    late = (runs.time > 10.0) & (runs.time < 13.9)
    torque, slip = runs.torque[late, 0], runs.slip[late, 0]
    starts = np.flatnonzero((np.diff(torque[:-1]) < 0.0) & (np.diff(torque[1:]) >= 0.0))
    period = np.diff(runs.time[late][starts]).mean()
    assert predicted.period == pytest.approx(period, rel=0.12)
    assert np.ptp(predicted.torque) == pytest.approx(np.ptp(torque), rel=0.25)
    assert predicted.slip[1] == pytest.approx(slip.max(), rel=0.25)


def test_a_rail_that_carries_the_plan_needs_no_limit_cycle(train):
    assert model(train, NARROW, peak=0.2).limit_cycle() is None
