"""The readhesion MPC of several units as one problem: of the units of a car, or of all units of a train without delay."""

import math
import time as clock
from collections.abc import Sequence
from itertools import groupby

import numpy as np

from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from mpc.condensing import TORQUE_SCALE, UNIT_SHARE
from mpc.group_belief import GroupBelief, even_split
from mpc.group_settings import GroupSettings
from mpc.horizon import HorizonProblem, unit_rows
from mpc.real_time import RealTimeIteration
from mpc.unit_model import parameters, unit_of_axle


class GroupController:
    """Readhesion MPC of a group of units; a `TrainController` of these units alone.

    Follows the total of the units' targets, whoever gives it: a unit whose rail fails is made up for by the others, within
    what their motors and their believed adhesion allow. A unit alone keeps to its own target. Braking is driving mirrored.
    If anything goes wrong, all units of the group are told so.
    """

    def __init__(
        self, contexts: Sequence[UnitContext], settings: GroupSettings | None = None
    ) -> None:
        self.settings = settings or GroupSettings()
        mpc = self.settings.mpc
        group = tuple(contexts)
        self.belief = GroupBelief(group, mpc.belief)
        self._solver = RealTimeIteration(group, mpc, self.settings.evenness)
        rows = unit_rows(group, mpc)
        self._scale, self._share = rows[TORQUE_SCALE], rows[UNIT_SHARE]
        self._unit = unit_of_axle(group)
        self._radius = np.array([context.radius for context in group])[self._unit]
        self._parameters = parameters(group, self.belief.peak)
        self._shifts = math.isclose(group[0].period, mpc.step)
        self._sign = 0.0
        self._before = np.zeros(len(group))

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period; never raises."""
        started = clock.perf_counter()
        residual = math.nan
        try:
            torques, status, residual = self._decide(senses, started)
        except Exception as error:  # a controller on board must answer, whatever happens
            torques, status = np.zeros(len(senses)), f"{type(error).__name__}: {error}"
        elapsed = clock.perf_counter() - started
        if status == "ok" and elapsed > self.settings.mpc.deadline:
            status = "late"
        if status != "ok":
            self._sign = 0.0  # start anew: what the units do meanwhile is not known here
            return [TorqueDecision(0.0, False, status, elapsed, residual) for _ in senses]
        return [TorqueDecision(float(u), True, status, elapsed, residual) for u in torques]

    def _decide(self, senses: Sequence[UnitSense], started: float) -> tuple[np.ndarray, str, float]:
        columns = np.array(
            [(s.speed, s.torque, s.target, s.drive_limit, s.brake_limit) for s in senses]
        ).T
        omega = np.concatenate([sense.omega for sense in senses])
        if not (np.isfinite(columns).all() and np.isfinite(omega).all()):
            return self._before, "reading not finite", math.nan
        speed, torque, target, drive_limit, brake_limit = columns
        total = float(target.sum())
        sign = math.copysign(1.0, total) if total else self._sign or 1.0
        if sign != self._sign:
            self.belief.forget_forces()
            self._before = np.maximum(sign * torque, 0.0)
            self._solver.restart(self._before)
            self._sign = sign
        elif self._shifts:
            self._solver.shift()
        self.belief.update(sign * speed, sign * omega, sign * torque)
        if total == 0.0:
            self._before = np.zeros(len(senses))
            self._solver.restart(0.0)
            return self._before, "ok", 0.0
        limit = drive_limit if sign > 0.0 else brake_limit
        problem = self._problem(sign * speed, sign * omega, sign * torque, sign * target, limit)
        solution = self._solver.solve(problem, started + 0.5 * self.settings.mpc.deadline)
        self._before = solution.torques[: len(senses)].copy()
        return sign * self._before, solution.status, solution.residual

    def _problem(
        self,
        speed: np.ndarray,
        omega: np.ndarray,
        torque: np.ndarray,
        target: np.ndarray,
        limit: np.ndarray,
    ) -> HorizonProblem:
        mpc, belief = self.settings.mpc, self.belief
        # cars on couplers differ in speed: the one body keeps the slip of every axle
        mean = float(self._share @ speed)
        omega = omega + (mean - speed[self._unit]) / self._radius
        self._parameters[: omega.size] = belief.peak
        carried = belief.carried_torque()
        upper = np.minimum(limit, (1.0 + mpc.headroom) * carried)
        if target.size == 1:
            upper = np.minimum(upper, target)
        return HorizonProblem(
            state=np.concatenate([[mean], omega, torque]),
            parameters=self._parameters,
            slip_limit=mpc.slip_limit * belief.peak_slip,
            target=target,
            before=self._before,
            upper=upper,
            reference=even_split(target, carried, limit, self._scale, self._share),
        )


class CarControllers:
    """One `GroupController` per car, which know nothing of each other; a `TrainController`."""

    def __init__(
        self, contexts: Sequence[UnitContext], settings: GroupSettings | None = None
    ) -> None:
        self.cars = [
            list(members) for _, members in groupby(contexts, key=lambda context: context.car)
        ]
        """Contexts of each car's units."""
        self.controllers = [GroupController(members, settings) for members in self.cars]

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period; never raises."""
        decisions: list[TorqueDecision] = []
        for members, controller in zip(self.cars, self.controllers, strict=True):
            start = len(decisions)
            decisions += controller.decide(senses[start : start + len(members)])
        return decisions


def car_factory(contexts: Sequence[UnitContext]) -> CarControllers:
    """All units of a car as one problem, default settings; a `TrainControllerFactory`."""
    return CarControllers(contexts)


def ideal_train_factory(contexts: Sequence[UnitContext]) -> GroupController:
    """All units of the train as one problem every control period, as if telegrams took no time; a `TrainControllerFactory`.

    What no train has: the joint optimum against which distributed control is measured.
    """
    return GroupController(contexts)


__all__ = [
    "CarControllers",
    "GroupController",
    "car_factory",
    "ideal_train_factory",
]
