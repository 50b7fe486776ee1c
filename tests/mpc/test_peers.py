"""Solvers of other packages: on recorded problems, and in the place of the real-time iteration."""

import sys

import numpy as np
import pytest
import qpsolvers

from alloc.simulation import simulate
from mpc.hosted import MPC
from mpc.period import Problem, RealTimeIteration, cost_of
from mpc.reference import solve
from mpc.settings import MpcSettings
from tests.benchmarks import closed_loop
from tests.benchmarks.closed_loop import drawn_event
from tests.benchmarks.peers import (
    NEEDED,
    PEERS,
    AcadosSolver,
    DoMpcSolver,
    QpsolversIteration,
    iterations,
    missing,
    stages,
)
from tests.cases import looped
from tests.mpc.made_problems import model_at_guess

SETTINGS = MpcSettings()


SCALE_ERROR = 1e-4


"""Greatest difference of a torque, over the torque scale."""


@pytest.mark.skipif(missing("do-mpc with ipopt") != "", reason=missing("do-mpc with ipopt"))
@looped("axles", [1, 4])
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


LONG = drawn_event(1, 1)


SHORT_HORIZON = MpcSettings(horizon=5)


SAME_USE = 1e-4


"""Difference of the adhesion used that exact solvers may have."""


def way(iteration, settings=closed_loop.SETTINGS, name="other"):
    return closed_loop.Way(name, closed_loop.with_solver(iteration, settings))


@pytest.fixture(scope="module")
def own():
    return closed_loop.run(way(RealTimeIteration, name="own"), LONG)


def test_the_comparison_runs_the_controller_that_ships():
    recorded = simulate(LONG, "alone", MPC)
    for each in closed_loop.ways()[:2]:
        found = closed_loop.run(each, LONG)
        assert found.used == closed_loop.METRICS.find("utilisation_short").function(recorded)
        assert found.calls == recorded.attrs["controller_calls"]
        assert found.failures == 0


@looped("name", ["daqp", "quadprog"])
def test_the_iteration_with_an_exact_qp_solver_runs_as_the_own(own, name):
    found = closed_loop.run(way(iterations()[name]), LONG)
    assert found.failures == 0
    assert found.used == pytest.approx(own.used, abs=SAME_USE)
    assert found.damage == pytest.approx(own.damage, rel=1e-3)
    assert found.step_error < 1e-6
    # without demand nothing is solved
    assert 0.9 * found.calls < len(found.asked.iterations) < found.calls
    assert max(found.asked.iterations) <= closed_loop.SETTINGS.iterations


def test_a_solver_that_finds_nothing_is_counted(own):
    class Program(QpsolversIteration):
        """Solves two programs of three."""

        asked = 0

        def __init__(self, units, settings):
            super().__init__(units, settings, name="daqp")

        def program(self, *problem):
            self.asked += 1
            return None if self.asked % 3 == 0 else super().program(*problem)

    found = closed_loop.run(way(Program), LONG)
    assert 0.2 * found.calls < found.failures < found.calls
    row = closed_loop.table([own, found]).loc["other"]
    assert row["failures"] == found.failures
    assert row["used"] == pytest.approx(found.used)


def test_a_program_without_an_answer_has_none(context):
    solver = QpsolversIteration(context, SHORT_HORIZON, name="quadprog")
    n = SHORT_HORIZON.horizon
    bounds = -np.ones(n), np.ones(n)
    np.testing.assert_allclose(solver.program(np.eye(n), np.full(n, 3.0), *bounds), -1.0)
    assert [solved.error for solved in solver.solved] == pytest.approx([0.0], abs=1e-9)
    assert solver.program(-np.eye(n), np.ones(n), *bounds) is None


def test_what_is_not_installed_is_named(context, monkeypatch):
    with pytest.raises(ImportError, match=r"'sedumi' is not installed; there are .*daqp"):
        QpsolversIteration(context, SHORT_HORIZON, name="sedumi")
    assert set(iterations()) == set(qpsolvers.available_solvers)
    monkeypatch.setattr("tests.benchmarks.peers.find_spec", lambda name: None)
    assert [bool(missing(name)) for name in PEERS] == [name in NEEDED for name in PEERS]
    assert "pip install" in missing("do-mpc with ipopt")
