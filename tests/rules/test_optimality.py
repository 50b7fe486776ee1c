"""Every solver of the allocation's QP satisfies its optimality conditions; what a rule gives away is measured."""

import numpy as np
import pytest
import qpsolvers
from hypothesis import given
from scipy import sparse

from alloc.rules import AllocationProblem, find_rule, optimality
from alloc.rules.exact import exact_in_box
from alloc.rules.problem import allocation
from alloc.rules.testing import EXPECTED, problems

ACCURACY = 1e-9 * EXPECTED


@pytest.mark.parametrize("solver", qpsolvers.available_solvers)
def test_every_installed_solver_gives_the_exact_limits(solver):
    generator = np.random.default_rng(3)
    # a first-order method (scs) and a simplex-like one (highs) reach what their own tolerances allow
    accuracy = {"scs": 1e-5, "highs": 1e-6}.get(solver, 1e-7)
    options = {
        "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9},
        "osqp": {"eps_abs": 1e-10, "eps_rel": 1e-10, "raise_error": True},
    }
    for n in (1, 3, 8, 16):
        cap = EXPECTED * generator.uniform(0.6, 1.6, n)
        mass = generator.uniform(0.5, 1.5, n)
        problem = AllocationProblem(cap, EXPECTED, mass=mass)
        quadratic = sparse.diags(mass).tocsc()
        total = np.array([mass.sum() * problem.attainable / EXPECTED])
        dense = solver in ("quadprog", "daqp")
        x = qpsolvers.solve_qp(
            quadratic.toarray() if dense else quadratic, -mass,
            A=mass[None, :] if dense else sparse.csc_matrix(mass[None, :]), b=total,
            lb=np.zeros(n), ub=cap / EXPECTED, solver=solver, **options.get(solver, {}),
        )  # fmt: skip
        exact = find_rule("exact")(problem)
        assert x is not None
        np.testing.assert_allclose(EXPECTED * x, exact.limit, atol=accuracy)


@given(problem=problems(64, bounded=False))
def test_gap_of_the_reference_is_its_excess_and_nothing_else(problem):
    answer = find_rule("greedy")(problem)
    check = optimality(problem, answer)
    # the only condition that it misses is the sum, by what it delivers beyond the plan
    assert check.primal == pytest.approx(
        answer.excess(problem) if answer.case == "B" else 0.0, abs=1e-15
    )
    assert check.stationarity <= 1e-15
    assert check.complementarity <= 1e-15
    assert check.dual <= 1e-15
    if check.primal > 1e-12:
        assert check.gap > 0.0


@given(problem=problems(24))
def test_checker_finds_a_limit_moved_from_the_optimum(problem):
    limit = np.empty(problem.n)
    level, case = exact_in_box(problem, limit)
    moved = limit.copy()
    moved[0] += 1e-3
    check = optimality(problem, allocation(problem, moved, level, case, 0.0))
    share = problem.weight[0] / problem.weight.sum()
    assert check.worst >= 0.99e-3 * share
    assert check.gap == pytest.approx(1e-3 * np.sqrt(share), rel=1e-6)
