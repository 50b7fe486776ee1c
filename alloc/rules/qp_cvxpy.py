"""The quadratic program of `alloc.rules.qp` as one would write it on paper: the readable reference."""

import time
import warnings
from functools import lru_cache

import numpy as np

from alloc.rules.allocation import Allocation
from alloc.rules.problem import AllocationProblem, import_solver
from alloc.rules.qp import checked, finished, scaled
from alloc.rules.rule import RULES, Rule

SOLVER = "CLARABEL"
"""An interior-point solver: another method than `qp`'s, so that the two check each other."""
SETTINGS = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11, "max_iter": 200}


class Formulation:
    """The problem for n units with its parameters, built once, since compiling it costs more than solving it."""

    def __init__(self, n: int) -> None:
        cp = import_solver("cvxpy", "qp-cvxpy")

        self.root_weight = cp.Parameter(n, pos=True)
        self.weight = cp.Parameter(n, pos=True)
        self.lower = cp.Parameter(n, nonneg=True)
        self.upper = cp.Parameter(n, nonneg=True)
        self.total = cp.Parameter(nonneg=True)
        self.z = cp.Variable(n)

        deviation = cp.multiply(self.root_weight, self.z - 1)
        self.problem = cp.Problem(
            cp.Minimize(cp.sum_squares(deviation)),
            [self.weight @ self.z == self.total, self.lower <= self.z, self.z <= self.upper],
        )


formulation = lru_cache(maxsize=64)(Formulation)
"""The formulation for n units, built on first use."""


def answer_qp_cvxpy(problem: AllocationProblem) -> Allocation:
    """Limits by cvxpy; where its solver fails, the exact ones, and the status says so."""
    stated = formulation(problem.n)
    started = time.perf_counter()
    weight, lower, upper, total = scaled(problem)
    stated.root_weight.value, stated.weight.value = np.sqrt(weight), weight
    stated.lower.value, stated.upper.value, stated.total.value = lower, upper, total
    z, status = np.full(problem.n, np.nan), "ok"
    try:
        with warnings.catch_warnings():
            # "may be inaccurate": whether it is, is checked below
            warnings.simplefilter("ignore", UserWarning)
            stated.problem.solve(solver=SOLVER, **SETTINGS)
    except import_solver("cvxpy", "qp-cvxpy").SolverError as error:
        status = str(error)
    if stated.problem.status not in ("optimal", "optimal_inaccurate"):
        status = str(stated.problem.status)
    elif status == "ok":
        z, status = checked(stated.z.value, weight, lower, upper, total)
    return finished("qp-cvxpy", problem, z, status, started)


QP_CVXPY = Rule(
    "qp-cvxpy", "the same program stated in cvxpy: readable reference, slow", answer_qp_cvxpy,
    colour="#009e73", marker="<",
)  # fmt: skip
RULES.register("qp-cvxpy", QP_CVXPY)
