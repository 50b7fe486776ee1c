"""Real-time iteration: one step of sequential quadratic programming per control period, warm started by shifting.

Diehl, Bock, Schloeder, Findeisen, Nagy, Allgoewer: Real-time optimization and nonlinear model predictive control of
processes governed by differential-algebraic equations, J. Process Control 12 (2002) 577-585. The states are condensed
away; the quadratic programs in the torques alone are solved by DAQP (Arnstroem, Bemporad, Axehall: A dual active-set solver
for embedded quadratic programming, IEEE Trans. Automatic Control 67 (2022) 4362-4369).
"""

import time as clock

import daqp
import numpy as np

from mpc.assembly import compiled_group
from mpc.condensing import Quadratic, add_second_order, condense, trajectory_cost
from mpc.horizon import HorizonProblem, HorizonSolution, cost_of
from mpc.settings import MpcSettings
from mpc.shooting import Linearised, linearise, second_order, simulate
from mpc.unit_model import Units, substeps, unit_model

LEAST_CURVATURE = 0.1
"""Least eigenvalue of the quadratic model, relative to twice the weight of tracking; reflection can leave a small one."""

HALVINGS = 12
"""Most halvings of a step that would raise the cost; the last is taken only if it does not."""


SOLVER_ERRORS = (np.linalg.LinAlgError,)
"""What a solver raises where it fails; DAQP reports failures by its flag, and CasADi is not called in the loop. Anything
else that is raised is a fault of the program."""


class RealTimeIteration:
    """Solver of `HorizonProblem`; arrays and the QP solver are made once, and the last solution is kept as a guess.

    For one unit, or for a group as one problem; `evenness` is the weight of that term of the cost.
    """

    def __init__(self, units: Units, settings: MpcSettings, evenness: float = 0.0) -> None:
        self._settings = settings
        model = unit_model(units)
        self._model = compiled_group(units, settings.code)
        self._substeps = substeps(units, settings.step)
        self._small_step = settings.step / self._substeps
        self._terms = cost_of(units, settings, evenness)
        self._scale = np.tile(self._terms.unit.scale, settings.horizon)
        self.units, states = model.units, model.states
        axles, horizon = model.axles, settings.horizon
        n, evaluations = horizon * self.units, 4 * horizon * self._substeps
        size, nonzeros = states + self.units, self._model.nonzeros
        self.torques = np.zeros(n)
        """The guess, [N m], (horizon * units,)."""
        self._trial, self._trial_nodes = np.zeros(n), np.zeros((horizon + 1, states))
        self._now = Linearised(
            nodes=np.zeros((horizon + 1, states)),
            sensitivity=np.zeros((horizon, states, size)),
            points=np.zeros((evaluations, states)),
            jacobians=np.zeros((evaluations, nonzeros.row.size)),
            spread=np.zeros((evaluations, states, size)),
        )
        self._quadratic = Quadratic(
            hessian=np.zeros((n, n)),
            gradient=np.zeros(n),
            adjoint=np.zeros((horizon + 1, states)),
            influence=np.zeros((horizon + 1, states, n)),
            row=np.zeros((axles, n)),
        )
        self._cube, self._rows = np.zeros((3, states, size)), np.zeros((3, states))
        self._hessians = np.zeros((horizon, size, size))
        self._second = np.zeros((6, max(size, nonzeros.upper_row.size)))
        self._wide = np.zeros((2 * size, n))
        self._lower, self._upper = np.zeros(n), np.zeros(n)
        self._solver = daqp.Model()
        self._solver.setup(
            np.eye(n), np.zeros(n), np.zeros((0, n)), np.ones(n), -np.ones(n),
            np.zeros(n, dtype=np.int32),
        )  # fmt: skip

    def shift(self) -> None:
        """Move the guess on by one period."""
        self.torques[: -self.units] = self.torques[self.units :]

    def restart(self, torque: float | np.ndarray) -> None:
        """Forget the guess: hold `torque` [N m], (units,), over the horizon."""
        self._by_unit(self.torques)[:] = torque

    def _by_unit(self, torques: np.ndarray) -> np.ndarray:
        """The same memory as (horizon, units)."""
        return torques.reshape(-1, self.units)

    def solve(self, problem: HorizonProblem, give_up: float = np.inf) -> HorizonSolution:
        """Improve the guess by one step, and by more while the residual before the last one exceeds `settings.tolerance`.

        At most `settings.iterations` in all, none but the first begun after `give_up` (perf_counter) [s]. A solution with
        another status than "ok" must not be used; the guess is then to be restarted.
        """
        settings = self._settings
        now = self._by_unit(self.torques)
        np.clip(now, 0.0, problem.upper, out=now)
        cost, residual, done = np.nan, np.inf, 0
        while done == 0 or (done < settings.iterations and clock.perf_counter() < give_up):
            self._linearise(problem)
            cost = float(trajectory_cost(self._now.nodes, self.torques, self._terms))
            residual = self._residual(problem)
            if not (np.isfinite(cost) and np.isfinite(residual)):
                return HorizonSolution(self.torques.copy(), cost, residual, done, "not finite")
            near = residual <= settings.tolerance
            if near and done > 0:
                break
            # the first step is taken always: it is what answers the measurement
            failure = self._step(problem)
            done += 1
            if failure:
                return HorizonSolution(self.torques.copy(), cost, residual, done, failure)
            if not self._search(problem, cost) or near:
                break
        return HorizonSolution(self.torques.copy(), cost, residual, done, "ok")

    def _linearise(self, problem: HorizonProblem) -> None:
        axle, unit = self._terms.axle, self._terms.unit
        unit.target[:], unit.before[:] = problem.target, problem.before
        unit.reference[:], axle.slip_limit[:] = problem.reference, problem.slip_limit
        self._now.nodes[0] = problem.state
        linearise(
            self._model.rate, self._model.nonzeros, self.torques, problem.parameters,
            self._small_step, self._substeps, self._now, self._cube,
        )  # fmt: skip
        condense(self._now, self.torques, self._terms, self._quadratic)

    def _residual(self, problem: HorizonProblem) -> float:
        now = self.torques / self._scale
        upper = problem.upper / self._terms.unit.scale
        projected = np.clip(self._by_unit(now - self._quadratic.gradient), 0.0, upper)
        return float(np.abs(projected.ravel() - now).max())

    def _step(self, problem: HorizonProblem) -> str:
        """Solve the quadratic model; leaves the step's end in the trial torques and returns what failed, "" for nothing."""
        if self._settings.exact_hessian:
            try:
                self._make_exact(problem)
            except SOLVER_ERRORS as error:
                return f"{type(error).__name__}: {error}"
        np.divide(self.torques, -self._scale, out=self._lower)
        upper = problem.upper / self._terms.unit.scale
        np.add(self._by_unit(self._lower), upper, out=self._by_unit(self._upper))
        flag = self._solver.update(
            H=self._quadratic.hessian,
            f=self._quadratic.gradient,
            bupper=self._upper,
            blower=self._lower,
        )
        if flag < 0:
            return f"QP flag {int(flag)}"
        step, _, flag, _ = self._solver.solve()
        if flag < 0:
            return f"QP flag {int(flag)}"
        np.multiply(step, self._scale, out=self._trial)
        self._trial += self.torques
        trial = self._by_unit(self._trial)
        np.clip(trial, 0.0, problem.upper, out=trial)
        return ""

    def _make_exact(self, problem: HorizonProblem) -> None:
        """Add the model's second derivatives; reflect negative curvature, so that the QP is convex."""
        second_order(
            self._model.curvature, self._model.nonzeros, self.torques, problem.parameters,
            self._small_step, self._substeps, self._now, self._quadratic.adjoint, self._hessians,
            self._second,
        )  # fmt: skip
        add_second_order(self._hessians, self._terms, self._quadratic, self._wide)
        hessian = self._quadratic.hessian
        values, vectors = np.linalg.eigh(hessian)
        least = 2.0 * LEAST_CURVATURE * self._settings.weights.tracking
        if values[0] < least:
            np.matmul(vectors * np.maximum(np.abs(values), least), vectors.T, out=hessian)

    def _search(self, problem: HorizonProblem, cost: float) -> bool:
        """Take the trial torques, halving the step while the cost rises; False if no step lowers it."""
        for _ in range(HALVINGS + 1):
            self._trial_nodes[0] = problem.state
            simulate(
                self._model.slope, self._trial, problem.parameters, self._small_step,
                self._substeps, self._trial_nodes, self._rows,
            )  # fmt: skip
            if trajectory_cost(self._trial_nodes, self._trial, self._terms) <= cost:
                self.torques[:] = self._trial
                return True
            self._trial += self.torques
            self._trial *= 0.5
        return False
