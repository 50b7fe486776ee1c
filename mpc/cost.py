"""The cost of a trajectory of one unit or a group, compiled.

With U_j the torque scale of unit j, w_j its share of the group's mass, and sums over the units:

    cost = sum over the horizon of tracking (sum w_j (u_j - target_j) / U_j)^2 + rate sum w_j ((u_j - u_j before) / U_j)^2
           + evenness sum w_j ((u_j - reference_j) / U_j)^2
           + slip sum over the axles of share (max(0, slip - limit) / slip scale)^2 at the step's end.

So the cost tracks the group's total effort, whichever unit delivers it; only evenness determines the split. An axle's share
is that of its unit, divided by the unit's axles. The penalty of slip is a soft constraint with its slack eliminated.
"""

from typing import NamedTuple

import numpy as np
from numba import float64, int64

from alloc.by_reference import ByReference
from alloc.plant.structure import Floats
from mpc.arrays import MATRIX, VECTOR, sweep


class CostWeights(NamedTuple):
    """Weights of the cost's terms."""

    tracking: float
    slip: float
    rate: float
    evenness: float
    slip_scale: float
    """[m/s]"""


class UnitTerms(NamedTuple):
    """Parameters of each unit in the cost, (units,) each; torques in N m."""

    target: Floats
    before: Floats
    reference: Floats
    scale: Floats
    """Torque scale."""
    share: Floats
    """Share of the group's mass."""


class AxleTerms(NamedTuple):
    """Parameters of each axle in the cost, (axles,) each."""

    slip_limit: Floats
    """[m/s]"""
    share: Floats
    """Share of the penalty."""


class Cost(NamedTuple):
    """The cost of one problem."""

    slip_matrix: Floats
    """Slip velocity of each axle by the state, (axles, states)."""
    axle: AxleTerms
    unit: UnitTerms
    weights: CostWeights


_NONE, _NUMBER = np.zeros(0), 0.0
COST = ByReference(
    Cost(
        np.zeros((0, 0)),
        AxleTerms(*[_NONE] * 2),
        UnitTerms(*[_NONE] * 5),
        CostWeights(*[_NUMBER] * 5),
    )
).kind


@sweep(float64(int64, float64, MATRIX, VECTOR, COST))
def cost_up_to(k, cost, nodes, torques, terms):
    """`cost` of the steps before step `k`, plus that of step `k`, of `nodes` (horizon + 1, states) under `torques`."""
    slip_matrix, axle, unit, weights = terms.slip_matrix, terms.axle, terms.unit, terms.weights
    axles, states = slip_matrix.shape
    units = unit.target.size
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


@sweep(float64(MATRIX, VECTOR, COST))
def trajectory_cost(nodes, torques, terms):
    """Cost of `nodes` (horizon + 1, states) under `torques` (horizon * units,)."""
    cost = 0.0
    for k in range(nodes.shape[0] - 1):
        cost = cost_up_to(k, cost, nodes, torques, terms)
    return cost
