"""The optimal control problem of one control period: what is asked of a solver, and what it answers.

Everything counts positive in the direction of the demand, so braking and driving are one problem. One unit or a group: what
has an entry per unit may be a plain number where there is one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpc.condensing import (
    AXLE_ROWS,
    AXLE_SHARE,
    EVENNESS,
    RATE,
    SLIP,
    SLIP_SCALE,
    TORQUE_SCALE,
    TRACKING,
    UNIT_ROWS,
    UNIT_SHARE,
    WEIGHTS,
)
from mpc.settings import MpcSettings
from mpc.unit_model import Units, group_of, torque_per_coefficient, unit_of_axle

Floats = NDArray[np.float64]


class HorizonProblem(NamedTuple):
    """Data of the problem of one control period; the cost is that of `mpc.condensing`."""

    state: Floats
    """State of the model now, (axles + 1 + units,)."""
    parameters: Floats
    """Parameters of the model, see `mpc.unit_model.parameters`."""
    slip_limit: Floats
    """Slip velocity that each axle should stay below [m/s], (axles,)."""
    target: float | Floats
    """Torque wanted of each motor of each unit [N m], (units,); of a group only their total counts."""
    before: float | Floats
    """Torque command of the period before [N m], (units,)."""
    upper: float | Floats
    """Greatest torque command [N m], (units,); the least is zero."""
    reference: float | Floats = 0.0
    """Torque of an even split [N m], (units,), which decides who gives the total of a group."""


class HorizonSolution(NamedTuple):
    """Answer of a solver."""

    torques: Floats
    """Torque commands over the horizon [N m], step by step, (horizon * units,)."""
    cost: float
    residual: float
    """Optimality residual: largest change of a torque, over the torque scale, by a projected gradient step.

    For the real-time iteration, as cost, that of the last linearisation, before the last step."""
    iterations: int
    status: str
    """"ok", or what went wrong."""


def weight_vector(settings: MpcSettings, evenness: float = 0.0) -> Floats:
    """Weights as the compiled cost takes them, (WEIGHTS,)."""
    weights = np.empty(WEIGHTS)
    weights[TRACKING] = settings.weights.tracking
    weights[SLIP] = settings.weights.slip
    weights[RATE] = settings.weights.rate
    weights[EVENNESS] = evenness
    weights[SLIP_SCALE] = settings.weights.slip_scale
    return weights


def unit_rows(units: Units, settings: MpcSettings) -> Floats:
    """Rows of the units as the compiled cost takes them, (UNIT_ROWS, units), with scale and share filled in."""
    group = group_of(units)
    rows = np.zeros((UNIT_ROWS, len(group)))
    carried = np.array([torque_per_coefficient(context) for context in group])
    mass = np.array([context.mass for context in group])
    rows[TORQUE_SCALE] = settings.weights.coefficient_scale * carried
    rows[UNIT_SHARE] = mass / mass.sum()
    return rows


def axle_rows(units: Units, share: Floats) -> Floats:
    """Rows of the axles as the compiled cost takes them, (AXLE_ROWS, axles); `share` (units,) of the group's mass."""
    unit = unit_of_axle(units)
    rows = np.zeros((AXLE_ROWS, unit.size))
    rows[AXLE_SHARE] = (share / np.bincount(unit))[unit]
    return rows
