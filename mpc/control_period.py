"""What the controllers of a unit and of a group share: one answer per control period.

A controller updates its belief about the rail, asks the real-time iteration for the best torques over the horizon, and
commands the first. A solver that fails, is too slow or is given what is no number is answered with ok = False; the unit then
cuts and ramps. What is raised is a fault of the program and ends the run. Braking is driving mirrored: every law of a
unit is odd.
"""

import math
from collections.abc import Sequence

import numpy as np

from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.plant.structure import Floats
from mpc.belief import GroupBelief, UnitBelief
from mpc.horizon import HorizonProblem
from mpc.real_time import RealTimeIteration
from mpc.settings import MpcSettings


class PredictiveController:
    """Controller of the units of `contexts` as one problem; a subclass says what it believes and what it asks.

    Arrays of its methods are (units,), or (axles,) unit by unit, and count positive in the direction of the demand.
    """

    belief: UnitBelief | GroupBelief

    def __init__(
        self, contexts: Sequence[UnitContext], settings: MpcSettings, solver: RealTimeIteration
    ) -> None:
        self.settings = settings
        self._solver = solver
        self._axles = sum(context.axles for context in contexts)
        self._late = settings.steps_in_time(contexts[0].period) < 1
        self._period = contexts[0].period
        self._shifts = math.isclose(self._period, settings.step)
        self._sign = 0.0
        self._observed = 0.0
        """Direction that the observers count in; 0: a reading was missed."""
        self._before = np.zeros(len(contexts))
        self._in_force = self._before
        """Signed torques of the present period, if computing takes one."""
        self._found = "ok"
        """Status of the torques that will act next, if computing takes a period."""

    def _believe(
        self, speed: Floats, omega: Floats, torque: Floats, wanted: Floats, estimate: Floats
    ) -> None:
        """Take in the readings; `wanted`: torques that the motors could give; `estimate`: each unit's of its coefficient."""
        raise NotImplementedError

    def _problem(
        self, speed: Floats, omega: Floats, torque: Floats, target: Floats, limit: Floats
    ) -> HorizonProblem:
        """The problem of this period; `limit`: of the motors."""
        raise NotImplementedError

    def _answer(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period."""
        torques, status, residual, steps = self._decide(senses)
        if status == "ok" and steps > 0 and self._late:
            status = "late"
        elapsed = steps * self.settings.step_time
        if status != "ok":
            self._sign = (
                0.0  # guess anew: what the units do meanwhile is not known here, but observed
            )
        if self.settings.computing_delay:
            torques, status, self._found = self._in_force, self._found, status
        if status != "ok":
            return [TorqueDecision(0.0, False, status, elapsed, residual) for _ in senses]
        return [TorqueDecision(float(u), True, status, elapsed, residual) for u in torques]

    def _decide(self, senses: Sequence[UnitSense]) -> tuple[Floats, str, float, int]:
        """Torques, status, residual, and SQP steps taken."""
        self._in_force = self._sign * self._before
        columns = np.array(
            [(s.speed, s.torque, s.target, s.drive_limit, s.brake_limit) for s in senses]
        ).T
        omega = np.concatenate([sense.omega for sense in senses])
        if not (np.isfinite(columns).all() and np.isfinite(omega).all()):
            self._observed = 0.0
            return self._before, "reading not finite", math.nan, 0
        if omega.size != self._axles:
            raise ValueError(f"{omega.size} angular speeds for {self._axles} axles")
        speed, torque, target, drive_limit, brake_limit = columns
        total = float(target.sum())
        sign = math.copysign(1.0, total) if total else self._sign or 1.0
        if sign != self._observed:
            self.belief.forget_forces()
            self._observed = sign
        if sign != self._sign:
            self._before = np.maximum(sign * torque, 0.0)
            self._solver.restart(self._before)
            self._sign = sign
        elif self._shifts and self._solver.prepared is None:
            self._solver.shift()
        speed, omega, torque = sign * speed, sign * omega, sign * torque
        limit = drive_limit if sign > 0.0 else brake_limit
        estimate = np.array([sense.coefficient for sense in senses])
        self._believe(speed, omega, torque, np.minimum(sign * target, limit), estimate)
        if total == 0.0:
            self._before = self._in_force = np.zeros(len(senses))
            self._solver.restart(0.0)
            return self._before, "ok", 0.0, 0
        if self.settings.computing_delay:
            # that the driver wants less now needs no computing
            self._before = min(1.0, abs(total) / max(self._before.sum(), 1e-9)) * self._before
            self._in_force = sign * self._before
        problem = self._problem(speed, omega, torque, sign * target, limit)
        if self.settings.computing_delay and self.settings.compensated:
            problem = self._solver.ahead(problem, self._period)
        solution = self._solver.solve(problem)
        self._before = solution.torques[: len(senses)].copy()
        if self.settings.phases_apart and solution.status == "ok" and not self._late:
            self._prepare(problem)
        return sign * self._before, solution.status, solution.residual, solution.iterations

    def _prepare(self, problem: HorizonProblem) -> None:
        """The preparation phase for the next readings, once the command is out."""
        if self._shifts:
            self._solver.shift()
        coming = problem._replace(
            before=self._before,
            slip_limit=np.broadcast_to(self.belief.coming_slip_limit, problem.slip_limit.shape),
        )
        if not self._solver.prepare(coming, self._period):
            self._sign = 0.0
