"""Steps of the real-time iteration, its model of the unit replaced: when it stops, how far it goes, what it answers."""

import math
from types import SimpleNamespace

import daqp
import numpy as np
import pytest

import mpc.real_time as real_time
from mpc.condensing import Quadratic
from mpc.horizon import HorizonProblem
from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings, Weights

SCALE = np.array([10.0, 20.0])
PROBLEM = HorizonProblem(np.zeros(1), np.zeros(1), np.zeros(1), 0.0, 0.0, np.array([50.0, 60.0]))


def _solver(**settings):
    """Two units over two steps of horizon, without a model."""
    solver = object.__new__(RealTimeIteration)
    solver._settings = MpcSettings(horizon=2, **settings)
    solver.units, solver._scale = 2, np.tile(SCALE, 2)
    solver.torques, solver._trial = np.zeros(4), np.zeros(4)
    solver._lower, solver._upper = np.zeros(4), np.zeros(4)
    solver._terms = SimpleNamespace(unit=SimpleNamespace(scale=SCALE))
    solver._now, solver._trial_nodes = SimpleNamespace(nodes=None), np.zeros((3, 1))
    solver._quadratic = Quadratic(np.eye(4), np.zeros(4), None, None, None)
    solver._model = SimpleNamespace(slope=None, curvature=None, nonzeros=None)
    solver._small_step = solver._substeps = solver._rows = solver._wide = None
    solver._hessians = solver._second = None
    solver._solver = daqp.Model()
    solver._solver.setup(
        np.eye(4),
        np.zeros(4),
        np.zeros((0, 4)),
        np.ones(4),
        -np.ones(4),
        np.zeros(4, dtype=np.int32),
    )
    return solver


@pytest.fixture
def steps(monkeypatch):
    """Function (residuals, settings) -> solver whose residual before each step is given, and the list of its steps."""

    def make(residuals, cost=1.0, failure="", better=True, **settings):
        solver, taken, left = _solver(**settings), [], list(residuals)
        solver._linearise = lambda problem: None
        solver._residual = lambda problem: left.pop(0)
        solver._step = lambda problem: taken.append("step") or failure
        solver._search = lambda problem, cost: taken.append(("search", cost)) or better
        monkeypatch.setattr(real_time, "trajectory_cost", lambda *_: cost)
        return solver, taken

    return make


@pytest.mark.parametrize(
    ("residuals", "done", "last"),
    [
        ([1.0] * 3, 3, 1.0),  # no more than `iterations`
        ([0.01], 1, 0.01),  # the first is taken always, and no other where it was near
        ([0.0101, 0.01], 1, 0.01),
        ([1.0, 0.5, 0.001], 2, 0.001),
    ],
)
def test_steps_are_taken_until_the_residual_is_small(steps, residuals, done, last):
    solver, taken = steps(residuals, iterations=3, tolerance=0.01)
    solution = solver.solve(PROBLEM)
    assert (solution.iterations, solution.residual, solution.status, solution.cost) == (
        done,
        last,
        "ok",
        1.0,
    )
    assert taken == ["step", ("search", 1.0)] * done


def test_no_step_but_the_first_is_begun_too_late(steps, monkeypatch):
    monkeypatch.setattr(real_time, "clock", SimpleNamespace(perf_counter=lambda: 5.0))
    for give_up, done in ((5.0, 1), (4.0, 1), (5.1, 3)):
        solver, _ = steps([1.0] * 3, iterations=3)
        assert solver.solve(PROBLEM, give_up).iterations == done


def test_steps_that_do_not_lower_the_cost_are_the_last(steps):
    solver, taken = steps([1.0] * 3, better=False)
    assert solver.solve(PROBLEM).status == "ok"
    assert len(taken) == 2


@pytest.mark.parametrize(("cost", "residual"), [(math.nan, 1.0), (1.0, math.inf)])
def test_what_is_not_finite_is_said(steps, cost, residual):
    solver, taken = steps([residual], cost=cost)
    solution = solver.solve(PROBLEM)
    assert (solution.status, solution.iterations, taken) == ("not finite", 0, [])


@pytest.mark.parametrize(("failure", "status"), [("QP flag -1", "QP flag -1"), ("", "ok")])
def test_a_quadratic_program_that_fails_is_said(steps, failure, status):
    solver, _ = steps([1.0, 0.0], failure=failure)
    solution = solver.solve(PROBLEM)
    assert (solution.status, solution.iterations) == (status, 1)


def test_the_guess_is_brought_within_bounds(steps):
    solver, _ = steps([0.0])
    solver.torques[:] = -1.0, 61.0, 51.0, 3.0
    assert solver.solve(PROBLEM).torques.tolist() == [0.0, 60.0, 50.0, 3.0]


def test_the_guess_is_shifted_unit_by_unit_and_held():
    solver = _solver()
    solver.restart(np.array([1.0, 2.0]))
    assert solver.torques.tolist() == [1.0, 2.0, 1.0, 2.0]
    solver.torques[:] = 1.0, 2.0, 3.0, 4.0
    solver.shift()
    assert solver.torques.tolist() == [3.0, 4.0, 3.0, 4.0]


def test_the_residual_is_a_projected_gradient_step():
    solver = _solver()
    solver.torques[:] = 0.0, 59.0, 50.0, 10.0  # over the scale 0, 2.95, 5, 0.5; bounds 5 and 3
    solver._quadratic.gradient[:] = 1.0, -0.3, -2.0, 0.02
    assert solver._residual(PROBLEM) == pytest.approx(0.05)
    solver._quadratic.gradient[:] = -0.4, 0.0, 0.0, 0.0
    assert solver._residual(PROBLEM) == pytest.approx(0.4)


def test_a_step_minimises_the_quadratic_model_within_the_bounds():
    solver = _solver()
    solver.torques[:] = 20.0, 20.0, 45.0, 10.0
    solver._quadratic.hessian[:] = np.diag([1.0, 2.0, 4.0, 0.5])
    solver._quadratic.gradient[:] = 0.3, -0.4, -8.0, 5.0
    assert solver._step(PROBLEM) == ""
    # -g / h in scaled torques: -0.3, 0.2, 2 and -10, the last two beyond their bounds
    np.testing.assert_allclose(solver._trial, [17.0, 24.0, 50.0, 0.0], atol=1e-9)
    solver._solver = SimpleNamespace(update=lambda **_: -3)
    assert solver._step(PROBLEM) == "QP flag -3"
    solver._solver = SimpleNamespace(update=lambda **_: 0, solve=lambda: (None, 0.0, -1, None))
    assert solver._step(PROBLEM) == "QP flag -1"
    solver._solver = SimpleNamespace(
        update=lambda **_: 0, solve=lambda: (np.zeros(4), 0.0, 0, None)
    )
    assert solver._step(PROBLEM) == ""


def test_curvature_that_cannot_be_had_is_a_failure_and_not_a_fault():
    solver = _solver(exact_hessian=True)

    def fails(problem):
        raise np.linalg.LinAlgError("no eigenvalues")

    solver._make_exact = fails
    assert solver._step(PROBLEM) == "LinAlgError: no eigenvalues"


def test_a_step_that_would_raise_the_cost_is_halved(monkeypatch):
    solver = _solver()
    solver.torques[:] = 8.0
    seen = []

    def cost(nodes, torques, terms):
        seen.append(torques[0])
        return abs(torques[0] - 8.0)

    monkeypatch.setattr(real_time, "simulate", lambda *_: None)
    monkeypatch.setattr(real_time, "trajectory_cost", cost)
    problem = PROBLEM._replace(state=np.array([7.0]))
    for allowed, halvings in ((4.0, 0), (1.0, 2), (0.99, 3), (4.0 / 2**12, 12)):
        solver.torques[:], solver._trial[:] = 8.0, 12.0
        seen.clear()
        assert solver._search(problem, allowed)
        assert len(seen) == halvings + 1
        assert solver.torques.tolist() == [8.0 + 4.0 / 2**halvings] * 4
    assert solver._trial_nodes[0] == 7.0
    solver.torques[:], solver._trial[:] = 8.0, 12.0
    assert not solver._search(problem, 3.9 / 2**12)
    assert solver.torques.tolist() == [8.0] * 4


def test_negative_curvature_is_reflected_and_none_is_left_too_small(monkeypatch):
    solver = _solver(exact_hessian=True, weights=Weights(tracking=2.0))
    monkeypatch.setattr(real_time, "second_order", lambda *_: None)
    monkeypatch.setattr(real_time, "add_second_order", lambda *_: None)
    vectors = np.linalg.qr(np.random.default_rng(0).standard_normal((4, 4)))[0]
    for values, wanted in (
        ([-3.0, 0.1, 0.5, 2.0], [3.0, 0.4, 0.5, 2.0]), ([0.39, 0.5, 1.0, 2.0], [0.4, 0.5, 1.0, 2.0]),
        ([0.41, 0.5, 1.0, 2.0], [0.41, 0.5, 1.0, 2.0]),
    ):  # fmt: skip
        solver._quadratic.hessian[:] = vectors * values @ vectors.T
        solver._make_exact(PROBLEM)
        np.testing.assert_allclose(
            solver._quadratic.hessian, vectors * wanted @ vectors.T, atol=1e-12
        )
    calls = []
    solver._make_exact = calls.append
    solver._step(PROBLEM)
    assert calls == [PROBLEM]
    solver._settings = MpcSettings()
    solver._step(PROBLEM)
    assert len(calls) == 1
