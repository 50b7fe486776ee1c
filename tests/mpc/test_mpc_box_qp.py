"""Quadratic programs within bounds: the conditions of optimality first, then what other solvers find."""

import daqp
import numpy as np
import pytest
import quadprog

from alloc.records import ByReference
from mpc.box_qp import ACCEPTED, box_workspace, solve_box_qp
from tests.mpc.box_programs import KINDS, program, violation

SEEDS = range(200)


def solved(hessian, gradient, lower, upper, start=None):
    """Solution and number of steps, or -1."""
    x = np.zeros(gradient.size) if start is None else start.copy()
    work = box_workspace(gradient.size)
    for part in work[:4]:
        part[:] = np.nan  # nothing may be read that was not written
    steps = solve_box_qp(hessian, gradient, lower, upper, x, ByReference(work))
    return x, steps


@pytest.mark.parametrize("kind", KINDS)
def test_no_slope_is_left_that_could_be_followed(kind):
    at_bounds = free = 0
    for seed in SEEDS:
        data = program(seed, kind)
        x, steps = solved(*data)
        assert steps >= 0
        assert violation(*data, x) <= ACCEPTED
        bound = (x == data[2]) | (x == data[3])
        at_bounds, free = at_bounds + bound.sum(), free + (~bound).sum()
    assert min(at_bounds, free) > 100


def test_other_solvers_find_the_same():
    for seed in SEEDS:
        hessian, gradient, lower, upper = program(seed, "regular")
        n = gradient.size
        x, _ = solved(hessian, gradient, lower, upper)
        sides = np.hstack([np.eye(n), -np.eye(n)])
        other = quadprog.solve_qp(hessian, -gradient, sides, np.concatenate([lower, -upper]))[0]
        np.testing.assert_allclose(x, other, atol=1e-8)
        model = daqp.Model()
        model.setup(
            hessian, gradient, np.zeros((0, n)), upper.copy(), lower.copy(), np.zeros(n, np.int32)
        )
        model.settings = {**model.settings, "primal_tol": 1e-12}
        np.testing.assert_allclose(x, model.solve()[0], atol=1e-8)


def test_the_start_does_not_matter_and_a_solution_is_one_at_once():
    for seed in SEEDS:
        data = program(seed, "regular")
        x, _ = solved(*data)
        for start in (data[2], data[3], np.random.default_rng(seed).uniform(-5.0, 5.0, x.size)):
            np.testing.assert_allclose(solved(*data, start)[0], x, atol=1e-9)
        again, steps = solved(*data, x)
        assert steps == 0
        np.testing.assert_array_equal(again, x)


def test_the_answer_is_the_same_every_time():
    data = program(7, "nearly singular")
    np.testing.assert_array_equal(solved(*data)[0], solved(*data)[0])


def test_without_curvature_the_slope_is_followed_to_the_bounds():
    gradient, lower, upper = np.array([1.0, -2.0, 0.0]), -np.ones(3), np.array([3.0, 4.0, 5.0])
    x, steps = solved(np.zeros((3, 3)), gradient, lower, upper)
    assert x.tolist() == [-1.0, 4.0, 0.0]
    assert steps >= 0
    # curvature along the sum of the two alone: the difference is free to go to its bound
    hessian, gradient = np.ones((2, 2)), np.array([-1.0, 0.5])
    x, _ = solved(hessian, gradient, np.full(2, -2.0), np.full(2, 3.0))
    assert violation(hessian, gradient, np.full(2, -2.0), np.full(2, 3.0), x) <= ACCEPTED
    np.testing.assert_allclose(x, [3.0, -2.0])


def test_bounds_may_be_infinite_where_there_is_curvature():
    hessian, gradient = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([1.0, -4.0])
    x, _ = solved(hessian, gradient, np.full(2, -np.inf), np.full(2, np.inf))
    np.testing.assert_allclose(x, np.linalg.solve(hessian, -gradient), rtol=1e-12)


def test_where_the_projection_raises_the_cost_the_bounds_are_met_one_by_one():
    # Newton's step ends at (2.6, -5.4); cut off at -1, it would raise the cost from 0 to 1.7
    hessian, gradient = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([2.26, 3.06])
    lower, upper = np.array([-10.0, -1.0]), np.array([10.0, 1.0])
    cut = np.array([2.6, -1.0])
    np.testing.assert_allclose(np.linalg.solve(hessian, -gradient), [2.6, -5.4], rtol=1e-9)
    assert gradient @ cut + 0.5 * cut @ hessian @ cut > 0.0
    x, _ = solved(hessian, gradient, lower, upper)
    np.testing.assert_allclose(x, [-1.36, -1.0], rtol=1e-12)


@pytest.mark.parametrize("part", range(4))
def test_what_is_no_number_is_refused(part):
    data = [value.copy() for value in program(3, "regular")]
    data[part].flat[0] = np.nan
    assert solved(*data)[1] == -1


def test_bounds_in_the_wrong_order_are_refused():
    hessian, gradient, lower, upper = program(3, "regular")
    assert solved(hessian, gradient, upper + 1.0, lower)[1] == -1


def test_what_is_not_convex_ends():
    hessian = -np.eye(5)
    assert solved(hessian, np.ones(5), -np.ones(5), np.ones(5))[1] >= -1
