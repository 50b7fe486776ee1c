"""Steps of a control period, the model of the unit replaced: when they stop, how far they go, what they answer."""

import math

import numpy as np
import pytest

from mpc import solver as sqp
from mpc.condensing import AxleTerms, Cost, CostWeights, Nonzeros, Stiffness, UnitTerms
from mpc.period import HorizonProblem, RealTimeIteration
from mpc.settings import MpcSettings
from mpc.solver import ENDED, GOING, NO_SOLUTION, NOT_FINITE, Addresses, Rules, period

SCALE, UPPER = np.array([10.0, 20.0]), np.array([50.0, 60.0])


def _period(tolerance=0.01):
    """Two units over two steps of horizon, without a model."""
    terms = Cost(
        np.zeros((1, 1)),
        AxleTerms(np.zeros(1), np.ones(1)),
        UnitTerms(np.zeros(2), np.zeros(2), np.zeros(2), SCALE, np.full(2, 0.5)),
        CostWeights(1.0, 1.0, 1.0, 0.0, 1.0),
    )
    none = np.zeros(0, dtype=np.int64)
    rules = Rules(0.01, Stiffness(100.0, 50.0, 1, 1, 9, 2.0), tolerance)
    addresses = Addresses(1, 2, 3, 4)
    made = period(addresses, Nonzeros(none, none), terms, rules, 2, (3, 3))
    made.now.upper[:] = np.tile(UPPER, 2)
    made.now.parameters[:] = 0.1, 0.05, 4.0
    return made


@pytest.fixture(autouse=True)
def _prepared(monkeypatch):
    """A model whose constants are its parameters, doubled."""

    def prepare(parameters, constants):
        constants[:] = 2.0 * parameters

    monkeypatch.setattr(sqp, "prepare_at", lambda address: prepare)


@pytest.fixture
def steps(monkeypatch):
    """Function (residuals, ...) -> period whose residual before each step is given, and the list of what is done.

    `costs`: of the trajectory at the guess and at each whole step; a trial that is not better is one for `search`.
    """

    def make(residuals, costs=None, solved=True, found=True, **rules):
        made, done, left = _period(**rules), [], list(residuals)
        at = iter(costs or [1.0] * 100)
        monkeypatch.setattr(sqp, "linearise_at", lambda torques, p: done.append("linearise"))
        monkeypatch.setattr(sqp, "condense", lambda *_: None)
        monkeypatch.setattr(sqp, "trajectory_cost", lambda *_: next(at))
        monkeypatch.setattr(sqp, "optimality", lambda p: left.pop(0))
        monkeypatch.setattr(sqp, "step", lambda p: done.append("step") or solved)
        monkeypatch.setattr(sqp, "search", lambda *a: done.append(("search", *a[:2])) or found)
        return made, done

    return make


@pytest.mark.parametrize(
    ("peak", "peak_slip", "steepness", "substeps"),
    [
        (
            0.1,
            0.05,
            4.0,
            4,
        ),  # 100 / s per s/m of a slope of 8 s/m over 10 ms, in steps of two time constants
        (0.1, 0.05, 1.0, 2),  # at most as steep as a straight line times 2.8 / 1.9
        (0.01, 0.5, 2.0, 1),
        (0.5, 0.01, 9.0, 9),
    ],
)
def test_steps_are_as_short_as_the_curve_is_steep(steps, peak, peak_slip, steepness, substeps):
    made, _ = steps([0.0])
    made.now.parameters[:] = peak, peak_slip, steepness
    sqp.iterate(1, made)
    assert made.now.substeps[0] == substeps
    assert made.now.constants.tolist() == [2.0 * peak, 2.0 * peak_slip, 2.0 * steepness]


@pytest.mark.parametrize(
    ("residuals", "wanted"),
    [
        ([1.0] * 3, (1.0, 3, GOING)),  # no more than asked for
        ([0.01], (0.01, 1, ENDED)),  # the first is taken always, and no other where it was near
        ([0.0101, 0.01], (0.01, 1, ENDED)),
        ([1.0, 0.5, 0.001], (0.001, 2, ENDED)),
    ],
)
def test_steps_are_taken_until_the_residual_is_small(steps, residuals, wanted):
    made, done = steps(residuals)
    assert sqp.iterate(3, made) == (1.0, *wanted)
    assert done.count("step") == wanted[1]
    # the derivatives of what the last step leads to are not needed
    assert done.count("linearise") == len(residuals)


def test_a_whole_step_that_does_not_lower_the_cost_is_searched_on(steps):
    made, done = steps([1.0, 1.0], costs=[4.0, 5.0, 3.0])
    made.guess.torques[:], made.guess.trial[:] = 8.0, 12.0
    assert sqp.iterate(2, made)[2:] == (2, GOING)
    # half of the step is next, and one trial is used up; the last step has nothing to prepare
    assert ("search", 4.0, sqp.HALVINGS) in done
    assert ("search", 3.0, sqp.HALVINGS + 1) in done
    assert made.guess.trial.tolist() == [10.0] * 4


def test_a_whole_step_that_lowers_the_cost_is_taken(steps):
    made, done = steps([1.0, 0.0], costs=[4.0, 4.0, 4.0])
    made.guess.trial[:] = 12.0
    assert sqp.iterate(2, made) == (4.0, 0.0, 1, ENDED)
    assert made.guess.torques.tolist() == [12.0] * 4
    assert done == ["linearise", "step", "linearise"]


def test_steps_that_do_not_lower_the_cost_are_the_last(steps):
    made, done = steps([1.0] * 3, costs=[1.0, 2.0], found=False)
    assert sqp.iterate(3, made) == (1.0, 1.0, 1, ENDED)
    assert done.count("step") == 1


@pytest.mark.parametrize(("cost", "residual"), [(math.nan, 1.0), (1.0, math.inf), (1.0, math.nan)])
def test_what_is_not_finite_is_said(steps, cost, residual):
    made, done = steps([residual], costs=[cost])
    answer = sqp.iterate(3, made)
    assert answer[2:] == (0, NOT_FINITE)
    assert done == ["linearise"]


def test_a_quadratic_program_that_fails_is_said(steps):
    made, _ = steps([1.0, 0.0], solved=False)
    assert sqp.iterate(3, made) == (1.0, 1.0, 1, NO_SOLUTION)


def test_the_guess_is_brought_within_bounds(steps):
    made, _ = steps([math.nan])
    made.guess.torques[:] = -1.0, 61.0, 51.0, 3.0
    sqp.iterate(1, made)
    assert made.guess.torques.tolist() == [0.0, 60.0, 50.0, 3.0]


def test_the_residual_is_a_projected_gradient_step():
    made = _period()
    made.guess.torques[:] = 0.0, 59.0, 50.0, 10.0  # over the scale 0, 2.95, 5, 0.5; bounds 5 and 3
    made.quadratic.gradient[:] = 1.0, -0.3, -2.0, 0.02
    assert sqp.optimality(made) == pytest.approx(0.05)
    made.quadratic.gradient[:] = -0.4, 0.0, 0.0, 0.0
    assert sqp.optimality(made) == pytest.approx(0.4)
    made.quadratic.gradient[:] = 0.0, math.nan, 0.0, 0.0
    assert math.isnan(sqp.optimality(made))


def test_a_step_minimises_the_quadratic_model_within_the_bounds():
    made = _period()
    made.guess.torques[:] = 20.0, 20.0, 45.0, 10.0
    made.quadratic.hessian[:] = np.diag([1.0, 2.0, 4.0, 0.5])
    made.quadratic.gradient[:] = 0.3, -0.4, -8.0, 5.0
    assert sqp.step(made)
    # -g / h in scaled torques: -0.3, 0.2, 2 and -10, the last two beyond their bounds
    np.testing.assert_allclose(made.guess.trial, [17.0, 24.0, 50.0, 0.0], atol=1e-9)
    made.quadratic.gradient[0] = math.nan
    assert not sqp.step(made)


def test_a_step_that_would_raise_the_cost_is_halved(monkeypatch):
    made, seen = _period(), []

    def cost(k, before, nodes, torques, terms):
        seen.append((k, torques[0]))
        return before + 0.5 * abs(torques[0] - 8.0)  # over the two steps of the horizon

    monkeypatch.setattr(sqp, "simulate", lambda *_: None)
    monkeypatch.setattr(sqp, "slope_at", lambda address: None)
    monkeypatch.setattr(sqp, "cost_up_to", cost)
    made.now.state[:] = 7.0
    guess, trials = made.guess, sqp.HALVINGS + 1
    for allowed, halvings in ((4.0, 0), (1.0, 2), (0.99, 3), (4.0 / 2**12, 12)):
        guess.torques[:], guess.trial[:] = 8.0, 12.0
        seen.clear()
        assert sqp.search(allowed, trials, made)
        assert len({torque for _, torque in seen}) == halvings + 1
        assert seen[-2:] == [(k, guess.torques[0]) for k in (0, 1)]
        assert guess.torques.tolist() == [8.0 + 4.0 / 2**halvings] * 4
    assert guess.nodes[0] == 7.0
    # what costs too much already is followed no further
    guess.torques[:], guess.trial[:] = 8.0, 12.0
    seen.clear()
    assert sqp.search(1.0, trials, made)
    assert seen == [(0, 12.0), (0, 10.0), (1, 10.0), (0, 9.0), (1, 9.0)]
    guess.torques[:], guess.trial[:] = 8.0, 12.0
    assert not sqp.search(3.9 / 2**12, trials, made)
    assert guess.torques.tolist() == [8.0] * 4


def _solver(answers, **settings):
    """A solver whose compiled part gives these answers, and the list of what it was asked."""
    solver, asked = object.__new__(RealTimeIteration), []
    solver._settings = MpcSettings(horizon=2, **settings)
    solver.period, solver.units = _period(), 2
    solver.torques, solver._terms = solver.period.guess.torques, solver.period.terms
    solver._period, left = solver.period, list(answers)
    solver._iterate = lambda most, period: asked.append(most) or left.pop(0)
    solver.most = solver._settings.steps_in_time(0.01)
    return solver, asked


PROBLEM = HorizonProblem(np.full(1, 7.0), np.arange(3.0), np.full(1, 0.1), 4.0, 5.0, UPPER, 6.0)


def test_what_is_new_in_a_period_is_handed_over():
    solver, asked = _solver([(2.0, 0.3, 2, ENDED)], iterations=4)
    solver.torques[:] = 1.0, 2.0, 3.0, 4.0
    solution = solver.solve(PROBLEM)
    assert asked == [4]
    assert solution._replace(torques=solution.torques.tolist()) == (
        [1.0, 2.0, 3.0, 4.0], 2.0, 0.3, 2, "ok",
    )  # fmt: skip
    now, unit = solver.period.now, solver._terms.unit
    assert (now.state.tolist(), now.parameters.tolist()) == ([7.0], [0.0, 1.0, 2.0])
    assert now.constants.tolist() == [0.0, 2.0, 4.0]
    assert now.upper.tolist() == [50.0, 60.0, 50.0, 60.0]
    assert solver._terms.axle.slip_limit.tolist() == [0.1]
    assert [v.tolist() for v in unit[:3]] == [[4.0, 4.0], [5.0, 5.0], [6.0, 6.0]]


@pytest.mark.parametrize(
    ("end", "status"),
    [
        (NOT_FINITE, "not finite"),
        (NO_SOLUTION, "QP not solved"),
        (GOING, "ok"),
    ],
)
def test_every_end_has_its_status(end, status):
    solver, _ = _solver([(1.0, 1.0, 1, end)], iterations=1)
    assert solver.solve(PROBLEM).status == status


def test_the_guess_is_shifted_unit_by_unit_and_held():
    solver, _ = _solver([])
    solver.restart(np.array([1.0, 2.0]))
    assert solver.torques.tolist() == [1.0, 2.0, 1.0, 2.0]
    solver.torques[:] = 1.0, 2.0, 3.0, 4.0
    solver.shift()
    assert solver.torques.tolist() == [3.0, 4.0, 3.0, 4.0]
