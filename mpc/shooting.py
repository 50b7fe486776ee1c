"""Single shooting over the horizon: states, their sensitivities, and the second-order terms, compiled.

From the measured state on, the torques alone determine the trajectory, so they are the only unknowns. Slip below the peak is
strongly stable, and slip beyond it grows by a factor of about three over the horizon. So the states need not be unknowns
too.

Torques of several units are stored step by step in one vector (horizon * units,), so that a single unit has no further
dimension. Sensitivities are rows of whole blocks of `alloc.plant.simd.WIDTH` numbers, to be processed a block at a time.
"""

from typing import NamedTuple

import numpy as np
from numba import float64, int64, void

from alloc.by_reference import ByReference
from alloc.plant.simd import WIDTH, padded, spread, store
from alloc.plant.structure import Floats, Ints
from mpc.arrays import CUBE, CURVATURE, MATRIX, RATE, SLOPE, TANGENT, VECTOR, sweep


class Nonzeros(NamedTuple):
    """Places of the nonzeros of a model's derivatives by (state, torques)."""

    row: Ints
    """Row of each nonzero of the Jacobian of the slopes."""
    column: Ints
    upper_row: Ints
    """Row of each nonzero of the upper triangle of the weighted slopes' Hessian."""
    upper_column: Ints


class Linearised(NamedTuple):
    """A trajectory and its derivatives; `linearise` fills it. `width` stands for states + units, in whole blocks.

    An evaluation is one of the model; a Runge-Kutta step has four. Only the second derivatives need those of all steps.
    """

    nodes: Floats
    """(horizon + 1, states)"""
    sensitivity: Floats
    """Of each node to the node and the torques before, (horizon, states, width)."""
    points: Floats
    """Where the model was evaluated, (evaluations, states)."""
    jacobians: Floats
    """Nonzeros, (evaluations, nonzeros)."""
    spread: Floats
    """Sensitivity of each point and of the torques, (evaluations, states + units, width)."""
    slope: Floats
    """Scratch, (2, states)."""


def linearised(
    horizon: int, evaluations: int, states: int, units: int, nonzeros: int
) -> Linearised:
    """Room for a trajectory and its derivatives."""
    width = padded(states + units)
    around = Linearised(
        nodes=np.zeros((horizon + 1, states)),
        sensitivity=np.zeros((horizon, states, width)),
        points=np.zeros((evaluations, states)),
        jacobians=np.zeros((evaluations, nonzeros)),
        spread=np.zeros((evaluations, states + units, width)),
        slope=np.zeros((2, states)),
    )
    for j in range(states, states + units):
        around.spread[:, j, j] = 1.0  # a torque is constant over a step of the horizon
    return around


_NONE = np.zeros(0, dtype=np.int64)
NONZEROS = ByReference(Nonzeros(_NONE, _NONE, _NONE, _NONE)).kind
LINEARISED = ByReference(linearised(0, 0, 0, 0, 0)).kind


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
    e = 0
    for k in range(horizon):
        torque = torques[k * units : (k + 1) * units]
        now, moved = out.nodes[k + 1], out.sensitivity[k]
        for i in range(states):
            now[i] = out.nodes[k, i]
            for m in range(0, width, WIDTH):
                store(moved[i], m, spread(0.0))
            moved[i, i] = 1.0
        for _ in range(substeps):
            first = e if e < points.shape[0] else 0
            for i in range(states):
                total[i] = now[i]
                points[first, i] = now[i]
            for stage in range(4):
                e = first + stage
                model(points[e], torque, constants, slope, jacobians[e])
                ahead = step if stage == 2 else 0.5 * step
                share = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
                for i in range(states):
                    total[i] += share * slope[i]
                    if stage < 3:
                        points[e + 1, i] = now[i] + ahead * slope[i]
            for i in range(states):
                now[i] = total[i]
            e = first + 4
            tangent(jacobians[first:e], step, moved, out.spread[first:e])


@sweep(
    void(
        CURVATURE, NONZEROS, VECTOR, VECTOR, float64, int64, LINEARISED, MATRIX, CUBE, MATRIX,
    )
)  # fmt: skip
def second_order(
    curvature, nonzeros, torques, constants, step, substeps, around, adjoint, hessians, scratch
):
    """Fill `hessians` (horizon, states + units, states + units): second derivatives of adjoint[k + 1] . node[k + 1].

    They are by the node and torques before, `around` a trajectory. Only evaluations of the model are nonlinear. So they
    are the sum over the evaluations of their Hessians, weighted with what the step's end owes to each slope, seen through
    the point's spread. `scratch` (6, at least the number of nonzeros).
    """
    row, column = nonzeros.row, nonzeros.column
    upper_row, upper_column = nonzeros.upper_row, nonzeros.upper_column
    points, jacobians, places = around.points, around.jacobians, around.spread
    horizon, width, _ = hessians.shape
    states = adjoint.shape[1]
    units = width - states
    owed, point_owed, base_owed = scratch[0], scratch[1], scratch[2]
    weight = scratch[3, :states]
    values = scratch[4, : upper_row.size]
    for k in range(horizon - 1, -1, -1):
        torque = torques[k * units : (k + 1) * units]
        whole = hessians[k]
        for m in range(width):
            for n in range(width):
                whole[m, n] = 0.0
        for i in range(states):
            owed[i] = adjoint[k + 1, i]
        for s in range(substeps - 1, -1, -1):
            first = (k * substeps + s) * 4
            for i in range(states):
                point_owed[i] = 0.0
                base_owed[i] = owed[i]
            for stage in range(3, -1, -1):
                e = first + stage
                share = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
                ahead = step if stage == 2 else 0.5 * step
                for i in range(states):
                    weight[i] = share * owed[i]
                    if stage < 3:
                        weight[i] += ahead * point_owed[i]
                    point_owed[i] = 0.0
                for j in range(row.size):
                    if column[j] < states:
                        point_owed[column[j]] += jacobians[e, j] * weight[row[j]]
                for i in range(states):
                    base_owed[i] += point_owed[i]
                curvature(points[e], torque, constants, weight, values)
                for j in range(values.size):
                    a, b, value = upper_row[j], upper_column[j], values[j]
                    if value == 0.0:
                        continue
                    factor = value if a != b else 0.5 * value
                    for m in range(width):
                        left, right = places[e, a, m], places[e, b, m]
                        for n in range(m, width):
                            whole[m, n] += factor * (
                                left * places[e, b, n] + right * places[e, a, n]
                            )
            for i in range(states):
                owed[i] = base_owed[i]
        for m in range(width):
            for n in range(m):
                whole[m, n] = whole[n, m]
