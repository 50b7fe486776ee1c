"""The optimal control problem of one control period: the solver's input and its answer.

Everything counts positive in the direction of the demand, so braking and driving are one problem. The problem is for one
unit or a group; with one unit, plain numbers may replace entries per unit.
"""

from typing import NamedTuple

import numpy as np

from alloc.plant.structure import Floats
from mpc.cost import AxleTerms, Cost, CostWeights, UnitTerms
from mpc.settings import MpcSettings
from mpc.unit_model import (
    Units,
    group_of,
    slip_matrix,
    torque_per_coefficient,
    unit_of_axle,
)


class HorizonProblem(NamedTuple):
    """Data of the problem of one control period; the cost is that of `mpc.cost`."""

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


def cost_of(units: Units, settings: MpcSettings, evenness: float = 0.0) -> Cost:
    """Cost as the compiled functions take it; targets, torques before, references and slip limits are still to come."""
    group, unit = group_of(units), unit_of_axle(units)
    w = settings.weights
    mass = np.array([context.mass for context in group])
    carried = np.array([torque_per_coefficient(context) for context in group])
    share = mass / mass.sum()
    n = len(group)
    return Cost(
        slip_matrix=slip_matrix(units),
        axle=AxleTerms(np.zeros(unit.size), (share / np.bincount(unit))[unit]),
        unit=UnitTerms(np.zeros(n), np.zeros(n), np.zeros(n), w.coefficient_scale * carried, share),
        weights=CostWeights(*map(float, (w.tracking, w.slip, w.rate, evenness, w.slip_scale))),
    )
