"""The real-time iteration's loop in Python, its quadratic programs solved by any solver that `qpsolvers` finds installed.

Caron et al.: qpsolvers: quadratic programming solvers in Python with a unified API, github.com/qpsolvers/qpsolvers.
Solvers have their default settings, as who tries them in the loop's place would have.
"""

import warnings
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import qpsolvers
from scipy.sparse import csc_matrix

from alloc.plant.model import Floats
from alloc.records import ByReference
from mpc.box_qp import box_workspace, solve_box_qp
from mpc.period import RealTimeIteration
from tests.benchmarks.python_iteration import PythonIteration


class Solved(NamedTuple):
    """A quadratic program in scaled torques, and what a solver took for its solution."""

    hessian: Floats
    gradient: Floats
    lower: Floats
    upper: Floats
    step: Floats

    @property
    def error(self) -> float:
        """Greatest difference of a torque from the own solver's, over the torque scale."""
        exact = np.zeros(self.step.size)
        work = ByReference(box_workspace(exact.size))
        steps = solve_box_qp(self.hessian, self.gradient, self.lower, self.upper, exact, work)
        return float(np.abs(self.step - exact).max()) if steps >= 0 else np.nan


class QpsolversIteration(PythonIteration):
    """The iteration with the solver called `name` in `qpsolvers`; a program that it does not solve is a failure."""

    def __init__(self, units, settings, evenness=0.0, *, name):
        super().__init__(units, settings, evenness)
        if name not in qpsolvers.available_solvers:
            raise ImportError(
                f"QP solver {name!r} is not installed; there are {', '.join(solver_names())}"
            )
        self._name = name
        self._matrix = np.array if name in qpsolvers.dense_solvers else csc_matrix
        self.solved = []
        """Programs with their answers."""

    def program(self, hessian, gradient, lower, upper):
        """As any."""
        problem = qpsolvers.Problem(self._matrix(hessian), gradient.copy(), lb=lower, ub=upper)
        try:
            with warnings.catch_warnings():
                # qpsolvers asks OSQP in a way that will change
                warnings.simplefilter("ignore", PendingDeprecationWarning)
                solution = qpsolvers.solve_problem(problem, solver=self._name)
        except qpsolvers.QPError:
            return None
        step = solution.x
        if not solution.found or step is None or not np.isfinite(step).all():
            return None
        self.solved.append(Solved(hessian.copy(), gradient.copy(), lower, upper, step))
        return step


def solver_names() -> list[str]:
    """Names of the solvers that are installed."""
    return sorted(qpsolvers.available_solvers)


def iterations() -> dict[str, Callable[..., RealTimeIteration]]:
    """The iteration with each solver that is installed, by the solver's name."""
    return {name: partial(QpsolversIteration, name=name) for name in solver_names()}
