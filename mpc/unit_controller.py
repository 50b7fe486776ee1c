"""The readhesion MPC of one traction unit in Python, its solver exchangeable: the reference of `mpc.unit_step`."""

import numpy as np

from alloc.by_reference import ByReference
from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.plant.structure import Floats
from mpc.belief import CurveObserver
from mpc.control_period import PredictiveController
from mpc.horizon import HorizonProblem
from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings
from mpc.unit_problem import pose, steepest, unit_problem


class MpcController(PredictiveController):
    """Readhesion MPC of one unit; a `HostController`.

    It follows the target torque, holds the slip below that of the believed curve's peak and avoids changes of torque;
    see `MpcSettings` for the weights.
    """

    belief: CurveObserver

    def __init__(self, context: UnitContext, settings: MpcSettings | None = None) -> None:
        settings = settings or MpcSettings()
        solver = RealTimeIteration(context, settings, steepest=steepest(settings))
        super().__init__([context], settings, solver)
        self._context = context
        self.belief = CurveObserver(context, settings.belief, settings.curve)
        self._unit = unit_problem(context, settings, self.belief.record, solver.period)
        self._record = ByReference(self._unit)

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """Torque command for the coming control period."""
        return self._answer([sense])[0]

    def _believe(self, speed: Floats, omega: Floats, torque: Floats, estimate: Floats) -> None:
        self.belief.update(float(speed[0]), omega, float(torque[0]), float(estimate[0]))

    def _problem(
        self, speed: Floats, omega: Floats, torque: Floats, target: Floats, limit: Floats
    ) -> HorizonProblem:
        pose(self._record, target[0], limit[0])
        now, terms = self._unit.solver.now, self._unit.solver.terms
        state = np.concatenate([speed, omega, torque])
        return HorizonProblem(
            state, now.parameters, terms.axle.slip_limit, terms.unit.target, self._before, now.upper[:1]
        )  # fmt: skip
