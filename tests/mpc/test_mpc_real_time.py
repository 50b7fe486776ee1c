"""The real-time iteration lowers the cost step by step within its bounds, and says so when it cannot."""

from dataclasses import replace

import numpy as np
import pytest

from mpc.period import RealTimeIteration
from mpc.settings import MpcSettings

SETTINGS = MpcSettings()
SEEDS = range(12)


def test_no_step_raises_the_cost(context, random_problem):
    # constant measured state: one step per call, as in the loop, but without the shift
    solver = RealTimeIteration(context, replace(SETTINGS, iterations=1))
    for seed in SEEDS:
        solver.restart(random_problem(context, seed).before)
        costs = [solver.solve(random_problem(context, seed)).cost for _ in range(20)]
        assert np.all(np.diff(costs) <= 1e-12 * costs[0])


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
