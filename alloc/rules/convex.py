"""Rules as optimisations in cvxpy: state the objective, get a rule. As readable as on paper, and slow (some ms a call).

    steady = convex_rule("steady", lambda x, p: cp.sum_squares(x - p.plan) + 0.1 * cp.norm1(x - p.previous))
    RULES.register("steady", steady)

The effort comes first: the mean limit, weighted with mass, is as near to the plan as bounds and constraints allow.
The objective chooses among the limits that have it. A problem is built once per number of units, with parameters
(DPP), and then updated.
"""

import math
import threading
import warnings
from collections.abc import Callable, Sequence
from functools import lru_cache
from statistics import NormalDist
from types import SimpleNamespace
from typing import Any

import numpy as np

from alloc.onboard.beliefs import ROOM
from alloc.rules.cooperative import WEAR
from alloc.rules.exact import exact_limits, level_between
from alloc.rules.problem import ROUNDING, Allocation, AllocationProblem, Floats, allocated
from alloc.rules.qp import TOLERANCE, judge_answer, status_without_solver
from alloc.rules.rule import RULES, Rule
from alloc.schema.errors import AllocationError

Term = Callable[[Any, Any], Any]
"""`term(x, p)`: of the variable x (n,), and of parameters p, an objective or a constraint of cvxpy."""
Best = Callable[[AllocationProblem], tuple[Floats, float]]
"""Certified answer to a problem, limits and level, nan for none."""

SOLVER: dict[str, Any] = {
    "solver": "CLARABEL",
    "tol_gap_abs": 1e-15,
    "tol_gap_rel": 1e-15,
    "tol_feas": 1e-14,
    "max_iter": 200,
    "static_regularization_enable": False,
    "reduced_tol_gap_abs": 1e-6,
    "reduced_tol_gap_rel": 1e-6,
    "reduced_tol_feas": 1e-8,
}
"""An interior-point method: it differs from that of `qp`, so the two check each other. At 1e-12 masses of 1000:1
leave light units up to 8e-6 of the plan from the optimum, at 1e-15 up to 4e-7. Regularised, it fails on 2 % of random
problems of `wear-qp`, else on 1 of 10 000. What misses these tolerances and meets the reduced ones is called inaccurate."""
ROOM_LEFT = 1e-9
"""What constraints of a user keep of the most effort, relative to it: an interior-point method needs an interior."""
LARGE = 1e4
"""What stands for infinite, over the plan."""
ONE_AT_A_TIME = threading.Lock()
"""Parameters of cvxpy and Python's filters of warnings belong to the whole process."""


ARRAYS: tuple[str, ...] = ("cap", "mass", "limit_max", "previous", "delivered", "truth")
ARRAYS += ("deviation", "mark", "wear", "lower", "upper")
"""Fields of `AllocationProblem` that a term may use as p.NAME, beside p.plan and p.expected. Coefficients are over
`expected`, so that p.expected is 1 and weights do not depend on the plan; masses are over their mean."""


def _build_term(kind: str, term: Term, x: Any, p: Any) -> Any:
    try:
        return term(x, p)
    except Exception as error:
        raise AllocationError(
            f"{kind}: {type(error).__name__}: {error}; p has plan, expected, {', '.join(ARRAYS)}"
        ) from None


class Formulation:
    """The two problems of n units: most effort, and with that effort the least objective."""

    def __init__(self, n: int, objective: Term, constraints: Sequence[Term]) -> None:
        import cvxpy as cp

        arrays = {name: cp.Parameter(n, nonneg=True, name=name) for name in ARRAYS}
        p = SimpleNamespace(expected=1.0, plan=cp.Parameter(nonneg=True), **arrays)
        self.p, self.x, self.effort = p, cp.Variable(n), cp.Parameter(nonneg=True)
        x, effort = self.x, p.mass @ self.x / n
        goal = _build_term("objective", objective, x, p)
        if (
            not isinstance(goal, cp.Expression)
            or not goal.is_scalar()
            or all(v is not x for v in goal.variables())
        ):
            expected = "a scalar expression of cvxpy in x, as cp.sum_squares(x - p.plan)"
            raise AllocationError(f"objective returned {goal!r:.80}; return {expected}")
        terms = [_build_term("constraint", term, x, p) for term in constraints]
        if wrong := [term for term in terms if not isinstance(term, cp.Constraint)]:
            raise AllocationError(
                f"constraint returned {wrong[0]!r:.80}; return one of cvxpy, as x <= p.cap"
            )
        bounds = [p.lower <= x, x <= p.upper, *terms]
        self.most = cp.Problem(cp.Maximize(effort), [*bounds, effort <= self.effort])
        self.best = cp.Problem(cp.Minimize(goal), [*bounds, effort == self.effort])
        if not self.best.is_dpp():
            raise AllocationError(
                "objective and constraints must be convex in x, without products of parameters (DPP)"
            )

    def solve(
        self, problem: AllocationProblem, bounds: AllocationProblem, certain: bool
    ) -> tuple[Floats, str]:
        """Limits (n,), and "ok" or what went wrong. `certain`: `bounds` alone say what can be had."""
        import cvxpy as cp

        # no unit of a solution carries more than the whole train needs
        carries_all = problem.expected * problem.mass.sum() / problem.mass
        upper = np.maximum(np.minimum(problem.upper, carries_all), bounds.lower)
        mass, narrowed = problem.mass.mean(), {"lower": bounds.lower, "upper": upper}
        scale = {"mass": mass, "wear": mass / problem.expected}
        for name in ("plan", *ARRAYS):
            value = narrowed.get(name, getattr(problem, name)) / scale.get(name, problem.expected)
            getattr(self.p, name).value = np.minimum(value, LARGE)
        self.effort.value = bounds.attainable / problem.expected
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # the answer itself is judged
                if not certain:
                    self.most.solve(**SOLVER)
                    most = max(self.most.value or 0.0, 0.0) * (1.0 - ROOM_LEFT)
                    self.effort.value = min(most, self.effort.value)
                self.best.solve(**SOLVER)
        except cp.SolverError as error:
            return np.full(problem.n, np.nan), " ".join(str(error).split())[:80]
        fine = self.best.status in ("optimal", "optimal_inaccurate")
        solution = self.x.value if fine else np.full(problem.n, np.nan)
        return np.asarray(solution) * problem.expected, "ok" if fine else str(self.best.status)


def convex_answer(
    objective: Term,
    constraints: Sequence[Term] = (),
    best: Best | None = None,
    certain: Callable[[AllocationProblem], AllocationProblem] | None = None,
) -> Callable[[AllocationProblem], Allocation]:
    """The answer of `convex_rule`.

    `best`: the certified answer, where there is one. `certain`: the problem whose bounds alone say the same as all
    constraints.
    """
    formulation = lru_cache(maxsize=64)(lambda n: Formulation(n, objective, constraints))

    def answer(problem: AllocationProblem) -> Allocation:
        bounds = problem if certain is None else certain(problem)
        stand_in = (best or exact_limits)(bounds)
        bounded = not constraints or certain is not None
        if bounded and (reason := status_without_solver(bounds)):
            return allocated(bounds, *stand_in, status=reason)
        with ONE_AT_A_TIME:
            limit, status = formulation(problem.n).solve(problem, bounds, bounded)
        if best is not None:
            return judge_answer(bounds, limit, status, stand_in)
        within = np.clip(limit, problem.lower, problem.upper)  # all that is known of the optimum
        if status == "ok" and np.max(np.abs(limit - within)) <= TOLERANCE * problem.expected:
            return allocated(problem, within)
        status = "outside of its bounds" if status == "ok" else status
        return judge_answer(problem, limit, status, stand_in)

    return answer


def convex_rule(
    name: str, objective: Term, constraints: Sequence[Term] = (), **fields: Any
) -> Rule:
    """A rule that minimises `objective(x, p)` over the limits x that meet bounds, effort, and `constraints`, each (x, p).

    `p`: see `ARRAYS`; `x` is over `expected` too. `fields`: those of `Rule`, as belief, description. The first
    call raises `AllocationError` for what is not convex.
    """
    fields = {"description": f"least {name}"} | fields
    if "answer" not in fields:
        fields["answer"] = convex_answer(objective, constraints)
    return Rule(name, **fields)


def deviation_from_plan(x: Any, p: Any) -> Any:
    """Deviation from the plan, weighted with mass."""
    return p.mass @ (x - p.expected) ** 2


QP_CVXPY = convex_rule(
    "qp-cvxpy",
    deviation_from_plan,
    answer=convex_answer(deviation_from_plan, best=exact_limits),
    promise="exact",
    description="the same program stated in cvxpy: readable reference, slow",
    colour="#1c00ff",
    marker="<",
)


PROBABILITY = 0.9
"""That the rail carries a cap. Assumed, no source names one; 0.95 and 0.99 cost 1.3 and 1.8 times as much effort."""


def robust_rule(probability: float = PROBABILITY) -> Rule:
    """`qp-robust` with this probability that the rail carries a cap, unit by unit; 0.5 <= probability < 1.

    True caps are normal about `cap` with standard `deviation`. P(x <= true cap) >= p is a cone, |q deviation| <= cap - x,
    with q = Phi^-1(p) (Charnes and Cooper 1959, Management Science 6, p. 73). Where q deviation exceeds cap, x is 0.
    """
    if not 0.5 <= probability < 1.0:
        raise AllocationError(f"probability = {probability!r} must be 0.5 or more and less than 1")
    quantile = NormalDist().inv_cdf(probability)

    def carried(x: Any, p: Any) -> Any:
        import cvxpy as cp

        return cp.SOC(p.cap - x, cp.reshape(quantile * p.deviation, (1, x.size), order="C"))

    def certain(problem: AllocationProblem) -> AllocationProblem:
        return problem.changed(cap=np.maximum(problem.cap - quantile * problem.deviation, 0.0))

    solve = convex_answer(deviation_from_plan, [carried], exact_limits, certain)

    def answer(problem: AllocationProblem) -> Allocation:
        most = np.minimum(problem.deviation, problem.cap / max(quantile, 1e-9))
        return solve(problem.changed(deviation=most))

    return convex_rule(
        "qp-robust",
        deviation_from_plan,
        [carried],
        answer=answer,
        promise="exact",
        colour="#00c68e",
        marker=">",
        description=f"qp with caps that hold with a probability of {probability:g}, as cones",
    )


QP_ROBUST = robust_rule()


def least_wear(x: Any, p: Any) -> Any:
    """Model of the power that wheels dissipate, sum m x^2 / mark, see `alloc.rules.cooperative.share_wear`."""
    return p.wear @ x**2


def limits_of_least_wear(problem: AllocationProblem) -> tuple[Floats, float]:
    """The optimum of `least_wear`, (n,): the program of `exact` in shares of the marks."""
    mark = problem.mass / problem.wear
    needed = problem.expected * float(problem.mass.sum() / (problem.mass * mark).sum())
    lower, upper = problem.lower / mark, problem.upper / mark
    share, _ = level_between(lower, upper, problem.mass * mark, needed)
    return mark * np.clip(share, lower, upper), math.nan


_solve_wear = convex_answer(least_wear, best=limits_of_least_wear)


def answer_wear(problem: AllocationProblem) -> Allocation:
    """Limits of least wear; units at their bounds are left to search, as `wear` leaves them."""
    answer = _solve_wear(problem)
    room = np.where(problem.searching > 0.0, ROOM, 1.0) * problem.mark
    # of bounds below its tolerance the solver cannot tell
    at_bound = limits_of_least_wear(problem)[0] >= problem.upper * (1.0 - ROUNDING)
    limit = np.where(at_bound, np.maximum(room, problem.plan), answer.limit)
    return allocated(problem, limit, case=answer.case, status=answer.status, gap=answer.gap)


WEAR_QP = convex_rule(
    "wear-qp",
    least_wear,
    answer=answer_wear,
    belief=WEAR.belief,
    promise="effort",
    description="wear as a quadratic program, stated in cvxpy",
    colour="#b87557",
    marker="$Q$",
)

for _rule in (QP_CVXPY, QP_ROBUST, WEAR_QP):
    RULES.register(_rule)
