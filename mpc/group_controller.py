"""The readhesion MPC of several units as one problem: of the units of a car, or of all units of a train without delay."""

from collections.abc import Sequence

import numpy as np

from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.plant.structure import Floats
from mpc.belief import GroupBelief
from mpc.control_period import PredictiveController
from mpc.failed_motors import LostShare, leading
from mpc.group_problem import GroupProblem, WheelsAndRail
from mpc.horizon import HorizonProblem
from mpc.settings import MpcSettings
from mpc.unit_model import cars_of


class GroupController(PredictiveController):
    """Readhesion MPC of a group of units; a `TrainController` of these units alone.

    It follows the total of the units' targets, whichever unit delivers it: the others make up for a unit whose rail fails,
    within what their motors and their believed adhesion allow. A unit alone keeps to its own target. If anything goes wrong,
    all units of the group get that status. The others also make up for a unit whose motors have failed. That unit commands
    nothing.
    """

    belief: GroupBelief

    def __init__(
        self, contexts: Sequence[UnitContext], settings: MpcSettings | None = None
    ) -> None:
        settings = settings or MpcSettings()
        self._lost = LostShare(contexts)
        self._group = GroupProblem(contexts, settings)
        super().__init__(contexts, settings, self._group.solver)
        self.belief = GroupBelief(contexts, settings)

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period."""
        if all(sense.in_service for sense in senses):
            return self._answer(senses)
        return self._answer(self._within_reach(senses))

    def _within_reach(self, senses: Sequence[UnitSense]) -> list[UnitSense]:
        """What the problem is to know: motors that have failed give nothing, and what is lost is for the others."""
        leader, works = leading(senses), [sense.in_service for sense in senses]
        demand = np.array([sense.target for sense in senses])
        wanted = self._lost.wanted(demand, works, leader, senses[leader].planned)
        return [
            sense
            if sense.in_service
            else sense._replace(target=target, drive_limit=0.0, brake_limit=0.0)
            for sense, target in zip(senses, wanted.tolist(), strict=True)
        ]

    def _believe(
        self, speed: Floats, omega: Floats, torque: Floats, wanted: Floats, estimate: Floats
    ) -> None:
        self.belief.update(speed, omega, torque, wanted, estimate)

    def _problem(
        self, speed: Floats, omega: Floats, torque: Floats, target: Floats, limit: Floats
    ) -> HorizonProblem:
        belief, group = self.belief, self._group
        # cars on couplers differ in speed: the one body keeps the slip of every axle
        mean = float(group.share @ speed)
        omega = omega + (mean - speed[group.unit]) / group.radius
        rail = WheelsAndRail(
            belief.peak, belief.slip_limit, belief.carried_torque(), belief.air_torque
        )
        problem = group.problem(
            (mean, omega, torque), rail, belief.curve, target, self._before, limit
        )
        if target.size > 1:
            return problem
        return problem._replace(upper=np.minimum(problem.upper, target))


class CarControllers:
    """One `GroupController` per car, without exchange between them; a `TrainController`."""

    def __init__(
        self, contexts: Sequence[UnitContext], settings: MpcSettings | None = None
    ) -> None:
        self.cars = cars_of(contexts)
        """Contexts of each car's units."""
        self.controllers = [GroupController(members, settings) for members in self.cars]

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period."""
        decisions: list[TorqueDecision] = []
        for members, controller in zip(self.cars, self.controllers, strict=True):
            start = len(decisions)
            decisions += controller.decide(senses[start : start + len(members)])
        return decisions
