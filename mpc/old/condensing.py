"""Single shooting and condensing, compiled: from torques over the horizon to the cost's quadratic model in them alone.

In: torques, parameters, weights. Out: states and sensitivities, the cost, its gradient and Hessian in u_j / U_j.
"""

from typing import NamedTuple

import numpy as np
from numba import float64, int64, void

from alloc.old.compilation import equation
from alloc.old.plant.model import Floats, Ints
from alloc.old.plant.operations import WIDTH, load, padded, spread, store
from alloc.old.records import ByReference
from mpc.old.arrays import MATRIX, RATE, SLOPE, TANGENT, VECTOR, inlined, sweep

# How many Runge-Kutta steps a step of the horizon needs: as many as the believed curve is steep.
#
# The bound is the plant's (`alloc.old.plant.model.Model.stiffness`), whose greatest rate is that of a wheelset on the
# steepest part of its adhesion curve.


STEEPEST_SLOPE = 12.0
"""Slope [s/m] of the steepest curve that is predicted with; steeper ones would need shorter steps for next to no slip."""


class Stiffness(NamedTuple):
    """What decides how short a Runge-Kutta step of a group must be."""

    slope: float
    """Rate of its wheelsets [1/s] per slope of the curve [s/m]."""
    rest: float
    """Fastest rate of all else [1/s]."""
    axles: int
    curve: int
    """Place of the rational curve among the parameters; -1: the model has another curve."""
    most: int
    """Most substeps; for another curve, always."""
    stable: float
    """Greatest product of step and rate, see `alloc.old.plant.model.STABLE_STEP`."""


@equation
def steepest(peak, peak_slip, steepness):
    """Bound of the slope [s/m] of the rational curve, for a steepness from 1 on: above 2, its slope at the origin.

    Below, the curve turns on its way to the peak, and a straight line is a bound, see
    `alloc.old.plant.adhesion.RationalCurve.steepest_slope`.
    """
    return peak / peak_slip * max(steepness, (steepness + 1.8) / 1.9)


@equation
def no_steeper(peak_slip, n, most):
    """Peak slip [m/s] and steepness of a curve near the given one, with no slope above `STEEPEST_SLOPE`.

    `most`: the greatest peak coefficient that the curve is scaled with. `steepest` solved for the steepness.
    """
    top = max(peak_slip, 1.5 * most / STEEPEST_SLOPE)
    allowed = STEEPEST_SLOPE * top / most
    return top, min(n, allowed, 1.9 * allowed - 1.8)


@inlined
def needed_substeps(stiffness, step, parameters):
    """Substeps of a step of `step` [s] with the model's `parameters`."""
    if stiffness.curve < 0:
        return stiffness.most
    peak = 0.0
    for i in range(stiffness.axles):
        peak = max(peak, parameters[i])
    slope = steepest(peak, parameters[stiffness.curve], parameters[stiffness.curve + 1])
    needed = step * max(stiffness.slope * slope, stiffness.rest) / stiffness.stable
    # what is no number surfaces in the trajectory; a number of steps it must not become
    return max(1, int(np.ceil(needed))) if needed < stiffness.most else stiffness.most


# Single shooting over the horizon: states and their sensitivities, compiled.
#
# From the measured state on, the torques alone determine the trajectory, so they are the only unknowns. Slip below the
# peak is strongly stable, and slip beyond it grows by a factor of about three over the horizon. So the states need not
# be unknowns too.
#
# Torques of several units are stored step by step in one vector (horizon * units,), so that a single unit has no
# further dimension. Sensitivities are rows of whole blocks of `alloc.old.plant.operations.WIDTH` numbers, to be processed
# a block at a time.


class Nonzeros(NamedTuple):
    """Places of the nonzeros of a model's derivatives by (state, torques)."""

    row: Ints
    """Row of each nonzero of the Jacobian of the slopes."""
    column: Ints


class Linearised(NamedTuple):
    """A trajectory and its derivatives; `linearise` fills it. `width` stands for states + units, in whole blocks.

    A Runge-Kutta step evaluates the model at four points.
    """

    nodes: Floats
    """(horizon + 1, states)"""
    sensitivity: Floats
    """Of each node to the node and the torques before, (horizon, states, width)."""
    points: Floats
    """Where the model is evaluated in a step, (4, states)."""
    jacobians: Floats
    """Nonzeros there, (4, nonzeros)."""
    torques: Floats
    """Sensitivity of the torques, which are constant over a step of the horizon, (units, width)."""
    slope: Floats
    """Scratch, (2, states)."""


def linearised(horizon: int, states: int, units: int, nonzeros: int) -> Linearised:
    """Room for a trajectory and its derivatives."""
    width = padded(states + units)
    return Linearised(
        nodes=np.zeros((horizon + 1, states)),
        sensitivity=np.zeros((horizon, states, width)),
        points=np.zeros((4, states)),
        jacobians=np.zeros((4, nonzeros)),
        torques=np.eye(units, width, states),
        slope=np.zeros((2, states)),
    )


_NONE = np.zeros(0, dtype=np.int64)
NONZEROS = ByReference(Nonzeros(_NONE, _NONE)).kind
LINEARISED = ByReference(linearised(0, 0, 0, 0)).kind


@sweep(void(SLOPE, VECTOR, VECTOR, float64, int64, MATRIX, MATRIX))
def simulate(model, torques, constants, step, substeps, nodes, scratch):
    """Fill `nodes` (horizon + 1, states) from its first row on under `torques` (horizon * units,).

    `step` [s] is that of one Runge-Kutta step, of which `substeps` make a prediction step; `scratch` (3, states).
    """
    slope, point, total = scratch[0], scratch[1], scratch[2]
    horizon, states = nodes.shape[0] - 1, nodes.shape[1]
    units = torques.size // horizon
    for k in range(horizon):
        torque = torques[k * units : (k + 1) * units]
        now = nodes[k + 1]
        for i in range(states):
            now[i] = nodes[k, i]
        for _ in range(substeps):
            for i in range(states):
                point[i] = total[i] = now[i]
            for stage in range(4):
                model(point, torque, constants, slope)
                ahead = step if stage == 2 else 0.5 * step
                share = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
                for i in range(states):
                    point[i] = now[i] + ahead * slope[i]
                    total[i] += share * slope[i]
            for i in range(states):
                now[i] = total[i]


@sweep(void(RATE, TANGENT, VECTOR, VECTOR, float64, int64, LINEARISED))
def linearise(model, tangent, torques, constants, step, substeps, out):
    """As `simulate`, and fill `out` with the derivatives too."""
    points, jacobians = out.points, out.jacobians
    slope, total = out.slope[0], out.slope[1]
    horizon, states, width = out.sensitivity.shape
    units = torques.size // horizon
    for k in range(horizon):
        torque = torques[k * units : (k + 1) * units]
        now, moved = out.nodes[k + 1], out.sensitivity[k]
        for i in range(states):
            now[i] = out.nodes[k, i]
            for m in range(0, width, WIDTH):
                store(moved[i], m, spread(0.0))
            moved[i, i] = 1.0
        for _ in range(substeps):
            for i in range(states):
                total[i] = now[i]
                points[0, i] = now[i]
            for stage in range(4):
                model(points[stage], torque, constants, slope, jacobians[stage])
                ahead = step if stage == 2 else 0.5 * step
                share = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
                for i in range(states):
                    total[i] += share * slope[i]
                    if stage < 3:
                        points[stage + 1, i] = now[i] + ahead * slope[i]
            for i in range(states):
                now[i] = total[i]
            tangent(jacobians, step, moved, out.torques)


# The cost of a trajectory of one unit or a group, compiled.
#
# With U_j the torque scale of unit j, w_j its share of the group's mass, and sums over the units:
#
#     cost = sum over the horizon of tracking (sum w_j (u_j - target_j) / U_j)^2 + rate sum w_j ((u_j - u_j before) /
#     U_j)^2
#            + evenness sum w_j ((u_j - reference_j) / U_j)^2
#            + slip sum over the axles of share (max(0, slip - limit) / slip scale)^2 at the step's end.
#
# So the cost tracks the group's total effort, whichever unit delivers it; only evenness determines the split. An axle's
# share is that of its unit, divided by the unit's axles. The penalty of slip is a soft constraint with its slack
# eliminated.


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


_NONE_cost, _NUMBER = np.zeros(0), 0.0
COST = ByReference(
    Cost(
        np.zeros((0, 0)),
        AxleTerms(*[_NONE_cost] * 2),
        UnitTerms(*[_NONE_cost] * 5),
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


# The cost's quadratic model in the torques alone, compiled: the states are condensed away. Unknowns are u_j / U_j.


class Quadratic(NamedTuple):
    """The cost's quadratic model in the scaled torques; `condense` fills it. `size`: horizon * units, in whole blocks."""

    hessian: Floats
    """(horizon * units, horizon * units)"""
    gradient: Floats
    """(horizon * units,)"""
    adjoint: Floats
    """Derivative of the cost to go by the node, (horizon + 1, states)."""
    influence: Floats
    """Derivative of the nodes by the torques, (horizon + 1, states, size); a node's later torques stay zero."""
    excess: Floats
    """Derivative of the axles' penalised slips, over their root weight, (horizon * axles, size); scratch."""
    ends: Ints
    """Number of torques before the node of each row of `excess`, (horizon * axles,)."""
    tile: Floats
    """Scratch, (`ROWS`, `WIDTH`)."""


ROWS = 4
"""Rows of the Hessian that are summed up together: enough sums that none waits for another."""


def quadratic(horizon: int, states: int, axles: int, units: int) -> Quadratic:
    """Room for a quadratic model."""
    n = horizon * units
    return Quadratic(
        hessian=np.zeros((n, n)),
        gradient=np.zeros(n),
        adjoint=np.zeros((horizon + 1, states)),
        influence=np.zeros((horizon + 1, states, padded(n))),
        excess=np.zeros((horizon * axles, padded(n))),
        ends=np.zeros(horizon * axles, dtype=np.int64),
        tile=np.zeros((ROWS, WIDTH)),
    )


QUADRATIC = ByReference(quadratic(0, 0, 0, 0)).kind


@sweep(void(VECTOR, COST, QUADRATIC))
def _torque_terms(torques, terms, out):
    """Fill the upper half of the Hessian and the gradient with what the torques cost themselves."""
    unit, weights = terms.unit, terms.weights
    hessian, gradient = out.hessian, out.gradient
    units = unit.target.size
    horizon = torques.size // units
    for m in range(torques.size):
        for n in range(torques.size):
            hessian[m, n] = 0.0
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


@sweep(int64(LINEARISED, COST, QUADRATIC))
def _slip_slopes(around, terms, out):
    """Fill the adjoint with what the slips beyond their limit cost by the nodes; returns the last node with such slip."""
    slip_matrix, axle, adjoint = terms.slip_matrix, terms.axle, out.adjoint
    axles, states = slip_matrix.shape
    last = 0
    for j in range(states):
        adjoint[0, j] = 0.0
    for k in range(1, adjoint.shape[0]):
        for j in range(states):
            adjoint[k, j] = 0.0
        for i in range(axles):
            slip = -axle.slip_limit[i]
            for j in range(states):
                slip += slip_matrix[i, j] * around.nodes[k, j]
            if not slip <= 0.0:  # what is no number must surface
                last = k
                weight = 2.0 * terms.weights.slip * axle.share[i] / terms.weights.slip_scale**2
                for j in range(states):
                    adjoint[k, j] += weight * slip * slip_matrix[i, j]
    return last


@sweep(void(LINEARISED, COST, int64, QUADRATIC))
def _influence(around, terms, last, out):
    """Fill the influence of the torques on the nodes up to the node `last`."""
    sensitivity, influence, scale = around.sensitivity, out.influence, terms.unit.scale
    states, units = influence.shape[1], scale.size
    for k in range(last):
        before, known = k * units, (k + 1) * units
        now, then = influence[k], influence[k + 1]
        for i in range(states):
            moved = sensitivity[k, i]
            for m in range(0, known, WIDTH):
                change = spread(0.0)
                for j in range(states):
                    change = change + moved[j] * load(now[j], m)
                store(then[i], m, change)
            for j in range(units):
                then[i, before + j] = moved[states + j] * scale[j]


@sweep(int64(LINEARISED, COST, int64, QUADRATIC))
def _penalised(around, terms, last, out):
    """Fill `excess` for the axles beyond their limit up to the node `last`, node by node; returns their number."""
    slip_matrix, axle, excess = terms.slip_matrix, terms.axle, out.excess
    axles, states = slip_matrix.shape
    size, units = excess.shape[1], terms.unit.scale.size
    number = 0
    for k in range(1, last + 1):
        for i in range(axles):
            slip = -axle.slip_limit[i]
            for j in range(states):
                slip += slip_matrix[i, j] * around.nodes[k, j]
            if slip <= 0.0:
                continue
            weight = 2.0 * terms.weights.slip * axle.share[i] / terms.weights.slip_scale**2
            root, row = np.sqrt(weight), excess[number]
            for m in range(0, size, WIDTH):
                change = spread(0.0)
                if m < k * units:
                    for j in range(states):
                        if slip_matrix[i, j] != 0.0:
                            value = root * slip_matrix[i, j]
                            change = change + value * load(out.influence[k, j], m)
                store(row, m, change)
            out.ends[number] = k * units
            number += 1
    return number


@sweep(void(int64, QUADRATIC))
def _add_products(number, out):
    """Add to the Hessian's upper half the squares of the first `number` rows of `excess`."""
    hessian, excess, tile = out.hessian, out.excess, out.tile
    size, first = hessian.shape[0], 0
    for n in range(0, size, WIDTH):
        while first < number and out.ends[first] <= n:
            first += 1
        for m in range(0, min(n + WIDTH, size), ROWS):
            s0, s1, s2, s3 = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
            for r in range(first, number):
                row = excess[r]
                columns = load(row, n)
                s0 = s0 + row[m] * columns
                s1 = s1 + row[m + 1] * columns
                s2 = s2 + row[m + 2] * columns
                s3 = s3 + row[m + 3] * columns
            store(tile[0], 0, s0)
            store(tile[1], 0, s1)
            store(tile[2], 0, s2)
            store(tile[3], 0, s3)
            for a in range(min(ROWS, size - m)):
                for b in range(max(m + a - n, 0), min(WIDTH, size - n)):
                    hessian[m + a, n + b] += tile[a, b]


@sweep(void(LINEARISED, VECTOR, COST, QUADRATIC))
def condense(around, torques, terms, out):
    """Fill `out` with the Gauss-Newton model of the cost by u / U `around` a trajectory under `torques`."""
    sensitivity, scale = around.sensitivity, terms.unit.scale
    hessian, gradient, adjoint = out.hessian, out.gradient, out.adjoint
    states, units = adjoint.shape[1], scale.size
    _torque_terms(torques, terms, out)
    last = _slip_slopes(around, terms, out)
    _influence(around, terms, last, out)
    _add_products(_penalised(around, terms, last, out), out)
    for k in range(last, 0, -1):
        for j in range(states):
            costate, moved = adjoint[k, j], sensitivity[k - 1, j]
            if costate != 0.0:
                for i in range(units):
                    gradient[(k - 1) * units + i] += costate * moved[states + i] * scale[i]
                for i in range(states):
                    adjoint[k - 1, i] += moved[i] * costate
    for m in range(hessian.shape[0]):
        for n in range(m):
            hessian[m, n] = hessian[n, m]
