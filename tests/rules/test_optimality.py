"""Every solver of the allocation's QP satisfies its optimality conditions; what a rule gives away is measured."""

import numpy as np
import pytest
import qpsolvers
from hypothesis import given, settings
from scipy import sparse

from alloc.rules import RULES, AllocationProblem, find_rule, optimality
from alloc.rules.exact import exact_in_box
from alloc.rules.problem import allocation
from tests.rules.strategies import EXPECTED, caps, problems

ACCURACY = 1e-9 * EXPECTED


@given(problem=problems(bounded=True))
def test_exact_limits_satisfy_every_condition(problem):
    check = optimality(problem, find_rule("exact")(problem))
    assert check.worst <= 1e-12


@settings(max_examples=60)
@given(problem=problems(bounded=True))
def test_qp_satisfies_every_condition(problem):
    answer = find_rule("qp")(problem)
    assert answer.status == "ok"
    check = optimality(problem, answer)
    assert check.worst <= 1e-12
    assert check.gap <= 1e-12


@given(problem=problems())
def test_qp_equals_the_exact_level_with_equal_masses(problem):
    qp, exact = find_rule("qp")(problem), find_rule("exact")(problem)
    assert qp.case == exact.case
    np.testing.assert_allclose(qp.limit, exact.limit, rtol=0.0, atol=1e-12)


@settings(max_examples=25)
@given(problem=problems(bounded=True, largest=12))
def test_cvxpy_states_the_same_problem(problem):
    answer, exact = find_rule("qp-cvxpy")(problem), find_rule("exact")(problem)
    assert answer.status == "ok"
    assert answer.case == exact.case
    np.testing.assert_allclose(answer.limit, exact.limit, rtol=0.0, atol=1e-12)


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


@given(cap=caps())
def test_gap_of_the_reference_is_its_excess_and_nothing_else(cap):
    problem = AllocationProblem(cap, EXPECTED)
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


@given(problem=problems(bounded=True))
def test_checker_finds_a_limit_moved_from_the_optimum(problem):
    limit = np.empty(problem.n)
    level, case = exact_in_box(problem, limit)
    moved = limit.copy()
    moved[0] += 1e-3
    check = optimality(problem, allocation(problem, moved, level, case, 0.0))
    share = problem.weight[0] / problem.weight.sum()
    assert check.worst >= 0.99e-3 * share
    assert check.gap == pytest.approx(1e-3 * np.sqrt(share), rel=1e-6)


@pytest.mark.parametrize("rule", RULES)
@given(problem=problems(bounded=True, largest=6))
@settings(max_examples=20)
def test_checker_judges_every_rule(rule, problem):
    answer = find_rule(rule)(problem)
    check = optimality(problem, answer)
    values = (check.primal, check.dual, check.complementarity, check.stationarity, check.gap)
    assert np.all(np.isfinite(values))
    assert np.all(np.asarray(values) >= 0.0)
    if rule in ("exact", "oracle"):
        assert check.worst <= 1e-12
    if (
        check.worst <= 1e-12
    ):  # the program is strictly convex: who satisfies the conditions is the optimum
        assert check.gap <= 1e-9


@given(problem=problems(bounded=True))
def test_level_is_the_same_for_all_masses_inside_the_bounds(problem):
    answer = find_rule("exact")(problem)
    lower, upper = problem.box
    free = (answer.limit < upper - ACCURACY) & (answer.limit > lower + ACCURACY)
    assert np.all(np.abs(answer.limit[free] - answer.level) <= 1e-15)


def test_heavy_units_weigh_more_in_the_sum():
    # by hand: unit 1 lacks 0.05 x 2 t; units 2 and 3 (1 t each) make it up by 0.05 each
    problem = AllocationProblem([0.12, 0.30, 0.30], 0.17, mass=[2.0, 1.0, 1.0])
    assert find_rule("exact")(problem).limit == pytest.approx([0.12, 0.22, 0.22])
    assert find_rule("qp")(problem).limit == pytest.approx([0.12, 0.22, 0.22], abs=1e-9)
