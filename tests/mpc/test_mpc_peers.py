"""Solvers that share nothing but the model's right side find the same optimum: fatrop, ipopt in three ways, the own."""

import sys

import numpy as np
import pytest

from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings
from tests.benchmarks.acados_peer import AcadosSolver
from tests.benchmarks.fatrop_peer import FatropSolver
from tests.benchmarks.peer_iteration import CONVERGING, PEERS, missing
from tests.benchmarks.stages import stages
from tests.mpc.parts import model_at_guess

SETTINGS = MpcSettings(exact_hessian=True, iterations=50, tolerance=1e-7, step_time=1e-4)
SCALE_ERROR = 1e-4
"""Greatest difference of a torque, over the torque scale."""


@pytest.mark.parametrize("axles", [1, 4])
@pytest.mark.parametrize("name", CONVERGING)
def test_a_peer_and_the_converged_iteration_agree(make_context, random_problem, name, axles):
    if missing(name):
        pytest.skip(missing(name))
    context = make_context(axles=axles)
    iteration = RealTimeIteration(context, SETTINGS)
    solver = CONVERGING[name](context, SETTINGS)
    for seed in range(6):
        problem = random_problem(context, seed)
        guess = np.full(SETTINGS.horizon, problem.before)
        iteration.restart(problem.before)
        own = iteration.solve(problem)
        assert own.residual < 1e-6  # below, the cost's rounding hides whether a step lowers it
        other = solver.solve(problem, guess)
        assert other.status == "ok"
        assert other.cost == pytest.approx(own.cost, rel=1e-6, abs=1e-8) or np.isnan(other.cost)
        error = np.abs(other.torques - own.torques).max()
        assert error < SCALE_ERROR * iteration.period.guess.scale[0]


def test_fatrop_is_not_asked_what_has_no_answer(context, random_problem):
    problem = random_problem(context, 1)
    bad = problem._replace(state=np.full_like(problem.state, np.nan))
    assert FatropSolver(context, SETTINGS).solve(bad).status == "not finite"


def test_a_stage_is_a_step_of_the_model(context, random_problem):
    # the excess and the states that a structured solver sees are those of the real-time iteration
    iteration, made = RealTimeIteration(context, SETTINGS), stages(context, SETTINGS)
    problem = random_problem(context, 3)
    iteration.restart(400.0)
    model_at_guess(iteration, problem)
    controls = np.full(SETTINGS.horizon, 400.0 / made.torque_scale)
    trajectory = made.rollout(problem, controls)
    expected = iteration.period.around.nodes[1:]
    np.testing.assert_allclose(trajectory[:, :-1] * made.scale[:-1], expected, rtol=1e-9)
    np.testing.assert_allclose(trajectory[:, -1] * made.scale[-1], 400.0)
    slip = expected[:, 1:5] * context.radius - expected[:, :1]
    excess = np.asarray(made.excess(trajectory[-1], problem.slip_limit)).ravel()
    wanted = (slip[-1] - problem.slip_limit) / SETTINGS.weights.slip_scale
    np.testing.assert_allclose(excess, wanted, rtol=1e-6)


@pytest.mark.skipif(missing("acados SQP_RTI") != "", reason=missing("acados SQP_RTI"))
def test_acados_repeated_finds_the_same_torques(context, random_problem):
    # where Gauss-Newton steps converge without a line search, which acados' iteration does not have
    problem = random_problem(context, 0)
    acados, iteration = AcadosSolver(context, SETTINGS), RealTimeIteration(context, SETTINGS)
    acados.restart(problem, problem.before)
    iteration.restart(problem.before)
    for _ in range(10):
        solution = acados.solve(problem)
        assert solution.status == "ok"
    error = np.abs(solution.torques - iteration.solve(problem).torques).max()
    assert error < SCALE_ERROR * iteration.period.guess.scale[0]


@pytest.mark.parametrize(
    ("name", "package"), [("acados SQP_RTI", "acados_template"), ("do-mpc with ipopt", "do_mpc")]
)
def test_without_its_package_a_peer_says_so(context, monkeypatch, name, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=package):
        PEERS[name](context, SETTINGS)
