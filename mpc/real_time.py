"""Real-time iteration: one step of sequential quadratic programming per control period, warm started by shifting.

Diehl, Bock, Schloeder, Findeisen, Nagy, Allgoewer: Real-time optimization and nonlinear model predictive control of
processes governed by differential-algebraic equations, J. Process Control 12 (2002) 577-585. The states are condensed
away; the quadratic programs in the torques alone are solved by DAQP (Arnstroem, Bemporad, Axehall: A dual active-set solver
for embedded quadratic programming, IEEE Trans. Automatic Control 67 (2022) 4362-4369).
"""

import time as clock

import daqp
import numpy as np

from alloc.onboard.host import UnitContext
from mpc.compiled_model import compiled_model
from mpc.condensing import TORQUE_SCALE, add_second_order, condense, trajectory_cost
from mpc.horizon import HorizonProblem, HorizonSolution, weight_vector
from mpc.settings import MpcSettings
from mpc.shooting import linearise, second_order, simulate
from mpc.unit_model import slip_matrix, substeps, unit_model

LEAST_CURVATURE = 0.1
"""Least eigenvalue of the quadratic model, relative to twice the weight of tracking; reflection can leave a small one."""

HALVINGS = 12
"""Most halvings of a step that would raise the cost; the last is taken only if it does not."""


class RealTimeIteration:
    """Solver of `HorizonProblem`; arrays and the QP solver are made once, and the last solution is kept as a guess."""

    def __init__(self, context: UnitContext, settings: MpcSettings) -> None:
        self._settings = settings
        self._model = compiled_model(unit_model(context), settings.code)
        self._substeps = substeps(context, settings.step)
        self._small_step = settings.step / self._substeps
        self._slip = slip_matrix(context)
        self._weights = weight_vector(context, settings)
        self._scale = float(self._weights[TORQUE_SCALE])
        n, axles = settings.horizon, context.axles
        states, evaluations = axles + 2, 4 * n * self._substeps
        size = states + 1
        self.torques = np.zeros(n)
        """The guess, [N m], (horizon,)."""
        self._trial = np.zeros(n)
        self._nodes = np.zeros((n + 1, states))
        self._trial_nodes = np.zeros((n + 1, states))
        self._sensitivity = np.zeros((n, states, size))
        self._points = np.zeros((evaluations, states))
        self._jacobians = np.zeros((evaluations, self._model.row.size))
        self._spread = np.zeros((evaluations, states, size))
        self._cube = np.zeros((3, states, size))
        self._rows = np.zeros((3, states))
        self._hessian, self._gradient = np.zeros((n, n)), np.zeros(n)
        self._adjoint = np.zeros((n + 1, states))
        self._row = np.zeros((axles, n))
        self._influence = np.zeros((n + 1, states, n))
        self._hessians = np.zeros((n, size, size))
        self._second = np.zeros((6, max(size, self._model.upper_row.size)))
        self._wide = np.zeros((2 * size, n))
        self._lower, self._upper = np.zeros(n), np.zeros(n)
        self._solver = daqp.Model()
        self._solver.setup(
            np.eye(n), np.zeros(n), np.zeros((0, n)), np.ones(n), -np.ones(n),
            np.zeros(n, dtype=np.int32),
        )  # fmt: skip

    def shift(self) -> None:
        """Move the guess on by one period."""
        self.torques[:-1] = self.torques[1:]

    def restart(self, torque: float) -> None:
        """Forget the guess: hold `torque` [N m] over the horizon."""
        self.torques[:] = torque

    def solve(self, problem: HorizonProblem, give_up: float = np.inf) -> HorizonSolution:
        """Improve the guess by one step, and by more while the residual before the last one exceeds `settings.tolerance`.

        At most `settings.iterations` in all, none but the first begun after `give_up` (perf_counter) [s]. A solution with
        another status than "ok" must not be used; the guess is then to be restarted.
        """
        settings = self._settings
        np.clip(self.torques, 0.0, problem.upper, out=self.torques)
        cost, residual, done = np.nan, np.inf, 0
        while done == 0 or (done < settings.iterations and clock.perf_counter() < give_up):
            self._linearise(problem)
            cost = self._cost(self._nodes, self.torques, problem)
            residual = self._residual(problem)
            if not (np.isfinite(cost) and np.isfinite(residual)):
                return HorizonSolution(self.torques.copy(), cost, residual, done, "not finite")
            near = residual <= settings.tolerance
            if near and done > 0:
                break
            # the first step is taken always: it is what answers the measurement
            flag = self._step(problem)
            done += 1
            if flag < 0:
                return HorizonSolution(self.torques.copy(), cost, residual, done, f"QP flag {flag}")
            if not self._search(problem, cost) or near:
                break
        return HorizonSolution(self.torques.copy(), cost, residual, done, "ok")

    def _linearise(self, problem: HorizonProblem) -> None:
        model, weights = self._model, self._weights
        self._nodes[0] = problem.state
        linearise(
            model.rate, model.row, model.column, self.torques, problem.parameters,
            self._small_step, self._substeps, self._nodes, self._sensitivity,
            self._points, self._jacobians, self._spread, self._cube,
        )  # fmt: skip
        condense(
            self._nodes, self._sensitivity, self.torques, self._slip, problem.slip_limit,
            problem.target, problem.before, weights,
            self._hessian, self._adjoint, self._row, self._gradient, self._influence,
        )  # fmt: skip

    def _cost(self, nodes: np.ndarray, torques: np.ndarray, problem: HorizonProblem) -> float:
        return float(
            trajectory_cost(
                nodes, torques, self._slip, problem.slip_limit, problem.target, problem.before,
                self._weights,
            )
        )  # fmt: skip

    def _residual(self, problem: HorizonProblem) -> float:
        now = self.torques / self._scale
        projected = np.clip(now - self._gradient, 0.0, problem.upper / self._scale)
        return float(np.abs(projected - now).max())

    def _step(self, problem: HorizonProblem) -> int:
        """Solve the quadratic model; leaves the step's end in the trial torques and returns DAQP's flag."""
        if self._settings.exact_hessian:
            self._make_exact(problem)
        np.divide(self.torques, -self._scale, out=self._lower)
        np.add(self._lower, problem.upper / self._scale, out=self._upper)
        flag = self._solver.update(
            H=self._hessian, f=self._gradient, bupper=self._upper, blower=self._lower
        )
        if flag < 0:
            return int(flag)
        step, _, flag, _ = self._solver.solve()
        np.multiply(step, self._scale, out=self._trial)
        self._trial += self.torques
        np.clip(self._trial, 0.0, problem.upper, out=self._trial)
        return int(flag)

    def _make_exact(self, problem: HorizonProblem) -> None:
        """Add the model's second derivatives; reflect negative curvature, so that the QP is convex."""
        model = self._model
        second_order(
            model.curvature, model.row, model.column, model.upper_row, model.upper_column,
            self.torques, problem.parameters, self._small_step, self._substeps,
            self._points, self._jacobians, self._spread, self._adjoint, self._hessians,
            self._second,
        )  # fmt: skip
        add_second_order(self._hessians, self._influence, self._scale, self._hessian, self._wide)
        values, vectors = np.linalg.eigh(self._hessian)
        least = 2.0 * LEAST_CURVATURE * self._settings.weights.tracking
        if values[0] < least:
            np.matmul(vectors * np.maximum(np.abs(values), least), vectors.T, out=self._hessian)

    def _search(self, problem: HorizonProblem, cost: float) -> bool:
        """Take the trial torques, halving the step while the cost rises; False if no step lowers it."""
        for _ in range(HALVINGS + 1):
            self._trial_nodes[0] = problem.state
            simulate(
                self._model.slope, self._trial, problem.parameters, self._small_step,
                self._substeps, self._trial_nodes, self._rows,
            )  # fmt: skip
            if self._cost(self._trial_nodes, self._trial, problem) <= cost:
                self.torques[:] = self._trial
                return True
            self._trial += self.torques
            self._trial *= 0.5
        return False
