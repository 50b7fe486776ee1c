"""Real-time iteration: one step of sequential quadratic programming per control period, warm started by shifting.

Diehl, Bock, Schloeder, Findeisen, Nagy, Allgoewer: Real-time optimization and nonlinear model predictive control of
processes governed by differential-algebraic equations, J. Process Control 12 (2002) 577-585. The states are condensed
away. The whole period is one compiled call, `mpc.sqp.iterate`.
"""

import time
from functools import lru_cache

import numpy as np

from alloc.by_address import address_of
from alloc.by_reference import ByReference
from alloc.plant.structure import Floats
from mpc.arrays import PREPARE, RATE, SLOPE, TANGENT
from mpc.assembly import compiled_group
from mpc.cost import trajectory_cost
from mpc.horizon import HorizonProblem, HorizonSolution, Plan, Problem, cost_of
from mpc.phases import feedback, preparation
from mpc.settings import MpcSettings
from mpc.shooting import simulate
from mpc.sqp import (
    ENDED,
    NO_SOLUTION,
    NOT_FINITE,
    ahead,
    hold,
    iterate,
    prepare,
    shift,
)
from mpc.sqp_period import Addresses, Rules, period
from mpc.unit_model import Units, group_of, stiffness_of, unit_model

FAILURES = {
    NOT_FINITE: "not finite",
    NO_SOLUTION: "QP not solved",
}
"""Status of what ends without a solution."""


class RealTimeIteration:
    """Solver of `HorizonProblem`; arrays are made once, and the last solution is kept as a guess.

    For one unit, or for a group as one problem; `evenness` is the weight of that term of the cost.
    """

    def __init__(self, units: Units, settings: MpcSettings, evenness: float = 0.0) -> None:
        self._settings = settings
        self.most = max(1, settings.steps_in_time(group_of(units)[0].period))
        """Most steps of a solve."""
        self._model = compiled_group(units)  # kept: compiled code has its addresses
        self._terms = cost_of(units, settings, evenness)
        made, model = unit_model(units), self._model
        self.units = made.units
        rules = Rules(
            step=float(settings.step),
            stiffness=stiffness_of(units, settings.step),
            tolerance=settings.tolerance,
        )
        addresses = Addresses(
            address_of(model.prepare, PREPARE),
            address_of(model.slope, SLOPE),
            address_of(model.rate, RATE),
            address_of(model.tangent, TANGENT),
        )
        self.period = period(
            addresses,
            model.nonzeros,
            self._terms,
            rules,
            settings.horizon,
            (made.parameters.numel(), model.constants),
        )
        self._period = ByReference(self.period)
        self._iterate = iterate
        self.prepared: int | None = None
        """SQP steps of the preparation for the coming problem; None: there was none."""
        self._left = 0
        self.torques = self.period.guess.torques
        """The guess, [N m], (horizon * units,)."""

    def shift(self) -> None:
        """Move the guess on by one period."""
        shift(self._period)

    def restart(self, torque: float | np.ndarray) -> None:
        """Discard the guess: hold `torque` [N m], (units,), over the horizon."""
        self._terms.unit.before[:] = torque
        self.prepared = None
        hold(self._period)

    def take(self, problem: HorizonProblem) -> None:
        """Copy what is new in a period to where the compiled code reads it, and set the model's parameters."""
        self._write(problem)
        prepare(self._period)

    def _write(self, problem: HorizonProblem) -> None:
        now, axle, unit = self.period.now, self._terms.axle, self._terms.unit
        now.state[:], now.parameters[:] = problem.state, problem.parameters
        now.upper.reshape(-1, self.units)[:] = problem.upper
        axle.slip_limit[:] = problem.slip_limit
        unit.target[:], unit.before[:] = problem.target, problem.before
        unit.reference[:] = problem.reference

    def course(self, torques: Floats) -> tuple[Floats, float]:
        """States (horizon + 1, states) from that of the last problem on under `torques` [N m], (horizon * units,); cost."""
        now, guess, rules = self.period.now, self.period.guess, self.period.rules
        substeps = int(now.substeps[0])
        guess.nodes[0] = now.state
        simulate(
            self._model.slope, torques, now.constants, rules.step / substeps, substeps, guess.nodes, guess.scratch,
        )  # fmt: skip
        return guess.nodes.copy(), trajectory_cost(guess.nodes, torques, ByReference(self._terms))

    def ahead(self, problem: HorizonProblem, time: float) -> HorizonProblem:
        """The problem from the state on that is predicted after `time` [s] under the torques before."""
        self.take(problem)
        ahead(time, self._period)
        return problem._replace(state=self.period.now.state.copy())

    def prepare(self, problem: HorizonProblem, time: float) -> bool:
        """Prepare for readings `time` [s] after those of `problem`, the last solved; whether that succeeded.

        See `mpc.phases`; with the steps that are left of `most`.
        """
        self.take(problem)
        done, end = preparation(self._left, time, self._period)
        self.prepared = done if end <= ENDED else None
        return end <= ENDED

    def solve(self, problem: HorizonProblem) -> HorizonSolution:
        """Improve the guess by one step, and by more while the residual before the last one exceeds `settings.tolerance`.

        At most `most` in all; after a preparation, by one. A solution with another status than "ok" must not be used; the
        guess is then to be restarted.
        """
        if self.prepared is None:
            self.take(problem)
            cost, residual, done, end = self._iterate(self.most, self._period)
        else:  # the model's parameters stay those of the preparation
            self._write(problem)
            cost, residual, done, end = feedback(self._period)
        self._left = self.most - done
        done, self.prepared = done + (self.prepared or 0), None
        status = FAILURES.get(end, "ok")
        return HorizonSolution(self.torques.copy(), cost, residual, done, status)


_iteration = lru_cache(maxsize=16)(RealTimeIteration)


def solve_compiled(problem: Problem) -> Plan:
    """The answer of as many steps from the guess on as the settings allow, see `mpc.solve`."""
    units, settings, now, _ = problem
    alone = problem.evenness == 0.0
    solver = _iteration(units if alone else group_of(units), settings, problem.evenness)
    solver.restart(now.before)
    solver.torques[:] = problem.guessed().ravel()
    begun = time.perf_counter()
    found = solver.solve(now)
    took = time.perf_counter() - begun
    states, cost = solver.course(found.torques)
    excess = solver.period.terms.slip_matrix @ states[1:].T - np.reshape(now.slip_limit, (-1, 1))
    return Plan(
        found.torques.reshape(settings.horizon, -1), states, np.maximum(excess.T / settings.weights.slip_scale, 0.0),
        cost, found.status, found.iterations, took,
    )  # fmt: skip
