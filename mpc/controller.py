"""The readhesion MPC of one traction unit, as the simulation calls it.

Once per control period: update the belief about the peaks, ask the real-time iteration for the best torques over the
horizon, command the first. Whatever goes wrong is answered with ok = False; the unit then cuts and ramps.
"""

import math
import time as clock
from dataclasses import replace

import numpy as np

from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from mpc.belief import CurveObserver
from mpc.curve_belief import stretched
from mpc.horizon import HorizonProblem
from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings
from mpc.unit_model import parameters, torque_per_coefficient

STIFFNESS_MARGIN = 0.8
"""How much stiffer than the believed curve, as a share of its stretch, the steps of the prediction are made for."""


class MpcController:
    """Readhesion MPC of one unit; a `HostController`.

    Follows the target torque, holds the slip below that of the believed curve's peak and avoids changes of torque; see
    `MpcSettings` for the weights. Braking is driving mirrored: every law of the unit is odd.
    """

    def __init__(self, context: UnitContext, settings: MpcSettings | None = None) -> None:
        self.settings = settings or MpcSettings()
        self.belief = CurveObserver(context, self.settings.belief, self.settings.curve)
        self._solver = RealTimeIteration(context, self.settings)
        self._stable_stretch = STIFFNESS_MARGIN
        self._context = context
        self._carried = torque_per_coefficient(context)
        self._parameters = parameters(context, self.belief.peak)
        self._state = np.zeros(context.axles + 2)
        self._omega = np.zeros(context.axles)
        self._slip_limit = np.zeros(context.axles)
        self._shifts = math.isclose(context.period, self.settings.step)
        self._sign = 0.0
        self._before = 0.0

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """Torque command for the coming control period; never raises."""
        started = clock.perf_counter()
        try:
            torque, status, residual = self._decide(sense, started)
        except Exception as error:  # a controller on board must answer, whatever happens
            torque, status, residual = math.nan, f"{type(error).__name__}: {error}", math.nan
        elapsed = clock.perf_counter() - started
        if status == "ok" and elapsed > self.settings.deadline:
            status = "late"
        if status != "ok":
            self._sign = 0.0  # start anew: what the unit does meanwhile is not known here
            return TorqueDecision(0.0, False, status, elapsed, residual)
        return TorqueDecision(torque, True, status, elapsed, residual)

    def _decide(self, sense: UnitSense, started: float) -> tuple[float, str, float]:
        readings = (sense.speed, sense.torque, sense.target, sense.drive_limit, sense.brake_limit)
        if not (all(map(math.isfinite, readings)) and np.isfinite(sense.omega).all()):
            return math.nan, "reading not finite", math.nan
        sign = math.copysign(1.0, sense.target) if sense.target else self._sign or 1.0
        if sign != self._sign:
            self.belief.forget_forces()
            self._before = max(sign * sense.torque, 0.0)
            self._solver.restart(self._before)
            self._sign = sign
        elif self._shifts:
            self._solver.shift()
        np.multiply(sense.omega, sign, out=self._omega)
        speed, torque = sign * sense.speed, sign * sense.torque
        self.belief.update(speed, self._omega, torque, sense.coefficient)
        if sense.target == 0.0:
            self._before = 0.0
            self._solver.restart(0.0)
            return 0.0, "ok", 0.0
        if self.belief.stretch < self._stable_stretch:
            self._refine(self.belief.stretch)
        solution = self._solver.solve(
            self._problem(sense, speed, torque), started + 0.5 * self.settings.deadline
        )
        self._before = float(solution.torques[0])
        return sign * self._before, solution.status, solution.residual

    def _refine(self, stretch: float) -> None:
        """Divide the prediction's steps more finely: a curve steeper than the given one would make them unstable.

        The margin of Runge-Kutta's stability over the plant's own bound covers what the given curve's steps do not.
        """
        self._stable_stretch = STIFFNESS_MARGIN * stretch
        curve = stretched(self._context.curve, self._stable_stretch)
        torques = self._solver.torques
        self._solver = RealTimeIteration(replace(self._context, curve=curve), self.settings)
        self._solver.torques[:] = torques

    def _problem(self, sense: UnitSense, speed: float, torque: float) -> HorizonProblem:
        n = self._context.axles
        self._state[0], self._state[1 : n + 1], self._state[n + 1] = speed, self._omega, torque
        self._parameters[:n] = self.belief.peak
        self._parameters[-self.belief.q.size :] = self.belief.q
        np.multiply(self.belief.peak_slip, self.settings.slip_limit, out=self._slip_limit)
        limit = sense.drive_limit if sense.target > 0.0 else sense.brake_limit
        carried = (1.0 + self.settings.headroom) * self.belief.peak.min() * self._carried
        target = abs(sense.target)
        return HorizonProblem(
            state=self._state,
            parameters=self._parameters,
            slip_limit=self._slip_limit,
            target=target,
            before=self._before,
            upper=float(min(target, limit, carried)),
        )


def factory(context: UnitContext) -> MpcController:
    """Controller of a unit with default settings; a `HostControllerFactory`."""
    return MpcController(context)
