"""The readhesion paper's scenario in lanes, its findings, and the search for its limits."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.metrics.search import readhesion_possible
from studies.readhesion_paper import sensitivity as readhesion_grid
from studies.readhesion_paper.findings import (
    CLAIMS,
    UNMET,
    WORST,
    Finding,
    case_findings,
    grid_findings,
    objective,
)
from studies.readhesion_paper.paper import (
    CALIBRATED,
    CASE_A,
    CASE_B,
    DROP,
    PAPER_LIMITS,
    RECOVERY,
    Case,
    Unprinted,
    assess,
    longest_slip,
    run_cases,
    signals_of,
    slip_spans,
)
from studies.readhesion_paper.sensitivity import FINE_STEP, Cases, grid_tables, search_limits
from tests.studies.readhesion_tables import index_rows, limit_of

COARSE = 5e-4
"""Step [s] at which a run is cheap and its indices are still the same to some per cent."""


@pytest.fixture(scope="module")
def low():
    return run_cases(CALIBRATED, [CASE_A, CASE_B], step=COARSE)


def test_the_rail_is_the_same_until_it_recovers(low):
    recovering = run_cases(CALIBRATED, [CASE_A, CASE_B], recovers=True, step=COARSE)
    before = recovering.time < RECOVERY - 0.02
    rows = np.flatnonzero(before)
    for name in ("slip", "torque", "coefficient", "factor"):
        np.testing.assert_array_equal(getattr(recovering, name)[rows], getattr(low, name)[rows])
    assert (recovering.peak[-1] == 0.18).all()
    np.testing.assert_allclose(low.peak[-1], 0.12)


def test_a_case_does_not_depend_on_its_company(low):
    alone = run_cases(CALIBRATED, [CASE_B], step=COARSE)
    np.testing.assert_array_equal(alone.slip[:, 0], low.slip[:, 1])


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


def test_the_calibrated_set_shows_the_cases_of_the_paper(low):
    assert readhesion_possible(signals_of(low)).tolist() == [True, False]
    found = case_findings(low)
    assert [name for name, finding in found.items() if not finding.met] == []


def test_cases_in_the_wrong_place_are_not_those_of_the_paper(low):
    found = case_findings(low, lane_a=1, lane_b=0)
    for name in ("A readheres", "A period", "B diverges", "B factor rests"):
        assert not found[name].met
        assert found[name].misfit > 0.0


def test_what_the_paper_found_is_found_in_its_grid():
    found = grid_findings(index_rows())
    assert {name for name, finding in found.items() if not finding.met} == set()
    assert all(finding.misfit == 0.0 for finding in found.values())


@pytest.mark.parametrize(
    ("changed", "lost"),
    [
        (lambda m, w: 0.1, {"wide never", "width raises limit", "margin lowers limit", "width is steeper"}),
        (lambda m, w: limit_of(m, w) if w < 0.45 else np.inf, {"narrow somewhere"}),
        (lambda m, w: limit_of(0.9 - m, w), {"margin lowers limit"}),
        (lambda m, w: limit_of(8.0 * m - 3.0, 0.15 + 0.25 * w) if w < 0.59 else np.inf, {"width is steeper"}),
    ],
)  # fmt: skip
def test_another_grid_loses_a_finding(changed, lost):
    found = grid_findings(index_rows(changed))
    assert lost <= {name for name, finding in found.items() if not finding.met}


def test_a_half_slip_is_told_by_its_time_and_its_cost():
    table = index_rows()
    short = grid_findings(table.assign(longest_slip=0.4))["half-slip lasts"]
    cheap = grid_findings(table.assign(used_coefficient=table["limit"]))["half-slip costs"]
    assert not short.met
    assert not cheap.met


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
