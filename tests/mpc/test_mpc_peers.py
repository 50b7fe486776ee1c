"""Solvers of other packages find the optimum of `mpc.reference`: do-mpc, acados."""

import sys

import numpy as np
import pytest

from mpc.period import Problem, RealTimeIteration, cost_of
from mpc.reference import solve
from mpc.settings import MpcSettings
from tests.benchmarks.acados_peer import AcadosSolver
from tests.benchmarks.do_mpc_peer import DoMpcSolver
from tests.benchmarks.peer_iteration import PEERS, missing
from tests.benchmarks.stages import stages
from tests.mpc.parts import model_at_guess

SETTINGS = MpcSettings()
SCALE_ERROR = 1e-4
"""Greatest difference of a torque, over the torque scale."""


@pytest.mark.skipif(missing("do-mpc with ipopt") != "", reason=missing("do-mpc with ipopt"))
@pytest.mark.parametrize("axles", [1, 4])
def test_do_mpc_finds_the_optimum(make_context, random_problem, axles):
    context = make_context(axles=axles)
    solver = DoMpcSolver(context, SETTINGS)
    for seed in range(6):
        problem = random_problem(context, seed)
        other = solver.solve(problem, np.full(SETTINGS.horizon, problem.before))
        assert other.status == "ok"
        assert _error(other.torques, context, problem) < SCALE_ERROR


def _error(torques, context, problem):
    """Greatest difference of a torque from the optimum's, over the torque scale."""
    plan = solve(Problem(context, SETTINGS, problem), "ipopt")
    return np.abs(torques - plan.torques.ravel()).max() / cost_of(context, SETTINGS).unit.scale[0]


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
    acados = AcadosSolver(context, SETTINGS)
    acados.restart(problem, problem.before)
    for _ in range(10):
        solution = acados.solve(problem)
        assert solution.status == "ok"
    assert _error(solution.torques, context, problem) < SCALE_ERROR


@pytest.mark.parametrize(
    ("name", "package"), [("acados SQP_RTI", "acados_template"), ("do-mpc with ipopt", "do_mpc")]
)
def test_without_its_package_a_peer_says_so(context, monkeypatch, name, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=package):
        PEERS[name](context, SETTINGS)
