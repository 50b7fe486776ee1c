"""The readhesion MPC of one traction unit."""

from dataclasses import replace

import numpy as np

from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.plant.structure import Floats
from mpc.belief import CurveObserver
from mpc.control_period import PredictiveController
from mpc.curve_belief import stretched
from mpc.horizon import HorizonProblem
from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings
from mpc.unit_model import parameters, torque_per_coefficient

STIFFNESS_MARGIN = 0.8
"""How much stiffer than the believed curve, as a share of its stretch, the steps of the prediction are made for."""


class MpcController(PredictiveController):
    """Readhesion MPC of one unit; a `HostController`.

    It follows the target torque, holds the slip below that of the believed curve's peak and avoids changes of torque;
    see `MpcSettings` for the weights.
    """

    belief: CurveObserver

    def __init__(self, context: UnitContext, settings: MpcSettings | None = None) -> None:
        settings = settings or MpcSettings()
        super().__init__([context], settings, RealTimeIteration(context, settings))
        self.belief = CurveObserver(context, settings.belief, settings.curve)
        self._stable_stretch = STIFFNESS_MARGIN
        self._context = context
        self._carried = torque_per_coefficient(context)
        self._parameters = parameters(context, self.belief.peak)
        self._slip_limit = np.zeros(context.axles)

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """Torque command for the coming control period."""
        return self._answer([sense])[0]

    def _believe(self, speed: Floats, omega: Floats, torque: Floats, estimate: Floats) -> None:
        self.belief.update(float(speed[0]), omega, float(torque[0]), float(estimate[0]))

    def _problem(
        self, speed: Floats, omega: Floats, torque: Floats, target: Floats, limit: Floats
    ) -> HorizonProblem:
        belief = self.belief
        if belief.stretch < self._stable_stretch:
            self._refine(belief.stretch)
        self._parameters[: omega.size] = belief.peak
        self._parameters[-belief.q.size :] = belief.q
        np.multiply(belief.peak_slip, self.settings.slip_limit, out=self._slip_limit)
        carried = (1.0 + self.settings.headroom) * belief.peak.min() * self._carried
        return HorizonProblem(
            state=np.concatenate([speed, omega, torque]),
            parameters=self._parameters,
            slip_limit=self._slip_limit,
            target=target,
            before=self._before,
            upper=np.minimum(np.minimum(target, limit), carried),
        )

    def _refine(self, stretch: float) -> None:
        """Divide the prediction's steps more finely: a curve steeper than the given one would make them unstable.

        The margin of Runge-Kutta's stability over the plant's own bound covers what the given curve's steps do not.
        """
        self._stable_stretch = STIFFNESS_MARGIN * stretch
        curve = stretched(self._context.curve, self._stable_stretch)
        torques = self._solver.torques
        self._solver = RealTimeIteration(replace(self._context, curve=curve), self.settings)
        self._solver.torques[:] = torques
