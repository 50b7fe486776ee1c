"""The readhesion MPC of one traction unit in Python, its solver exchangeable: the reference of `mpc.unit_step`."""

import math
from collections.abc import Callable

import numpy as np

from alloc.by_reference import ByReference
from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.plant.structure import Floats
from mpc.belief import UnitBelief, with_predicted_curve
from mpc.control_period import PredictiveController
from mpc.horizon import HorizonProblem, HorizonSolution, Problem
from mpc.real_time import RealTimeIteration
from mpc.reference import solve
from mpc.settings import MpcError, MpcSettings
from mpc.unit_model import Units
from mpc.unit_problem import pose, unit_problem

Iteration = Callable[[Units, MpcSettings], RealTimeIteration]
"""Makes the solver of a unit's problem; another solver derives from `RealTimeIteration` and has its own `solve`."""


class OptiIteration(RealTimeIteration):
    """Solves the problem to convergence as `mpc.reference` states it, from its last solution on."""

    solver = "ipopt"
    """One of those of `mpc.solve`."""

    def __init__(self, units: Units, settings: MpcSettings, evenness: float = 0.0) -> None:
        super().__init__(units, settings, evenness)
        self._units = units

    def solve(self, problem: HorizonProblem) -> HorizonSolution:
        """As the loop's solver; the residual is not known (nan)."""
        plan = solve(Problem(self._units, self._settings, problem, self.torques), self.solver)
        if plan.status == "ok":
            self.torques[:] = plan.torques.ravel()
        return HorizonSolution(
            self.torques.copy(), plan.cost, math.nan, plan.iterations, plan.status
        )


class MpcController(PredictiveController):
    """Readhesion MPC of one unit; a `HostController`.

    It follows the target torque, keeps the slip at the best value that `mpc.slip_search` finds, and avoids changes of
    torque; see `MpcSettings` for the weights. `iteration` makes its solver: belief, limits and problem are the same for all
    solvers.
    """

    belief: UnitBelief

    def __init__(
        self,
        context: UnitContext,
        settings: MpcSettings | None = None,
        iteration: Iteration = RealTimeIteration,
    ) -> None:
        settings = settings or MpcSettings()
        if settings.phases_apart and iteration is not RealTimeIteration:
            raise MpcError(
                "mpc: phases_apart = True needs the project's own solver; set it to False"
            )
        predicted = with_predicted_curve(context)
        solver = iteration(predicted, settings)
        super().__init__([context], settings, solver)
        self.belief = UnitBelief(context, settings)
        self._unit = unit_problem(predicted, settings, self.belief.record, solver.period)
        self._record = ByReference(self._unit)

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """Torque command for the coming control period."""
        return self._answer([sense])[0]

    def _believe(
        self, speed: Floats, omega: Floats, torque: Floats, wanted: Floats, estimate: Floats
    ) -> None:
        own = (float(values[0]) for values in (torque, wanted, estimate))
        self.belief.update(float(speed[0]), omega, *own)

    def _problem(
        self, speed: Floats, omega: Floats, torque: Floats, target: Floats, limit: Floats
    ) -> HorizonProblem:
        pose(self._record, target[0], limit[0])
        now, terms = self._unit.solver.now, self._unit.solver.terms
        state = np.concatenate([speed, omega, torque])
        return HorizonProblem(
            state, now.parameters, terms.axle.slip_limit, terms.unit.target, self._before, now.upper[:1]
        )  # fmt: skip
