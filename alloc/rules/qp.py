"""The allocation as a quadratic program, by OSQP and as cvxpy states it; and with a probability that the rail carries a cap.

In: an `AllocationProblem`. Out: an `Allocation`, certified by its active set. Set up once per number of units, then updated.
"""

import signal
import threading
import time
import warnings
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from scipy.special import ndtri

from alloc.rules.exact import polished
from alloc.rules.problem import (
    Allocation,
    AllocationError,
    AllocationProblem,
    Floats,
    import_solver,
)
from alloc.rules.rule import RULES, Rule

# The allocation as a quadratic program, solved by OSQP: set up once per number of units, then updated.
#
# With z = limit / expected, w = mass / mean mass and T = the attainable sum over the plan's:
#
#     minimise    1/2 sum w (z - 1)^2
#     subject to  sum w z = n T,   lower <= expected z <= upper.
#
# OSQP is given y = sqrt(w) z: then every curvature is one, whatever the masses. From the bounds that it finds active
# the answer follows exactly (`alloc.rules.exact`), whichever problems were solved before. "ok" says that it is
# certified.


SETTINGS = {
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "rho": 10.0,
    "warm_starting": False,
    # the bounds always allow a solution; a tight box must not look like none
    "eps_prim_inf": 1e-15,
    "eps_dual_inf": 1e-15,
}
"""Tolerances that distinguish the active bounds. With OSQP's first step size of 0.1, masses a million apart take ten times
as many iterations. Without warm start the answer does not depend on the previous problem."""

ONE_AT_A_TIME = threading.Lock()
"""OSQP catches interrupts for the whole process while it solves: with two solves at once, Python would ignore Ctrl-C. The
parameters of cvxpy and Python's filters of warnings belong to the whole process too."""


class OsqpProblem:
    """OSQP's problem for n units, for use by one thread at a time."""

    def __init__(self, n: int) -> None:
        self.osqp = import_solver("osqp", "qp")
        from scipy import sparse

        # stopped short it may know the active bounds all the same: the certificate says whether it does
        status = self.osqp.SolverStatus
        self.answered = (
            status.OSQP_SOLVED, status.OSQP_SOLVED_INACCURATE, status.OSQP_MAX_ITER_REACHED
        )  # fmt: skip
        self.interrupted = status.OSQP_SIGINT
        self.lower, self.upper = np.zeros(n + 1), np.ones(n + 1)
        self.identity = sparse.eye(n, format="csc")
        self.matrix = sparse.vstack([np.ones((1, n)), self.identity]).tocsc()
        self.matrix.sort_indices()
        self.set_up(np.ones(n))

    def set_up(self, weight: Floats) -> None:
        """Set up again with other masses: updated matrices would keep the rounding errors of the previous ones."""
        self.weight, self.root = weight.copy(), np.sqrt(weight)
        self.matrix.data[::2] = self.root  # a column holds its entry of the sum, then of the box
        self.rho_changed = False
        self.solver = self.osqp.OSQP()
        self.solver.setup(
            self.identity, -self.root, self.matrix, np.zeros_like(self.lower),
            np.ones_like(self.upper), verbose=False, **SETTINGS,
        )  # fmt: skip

    def solve(
        self, weight: Floats, lower: Floats, upper: Floats, total: float
    ) -> tuple[Floats, Floats, str]:
        """z and the bounds' multipliers over w, (n,) each, and "ok" or what went wrong; all inputs scaled as well."""
        if not np.array_equal(weight, self.weight):
            self.set_up(weight)
        self.lower[0] = self.upper[0] = total
        self.lower[1:], self.upper[1:] = self.root * lower, self.root * upper
        if self.rho_changed:
            self.solver.update_settings(rho=SETTINGS["rho"])
        self.solver.update(l=self.lower, u=self.upper)
        result = self.solver.solve(raise_error=False)
        self.rho_changed = result.info.rho_updates > 0
        if result.info.status_val == self.interrupted:
            signal.raise_signal(signal.SIGINT)  # OSQP kept it from Python
        status = "ok" if result.info.status_val in self.answered else result.info.status
        return result.x / self.root, result.y[1:] / self.root, status


workspace = lru_cache(maxsize=256)(OsqpProblem)
"""The workspace for n units, set up on first use."""


def answer_qp(problem: AllocationProblem, name: str = "qp") -> Allocation:
    """Limits by OSQP; where they are not certified, the exact ones, and the status says so under the rule's `name`."""
    with ONE_AT_A_TIME:
        work = workspace(problem.n)
        started = time.perf_counter()
        *answer, status = work.solve(*scaled(problem))
    return polished(name, problem, answer, status, started)


def scaled(problem: AllocationProblem) -> tuple[Floats, Floats, Floats, float]:
    """w, lower and upper bounds of z, and the sum of w z that the bounds allow, nearest to n."""
    lower, upper = problem.box
    weight, plan = problem.weight / problem.weight.mean(), problem.expected
    return weight, lower / plan, upper / plan, problem.n * problem.attainable / plan


QP = Rule(
    "qp", "quadratic program: least deviation from the plan (OSQP)", answer_qp, promise="exact", colour="#e38eff", marker="X"
)  # fmt: skip
RULES.register("qp", QP)


# The same program as one would write it on paper, in cvxpy: the readable reference, slow.


SOLVER = "CLARABEL"
"""An interior-point solver: its method differs from that of `qp`, so the two check each other."""
CLARABEL_SETTINGS = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11, "max_iter": 200}


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
        """As `Workspace.solve`."""
        self.root_weight.value, self.weight.value = np.sqrt(weight), weight
        self.lower.value, self.upper.value, self.total.value = lower, upper, total
        nothing = np.full(weight.size, np.nan)
        try:
            with warnings.catch_warnings():
                # "may be inaccurate": whether the answer is, its certificate says
                warnings.simplefilter("ignore", UserWarning)
                self.problem.solve(solver=SOLVER, **CLARABEL_SETTINGS)
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
    promise="exact", colour="#1c00ff", marker="<",
)  # fmt: skip
RULES.register("qp-cvxpy", QP_CVXPY)


# Chance-constrained allocation: the rail carries every cap with a chosen probability; then the quadratic program as
# before.
#
# The true bound of unit j is normal about its cap with standard deviation d_j. Then
#
#     P(limit_j <= true bound_j) >= p    is equivalent to    limit_j <= cap_j - Phi^-1(p) d_j,
#
# a linear constraint again: the program of `alloc.rules.qp` with lower caps (Charnes and Cooper, Management Science 6
# (1959), p. 73: deterministic equivalent of an individual chance constraint). The probability applies unit by unit.
# That the rail carries all caps at once is less probable. An error of the foremost unit's estimate shifts all caps
# alike, and is part of each deviation.


PROBABILITY = 0.9
"""Default probability that the rail carries a cap. Assumed, no source names one. The next steps, 0.95 and 0.99, cost 1.3 and
1.8 times as much effort, and a unit that slips all the same has its own readhesion control."""


def check_probability(probability: float) -> float:
    """`probability` as a number; raises `AllocationError` outside of 0.5 <= p < 1."""
    try:
        value = float(probability)
    except (TypeError, ValueError):
        value = float("nan")
    if isinstance(probability, bool) or not 0.5 <= value < 1.0:
        raise AllocationError(
            f"probability = {probability!r} must be a number with 0.5 <= probability < 1: at 0.5 the caps stay as they "
            "are, and with certainty a normal error allows no limit at all"
        )
    return value


def chance_constrained(
    problem: AllocationProblem, probability: float = PROBABILITY
) -> AllocationProblem:
    """The certain problem whose caps the true ones exceed with `probability` each: cap - Phi^-1(p) deviation, >= 0.

    Raises `AllocationError` for an impossible probability.
    """
    quantile = float(ndtri(check_probability(probability)))
    if problem.deviation is None:
        return problem
    cap = np.asarray(problem.cap) - quantile * np.asarray(problem.deviation)
    return problem.changed(cap=np.maximum(cap, 0.0), deviation=None)


def answer_robust(problem: AllocationProblem, probability: float = PROBABILITY) -> Allocation:
    """Limits by `qp` under the caps of `chance_constrained`."""
    return answer_qp(chance_constrained(problem, probability), "qp-robust")


QP_ROBUST = Rule(
    "qp-robust", "qp with caps that hold with a probability of 0.9", answer_robust,
    promise="exact", colour="#00c68e", marker=">",
)  # fmt: skip
RULES.register("qp-robust", QP_ROBUST)


def robust_rule(probability: float) -> Rule:
    """`qp-robust` with another probability; raises `AllocationError` for an impossible one."""
    value = check_probability(probability)
    description = f"qp with caps that hold with a probability of {value:g}"
    answer = partial(answer_robust, probability=value)
    return replace(QP_ROBUST, description=description, answer=answer)
