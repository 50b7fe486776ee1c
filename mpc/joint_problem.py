"""The leader's work for the train: from reports of some age to torques for all units.

It predicts every unit over the delay under the commands that are already on their way. It then solves one problem over all
units from the instant at which its orders can act.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.structure import Floats
from mpc.assembly import compiled_group
from mpc.belief import mean_curve, with_predicted_curve
from mpc.group_problem import GroupProblem, WheelsAndRail
from mpc.horizon import HorizonSolution
from mpc.settings import MpcSettings
from mpc.shooting import simulate
from mpc.telegrams import Report
from mpc.unit_model import air_place, curve_place, parameters, substeps, torque_per_coefficient

NO_SLIP_LIMIT = 1e3
"""Slip limit [m/s] of the train's problem: every unit searches for its best slip itself, with newer information than a
report gives. The binding constraint is the torque that a unit is believed to carry."""


class UnitForecast:
    """Predicts one unit, alone on its share of the train, over the delay."""

    def __init__(self, context: UnitContext) -> None:
        alone = replace(with_predicted_curve(context), unloading=())
        self._context, self._period = alone, context.period
        self._model = compiled_group(alone)
        self._curve, self._air = curve_place(alone), air_place(alone)
        self._substeps = substeps(alone, context.period)
        self._scratch = np.zeros((3, context.axles + 2))

    def state(self, report: Report, commands: Floats) -> Floats:
        """State (axles + 2,) after `commands` [N m], one per control period since the report."""
        nodes = np.zeros((commands.size + 1, report.omega.size + 2))
        nodes[0] = np.concatenate([[report.speed], report.omega, [report.torque]])
        if commands.size:
            values = parameters(self._context, report.peak)
            values[self._curve] = report.peak_slip, report.steepness
            values[self._air] = report.air
            simulate(
                self._model.slope, commands, self._model.prepared(values),
                self._period / self._substeps, self._substeps, nodes, self._scratch,
            )  # fmt: skip
        return np.asarray(nodes[-1])


class JointProblem:
    """The train's problem at the unit that leads."""

    def __init__(self, contexts: Sequence[UnitContext], settings: MpcSettings) -> None:
        self.settings = settings
        self._contexts = tuple(contexts)
        self._forecasts = [UnitForecast(context) for context in contexts]
        self._group = GroupProblem(contexts, settings, settings.group.steps)
        self._radius = [context.radius for context in contexts]
        held = round(contexts[0].telegrams.period / settings.step)
        self._last = min(held, settings.horizon) - 1
        """Step of the horizon at which the next orders come into force."""
        self._cold = True

    def forget(self) -> None:
        """Drop the guess: the demand has changed its direction, or another unit leads."""
        self._cold = True

    def supposed(self, j: int, leader: Report, target: float, works: bool) -> Report:
        """What counts for unit `j` of which no report is used: it rolls with the `leader`.

        One that `works` gives its `target` [N m], no more. Of one whose motors have failed nothing is to be had: the others
        give its target.
        """
        one = self._contexts[j]
        peak = np.full(one.axles, self.settings.belief.initial)
        torque = target if works else 0.0
        return Report(
            time=leader.time,
            speed=leader.speed,
            omega=np.full(one.axles, leader.speed / one.radius),
            torque=torque,
            command=torque,
            target=target,
            limit=torque,
            peak=peak,
            peak_slip=leader.peak_slip,
            steepness=leader.steepness,
            carried=float(peak[0]) * torque_per_coefficient(one) if works else 0.0,
            air=0.0,
        )

    def solve(
        self, reports: Sequence[Report], commands: Sequence[Floats], leader: int = 0
    ) -> tuple[Floats, HorizonSolution]:
        """Torque to ask of each unit [N m], (units,), and the solution behind it; the body has the speed of the `leader`.

        `commands`: per unit, the commands known for each control period from its report until the orders act. The result is
        the torque at the end of the time for which an order is in force; the course before that is left to the units. A unit
        that is limited by its rail is asked for more than it is believed to carry. Its own controller has newer information
        on its rail than a report gives, and only an axle that is pushed finds out that adhesion has returned. No unit is
        asked for more than its motors can deliver.
        """
        pairs = list(zip(reports, commands, strict=True))
        states = [f.state(*pair) for f, pair in zip(self._forecasts, pairs, strict=True)]
        before = np.array([known[-1] if known.size else r.command for r, known in pairs])
        speed = float(states[leader][0])
        slip = np.concatenate(
            [r * s[1:-1] - s[0] for r, s in zip(self._radius, states, strict=True)]
        )
        target, carried, limit, air = np.array(
            [(r.target, r.carried, r.limit, r.air) for r in reports]
        ).T
        peak = np.concatenate([r.peak for r in reports])
        curve = mean_curve([(r.peak_slip, r.steepness) for r in reports])
        state = (speed, (speed + slip) / self._group.radius, np.array([s[-1] for s in states]))
        free = np.full_like(peak, NO_SLIP_LIMIT)
        rail = WheelsAndRail(peak, free, carried, air)
        problem = self._group.problem(state, rail, curve, target, before, limit)
        solver = self._group.solver
        if self._cold:
            solver.restart(before)
        else:
            for _ in range(self._last + 1):
                solver.shift()
        solution = solver.solve(problem)
        self._cold = solution.status != "ok"
        units = len(reports)
        asked = solution.torques[self._last * units : (self._last + 1) * units].copy()
        bound = asked >= self.settings.group.limited * carried
        push = np.maximum(target, (1.0 + self.settings.headroom) * asked)
        return np.minimum(np.where(bound, push, asked), limit), solution
