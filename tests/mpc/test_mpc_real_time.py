"""The real-time iteration solves the same problem as ipopt, and says so when it cannot."""

from dataclasses import replace

import numpy as np
import pytest

from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings
from tests.benchmarks.ipopt_peer import ReferenceSolver

SETTINGS = MpcSettings()
SEEDS = range(12)


@pytest.fixture(scope="module")
def references(context, random_problem):
    """Random problems and what ipopt finds for them, from the torque in force on."""
    solver = ReferenceSolver(context, SETTINGS)
    problems = [random_problem(context, seed) for seed in SEEDS]
    return [(p, solver.solve(p, np.full(SETTINGS.horizon, p.before))) for p in problems]


def test_references_are_converged(references):
    assert [solution.status for _, solution in references] == ["ok"] * len(SEEDS)
    assert max(solution.residual for _, solution in references) < 1e-8


@pytest.mark.parametrize("exact", [False, True], ids=["Gauss-Newton", "exact Hessian"])
def test_repeated_iteration_converges_to_the_reference(context, references, exact):
    # constant measured state: one step per call, as in the loop, but without the shift
    solver = RealTimeIteration(context, replace(SETTINGS, exact_hessian=exact, tolerance=1e-7))
    calls = 20 if exact else 60
    for problem, reference in references:
        solver.restart(problem.before)
        costs = []
        for _ in range(calls):
            solution = solver.solve(problem)
            assert solution.status == "ok"
            costs.append(solution.cost)
        assert np.all(np.diff(costs) <= 1e-12 * costs[0]), "no step may raise the cost"
        assert solution.cost == pytest.approx(reference.cost, rel=1e-6, abs=1e-8)
        error = np.abs(solution.torques - reference.torques).max()
        assert error < 1e-4 * solver.period.guess.scale[0]
        assert solution.residual < (1e-6 if exact else 5e-3)


def test_one_step_solves_a_problem_without_slip(context, random_problem):
    # far below the peak the model is linear and the limit inactive: the quadratic model is the problem
    problem = random_problem(context, 2)
    problem.parameters[:4] = 0.4
    state = np.array([10.0, *[10.0 / 0.43] * 4, 0.0])
    problem = problem._replace(state=state, before=0.0, target=200.0, slip_limit=np.ones(4))
    solver = RealTimeIteration(context, SETTINGS)
    torques = solver.solve(problem).torques
    assert torques[0] < torques[-1] <= 200.0  # the rate is weighed
    assert solver.solve(problem).residual < 1e-10


def test_bounds_hold(context, random_problem):
    solver = RealTimeIteration(context, SETTINGS)
    for seed in SEEDS:
        for upper in (0.0, 50.0, 400.0):
            solver.restart(1000.0)
            problem = random_problem(context, seed)._replace(upper=upper)
            torques = solver.solve(problem).torques
            assert np.all((torques >= 0.0) & (torques <= upper))
    # some bound is active, else the test would show nothing
    assert np.any(torques == upper)


def test_solution_is_not_overwritten_by_the_next(context, random_problem):
    solver = RealTimeIteration(context, SETTINGS)
    first = solver.solve(random_problem(context, 1)).torques
    kept = first.copy()
    solver.shift()
    solver.solve(random_problem(context, 3))
    np.testing.assert_array_equal(first, kept)


def test_shift_moves_the_guess_on(context):
    solver = RealTimeIteration(context, SETTINGS)
    solver.torques[:] = np.arange(SETTINGS.horizon)
    solver.shift()
    np.testing.assert_array_equal(solver.torques, [*range(1, SETTINGS.horizon), 19])


@pytest.mark.parametrize("field", ["state", "parameters", "target"])
def test_nan_is_reported(context, random_problem, field):
    problem = random_problem(context, 1)
    value = getattr(problem, field)
    bad = np.nan if np.isscalar(value) else np.full_like(value, np.nan)
    solution = RealTimeIteration(context, SETTINGS).solve(problem._replace(**{field: bad}))
    assert solution.status == "not finite"


@pytest.mark.parametrize("iterations", [1, 5])
def test_no_more_steps_than_asked_for(context, random_problem, iterations):
    solver = RealTimeIteration(context, replace(SETTINGS, iterations=iterations, tolerance=0.0))
    assert solver.solve(random_problem(context, 3)).iterations == iterations
