"""Other solvers in the place of the real-time iteration: they are what answers, and what they lack shows."""

from dataclasses import replace

import numpy as np
import pytest
import qpsolvers

from alloc.simulation import simulate
from mpc.hosted import MPC
from mpc.period import RealTimeIteration
from mpc.settings import MpcSettings
from tests.benchmarks import closed_loop
from tests.benchmarks.closed_loop_events import DROP, drawn_event
from tests.benchmarks.peer_iteration import NEEDED, PEERS, missing
from tests.benchmarks.qpsolvers_peer import QpsolversIteration, Solved, iterations

EVENT = replace(drawn_event(1, 0), duration=DROP + 0.5)
LONG = drawn_event(1, 1)
SHORT_HORIZON = MpcSettings(horizon=5)
CONVERGED = replace(closed_loop.CONVERGED, horizon=5)
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


@pytest.mark.parametrize("name", ["daqp", "quadprog"])
def test_the_iteration_with_an_exact_qp_solver_runs_as_the_own(own, name):
    found = closed_loop.run(way(iterations()[name]), LONG)
    assert found.failures == 0
    assert found.used == pytest.approx(own.used, abs=SAME_USE)
    assert found.damage == pytest.approx(own.damage, rel=1e-3)
    assert found.step_error < 1e-6
    # without demand nothing is solved
    assert 0.9 * found.calls < len(found.asked.iterations) < found.calls
    assert max(found.asked.iterations) <= closed_loop.SETTINGS.iterations


@pytest.mark.parametrize("name", ["fatrop", "do-mpc with ipopt"])
def test_a_converging_peer_runs_as_the_converged_iteration(name):
    if missing(name):
        pytest.skip(missing(name))
    runs = [
        closed_loop.run(way(PEERS[name], SHORT_HORIZON, "peer"), EVENT),
        closed_loop.run(way(RealTimeIteration, CONVERGED, "converged"), EVENT),
    ]
    assert [one.failures for one in runs] == [0, 0]
    assert 0.5 < runs[0].used < 1.0
    # it is the peer that was asked: it takes more than the own may
    assert max(runs[0].asked.iterations) > SHORT_HORIZON.iterations
    assert closed_loop.differences(runs, "converged")["peer"] < SAME_USE


def test_a_solver_that_gives_too_little_is_seen(own):
    class Half(RealTimeIteration):
        """Answers with half of the torques."""

        def solve(self, problem):
            solution = super().solve(problem)
            return solution._replace(torques=0.5 * solution.torques)

    found = closed_loop.run(way(Half), LONG)
    assert closed_loop.differences([own, found], "own")["other"] > 0.2
    assert found.damage < 0.7 * own.damage


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


def test_a_wrong_solution_of_a_program_has_an_error():
    program = Solved(
        np.eye(2), np.array([-0.5, -3.0]), -np.ones(2), np.ones(2), np.array([0.5, 0.9])
    )
    assert program.error == pytest.approx(0.1)


def test_what_is_not_installed_is_named(context, monkeypatch):
    with pytest.raises(ImportError, match=r"'sedumi' is not installed; there are .*daqp"):
        QpsolversIteration(context, SHORT_HORIZON, name="sedumi")
    assert set(iterations()) == set(qpsolvers.available_solvers)
    monkeypatch.setattr("tests.benchmarks.peer_iteration.find_spec", lambda name: None)
    assert [bool(missing(name)) for name in PEERS] == [name in NEEDED for name in PEERS]
    assert "pip install" in missing("do-mpc with ipopt")
