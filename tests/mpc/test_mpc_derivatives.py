"""Sensitivities, gradient and Hessian of the condensed cost against CasADi and finite differences."""

import casadi as cs
import numpy as np
import pytest

from alloc.records import ByReference
from mpc.condensing import trajectory_cost
from mpc.model import unit_model
from mpc.period import RealTimeIteration, cost_of
from mpc.settings import MpcSettings
from tests.benchmarks.unit_step import step_function
from tests.mpc.parts import cost_of_torques, model_at_guess

SETTINGS = MpcSettings(horizon=6)


def _linearised(context, problem, seed):
    solver = RealTimeIteration(context, SETTINGS)
    solver.torques[:] = np.random.default_rng(seed).uniform(100.0, 900.0, SETTINGS.horizon)
    return solver, model_at_guess(solver, problem)


def _central(function, x, width):
    """Derivative of `function` by each entry of `x`, last dimension."""
    columns = []
    for k in range(x.size):
        ahead, behind = x.copy(), x.copy()
        ahead[k] += width
        behind[k] -= width
        columns.append((function(ahead) - function(behind)) / (2.0 * width))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("curve", ["piecewise", "rational", "slip-ratio"])
def test_sensitivities_equal_casadi(make_context, random_problem, curve):
    context = make_context(curve)
    model = unit_model(context)
    for seed in range(4):
        problem = random_problem(context, seed)
        solver, _ = _linearised(context, problem, seed)
        around = solver.period.around
        step = step_function(model, SETTINGS.step, int(solver.period.now.substeps[0]))
        x, u, p = model.state, model.torque, model.parameters
        end = step(x, u, p)
        jacobian = cs.Function("jacobian", [x, u, p], [cs.jacobian(end, cs.vertcat(x, u))])
        for k in range(SETTINGS.horizon):
            arguments = (around.nodes[k], solver.torques[k], problem.parameters)
            np.testing.assert_allclose(
                around.nodes[k + 1], np.asarray(step(*arguments)).ravel(), rtol=1e-12
            )
            np.testing.assert_allclose(
                around.sensitivity[k, :, : model.states + 1],
                np.asarray(jacobian(*arguments)),
                rtol=1e-8,
                atol=1e-10,
            )


@pytest.mark.parametrize("curve", ["piecewise", "rational", "slip-ratio"])
@pytest.mark.parametrize("seed", range(4))
def test_gradient_equals_finite_differences_of_the_cost(make_context, random_problem, curve, seed):
    context = make_context(curve)
    problem = random_problem(context, seed)
    solver, quadratic = _linearised(context, problem, seed)
    scale = solver.period.guess.scale

    def cost(scaled):
        return cost_of_torques(solver, problem, scaled * scale)

    expected = _central(cost, solver.torques / scale, 1e-5)
    assert np.abs(expected).max() > 0.1
    # central differences: 1e-5 squared, times the third derivatives that kinks leave undefined
    np.testing.assert_allclose(quadratic.gradient, expected, rtol=1e-5, atol=1e-6)


def test_gauss_newton_hessian_is_exact_where_the_rail_never_slips(context, random_problem):
    # below the break point of the line the model is linear, and the cost quadratic
    problem = random_problem(context, 0)._replace(
        state=np.array([10.0, *[10.01 / 0.43] * 4, 100.0]), slip_limit=np.zeros(4)
    )
    problem.parameters[:4] = 0.4
    solver, _ = _linearised(context, problem, 0)
    solver.torques[:] = 100.0
    hessian = model_at_guess(solver, problem).hessian.copy()
    scale = solver.period.guess.scale
    assert np.linalg.eigvalsh(hessian)[0] > 0.0

    def gradient(scaled):
        solver.torques[:] = scaled * scale
        return model_at_guess(solver, problem).gradient.copy()

    expected = _central(gradient, 100.0 / scale, 1e-3)
    np.testing.assert_allclose(hessian, expected, rtol=1e-6, atol=1e-8)


def test_cost_is_the_documented_sum(context):
    # nodes without slip: only tracking and rate are left
    terms = ByReference(cost_of(context, SETTINGS, 0.2))
    terms.slip_matrix[:] = 0.0
    axle, unit = terms.axle, terms.unit
    torques = np.array([100.0, 300.0])
    nodes = np.zeros((3, 6))
    scale, w = unit.scale[0], SETTINGS.weights
    unit.target[:], unit.before[:], unit.reference[:] = 400.0, 50.0, 150.0
    axle.slip_limit[:] = 1.0
    cost = trajectory_cost(nodes, torques, terms)
    expected = w.tracking * (300.0**2 + 100.0**2) + w.rate * (50.0**2 + 200.0**2)
    expected += 0.2 * (50.0**2 + 150.0**2)
    assert cost == pytest.approx(expected / scale**2, rel=1e-12)
    axle.slip_limit[0] = -0.1
    over = trajectory_cost(nodes, torques, terms)
    assert over - cost == pytest.approx(2 * w.slip / 4 * (0.1 / w.slip_scale) ** 2, rel=1e-12)


def test_condensing_leaves_no_state_from_call_to_call(context, random_problem):
    problem = random_problem(context, 1)
    solver, quadratic = _linearised(context, problem, 1)
    first = quadratic.hessian.copy(), quadratic.gradient.copy()
    model_at_guess(solver, random_problem(context, 3))
    model_at_guess(solver, problem)
    np.testing.assert_array_equal(quadratic.hessian, first[0])
    np.testing.assert_array_equal(quadratic.gradient, first[1])
