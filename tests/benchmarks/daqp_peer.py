"""The reference of the compiled real-time iteration: its loop in Python, its quadratic programs solved by DAQP.

DAQP is Arnstroem, Bemporad, Axehall: A dual active-set solver for embedded quadratic programming, IEEE Trans. Automatic
Control 67 (2022) 4362-4369. Linearisation, condensing and simulation are those of the compiled step.
"""

import daqp
import numpy as np

from alloc.by_reference import ByReference
from mpc.condensing import condense
from mpc.cost import trajectory_cost
from mpc.horizon import HorizonSolution
from mpc.real_time import RealTimeIteration
from mpc.shooting import simulate
from mpc.sqp import HALVINGS, linearise_at, second_derivatives

PRIMAL_TOLERANCE = 1e-12
"""Violation of a bound that DAQP leaves, in scaled torques."""


class DaqpIteration(RealTimeIteration):
    """A `RealTimeIteration` whose `solve` is written with NumPy and DAQP."""

    def __init__(self, units, settings, evenness=0.0):
        super().__init__(units, settings, evenness)
        n = self.torques.size
        self._daqp = daqp.Model()
        self._daqp.setup(
            np.eye(n), np.zeros(n), np.zeros((0, n)), np.ones(n), -np.ones(n), np.zeros(n, dtype=np.int32),
        )  # fmt: skip
        self._daqp.settings = {**self._daqp.settings, "primal_tol": PRIMAL_TOLERANCE}
        made = self.period
        self._parts = [ByReference(part) for part in (made.around, made.terms, made.quadratic)]

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
            condense(around, self.torques, terms, settings.exact_hessian, quadratic)
            cost = trajectory_cost(made.around.nodes, self.torques, terms)
            scaled = self.torques / scale
            projected = np.clip(scaled - made.quadratic.gradient, 0.0, upper / scale)
            residual = float(np.abs(projected - scaled).max())
            if not np.isfinite([cost, residual]).all():
                return HorizonSolution(self.torques.copy(), cost, residual, done, "not finite")
            near = residual <= settings.tolerance
            if near and done > 0:
                break
            trial = np.clip(self.torques + scale * self._program(), 0.0, upper)
            done += 1
            if not self._better(problem, trial, cost) or near:
                break
        return HorizonSolution(self.torques.copy(), cost, residual, done, "ok")

    def _program(self):
        """Step of the scaled torques that minimises the quadratic model within the bounds."""
        made = self.period
        hessian = made.quadratic.hessian
        if made.rules.exact:
            second_derivatives(self._period)
            values, vectors = np.linalg.eigh(hessian)
            raised = np.maximum(np.abs(values), made.rules.least_curvature)
            if values[0] < made.rules.least_curvature:
                hessian[:] = vectors * raised @ vectors.T
        flags = [
            self._daqp.update(
                H=hessian,
                f=made.quadratic.gradient,
                bupper=(made.now.upper - self.torques) / made.guess.scale,
                blower=-self.torques / made.guess.scale,
            )
        ]
        step, _, flag, _ = self._daqp.solve()
        assert min(*flags, flag) >= 0
        return step

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
