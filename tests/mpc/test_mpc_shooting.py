"""Trajectory, cost, gradient and Hessian of a polynomial model, against formulas and CasADi's derivatives."""

import casadi as cs
import numpy as np
import pytest

from alloc.records import ByReference
from mpc.condensing import (
    AxleTerms,
    Cost,
    CostWeights,
    Nonzeros,
    UnitTerms,
    condense,
    linearise,
    linearised,
    quadratic,
    simulate,
    trajectory_cost,
)
from mpc.generated import compile_functions, compile_tangent

STATES, UNITS, HORIZON, SUBSTEPS, STEP = 3, 2, 3, 2, 0.15
SIZE, WIDTH = HORIZON * UNITS, STATES + UNITS
P = np.array([0.7, 0.4])

x, u, p = (cs.SX.sym(name, size) for name, size in (("x", 3), ("u", 2), ("p", 2)))
RATE = cs.vertcat(
    p[0] * x[1] * x[2] - 0.3 * x[0] ** 2 + 0.2 * u[0],
    u[0] * (1.0 + 0.3 * x[0]) - p[1] * x[1] ** 3,
    u[1] - 0.5 * u[1] ** 2 * x[2] + 0.6 * x[0] * x[1] + 0.2 * u[0] * u[1],
)
JACOBIAN = cs.jacobian(RATE, cs.vertcat(x, u))
_rate = cs.Function("rate", [x, u, p], [RATE])
NAMES = ["state", "torque", "parameters"]
MODEL = [
    cs.Function("slope", [x, u, p], [RATE], NAMES, ["slopes"]),
    cs.Function("rate", [x, u, p], [RATE, JACOBIAN], NAMES, ["slopes", "nonzeros"]),
]
NONZEROS = Nonzeros(*map(np.array, JACOBIAN.sparsity().get_triplet()))


@pytest.fixture(scope="module")
def made():
    """The model's compiled functions by name."""
    return compile_functions(MODEL)


def trajectory(torques, start):
    """Classical Runge-Kutta, two steps per control period, as CasADi expressions or numbers."""
    nodes = [start]
    for k in range(HORIZON):
        now, torque = nodes[-1], torques[k * UNITS : (k + 1) * UNITS]
        for _ in range(SUBSTEPS):
            k1 = _rate(now, torque, P)
            k2 = _rate(now + 0.5 * STEP * k1, torque, P)
            k3 = _rate(now + 0.5 * STEP * k2, torque, P)
            k4 = _rate(now + STEP * k3, torque, P)
            now = now + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        nodes.append(now)
    return nodes


def cost(nodes, torques, c):
    """The cost as the module states it."""
    total, last = 0.0, cs.DM(c.unit.before)
    for k in range(HORIZON):
        now = torques[k * UNITS : (k + 1) * UNITS]
        parts = [(now - cs.DM(v)) / cs.DM(c.unit.scale) for v in (c.unit.target, c.unit.reference)]
        share, change = cs.DM(c.unit.share), (now - last) / cs.DM(c.unit.scale)
        total += c.weights.tracking * cs.dot(share, parts[0]) ** 2
        total += c.weights.rate * cs.dot(share, change**2)
        total += c.weights.evenness * cs.dot(share, parts[1] ** 2)
        excess = cs.fmax(0.0, cs.DM(c.slip_matrix) @ nodes[k + 1] - cs.DM(c.axle.slip_limit))
        total += c.weights.slip * cs.dot(cs.DM(c.axle.share), (excess / c.weights.slip_scale) ** 2)
        last = now
    return total


def _case(seed):
    """Random start, torques and cost; about half of the slips are beyond their limits."""
    rng = np.random.default_rng(seed)
    terms = Cost(
        slip_matrix=np.array([[-1.0, 0.8, 0.0], [-1.0, 0.0, 0.9], [-0.7, 0.4, 0.2]]),
        axle=AxleTerms(
            np.array([-0.2, 0.1, 0.05]) * rng.uniform(0.5, 2.0), np.array([0.3, 0.3, 0.4])
        ),
        unit=UnitTerms(*(rng.uniform(0.3, 1.2, UNITS) for _ in range(4)), np.array([0.6, 0.4])),
        weights=CostWeights(1.3, 2.1, 0.4, 0.15, 0.6),
    )
    return terms, rng.uniform(0.2, 1.0, STATES), rng.uniform(0.1, 1.0, SIZE)


def _linearised(model, torques, start):
    out = linearised(HORIZON, STATES, UNITS, NONZEROS.row.size)
    for part in (out.nodes, out.sensitivity, out.points, out.jacobians, out.slope):
        part[:] = np.nan  # nothing may be read that was not written
    out.nodes[0] = start
    tangent = compile_tangent(NONZEROS.row, NONZEROS.column, STATES, UNITS)
    linearise(model["rate"], tangent, torques, P, STEP, SUBSTEPS, ByReference(out))
    return out


def _condensed(around, torques, terms):
    made = quadratic(HORIZON, STATES, 3, UNITS)
    for part in (made.hessian, made.gradient, made.adjoint, made.excess, made.tile):
        part[:] = np.nan
    condense(ByReference(around), torques, ByReference(terms), ByReference(made))
    return made


@pytest.mark.parametrize("seed", range(3))
def test_trajectory_and_cost_are_those_of_the_formulas(made, seed):
    terms, start, torques = _case(seed)
    nodes = np.full((HORIZON + 1, STATES), np.nan)
    nodes[0] = start
    simulate(made["slope"], torques, P, STEP, SUBSTEPS, nodes, np.full((3, STATES), np.nan))
    expected = [np.asarray(node).ravel() for node in trajectory(torques, cs.DM(start))]
    np.testing.assert_allclose(nodes, expected, rtol=1e-12)
    found = trajectory_cost(nodes, torques, ByReference(terms))
    assert found == pytest.approx(
        float(cost(list(map(cs.DM, nodes)), cs.DM(torques), terms)), rel=1e-12
    )


@pytest.mark.parametrize("seed", range(3))
def test_sensitivities_are_the_trajectorys_derivatives(made, seed):
    _, start, torques = _case(seed)
    out = _linearised(made, torques, start)
    symbols, state = cs.SX.sym("torques", UNITS), cs.SX.sym("state", STATES)
    one = trajectory(cs.repmat(symbols, HORIZON, 1), state)[1]
    jacobian = cs.Function("j", [state, symbols], [cs.jacobian(one, cs.vertcat(state, symbols))])
    for k in range(HORIZON):
        expected = np.asarray(jacobian(out.nodes[k], torques[k * UNITS : (k + 1) * UNITS]))
        np.testing.assert_allclose(out.sensitivity[k, :, :WIDTH], expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_gradient_and_gauss_newton_hessian_are_the_costs(made, seed):
    terms, start, torques = _case(seed)
    symbols = cs.SX.sym("torques", SIZE)
    scale = np.tile(terms.unit.scale, HORIZON)
    nodes = trajectory(symbols, start)
    total = cost(nodes, symbols, terms)
    gradient = cs.gradient(total, symbols)
    # Gauss-Newton: the second derivatives with the nodes as linear functions of the torques
    straight = [cs.DM(start)]
    jacobians = [
        cs.Function("n", [symbols], [node, cs.jacobian(node, symbols)]) for node in nodes[1:]
    ]
    for function in jacobians:
        value, jacobian = function(torques)
        straight.append(value + jacobian @ (symbols - torques))
    gauss_newton = cs.hessian(cost(straight, symbols, terms), symbols)[0]
    wanted = cs.Function("wanted", [symbols], [gradient, gauss_newton])
    g, gn = (np.asarray(value) for value in wanted(torques))
    around = _linearised(made, torques, start)
    both = np.outer(scale, scale)
    found = _condensed(around, torques, terms)
    np.testing.assert_allclose(found.gradient, g.ravel() * scale, rtol=1e-10)
    np.testing.assert_allclose(found.hessian, gn * both, rtol=1e-9, atol=1e-10)


def test_an_axle_at_its_limit_costs_nothing(made):
    terms, start, torques = _case(0)
    around = _linearised(made, torques, start)
    matrix = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    highest = matrix @ around.nodes[1:].max(axis=0)
    found = []
    for limit in (highest, highest + 1.0):
        case = terms._replace(slip_matrix=matrix, axle=terms.axle._replace(slip_limit=limit))
        found.append(_condensed(around, torques, case))
    np.testing.assert_array_equal(found[0].hessian, found[1].hessian)
    np.testing.assert_array_equal(found[0].gradient, found[1].gradient)
