"""The data of the optimal control problem of one control period, and its answer; `mpc.reference` states it whole.

Everything counts positive in the direction of the demand, so braking and driving are one problem. The problem is for one
unit or a group; with one unit, plain numbers may replace entries per unit.
"""

from typing import NamedTuple

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.structure import Floats
from mpc.cost import AxleTerms, Cost, CostWeights, UnitTerms
from mpc.settings import MpcError, MpcSettings
from mpc.unit_model import (
    Units,
    group_of,
    slip_matrix,
    torque_per_coefficient,
    unit_model,
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


class Problem(NamedTuple):
    """The whole problem of a period, of a unit or of a group, for `mpc.solve`."""

    units: Units
    settings: MpcSettings
    period: HorizonProblem
    guess: Floats | None = None
    """Torques to start from [N m], (horizon, units); None: those of the period before, held."""

    @property
    def evenness(self) -> float:
        """Weight of that term of the cost; a unit alone has nobody to share with."""
        alone = isinstance(self.units, UnitContext)
        return 0.0 if alone else self.settings.group.evenness

    def numbers(self) -> list[Floats]:
        """Data of the period as arrays of their full size; raises `MpcError` where one has another."""
        model, found = unit_model(self.units), []
        sizes = model.states, model.parameters.numel(), model.axles, *[model.units] * 4
        for name, value, size in zip(self.period._fields, self.period, sizes, strict=True):
            if np.size(value) not in (1, size):
                raise MpcError(f"mpc: {name} has {np.size(value)} numbers; give it {size}")
            found.append(np.broadcast_to(np.asarray(value, dtype=float), size))
        return found

    def guessed(self) -> Floats:
        """The guess within its bounds, (horizon, units)."""
        now, shape = self.period, (self.settings.horizon, len(group_of(self.units)))
        guess = now.before if self.guess is None else np.reshape(self.guess, shape)
        return np.clip(np.broadcast_to(guess, shape), 0.0, now.upper)


class Plan(NamedTuple):
    """What `mpc.solve` answers."""

    torques: Floats
    """Torque commands [N m], (horizon, units)."""
    states: Floats
    """From the measured one on, (horizon + 1, states), see `mpc.unit_model.UnitModel`."""
    slack: Floats
    """Slip beyond its limit at the end of each step, over the scale of slip, (horizon, axles)."""
    cost: float
    status: str
    """"ok", or what went wrong: the rest is then not to be used."""
    iterations: int
    solve_time: float
    """Measured [s]; without what is made once for all problems of a shape."""


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
