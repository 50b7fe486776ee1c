"""The allocation as a quadratic program, solved by OSQP: set up once per number of units, then updated.

With z = limit / expected, w = mass / mean mass and T = the attainable sum over the plan's:

    minimise    1/2 sum w (z - 1)^2
    subject to  sum w z = n T,   lower <= expected z <= upper.

The scaling makes every number of order one, which OSQP's absolute tolerances need.
"""

import time
from functools import lru_cache
from typing import Any

import numpy as np

from alloc.rules.allocation import CASE_A, CASE_B, Allocation, allocation
from alloc.rules.exact import exact_in_box
from alloc.rules.optimality_check import fitted_level
from alloc.rules.problem import AllocationProblem, Floats, import_solver
from alloc.rules.rule import RULES, Rule

SETTINGS = {
    "eps_abs": 1e-10,
    "eps_rel": 1e-10,
    "delta": 1e-7,  # regularisation of the polishing step
    "polishing": True,
    # the bounds always allow a solution; a tight box must not look like none
    "eps_prim_inf": 1e-15,
    "eps_dual_inf": 1e-15,
    "max_iter": 20_000,
    "check_termination": 25,
}
"""OSQP's defaults (1e-3) would leave a tenth of a per cent of the train's effort to chance."""

FEASIBLE = 1e-8
"""Largest violation, relative to the plan, with which an answer is taken."""


class Workspace:
    """OSQP's problem for n units. Not for use by several threads at once."""

    def __init__(self, n: int) -> None:
        osqp = import_solver("osqp", "qp")
        from scipy import sparse

        # "inaccurate" is within ten times the tolerances; what matters is checked below
        self.solved = (osqp.SolverStatus.OSQP_SOLVED, osqp.SolverStatus.OSQP_SOLVED_INACCURATE)
        self.n = n
        self.weight = np.ones(n)
        self.lower, self.upper = np.zeros(n + 1), np.ones(n + 1)
        quadratic = sparse.eye(n, format="csc")
        matrix = sparse.vstack([np.ones((1, n)), sparse.eye(n)]).tocsc()
        matrix.sort_indices()
        self.matrix_data = matrix.data.copy()
        self.solver = osqp.OSQP()
        self.solver.setup(
            quadratic, -np.ones(n), matrix, self.lower, self.upper, verbose=False, **SETTINGS
        )

    def solve(
        self, weight: Floats, lower: Floats, upper: Floats, total: float
    ) -> tuple[Floats, str]:
        """Solution z (n,) of the scaled problem, and "ok" or what went wrong; all inputs scaled as well."""
        changes: dict[str, Any] = {}
        if not np.array_equal(weight, self.weight):
            self.weight = weight.copy()
            self.matrix_data[::2] = weight  # a column holds its entry of the sum, then of the box
            changes = {"Px": self.weight, "q": -self.weight, "Ax": self.matrix_data}
        self.lower[0] = self.upper[0] = total
        self.lower[1:], self.upper[1:] = lower, upper
        self.solver.update(l=self.lower, u=self.upper, **changes)
        result = self.solver.solve(raise_error=False)
        if result.info.status_val not in self.solved:
            return np.full(self.n, np.nan), result.info.status
        return checked(result.x, weight, lower, upper, total)


def checked(
    z: Floats, weight: Floats, lower: Floats, upper: Floats, total: float
) -> tuple[Floats, str]:
    """A solver's answer put inside its bounds, and "ok" or by how much it misses the sum."""
    inside = np.clip(z, lower, upper)
    missed = abs(float(weight @ inside) - total) / z.size
    if not missed <= FEASIBLE:
        return inside, f"constraints missed by {missed:.1e}"
    return inside, "ok"


workspace = lru_cache(maxsize=256)(Workspace)
"""The workspace for n units, set up on first use."""


def answer_qp(problem: AllocationProblem, name: str = "qp") -> Allocation:
    """Limits by OSQP; where it fails, the exact ones, and the status says so under the rule's `name`."""
    work = workspace(problem.n)
    started = time.perf_counter()
    weight, lower, upper, total = scaled(problem)
    z, status = work.solve(weight, lower, upper, total)
    return finished(name, problem, z, status, started)


def scaled(problem: AllocationProblem) -> tuple[Floats, Floats, Floats, float]:
    """w, lower and upper bounds of z, and the sum of w z that the bounds allow, nearest to n."""
    lower, upper = problem.box
    weight, plan = problem.weight / problem.weight.mean(), problem.expected
    return weight, lower / plan, upper / plan, problem.n * problem.attainable / plan


def finished(
    name: str, problem: AllocationProblem, z: Floats, status: str, started: float
) -> Allocation:
    """The answer with the limits `z` times the plan, or with the exact ones unless `status` is "ok"."""
    limit = z * problem.expected
    if status == "ok":
        case = CASE_B if problem.within_reach else CASE_A
        level = fitted_level(limit, problem, FEASIBLE)
    else:
        status = f"{name} failed ({status}): exact level used"
        level, case = exact_in_box(problem, limit)
    return allocation(problem, limit, level, case, time.perf_counter() - started, status)


QP = Rule(
    "qp", "quadratic program: least deviation from the plan (OSQP)", answer_qp, colour="#56b4e9", marker="X"
)  # fmt: skip
RULES.register("qp", QP)
