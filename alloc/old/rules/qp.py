"""The allocation as a quadratic program, by OSQP, by DAQP and by cvxpy; and with a probability that the rail carries a cap.

In: an `AllocationProblem`. Out: an `Allocation`, certified by its active set. Set up once per number of units, then updated.
"""

import signal
import threading
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from scipy.special import ndtri

from alloc.old.compilation import jit
from alloc.old.rules.exact import polished
from alloc.old.rules.problem import (
    Allocation,
    AllocationError,
    AllocationProblem,
    Floats,
    import_solver,
)
from alloc.old.rules.rule import RULES, Rule
from alloc.old.rules.wear import WEAR, answer_wear

# The allocation as a quadratic program, set up once per number of units and solver, then updated.
#
# With z = limit / expected, w = mass / mean mass and T = the attainable sum over the plan's:
#
#     minimise    1/2 sum w (z - 1)^2
#     subject to  sum w z = n T,   lower <= expected z <= upper.
#
# Solvers are given y = sqrt(w) z: then every curvature is one, whatever the masses. From the bounds that a solver finds
# active the answer follows exactly (`alloc.old.rules.exact`), whichever problems were solved before. "ok" says that it is
# certified.


ONE_AT_A_TIME = threading.Lock()
"""OSQP catches interrupts for the whole process while it solves: with two solves at once, Python would ignore Ctrl-C. The
parameters of cvxpy and Python's filters of warnings belong to the whole process too."""

INFINITE = 1e30
"""What solvers take for infinite."""


@jit
def state(lower, upper, mass, expected, known, root, low, high):
    """Fill `low` and `high` (n + 1,) with the bounds of y, then of the sum; False where the masses are not `known`."""
    n, least, most = mass.size, 0.0, 0.0
    for j in range(n):
        if mass[j] != known[j]:
            return False
        low[j] = root[j] * lower[j] / expected
        high[j] = min(root[j] * upper[j] / expected, INFINITE)
        least += root[j] * low[j]
        most += root[j] * high[j]
    low[n] = high[n] = min(max(float(n), least), most)
    return True


class Workspace:
    """The problem of n units in y for a solver, for use by one thread at a time."""

    def __init__(self, n: int) -> None:
        self.low, self.high = np.zeros(n + 1), np.ones(n + 1)
        self.set_up(np.ones(n))

    def set_up(self, mass: Floats) -> None:
        """Set up with these masses, anew: updated matrices would keep the rounding errors of the previous ones."""
        self.mass, self.root = mass.copy(), np.sqrt(mass / mass.mean())

    def answer(self) -> tuple[Floats, Floats, str]:
        """y, the multipliers of its bounds first of all, and "ok" or what went wrong."""
        raise NotImplementedError

    def solve(self, problem: AllocationProblem) -> tuple[Floats, Floats, str]:
        """z and the bounds' multipliers over w, (n,) each, and "ok" or what went wrong."""
        for _ in range(2):
            given = *problem.box, problem.weight, problem.expected, self.mass, self.root
            if state(*given, self.low, self.high):
                break
            self.set_up(problem.weight)
        y, multipliers, status = self.answer()
        return y / self.root, multipliers[: problem.n] / self.root, status


@lru_cache(maxsize=256)
def workspace(kind: Callable[[int], Workspace], n: int) -> Workspace:
    """The workspace of n units, set up on first use."""
    return kind(n)


def answer_by(
    kind: Callable[[int], Workspace], name: str, problem: AllocationProblem
) -> Allocation:
    """Limits by a solver; where they are not certified, the exact ones, and the status says so under the rule's `name`."""
    with ONE_AT_A_TIME:
        work = workspace(kind, problem.n)
        started = time.perf_counter()
        *answer, status = work.solve(problem)
    return polished(name, problem, answer, status, started)


SETTINGS = {
    "eps_abs": 1e-9,
    "eps_rel": 1e-9,
    "rho": 2.0,
    "alpha": 1.45,
    "check_termination": 10,
    "warm_starting": False,
    # the bounds always allow a solution; a tight box must not look like none
    "eps_prim_inf": 1e-15,
    "eps_dual_inf": 1e-15,
}
"""Settings of OSQP: tolerances that distinguish the active bounds, and a step size and relaxation that suit problems of
caps, unequal masses and rates of change alike. With both at one, caps alone take half the time, but limits of 64 units that
may change little take up to nine times. Without warm start the answer does not depend on the previous problem."""


class OsqpProblem(Workspace):
    """The problem for OSQP."""

    def __init__(self, n: int) -> None:
        self.osqp = import_solver("osqp", "qp")
        from scipy import sparse

        # stopped short it may know the active bounds all the same: the certificate says whether it does
        status = self.osqp.SolverStatus
        self.answered = (
            status.OSQP_SOLVED, status.OSQP_SOLVED_INACCURATE, status.OSQP_MAX_ITER_REACHED
        )  # fmt: skip
        self.interrupted = status.OSQP_SIGINT
        self.identity = sparse.eye(n, format="csc")
        self.matrix = sparse.vstack([self.identity, np.ones((1, n))]).tocsc()
        self.matrix.sort_indices()
        super().__init__(n)

    def set_up(self, mass: Floats) -> None:
        """As any solver's, by OSQP's interface in Python."""
        super().set_up(mass)
        self.matrix.data[1::2] = self.root  # a column holds its entry of the box, then of the sum
        interface = self.osqp.OSQP()
        interface.setup(
            self.identity, -self.root, self.matrix, np.zeros_like(self.low), np.ones_like(self.high),
            verbose=False, **SETTINGS,
        )  # fmt: skip
        # without the interface, which costs as much per call as OSQP takes for 16 units
        self.solver, self.rho_changed = interface._solver, False

    def answer(self) -> tuple[Floats, Floats, str]:
        """As any solver's."""
        if self.rho_changed:
            self.solver.update_rho(SETTINGS["rho"])
        self.solver.update_data_vec(q=None, l=self.low, u=self.high)
        self.solver.solve()
        info, found = self.solver.info, self.solver.solution
        self.rho_changed = info.rho_updates > 0
        if info.status_val == self.interrupted:
            signal.raise_signal(signal.SIGINT)  # OSQP kept it from Python
        return found.x, found.y, "ok" if info.status_val in self.answered else info.status


QP = Rule(
    "qp", "quadratic program: least deviation from the plan (OSQP)", partial(answer_by, OsqpProblem, "qp"),
    promise="exact", colour="#e38eff", marker="X",
)  # fmt: skip
RULES.register("qp", QP)


PRIMAL_TOLERANCE = 1e-11
"""Violation of a bound of y that DAQP leaves."""


class DaqpProblem(Workspace):
    """The problem for DAQP, a dual active-set method.

    Source: Arnstroem, Bemporad, Axehall, IEEE Transactions on Automatic Control 67 (2022), 4362-4369.
    """

    def __init__(self, n: int) -> None:
        self.daqp = import_solver("daqp", "qp-daqp")
        self.sense = np.zeros(n + 1, dtype=np.int32)
        self.sense[n] = 5  # the sum is an equation
        super().__init__(n)

    def set_up(self, mass: Floats) -> None:
        """As any solver's."""
        super().set_up(mass)
        self.model = self.daqp.Model()
        self.model.setup(
            np.eye(mass.size), -self.root, self.root[None], np.ones_like(self.high),
            np.zeros_like(self.low), self.sense,
        )  # fmt: skip
        self.model.settings = {**self.model.settings, "primal_tol": PRIMAL_TOLERANCE}

    def answer(self) -> tuple[Floats, Floats, str]:
        """As any solver's; given `sense` anew, DAQP forgets the bounds that were active."""
        self.model.update(bupper=self.high, blower=self.low, sense=self.sense)
        y, _, flag, more = self.model.solve()
        return y, more["lam"], "ok" if flag > 0 else f"exit flag {flag}"


QP_DAQP = Rule(
    "qp-daqp", "qp by DAQP, an active-set method", partial(answer_by, DaqpProblem, "qp-daqp"),
    promise="exact", colour="#7896b4", marker="H",
)  # fmt: skip
RULES.register("qp-daqp", QP_DAQP)


# The same program as one would write it on paper, in cvxpy: the readable reference, slow.


SOLVER = "CLARABEL"
"""An interior-point solver: its method differs from those of `qp` and `qp-daqp`, so they check each other."""
CLARABEL_SETTINGS = {"tol_gap_abs": 1e-11, "tol_gap_rel": 1e-11, "tol_feas": 1e-11, "max_iter": 200}


class Formulation(Workspace):
    """The problem with its parameters, built once, since building it costs more than solving it."""

    def __init__(self, n: int) -> None:
        cp = import_solver("cvxpy", "qp-cvxpy")

        self.failure = cp.SolverError
        self.p_root = cp.Parameter(n, pos=True)
        self.p_low, self.p_high = cp.Parameter(n, nonneg=True), cp.Parameter(n, nonneg=True)
        self.p_sum = cp.Parameter(nonneg=True)
        self.y = cp.Variable(n)
        self.problem = cp.Problem(
            cp.Minimize(cp.sum_squares(self.y - self.p_root)),
            [self.p_low <= self.y, self.y <= self.p_high, self.p_root @ self.y == self.p_sum],
        )
        super().__init__(n)

    def answer(self) -> tuple[Floats, Floats, str]:
        """As any solver's."""
        self.p_root.value, self.p_sum.value = self.root, self.low[-1]
        self.p_low.value, self.p_high.value = self.low[:-1], self.high[:-1]
        nothing = np.full(self.root.size, np.nan)
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
        return self.y.value, 0.5 * (at_upper - at_lower), "ok"


QP_CVXPY = Rule(
    "qp-cvxpy", "the same program stated in cvxpy: readable reference, slow", partial(answer_by, Formulation, "qp-cvxpy"),
    promise="exact", colour="#1c00ff", marker="<",
)  # fmt: skip
RULES.register("qp-cvxpy", QP_CVXPY)


# The program of least wear (`alloc.old.rules.wear`) in shares of the marks, by the same solvers.


WEAR_QP = replace(
    WEAR, name="wear-qp", description="wear as a quadratic program (OSQP)", law=None, colour="#b87557", marker="$Q$",
    answer=partial(answer_wear, partial(answer_by, OsqpProblem, "wear-qp")),
)  # fmt: skip
WEAR_CVXPY = replace(
    WEAR, name="wear-cvxpy", description="wear stated in cvxpy: readable reference, slow", law=None, colour="#ae4006",
    marker="$C$", answer=partial(answer_wear, partial(answer_by, Formulation, "wear-cvxpy")),
)  # fmt: skip
RULES.register("wear-qp", WEAR_QP)
RULES.register("wear-cvxpy", WEAR_CVXPY)


# Chance-constrained allocation: the rail carries every cap with a chosen probability; then the quadratic program as
# before.
#
# The true bound of unit j is normal about its cap with standard deviation d_j. Then
#
#     P(limit_j <= true bound_j) >= p    is equivalent to    limit_j <= cap_j - Phi^-1(p) d_j,
#
# a linear constraint again: the program of `alloc.old.rules.qp` with lower caps (Charnes and Cooper, Management Science 6
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
    return answer_by(OsqpProblem, "qp-robust", chance_constrained(problem, probability))


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
