"""Solvers on trial: problems are what their families say; a solver that is wrong, boasts, hangs or crashes is noticed."""

import os
import sys
import time

import numpy as np
import pandas as pd
import pytest

from studies import StudyError, solvers
from tests.cases import looped

PROMISES = {
    "growing": lambda m, low, high: np.all(np.diff(high) >= 0.0), "ties": lambda m, low, high: np.unique(high).size <= 3,
    "pinned": lambda m, low, high: 0.25 < np.mean(low == high) < 0.6, "zero caps": lambda m, low, high: (high == 0.0).any(),
    "near ties": lambda m, low, high: 0.0 < m @ high / (m.sum() * solvers.PLAN) - 1.0 < 2e-7,
}  # fmt: skip


@looped("family", solvers.FAMILIES)
def test_families_keep_their_promise_and_the_optimum_its_conditions(family):
    for mass, ask, low, high in (solvers.draw(family, n, 0, 1) for n in solvers.SIZES):
        assert PROMISES.get(family, lambda *_: True)(mass, low, high)
        best = solvers.exact_limits((mass, ask, low, high))
        assert np.isfinite(best).all() == (family != "infeasible")
        if family != "infeasible":
            assert mass @ best == pytest.approx(ask, rel=1e-14)
            assert np.all((low <= best) & (best <= high))
            assert np.unique(best[(low < best) & (best < high)]).size <= 1  # one level


def by_level(solver, program, options):
    yield None, "built"
    {"hangs": lambda: time.sleep(60.0), "crashes": os.abort}.get(solver, int)()
    best = solvers.exact_limits(program)
    x = np.nan_to_num(best) + 1e-4 * solvers.PLAN if solver == "spoiled" else best
    yield x, "infeasible" if np.isnan(best).any() and solver != "boasts" else "solved"


def test_what_a_solver_does_wrong_is_noticed():
    wanted = {"true": [0, 0, 0, 0, ""], "spoiled": [50, 0, 0, 100, ""], "boasts": [50, 0, 0, 0, ""]}
    rows, wanted = [], wanted | {end: [0, 100, 100, 0, end] for end in ("hangs", "crashes")}
    keys = {"setting": "tight", "n": 8, "event": 0, "seed": 1}
    tasks = [keys | {"family": family} for family in ("plain", "infeasible")]
    for solver in wanted:
        several = solvers.try_solver(by_level, solver, tasks, 0.5 if solver == "hangs" else 60.0)
        rows += [row | {"solver": solver, "by": "test"} for row in several]
    lines = solvers.table(pd.DataFrame(rows)).set_index("solver").iloc[:, [4, 5, 6, 7, 10]]
    assert dict(zip(lines.index, lines.to_numpy().tolist(), strict=True)) == wanted


def test_a_solver_of_each_library_is_near_the_exact_level():
    pytest.importorskip("qpsolvers")
    for library, adapter in solvers.ADAPTERS.items():
        program = solvers.draw("plain", 8, 0, 1)
        *_, (x, verdict) = adapter("DAQP" if library == "cvxpy" else "daqp", program, {})
        assert verdict == "solved", library
        assert np.ravel(x) == pytest.approx(solvers.exact_limits(program), abs=1e-9)


def test_without_qpsolvers_there_is_one_line_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "qpsolvers", None)
    with pytest.raises(StudyError, match=r"pip install -e '.\[solvers\]'"):
        solvers.cells(1, 0)
