"""The readhesion MPC of several units as one problem: of the units of a car, or of all units of a train without delay.

In: a `UnitSense` per unit. Out: a torque command per unit.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from alloc.old.onboard.host import TorqueDecision, UnitContext, UnitSense
from alloc.old.plant.model import Floats
from alloc.old.rules.exact import exact_limits
from mpc.old.belief import GroupBelief, with_predicted_curve
from mpc.old.condensing import no_steeper
from mpc.old.model import (
    LostShare,
    air_place,
    cars_of,
    curve_place,
    leading,
    parameters,
    unit_of_axle,
)
from mpc.old.period import (
    HorizonProblem,
    Iteration,
    PredictiveController,
    RealTimeIteration,
    cost_of,
)
from mpc.old.settings import MpcSettings
from mpc.old.unit import tracked_coefficient

# The problem of several units in one: its solver, and its targets and limits in a period.


class WheelsAndRail(NamedTuple):
    """What a group believes of what its wheels meet, in the direction of the demand."""

    peak: Floats
    """Peak coefficient, (axles,)."""
    slip_limit: Floats
    """Slip that should not be exceeded [m/s], (axles,)."""
    carried: Floats
    """Motor torque that the weakest axle of each unit carries [N m], (units,)."""
    air: Floats
    """Torque of the air brake at each wheelset of a unit [N m], (units,)."""
    drag: Floats
    """Gradient equivalent to the drag of each unit, see `mpc.old.belief.Drag`, (units,)."""


class GroupProblem:
    """Makes the problems of a group and has their solver; axles unit by unit, foremost first."""

    def __init__(
        self,
        contexts: Sequence[UnitContext],
        settings: MpcSettings,
        steps: int | None = None,
        iteration: Iteration = RealTimeIteration,
    ) -> None:
        """`steps`: most SQP steps, if others than those of the settings; `iteration`: makes the solver."""
        group = tuple(map(with_predicted_curve, contexts))
        self._settings = settings
        own = settings if steps is None else replace(settings, iterations=steps)
        self.solver = iteration(group, own, settings.group.evenness)
        terms = cost_of(group, settings).unit
        self.share, self._scale = terms.share, terms.scale
        self.unit = unit_of_axle(group)
        """Number of each axle's unit, (axles,)."""
        self._first = np.flatnonzero(np.diff(self.unit, prepend=-1))
        self.radius = np.array([context.radius for context in group])[self.unit]
        """Of each axle's wheels [m], (axles,)."""
        self._parameters = parameters(group, settings.belief.initial)
        self._curve, self._air = curve_place(group), air_place(group)

    def problem(
        self,
        state: tuple[float, Floats, Floats],
        rail: WheelsAndRail,
        curve: Floats,
        target: Floats,
        before: Floats,
        limit: Floats,
    ) -> HorizonProblem:
        """The problem from `state` on: speed [m/s], angular speeds (axles,), torques (units,).

        `curve`: peak slip [m/s] and steepness of all, taken less steep where the axles' highest peak would make it too
        steep to predict with. `target`, torques `before` and motors' `limit` [N m], (units,).
        """
        speed, omega, torque = state
        carried = rail.carried
        self._parameters[: omega.size] = rail.peak
        # forces between the units cancel in the mean
        self._parameters[omega.size] = self.share @ rail.drag
        self._parameters[self._curve] = no_steeper(curve[0], curve[1], rail.peak.max())
        self._parameters[self._air] = rail.air
        target = self._tracked(target, rail)
        return HorizonProblem(
            state=np.concatenate([[speed], omega, torque]),
            parameters=self._parameters,
            slip_limit=rail.slip_limit,
            target=target,
            before=before,
            upper=np.minimum(limit, (1.0 + self._settings.headroom) * carried),
            reference=even_split(target, carried, limit, self._scale, self.share),
        )

    def _tracked(self, target: Floats, rail: WheelsAndRail) -> Floats:
        """What the group tracks of `target` [N m], (units,): its total as far as `mpc.old.unit` says of all units."""
        scale, w = self._settings.weights.coefficient_scale, self._settings.weights
        carried = rail.carried * scale / self._scale
        slips = np.minimum.reduceat(rail.slip_limit, self._first)
        most = np.array(
            [
                tracked_coefficient(held, slip, scale, w.tracking, w.slip, w.slip_scale)
                for held, slip in zip(carried, slips, strict=True)
            ]
        )
        allowed = float(self.share @ most)
        wanted = float(self.share @ (target * scale / self._scale))
        return target if wanted <= allowed else target * (allowed / wanted)


SPARED = 0.9
"""Share of what a unit is believed to carry up to which the others relieve it: the last tenth doubles its slip, or more."""


def even_split(
    target: Floats, carried: Floats, limit: Floats, scale: Floats, share: Floats
) -> Floats:
    """Torques [N m] that give the total of `target` at one coefficient, except for units that cannot; (units,).

    This is the exact level that par. 0050 of JP5484215 names, with `SPARED` of what the units are believed to carry as caps.
    The work lost at the wheels grows with the slip, so a unit goes nearer to its peak only as far as the others, each as
    near to its own, do not reach the total. For a unit that has not slipped, that belief is a guess. Loads in proportion to
    it would send untested units to their peak; one level asks no more of them than the total needs. `carried` and motor
    `limit` [N m], torque `scale` [N m] and `share` of the mass, (units,).
    """
    split, wanted = np.empty_like(target), float(share @ (target / scale))
    exact_limits(SPARED * carried / scale, wanted, share, limit / scale, split)
    left = np.minimum(carried, limit) / scale - split
    missing = wanted - float(share @ split)
    if missing > 0.0:
        split += left * min(missing / max(float(share @ left), missing), 1.0)
    return split * scale


class GroupController(PredictiveController):
    """Readhesion MPC of a group of units; a `TrainController` of these units alone.

    It follows the total of the units' targets, whichever unit delivers it: the others make up for a unit whose rail fails,
    within what their motors and their believed adhesion allow. A unit alone keeps to its own target. If anything goes wrong,
    all units of the group get that status. The others also make up for a unit whose motors have failed. That unit commands
    nothing.
    """

    belief: GroupBelief

    def __init__(
        self,
        contexts: Sequence[UnitContext],
        settings: MpcSettings | None = None,
        iteration: Iteration = RealTimeIteration,
    ) -> None:
        settings = settings or MpcSettings()
        self._lost = LostShare(contexts)
        self._group = GroupProblem(contexts, settings, iteration=iteration)
        super().__init__(contexts, settings, self._group.solver)
        self.belief = GroupBelief(contexts, settings)

    def decide(self, senses: Sequence[UnitSense]) -> list[TorqueDecision]:
        """Torque command of each unit for the coming control period."""
        if all(sense.in_service for sense in senses):
            return self._answer(senses)
        return self._answer(self._is_feasible(senses))

    def _is_feasible(self, senses: Sequence[UnitSense]) -> list[UnitSense]:
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
            belief.peak,
            belief.slip_limit,
            belief.carried_torque(),
            belief.air_torque,
            belief.drag,
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
