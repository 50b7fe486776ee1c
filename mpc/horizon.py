"""The optimal control problem of one control period: what is asked of a solver, and what it answers.

Everything counts positive in the direction of the demand, so braking and driving are one problem.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.host import UnitContext
from mpc.condensing import RATE, SLIP, SLIP_SCALE, TORQUE_SCALE, TRACKING, WEIGHTS
from mpc.settings import MpcSettings
from mpc.unit_model import torque_per_coefficient

Floats = NDArray[np.float64]


class HorizonProblem(NamedTuple):
    """Data of the problem of one control period; the cost is that of `mpc.condensing`."""

    state: Floats
    """State of the model now, (axles + 2,)."""
    parameters: Floats
    """Parameters of the model, see `mpc.unit_model.parameters`."""
    slip_limit: Floats
    """Slip velocity that each axle should stay below [m/s], (axles,)."""
    target: float
    """Torque wanted of each motor [N m]."""
    before: float
    """Torque command of the period before [N m]."""
    upper: float
    """Greatest torque command [N m]; the least is zero."""


class HorizonSolution(NamedTuple):
    """Answer of a solver."""

    torques: Floats
    """Torque commands over the horizon [N m], (horizon,)."""
    cost: float
    residual: float
    """Optimality residual: largest change of a torque, over the torque scale, by a projected gradient step.

    For the real-time iteration, as cost, that of the last linearisation, before the last step."""
    iterations: int
    status: str
    """"ok", or what went wrong."""


def weight_vector(context: UnitContext, settings: MpcSettings) -> Floats:
    """Weights and scales as the compiled cost takes them, (WEIGHTS,)."""
    weights = np.empty(WEIGHTS)
    weights[TRACKING] = settings.weights.tracking
    weights[SLIP] = settings.weights.slip
    weights[RATE] = settings.weights.rate
    weights[TORQUE_SCALE] = settings.weights.coefficient_scale * torque_per_coefficient(context)
    weights[SLIP_SCALE] = settings.weights.slip_scale
    return weights
