"""Single shooting over the horizon: states, their sensitivities, and the second-order terms, compiled.

From the measured state on, the torques alone decide the trajectory, so they are the only unknowns. Slip below the
peak is strongly stable and slip beyond it grows by a factor of three or so over the horizon: no need to keep the
states as unknowns too.

Torques of several units lie step by step in one vector (horizon * units,), so that a single unit has no dimension more.
"""

from functools import partial
from typing import Any, NamedTuple

from numba import float64, int64, types, void

from alloc.compilation import FASTMATH, compiled
from alloc.plant.structure import Floats, Ints


class Nonzeros(NamedTuple):
    """Places of the nonzeros of a model's derivatives by (state, torques)."""

    row: Ints
    """Row of each nonzero of the Jacobian of the slopes."""
    column: Ints
    upper_row: Ints
    """Row of each nonzero of the upper triangle of the weighted slopes' Hessian."""
    upper_column: Ints


class Linearised(NamedTuple):
    """A trajectory and its derivatives; `linearise` fills it.

    An evaluation is one of the model; a Runge-Kutta step has four.
    """

    nodes: Floats
    """(horizon + 1, states)"""
    sensitivity: Floats
    """Of each node to the node and the torques before, (horizon, states, states + units)."""
    points: Floats
    """Where the model was evaluated, (evaluations, states)."""
    jacobians: Floats
    """Nonzeros, (evaluations, nonzeros)."""
    spread: Floats
    """Sensitivity of each point, (evaluations, states, states + units)."""


def record(kind: type, *fields: Any) -> Any:
    """Numba's type of the named tuple `kind` with these types of `fields`."""
    return types.BaseTuple.from_types(fields, kind)


VECTOR, MATRIX, CUBE = float64[::1], float64[:, ::1], float64[:, :, ::1]
INDEX = int64[::1]
NONZEROS = record(Nonzeros, INDEX, INDEX, INDEX, INDEX)
LINEARISED = record(Linearised, MATRIX, CUBE, MATRIX, MATRIX, CUBE)
SLOPE = types.FunctionType(void(VECTOR, VECTOR, VECTOR, VECTOR))
"""Model: (state, torque of each unit, parameters, slope)."""
RATE = types.FunctionType(void(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR))
"""Model with derivatives: (state, torque, parameters, slope, nonzeros of the Jacobian)."""
CURVATURE = RATE
"""Second derivatives: (state, torque, parameters, weights of the slopes, nonzeros of the upper Hessian)."""


def sweep(signature):
    """Decorator of a compiled sweep; the signature is given, for the model is an argument of it."""
    return partial(
        compiled, signature=signature, error_model="numpy", fastmath=FASTMATH, nogil=True
    )


@sweep(void(SLOPE, VECTOR, VECTOR, float64, int64, MATRIX, MATRIX))
def simulate(model, torques, parameters, step, substeps, nodes, scratch):
    """Fill `nodes` (horizon + 1, states) from its first row on under `torques` (horizon * units,).

    `step` [s] is that of one Runge-Kutta step, of which `substeps` make a prediction step; `scratch` (3, states).
    """
    slope, point, total = scratch[0], scratch[1], scratch[2]
    horizon, states = nodes.shape[0] - 1, nodes.shape[1]
    units = torques.size // horizon
    for k in range(horizon):
        torque = torques[k * units : (k + 1) * units]
        now = nodes[k + 1]
        now[:] = nodes[k]
        for _ in range(substeps):
            point[:] = now
            total[:] = now
            for stage in range(4):
                model(point, torque, parameters, slope)
                ahead = step if stage == 2 else 0.5 * step
                share = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
                for i in range(states):
                    point[i] = now[i] + ahead * slope[i]
                    total[i] += share * slope[i]
            now[:] = total


@sweep(void(RATE, NONZEROS, VECTOR, VECTOR, float64, int64, LINEARISED, CUBE))
def linearise(model, nonzeros, torques, parameters, step, substeps, out, scratch):
    """As `simulate`, and fill `out` with the derivatives too; `scratch` (3, states, states + units)."""
    row, column = nonzeros.row, nonzeros.column
    nodes, sensitivity, points = out.nodes, out.sensitivity, out.points
    jacobians, spread = out.jacobians, out.spread
    horizon, states, width = sensitivity.shape
    units = width - states
    slope = scratch[2, 0, :states]
    change, total_change = scratch[0], scratch[1]
    total = scratch[2, 1, :states]
    e = 0
    for k in range(horizon):
        torque = torques[k * units : (k + 1) * units]
        now, moved = nodes[k + 1], sensitivity[k]
        now[:] = nodes[k]
        moved[:] = 0.0
        for i in range(states):
            moved[i, i] = 1.0
        for _ in range(substeps):
            total[:] = now
            total_change[:] = moved
            points[e] = now
            spread[e] = moved
            for stage in range(4):
                model(points[e], torque, parameters, slope, jacobians[e])
                change[:] = 0.0
                for j in range(row.size):
                    i, c, value = row[j], column[j], jacobians[e, j]
                    if c >= states:
                        change[i, c] += value
                    else:
                        for m in range(width):
                            change[i, m] += value * spread[e, c, m]
                share = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
                for i in range(states):
                    total[i] += share * slope[i]
                    for m in range(width):
                        total_change[i, m] += share * change[i, m]
                e += 1
                if stage < 3:
                    ahead = step if stage == 2 else 0.5 * step
                    for i in range(states):
                        points[e, i] = now[i] + ahead * slope[i]
                        for m in range(width):
                            spread[e, i, m] = moved[i, m] + ahead * change[i, m]
            now[:] = total
            moved[:] = total_change


@sweep(
    void(
        CURVATURE, NONZEROS, VECTOR, VECTOR, float64, int64, LINEARISED, MATRIX, CUBE, MATRIX,
    )
)  # fmt: skip
def second_order(
    curvature, nonzeros, torques, parameters, step, substeps, around, adjoint, hessians, scratch
):
    """Fill `hessians` (horizon, states + units, states + units): second derivatives of adjoint[k + 1] . node[k + 1].

    They are by the node and torques before, `around` a trajectory. Only evaluations of the model are nonlinear. So they
    are the sum over the evaluations of their Hessians, weighted with what the step's end owes to each slope, seen through
    the point's spread. `scratch` (6, at least the number of nonzeros).
    """
    row, column = nonzeros.row, nonzeros.column
    upper_row, upper_column = nonzeros.upper_row, nonzeros.upper_column
    points, jacobians, spread = around.points, around.jacobians, around.spread
    horizon, width, _ = hessians.shape
    states = adjoint.shape[1]
    units = width - states
    owed, point_owed, base_owed = scratch[0], scratch[1], scratch[2]
    weight = scratch[3, :states]
    values = scratch[4, : upper_row.size]
    for k in range(horizon - 1, -1, -1):
        torque = torques[k * units : (k + 1) * units]
        whole = hessians[k]
        whole[:] = 0.0
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
                curvature(points[e], torque, parameters, weight, values)
                for j in range(values.size):
                    a, b, value = upper_row[j], upper_column[j], values[j]
                    if value == 0.0:
                        continue
                    # a torque is constant over the step: its own row of the spread would be one of the identity
                    factor = value if a != b else 0.5 * value
                    for m in range(width):
                        left = spread[e, a, m] if a < states else (1.0 if m == a else 0.0)
                        right = spread[e, b, m] if b < states else (1.0 if m == b else 0.0)
                        for n in range(m, width):
                            left_n = spread[e, a, n] if a < states else (1.0 if n == a else 0.0)
                            right_n = spread[e, b, n] if b < states else (1.0 if n == b else 0.0)
                            whole[m, n] += factor * (left * right_n + right * left_n)
            for i in range(states):
                owed[i] = base_owed[i]
        for m in range(width):
            for n in range(m):
                whole[m, n] = whole[n, m]
