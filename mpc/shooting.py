"""Single shooting over the horizon: states and their sensitivities, compiled.

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
from mpc.arrays import MATRIX, RATE, SLOPE, TANGENT, VECTOR, sweep


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
