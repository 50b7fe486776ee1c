"""What the foremost unit does for the train: from reports of some age to torques that all units should give.

It predicts every unit over the delay under the commands it knows are on their way, and solves one problem over all of them
from the instant on at which its orders can act.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.structure import Floats
from mpc.assembly import compiled_group
from mpc.belief import with_predicted_curve
from mpc.group_problem import GroupProblem
from mpc.horizon import HorizonSolution
from mpc.settings import MpcSettings
from mpc.shooting import simulate
from mpc.unit_model import parameters, substeps


class Report(NamedTuple):
    """What a unit tells the foremost one; in the direction of the demand."""

    time: float
    """Instant of its readings [s]."""
    speed: float
    omega: Floats
    torque: float
    command: float
    """Torque command in force from then on [N m]."""
    target: float
    """Torque that the driver wants of it [N m]; signed in a telegram, for it says which direction that is."""
    limit: float
    """What its motors can give [N m]."""
    peak: Floats
    """Believed peak coefficient of its axles, (axles,)."""
    slip_limit: Floats
    """Slip [m/s] that they should not exceed, (axles,)."""
    curve: tuple[float, float]
    """Peak slip [m/s] and steepness of the believed curve."""
    carried: float
    """Torque that its weakest axle is believed to carry [N m]."""


class UnitForecast:
    """Predicts one unit, alone on its share of the train, over the delay."""

    def __init__(self, context: UnitContext) -> None:
        alone = replace(with_predicted_curve(context), unloading=())
        self._context, self._period = alone, context.period
        self._slope = compiled_group(alone).slope
        self._substeps = substeps(alone, context.period)
        self._scratch = np.zeros((3, context.axles + 2))

    def state(self, report: Report, commands: Floats) -> Floats:
        """State (axles + 2,) after `commands` [N m], one per control period since the report."""
        nodes = np.zeros((commands.size + 1, report.omega.size + 2))
        nodes[0] = np.concatenate([[report.speed], report.omega, [report.torque]])
        if commands.size:
            values = parameters(self._context, report.peak)
            values[-6:-4] = report.curve
            simulate(
                self._slope, commands, values,
                self._period / self._substeps, self._substeps, nodes, self._scratch,
            )  # fmt: skip
        return np.asarray(nodes[-1])


class JointProblem:
    """The train's problem at the foremost unit."""

    def __init__(self, contexts: Sequence[UnitContext], settings: MpcSettings) -> None:
        self.settings = settings
        self._forecasts = [UnitForecast(context) for context in contexts]
        self._group = GroupProblem(contexts, settings, settings.group.steps)
        self._radius = [context.radius for context in contexts]
        held = round(contexts[0].telegrams.period / settings.step)
        self._last = min(held, settings.horizon) - 1
        """Step of the horizon at which the next orders come into force."""
        self._cold = True

    def forget(self) -> None:
        """Drop the guess: the demand has changed its direction."""
        self._cold = True

    def solve(
        self, reports: Sequence[Report], commands: Sequence[Floats]
    ) -> tuple[Floats, HorizonSolution]:
        """Torque to ask of each unit [N m], (units,), and the solution behind it.

        `commands`: per unit, what is known to be commanded in each control period from its report until the orders act.
        Asked for is the torque at the end of the time for which an order stands: what precedes it is the units' own to do. A
        unit that is bound by its rail is asked for more than it is believed to carry: its own controller knows its rail
        better than a report of some age, and only an axle that is pushed finds out that adhesion has come back.
        """
        pairs = list(zip(reports, commands, strict=True))
        states = [f.state(*pair) for f, pair in zip(self._forecasts, pairs, strict=True)]
        before = np.array([known[-1] if known.size else r.command for r, known in pairs])
        speed = float(states[0][0])
        slip = np.concatenate(
            [r * s[1:-1] - s[0] for r, s in zip(self._radius, states, strict=True)]
        )
        target, carried, limit = np.array([(r.target, r.carried, r.limit) for r in reports]).T
        peak = np.concatenate([r.peak for r in reports])
        slip_limit = np.concatenate([r.slip_limit for r in reports])
        curve = np.exp(np.mean(np.log([r.curve for r in reports]), axis=0))
        state = (speed, (speed + slip) / self._group.radius, np.array([s[-1] for s in states]))
        problem = self._group.problem(
            state, (peak, slip_limit, carried), curve, target, before, limit
        )
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
        return np.where(bound, push, asked), solution
