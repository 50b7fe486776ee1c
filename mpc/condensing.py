"""The cost's quadratic model in the torques alone, compiled: the states are condensed away. Unknowns are u_j / U_j."""

from typing import NamedTuple

import numpy as np
from numba import int64, void

from alloc.by_reference import ByReference
from alloc.plant.simd import WIDTH, load, padded, spread, store
from alloc.plant.structure import Floats, Ints
from mpc.arrays import VECTOR, sweep
from mpc.cost import COST
from mpc.shooting import LINEARISED


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
            owed, moved = adjoint[k, j], sensitivity[k - 1, j]
            if owed != 0.0:
                for i in range(units):
                    gradient[(k - 1) * units + i] += owed * moved[states + i] * scale[i]
                for i in range(states):
                    adjoint[k - 1, i] += moved[i] * owed
    for m in range(hessian.shape[0]):
        for n in range(m):
            hessian[m, n] = hessian[n, m]
