"""The cost of a trajectory and its condensed quadratic model in the torques, compiled.

Of one unit or a group. With U_j the torque scale of unit j, w_j its share of the group's mass, and sums over the units:

cost = sum over the horizon of tracking (sum w_j (u_j - target_j) / U_j)^2 + rate sum w_j ((u_j - u_j before) / U_j)^2
     + evenness sum w_j ((u_j - reference_j) / U_j)^2
     + slip sum over the axles of share (max(0, slip - limit) / slip scale)^2 at the step's end.

So the group's total effort is tracked, whoever gives it; evenness alone says who. An axle's share is that of its unit,
divided by the unit's axles. The penalty of slip is a soft constraint with its slack eliminated. Unknowns are u_j / U_j.
"""

from typing import NamedTuple

from numba import float64, void

from alloc.plant.structure import Floats
from mpc.shooting import CUBE, LINEARISED, MATRIX, VECTOR, record, sweep


class CostWeights(NamedTuple):
    """Weights of the cost's terms."""

    tracking: float
    slip: float
    rate: float
    evenness: float
    slip_scale: float
    """[m/s]"""


class UnitTerms(NamedTuple):
    """What the cost takes of each unit, (units,) each; torques in N m."""

    target: Floats
    before: Floats
    reference: Floats
    scale: Floats
    """Torque scale."""
    share: Floats
    """Of the group's mass."""


class AxleTerms(NamedTuple):
    """What the cost takes of each axle, (axles,) each."""

    slip_limit: Floats
    """[m/s]"""
    share: Floats
    """Of the penalty."""


class Cost(NamedTuple):
    """The cost of one problem."""

    slip_matrix: Floats
    """Slip velocity of each axle by the state, (axles, states)."""
    axle: AxleTerms
    unit: UnitTerms
    weights: CostWeights


class Quadratic(NamedTuple):
    """The cost's quadratic model in the scaled torques; `condense` fills it."""

    hessian: Floats
    """(horizon * units, horizon * units)"""
    gradient: Floats
    """(horizon * units,)"""
    adjoint: Floats
    """Derivative of the cost to go by the node, (horizon + 1, states)."""
    influence: Floats
    """Derivative of the nodes by the torques, (horizon + 1, states, horizon * units)."""
    row: Floats
    """Scratch, (axles, horizon * units)."""


COST = record(
    Cost,
    MATRIX,
    record(AxleTerms, *[VECTOR] * 2),
    record(UnitTerms, *[VECTOR] * 5),
    record(CostWeights, *[float64] * 5),
)
QUADRATIC = record(Quadratic, MATRIX, VECTOR, MATRIX, CUBE, MATRIX)


@sweep(float64(MATRIX, VECTOR, COST))
def trajectory_cost(nodes, torques, terms):
    """Cost of `nodes` (horizon + 1, states) under `torques` (horizon * units,)."""
    slip_matrix, axle, unit, weights = terms
    axles, states = slip_matrix.shape
    units = unit.target.size
    cost = 0.0
    for k in range(nodes.shape[0] - 1):
        missed = 0.0
        for j in range(units):
            u, scale, share = torques[k * units + j], unit.scale[j], unit.share[j]
            last = unit.before[j] if k == 0 else torques[(k - 1) * units + j]
            missed += share * (u - unit.target[j]) / scale
            change, uneven = (u - last) / scale, (u - unit.reference[j]) / scale
            cost += share * (weights.rate * change * change + weights.evenness * uneven * uneven)
        cost += weights.tracking * missed * missed
        for i in range(axles):
            slip = -axle.slip_limit[i]
            for j in range(states):
                slip += slip_matrix[i, j] * nodes[k + 1, j]
            excess = max(slip, 0.0) / weights.slip_scale
            cost += weights.slip * axle.share[i] * excess * excess
    return cost


@sweep(void(VECTOR, COST, QUADRATIC))
def _torque_terms(torques, terms, out):
    """Fill the upper half of the Hessian and the gradient with what the torques cost themselves."""
    unit, weights = terms.unit, terms.weights
    hessian, gradient = out.hessian, out.gradient
    units = unit.target.size
    horizon = torques.size // units
    hessian[:] = 0.0
    for k in range(horizon):
        missed = 0.0
        for j in range(units):
            here = k * units + j
            missed += unit.share[j] * (torques[here] - unit.target[j]) / unit.scale[j]
        for j in range(units):
            here = k * units + j
            scale, share = unit.scale[j], unit.share[j]
            rate, even = 2.0 * weights.rate * share, 2.0 * weights.evenness * share
            track = 2.0 * weights.tracking * share
            last = unit.before[j] if k == 0 else torques[here - units]
            change = rate * (torques[here] - last) / scale
            gradient[here] = track * missed + change
            gradient[here] += even * (torques[here] - unit.reference[j]) / scale
            hessian[here, here] += rate + even
            for i in range(j, units):
                hessian[here, here - j + i] += track * unit.share[i]
            if k > 0:
                gradient[here - units] -= change
                hessian[here - units, here - units] += rate
                hessian[here - units, here] -= rate


@sweep(void(LINEARISED, VECTOR, COST, QUADRATIC))
def condense(around, torques, terms, out):
    """Fill `out` with the Gauss-Newton model of the cost by u / U `around` a trajectory under `torques`."""
    nodes, sensitivity = around.nodes, around.sensitivity
    slip_matrix, axle, unit, weights = terms
    hessian, gradient, adjoint, influence, row = out
    axles, states = slip_matrix.shape
    units, size = unit.target.size, torques.size
    horizon = size // units
    _torque_terms(torques, terms, out)
    adjoint[:] = 0.0
    influence[0] = 0.0
    for k in range(horizon):
        before, known = k * units, (k + 1) * units
        for i in range(states):
            for m in range(size):
                influence[k + 1, i, m] = 0.0
            for j in range(units):
                moved = sensitivity[k, i, states + j] * unit.scale[j]
                influence[k + 1, i, before + j] = moved
            for j in range(states):
                value = sensitivity[k, i, j]
                if value != 0.0:
                    for m in range(before):
                        influence[k + 1, i, m] += value * influence[k, j, m]
        for i in range(axles):
            slip = -axle.slip_limit[i]
            for j in range(states):
                slip += slip_matrix[i, j] * nodes[k + 1, j]
            if slip <= 0.0:
                continue
            w_slip = 2.0 * weights.slip * axle.share[i] / weights.slip_scale**2
            for m in range(known):
                row[i, m] = 0.0
            for j in range(states):
                value = slip_matrix[i, j]
                if value != 0.0:
                    adjoint[k + 1, j] += w_slip * slip * value
                    for m in range(known):
                        row[i, m] += value * influence[k + 1, j, m]
            for m in range(known):
                part = w_slip * row[i, m]
                for n in range(m, known):
                    hessian[m, n] += part * row[i, n]
    for k in range(horizon - 1, -1, -1):
        for j in range(states):
            for i in range(units):
                own = adjoint[k + 1, j] * sensitivity[k, j, states + i]
                gradient[k * units + i] += own * unit.scale[i]
        for j in range(states):
            for i in range(states):
                adjoint[k, i] += sensitivity[k, j, i] * adjoint[k + 1, j]
    for m in range(size):
        for n in range(m):
            hessian[m, n] = hessian[n, m]


@sweep(void(CUBE, COST, QUADRATIC, MATRIX))
def add_second_order(hessians, terms, out, scratch):
    """Add to the Hessian the model's second-order terms `hessians` (horizon, states + units, states + units).

    `scratch` (2 (states + units), horizon * units).
    """
    scale, hessian, influence = terms.unit.scale, out.hessian, out.influence
    horizon, width = hessians.shape[0], hessians.shape[1]
    units = scale.size
    states = width - units
    for k in range(horizon):
        before, known = k * units, (k + 1) * units
        for i in range(states):
            for m in range(known):
                scratch[i, m] = influence[k, i, m] if m < before else 0.0
        for j in range(units):
            for m in range(known):
                scratch[states + j, m] = scale[j] if m == before + j else 0.0
        for i in range(width):
            for m in range(known):
                scratch[width + i, m] = 0.0
            for j in range(width):
                value = hessians[k, i, j]
                if value != 0.0:
                    for m in range(known):
                        scratch[width + i, m] += value * scratch[j, m]
        for i in range(width):
            for m in range(known):
                left = scratch[i, m]
                for n in range(m, known):
                    hessian[m, n] += left * scratch[width + i, n]
    for m in range(hessian.shape[0]):
        for n in range(m):
            hessian[m, n] = hessian[n, m]
