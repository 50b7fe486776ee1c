"""The quadratic program of `alloc.rules.qp` as one would write it on paper: the readable reference."""

import threading
import time
import warnings
from functools import lru_cache

import numpy as np

from alloc.rules.exact import polished
from alloc.rules.problem import Allocation, AllocationProblem, Floats, import_solver
from alloc.rules.qp import scaled
from alloc.rules.rule import RULES, Rule

SOLVER = "CLARABEL"
"""An interior-point solver: its method differs from that of `qp`, so the two check each other."""
SETTINGS = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11, "max_iter": 200}

ONE_AT_A_TIME = threading.Lock()
"""A lock, because cvxpy's parameters and Python's filters of warnings belong to the whole process."""


class Formulation:
    """The problem for n units with its parameters, built once, since building it costs more than solving it."""

    def __init__(self, n: int) -> None:
        cp = import_solver("cvxpy", "qp-cvxpy")

        self.failure = cp.SolverError
        self.root_weight = cp.Parameter(n, pos=True)
        self.weight = cp.Parameter(n, pos=True)
        self.lower = cp.Parameter(n, nonneg=True)
        self.upper = cp.Parameter(n, nonneg=True)
        self.total = cp.Parameter(nonneg=True)
        self.z = cp.Variable(n)

        deviation = cp.multiply(self.root_weight, self.z - 1)
        self.problem = cp.Problem(
            cp.Minimize(cp.sum_squares(deviation)),
            [self.lower <= self.z, self.z <= self.upper, self.weight @ self.z == self.total],
        )

    def solve(
        self, weight: Floats, lower: Floats, upper: Floats, total: float
    ) -> tuple[Floats, Floats, str]:
        """As `alloc.rules.qp.Workspace.solve`."""
        self.root_weight.value, self.weight.value = np.sqrt(weight), weight
        self.lower.value, self.upper.value, self.total.value = lower, upper, total
        nothing = np.full(weight.size, np.nan)
        try:
            with warnings.catch_warnings():
                # "may be inaccurate": whether the answer is, its certificate says
                warnings.simplefilter("ignore", UserWarning)
                self.problem.solve(solver=SOLVER, **SETTINGS)
        except self.failure as error:
            return nothing, nothing, str(error)
        if self.problem.status not in ("optimal", "optimal_inaccurate"):
            return nothing, nothing, str(self.problem.status)
        at_lower, at_upper, _ = (constraint.dual_value for constraint in self.problem.constraints)
        return self.z.value, 0.5 * (at_upper - at_lower) / weight, "ok"


formulation = lru_cache(maxsize=64)(Formulation)
"""The formulation for n units, built on first use."""


def answer_qp_cvxpy(problem: AllocationProblem) -> Allocation:
    """Limits by cvxpy; where they are not certified, the exact ones, and the status says so."""
    with ONE_AT_A_TIME:
        stated = formulation(problem.n)
        started = time.perf_counter()
        *answer, status = stated.solve(*scaled(problem))
    return polished("qp-cvxpy", problem, answer, status, started)


QP_CVXPY = Rule(
    "qp-cvxpy", "the same program stated in cvxpy: readable reference, slow", answer_qp_cvxpy,
    colour="#1c00ff", marker="<",
)  # fmt: skip
RULES.register("qp-cvxpy", QP_CVXPY)
