"""The plant's model as CasADi functions, and the real-time iteration in Python with DAQP's solutions.

DAQP: Arnstroem, Bemporad, Axehall: A dual active-set solver for embedded quadratic programming, IEEE Trans. Autom. Control
67 (2022) 4362-4369. The loop is that of `mpc.solver`, written with NumPy.
"""

import casadi as cs
import daqp
import numpy as np

from alloc.records import ByReference
from mpc.condensing import condense, simulate, trajectory_cost
from mpc.model import UnitModel
from mpc.period import FAILURES, HorizonSolution, RealTimeIteration
from mpc.solver import HALVINGS, NO_SOLUTION, NOT_FINITE, linearise_at


def right_side(model: UnitModel) -> cs.Function:
    """CasADi function (state, torque, parameters) -> derivative of the state."""
    return cs.Function("right_side", [model.state, model.torque, model.parameters], [model.rate])


def step_function(model: UnitModel, step: float, substeps: int) -> cs.Function:
    """CasADi function (state, torque, parameters) -> state after `step` [s], classical Runge-Kutta."""
    x, u, p = model.state, model.torque, model.parameters
    f, h = right_side(model), step / substeps
    for _ in range(substeps):
        k1 = f(x, u, p)
        k2 = f(x + 0.5 * h * k1, u, p)
        k3 = f(x + 0.5 * h * k2, u, p)
        k4 = f(x + h * k3, u, p)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return cs.Function("step", [model.state, u, p], [x])


class PythonIteration(RealTimeIteration):
    """A `RealTimeIteration` whose `solve` is written with NumPy; a subclass solves the quadratic program."""

    def __init__(self, units, settings, evenness=0.0):
        super().__init__(units, settings, evenness)
        made = self.period
        self._parts = [ByReference(part) for part in (made.around, made.terms, made.quadratic)]

    def program(self, hessian, gradient, lower, upper):
        """Step of the scaled torques that minimises the quadratic model within the bounds, (n,); None if there is none."""
        raise NotImplementedError

    def solve(self, problem):
        """As the compiled one."""
        self.take(problem)
        made, settings = self.period, self._settings
        around, terms, quadratic = self._parts
        upper, scale = made.now.upper, made.guess.scale
        self.torques[:] = np.clip(self.torques, 0.0, upper)
        cost, residual, done = np.nan, np.inf, 0
        while done < self.most:
            linearise_at(self.torques, self._period)
            condense(around, self.torques, terms, quadratic)
            cost = trajectory_cost(made.around.nodes, self.torques, terms)
            scaled = self.torques / scale
            projected = np.clip(scaled - made.quadratic.gradient, 0.0, upper / scale)
            residual = float(np.abs(projected - scaled).max())
            if not np.isfinite([cost, residual]).all():
                return self._answer(cost, residual, done, FAILURES[NOT_FINITE])
            near = residual <= settings.tolerance
            if near and done > 0:
                break
            done += 1
            bounds = -scaled, (upper - self.torques) / scale
            step = self.program(made.quadratic.hessian, made.quadratic.gradient, *bounds)
            if step is None:
                return self._answer(cost, residual, done, FAILURES[NO_SOLUTION])
            trial = np.clip(self.torques + scale * step, 0.0, upper)
            if not self._better(problem, trial, cost) or near:
                break
        return self._answer(cost, residual, done, "ok")

    def _answer(self, *found):
        return HorizonSolution(self.torques.copy(), *found)

    def _better(self, problem, trial, cost):
        """Take the trial torques, halving the step while the cost rises; False if no step lowers it."""
        made, terms = self.period, self._parts[1]
        for _ in range(HALVINGS + 1):
            made.guess.nodes[0] = problem.state
            simulate(
                self._model.slope, trial, made.now.constants, made.rules.step / made.now.substeps[0],
                int(made.now.substeps[0]), made.guess.nodes, made.guess.scratch,
            )  # fmt: skip
            if trajectory_cost(made.guess.nodes, trial, terms) <= cost:
                self.torques[:] = trial
                return True
            trial = 0.5 * (trial + self.torques)
        return False


PRIMAL_TOLERANCE = 1e-12


"""Violation of a bound that DAQP leaves, in scaled torques."""


class DaqpIteration(PythonIteration):
    """The iteration with DAQP's own interface, set up once."""

    def __init__(self, units, settings, evenness=0.0):
        super().__init__(units, settings, evenness)
        n = self.torques.size
        self._daqp = daqp.Model()
        self._daqp.setup(
            np.eye(n), np.zeros(n), np.zeros((0, n)), np.ones(n), -np.ones(n), np.zeros(n, dtype=np.int32),
        )  # fmt: skip
        self._daqp.settings = {**self._daqp.settings, "primal_tol": PRIMAL_TOLERANCE}

    def program(self, hessian, gradient, lower, upper):
        """As any."""
        changed = self._daqp.update(H=hessian, f=gradient, bupper=upper, blower=lower)
        step, _, flag, _ = self._daqp.solve()
        assert min(changed, flag) >= 0
        return step
