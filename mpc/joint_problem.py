"""What the foremost unit does for the train: from reports of some age to torques that all units should give.

It predicts every unit over the delay under the commands it knows are on their way, and solves one problem over all of them
from the instant on at which its orders can act.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.host import UnitContext
from mpc.assembly import compiled_group
from mpc.condensing import TORQUE_SCALE, UNIT_SHARE
from mpc.group_belief import even_split
from mpc.group_settings import GroupSettings
from mpc.horizon import HorizonProblem, HorizonSolution, unit_rows
from mpc.real_time import RealTimeIteration
from mpc.shooting import simulate
from mpc.unit_model import parameters, substeps, unit_of_axle

Floats = NDArray[np.float64]


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
    peak_slip: Floats
    carried: float
    """Torque that its weakest axle is believed to carry [N m]."""


class UnitForecast:
    """Predicts one unit, alone on its share of the train, over the delay."""

    def __init__(self, context: UnitContext) -> None:
        alone = replace(context, unloading=())
        self._context, self._period = alone, context.period
        self._slope = compiled_group(alone).slope
        self._substeps = substeps(alone, context.period)
        self._scratch = np.zeros((3, context.axles + 2))

    def state(self, report: Report, commands: Floats) -> Floats:
        """State (axles + 2,) after `commands` [N m], one per control period since the report."""
        nodes = np.zeros((commands.size + 1, report.omega.size + 2))
        nodes[0] = np.concatenate([[report.speed], report.omega, [report.torque]])
        if commands.size:
            simulate(
                self._slope, commands, parameters(self._context, report.peak),
                self._period / self._substeps, self._substeps, nodes, self._scratch,
            )  # fmt: skip
        return np.asarray(nodes[-1])


class JointProblem:
    """The train's problem at the foremost unit."""

    def __init__(self, contexts: Sequence[UnitContext], settings: GroupSettings) -> None:
        self.settings = settings
        mpc = replace(settings.mpc, iterations=settings.steps)
        self._group = tuple(contexts)
        self._period = contexts[0].period
        self._forecasts = [UnitForecast(context) for context in contexts]
        self._solver = RealTimeIteration(self._group, mpc, settings.evenness)
        rows = unit_rows(self._group, mpc)
        self._scale, self._share = rows[TORQUE_SCALE], rows[UNIT_SHARE]
        self._unit = unit_of_axle(self._group)
        self._radius = np.array([context.radius for context in contexts])[self._unit]
        self._parameters = parameters(self._group, mpc.belief.initial)
        held = round(contexts[0].telegrams.period / mpc.step)
        self._last = min(held, mpc.horizon) - 1
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
        settings = self.settings
        states = [
            forecast.state(report, known)
            for forecast, report, known in zip(self._forecasts, reports, commands, strict=True)
        ]
        before = np.array(
            [
                known[-1] if known.size else report.command
                for report, known in zip(reports, commands, strict=True)
            ]
        )
        speed = float(states[0][0])
        slip = np.concatenate(
            [r * s[1:-1] - s[0] for r, s in zip(self._unit_radius(), states, strict=True)]
        )
        target = np.array([report.target for report in reports])
        carried = np.array([report.carried for report in reports])
        limit = np.array([report.limit for report in reports])
        self._parameters[: slip.size] = np.concatenate([report.peak for report in reports])
        problem = HorizonProblem(
            state=np.concatenate(
                [[speed], (speed + slip) / self._radius, [state[-1] for state in states]]
            ),
            parameters=self._parameters,
            slip_limit=settings.mpc.slip_limit * np.concatenate([r.peak_slip for r in reports]),
            target=target,
            before=before,
            upper=np.minimum(limit, (1.0 + settings.mpc.headroom) * carried),
            reference=even_split(target, carried, limit, self._scale, self._share),
        )
        if self._cold:
            self._solver.restart(before)
        else:
            for _ in range(self._last + 1):
                self._solver.shift()
        solution = self._solver.solve(problem)
        self._cold = solution.status != "ok"
        units = len(reports)
        asked = solution.torques[self._last * units : (self._last + 1) * units].copy()
        bound = asked >= settings.limited * carried
        push = np.maximum(target, (1.0 + settings.mpc.headroom) * asked)
        return np.where(bound, push, asked), solution

    def _unit_radius(self) -> list[float]:
        return [context.radius for context in self._group]
