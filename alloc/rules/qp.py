"""The allocation as a quadratic program for OSQP, set up once per number of units; its answer is judged.

With z = x / expected, w = mass / mean mass, T = the attainable sum over the plan's:

    minimise    1/2 sum w (z - 1)^2
    subject to  sum w z = n T,   lower <= expected z <= upper.

OSQP is given y = sqrt(w) z: then every curvature is one, whatever the masses.
"""

import math
import signal
import threading
from functools import lru_cache
from typing import Any

import numpy as np

from alloc.rules.exact import exact_limits
from alloc.rules.problem import Allocation, AllocationProblem, Floats, allocated
from alloc.rules.rule import RULES, Rule

TOLERANCE = 1e-6
"""Distance of a solver's answer from the certified one, over the plan, beyond which it has failed."""
ONE_AT_A_TIME = threading.Lock()
"""OSQP catches interrupts for the whole process while it solves; with two solves at once Python would ignore Ctrl-C. A
workspace answers one call at a time."""


def status_without_solver(problem: AllocationProblem) -> str:
    """Why the exact answer needs no solver: "ok" out of reach, where the bounds are the answer; "near tie"; else nothing."""
    least = problem.mean(problem.lower / problem.expected) - 1.0
    if problem.surplus <= 0.0 or least >= 0.0:
        return "ok"
    room = min(problem.surplus, -least)
    tie = f"near tie: bounds leave {room:.1g} of the plan, exact answer used"
    return tie if room <= TOLERANCE else ""


def judge_answer(
    problem: AllocationProblem, answer: Floats, status: str, certified: tuple[Floats, float]
) -> Allocation:
    """A solver's `answer`, limits (n,), if within `TOLERANCE` of the `certified` one, which else stands in.

    `status`: "ok", or what the solver says went wrong. `certified`: limits and level.
    """
    best, level = certified
    gap = float(np.max(np.abs(answer - best))) / problem.expected if status == "ok" else math.nan
    if status == "ok" and not gap <= TOLERANCE:
        status = f"off by {gap:.1g} of the plan"
    if status != "ok":
        status = f"failed: {status}; exact answer used"
        gap = gap if math.isfinite(gap) else math.inf
        return allocated(problem, best, level, status=status, gap=gap)
    limit = np.clip(answer, problem.lower, problem.upper)
    near = TOLERANCE * problem.expected
    free = (limit > problem.lower + near) & (limit < problem.upper - near)
    if free.any() and math.isfinite(level):
        level = float(limit[free].mean())
    return allocated(problem, limit, level, gap=gap)


SETTINGS: dict[str, Any] = {
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "rho": 2.0,
    "alpha": 1.45,
    "scaling": 0,
    "polishing": True,
    "check_termination": 10,
    "warm_starting": False,
    "eps_prim_inf": 1e-15,
    "eps_dual_inf": 1e-15,
}
"""Settings of OSQP: its default tolerances of 1e-3 are loose. Without warm start, and with the step set back, the
answer does not depend on the problem before."""


class Workspace:
    """The program of n units for OSQP."""

    def __init__(self, n: int) -> None:
        import osqp  # type: ignore[import-untyped]  # both take longer to import than a run takes
        from scipy import sparse

        matrix = sparse.vstack([sparse.eye(n), np.ones((1, n))]).tocsc()
        matrix.sort_indices()
        self.entries = matrix.data  # a column holds its entry of the box, then of the sum
        self.mass, self.moved, self.ends = np.ones(n), False, osqp.SolverStatus
        self.infinite, self.solver = osqp.constant("OSQP_INFTY"), osqp.OSQP()
        curvature, (lower, upper) = sparse.eye(n, format="csc"), (np.zeros(n + 1), np.ones(n + 1))
        self.solver.setup(curvature, -np.ones(n), matrix, lower, upper, verbose=False, **SETTINGS)

    def solve(self, problem: AllocationProblem) -> tuple[Floats, str]:
        """Limits (n,), and "ok" or what OSQP says went wrong."""
        root, plan = np.sqrt(problem.mass / problem.mass.mean()), problem.expected
        if not np.array_equal(problem.mass, self.mass):
            self.entries[1::2], self.mass = root, problem.mass
            self.solver.update(q=-root, Ax=self.entries)
        total = root @ root * problem.attainable / plan
        lower = np.append(root * problem.lower / plan, total)
        upper = np.append(root * problem.upper / plan, total)
        self.solver.update(l=lower, u=np.minimum(upper, self.infinite))
        if self.moved:
            self.solver.update_settings(rho=SETTINGS["rho"])
        solution = self.solver.solve(raise_error=False)
        self.moved = solution.info.rho_updates > 0
        status = self.ends(solution.info.status_val)
        if status == self.ends.OSQP_SIGINT:
            signal.raise_signal(signal.SIGINT)  # OSQP kept it from Python
        fine = status == self.ends.OSQP_SOLVED
        return solution.x / root * plan, "ok" if fine else str(solution.info.status)


workspace = lru_cache(maxsize=64)(Workspace)


def answer_qp(problem: AllocationProblem) -> Allocation:
    """Limits by OSQP."""
    certified = exact_limits(problem)
    if reason := status_without_solver(problem):
        return allocated(problem, *certified, status=reason)
    with ONE_AT_A_TIME:
        answer, status = workspace(problem.n).solve(problem)
    return judge_answer(problem, answer, status, certified)


QP = Rule(
    "qp",
    "quadratic program: least deviation from the plan (OSQP)",
    answer=answer_qp,
    promise="exact",
    colour="#e38eff",
    marker="X",
)
RULES.register(QP)
