"""The readhesion MPC of several units as one problem: of the units of a car, or of all units of a train without delay."""

from collections.abc import Sequence

import numpy as np

from alloc.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.plant.structure import Floats
from mpc.belief import GroupBelief
from mpc.control_period import PredictiveController
from mpc.group_problem import GroupProblem
from mpc.horizon import HorizonProblem
from mpc.settings import MpcSettings
from mpc.unit_model import cars_of


class GroupController(PredictiveController):
    """Readhesion MPC of a group of units; a `TrainController` of these units alone.

    It follows the total of the units' targets, whoever gives it: a unit whose rail fails is made up for by the others,
    within what their motors and their believed adhesion allow. A unit alone keeps to its own target. If anything goes
    wrong, all units of the group are told so.
    """

    belief: GroupBelief

    def __init__(
        self, contexts: Sequence[UnitContext], settings: MpcSettings | None = None
    ) -> None:
        settings = settings or MpcSettings()
        self._group = GroupProblem(contexts, settings)
        super().__init__(contexts, settings, self._group.solver)
        self.belief = GroupBelief(contexts, settings)

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period."""
        return self._answer(senses)

    def _believe(
        self, speed: Floats, omega: Floats, torque: Floats, wanted: Floats, estimate: Floats
    ) -> None:
        self.belief.update(speed, omega, torque, wanted)

    def _problem(
        self, speed: Floats, omega: Floats, torque: Floats, target: Floats, limit: Floats
    ) -> HorizonProblem:
        belief, group = self.belief, self._group
        # cars on couplers differ in speed: the one body keeps the slip of every axle
        mean = float(group.share @ speed)
        omega = omega + (mean - speed[group.unit]) / group.radius
        rail = (belief.peak, belief.slip_limit, belief.carried_torque())
        problem = group.problem(
            (mean, omega, torque), rail, belief.curve, target, self._before, limit
        )
        if target.size > 1:
            return problem
        return problem._replace(upper=np.minimum(problem.upper, target))


class CarControllers:
    """One `GroupController` per car, which know nothing of each other; a `TrainController`."""

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
