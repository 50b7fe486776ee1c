"""A rule's problem, its answer, and the one check of optimality.

In: caps along the train, the plan, and what else bounds the units. Out: a limit for each unit, and how it was found. All
coefficients are magnitudes in the direction of the demand; arrays are (n,), unit 1 foremost.

    minimise  1/2 sum m (x - expected)^2    subject to  sum m x = attainable sum m,  lower <= x <= upper
"""

import math
import sys
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.schema.errors import AllocationError

Floats = NDArray[np.float64]

ROUNDING = 1e-12
"""Slack of comparisons between sums, relative to the plan, so that a tie by hand is one in floating point."""
LEAST_MARK = 1e-3
"""Mark below which a unit's share counts as that of this mark: a unit without any adhesion has none."""
MOST_EXPECTED = 10.0
"""A greater coefficient is a percentage or a force by mistake."""

CASES = ("none", "A", "B")
"""Name of each case by its number: no answer yet; the plan is out of reach; it is within reach."""
_MAY_BE_INFINITE = ("cap", "limit_max", "truth", "mark")


class AllocationProblem:
    """Caps, plan and further bounds of n units. What is left out has the value named; arrays are read-only copies.

    Raises `AllocationError` that names field and value. Source: JP5484215, equations (5) to (11).
    """

    def __init__(
        self,
        cap: ArrayLike,
        expected: float,
        mass: ArrayLike | None = None,
        *,
        limit_max: ArrayLike | None = None,
        previous: ArrayLike | None = None,
        rate: float | None = None,
        delivered: ArrayLike | None = None,
        searching: ArrayLike | None = None,
        truth: ArrayLike | None = None,
        deviation: ArrayLike | None = None,
        mark: ArrayLike | None = None,
        plan: float | None = None,
    ) -> None:
        fields: dict[str, Any] = {"cap": cap, "expected": expected, "mass": mass}
        fields |= {"limit_max": limit_max, "previous": previous, "rate": rate}
        fields |= {"delivered": delivered, "searching": searching, "truth": truth}
        fields |= {"deviation": deviation, "mark": mark, "plan": plan}
        self.fields = {name: value for name, value in fields.items() if value is not None}
        """What was not left out, by its name."""
        self.cap = check_coefficients("cap", cap, None)
        """What each unit can carry, (5); >= 0, inf where nothing is known."""
        self.n = n = self.cap.size
        """Number of units."""
        self.expected = check_number("expected", expected)
        """Coefficient that the train needs of its units in the mean, the patent's Mu_z; > 0."""
        self.plan = self.expected if plan is None else check_number("plan", plan)
        """What the driver asks of every unit, where `expected` makes up for trailers too. Else: `expected`."""
        self.mass = check_coefficients("mass", mass, n, 1.0)
        """Mass on the axles of each unit, in any unit, > 0. Else: equal."""
        self.limit_max = check_coefficients("limit_max", limit_max, n, math.inf)
        """Torque limit as a coefficient. Else: none."""
        self.previous = check_coefficients("previous", previous, n, self.expected)
        """Limits in force. Else: `expected`."""
        rate = math.inf if rate is None else rate
        self.rate = check_number("rate", rate, zero=True, most=math.inf)
        """Largest change of a limit against `previous`; read by rules that promise the optimum. Else: inf."""
        carried = np.minimum(self.previous, self.cap)
        self.delivered = check_coefficients("delivered", delivered, n, carried)
        """What each unit delivers now. Else: what the caps carry of `previous`."""
        self.searching = check_coefficients("searching", searching, n, 0.0)
        """1 for each unit that is limited now. Else: none is."""
        self.truth = check_coefficients("truth", truth, n, self.cap)
        """What the rail truly carries, for `oracle` alone. Else: the caps."""
        self.deviation = check_coefficients("deviation", deviation, n, 0.0)
        """Standard deviation of each cap about the truth, read by `qp-robust`. Else: 0."""
        self.mark = check_coefficients("mark", mark, n, self.cap)
        """What each unit has shown to carry, read by `cooperative` and `wear`. Else: the caps."""

    def changed(self, **values: Any) -> "AllocationProblem":
        """The problem with other values of these fields."""
        return AllocationProblem(**(self.fields | values))

    @cached_property
    def upper(self) -> Floats:
        """Largest limit by cap, torque limit and rate, (n,)."""
        return np.minimum(np.minimum(self.cap, self.limit_max), self.previous + self.rate)

    @cached_property
    def lower(self) -> Floats:
        """Least limit by the rate, (n,); where adhesion or torque fell faster than that allows, they prevail."""
        return np.minimum(np.maximum(self.previous - self.rate, 0.0), self.upper)

    @cached_property
    def wear(self) -> Floats:
        """Mass over mark, (n,): weights of `wear`. A unit that was never limited counts as the best of the others."""
        best = np.max(self.mark, initial=self.plan, where=np.isfinite(self.mark))
        return self.mass / np.clip(self.mark, LEAST_MARK, best)

    @cached_property
    def _total(self) -> float:
        return float(self.mass.sum())

    def mean(self, values: Floats) -> float:
        """Mean of (n,) values, weighted with mass."""
        return float((values * self.mass).sum()) / self._total

    @cached_property
    def surplus(self) -> float:
        """How far the upper bounds are above `expected` in the mean, relative to it; case B where it is positive."""
        return self.mean(self.upper / self.expected - 1.0)

    @cached_property
    def attainable(self) -> float:
        """The mean limit that the bounds allow, weighted with mass, nearest to `expected`."""
        return min(max(self.expected, self.mean(self.lower)), self.mean(self.upper))

    def __repr__(self) -> str:
        fields = (f"{key}={np.asarray(value).tolist()}" for key, value in self.fields.items())
        return f"AllocationProblem({', '.join(fields)})"


def check_number(name: str, value: Any, zero: bool = False, most: float = MOST_EXPECTED) -> float:
    """`value` as a coefficient; raises `AllocationError` where it is none."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, bool) or not (0.0 <= number <= most) or (number == 0.0 and not zero):
        kind = "0 or greater" if zero else f"above 0, {most:g} at most"
        raise AllocationError(f"{name} = {value!r} must be a coefficient {kind}, as 0.17 for 17 %")
    return number


def check_coefficients(
    name: str, values: ArrayLike | None, n: int | None, default: Floats | float = 0.0
) -> Floats:
    """A read-only copy of `values`, (n,), or of the default; raises `AllocationError` where it is none."""
    if values is None and n is not None:
        values = np.full(n, default)
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise AllocationError(f"{name} = {values!r} must be an array of numbers") from None
    if (array.ndim != 1 or array.size == 0) if n is None else array.shape != (n,):
        wanted = "(n,) with n >= 1, one per unit" if n is None else f"({n},) as cap has"
        raise AllocationError(f"{name} has shape {array.shape}, must be {wanted}")
    least = 5e-324 if name == "mass" else 0.0
    most = math.inf if name in _MAY_BE_INFINITE else sys.float_info.max
    if not (array.min() >= least and array.max() <= most):
        j = int(np.argmin((array >= least) & (array <= most)))
        bound = "above 0" if name == "mass" else "0 or greater"
        kind = "" if most == math.inf else "finite and "
        raise AllocationError(f"{name}[{j}] = {array[j]} must be {kind}{bound}")
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Allocation:
    """Limits of the units, and how a rule found them."""

    limit: Floats
    """Limit of each unit, (n,), read-only; inf: none."""
    level: float
    """Coefficient at which units with adhesion to spare are held; nan where the rule has none."""
    case: str
    """"A": the bounds do not allow more than the plan. "B": they do."""
    unmet: float
    """Mean shortfall of the limits against the plan, weighted with mass, as a coefficient; >= 0."""
    status: str = "ok"
    """"ok", or what happened instead: "near tie: ...", "failed: ..."."""
    gap: float = math.nan
    """Distance of a solver's own answer from the certified one, over the plan; nan: no solver was asked."""
    solve_time: float = 0.0
    """Wall time [s]."""

    @property
    def failed(self) -> bool:
        """Whether a solver failed, so that the exact answer stands in for its own."""
        return self.status.startswith("failed")

    def effort(self, problem: AllocationProblem) -> float:
        """Mean limit weighted with mass: what the train would deliver if every unit reached its limit."""
        return problem.mean(self.limit)

    def usable(self, problem: AllocationProblem) -> float:
        """The same of min(limit, cap): what it would deliver if the caps were true."""
        return problem.mean(np.minimum(self.limit, problem.cap))


def check_limits(problem: AllocationProblem, limit: ArrayLike) -> Floats:
    """A copy of limits of all units, (n,); raises `AllocationError` for what is none."""
    try:
        x = np.array(math.nan if np.iscomplexobj(limit) else limit, dtype=float)
    except (TypeError, ValueError):  # no numbers
        x = np.array(math.nan)
    if x.shape != (problem.n,):
        answer = f"an array of shape {x.shape}" if x.ndim else f"{limit!r:.60}"
        advice = f"return one limit per unit, real numbers, here ({problem.n},)"
        raise AllocationError(f"answer returned {answer}; {advice}")
    if x.min() >= 0.0:
        return x
    x[(x < 0.0) & (x >= -ROUNDING * problem.expected)] = 0.0
    for j in np.flatnonzero(~(x >= 0.0))[:1]:
        advice = "; clip limits to problem.lower, problem.upper" if x[j] < 0.0 else ", no number"
        raise AllocationError(f"limit[{j}] is {x[j]:.6g}{advice}")
    return x


def allocated(
    problem: AllocationProblem,
    limit: ArrayLike,
    level: float = math.nan,
    case: str | None = None,
    **more: Any,
) -> Allocation:
    """The answer with `limit` to `problem`, the rest filled in; raises `AllocationError` for limits that are none."""
    x = np.minimum(check_limits(problem, limit), problem.limit_max)
    x.flags.writeable = False
    short = 1.0 - problem.mean(x) / problem.expected
    unmet = problem.expected * short if short > ROUNDING else 0.0
    case = case or CASES[2 if problem.surplus > ROUNDING else 1]
    return Allocation(x, float(level), case, unmet, **more)


@dataclass(frozen=True)
class Optimality:
    """Residuals of the conditions of Karush, Kuhn and Tucker, as coefficients; all zero at the optimum.

    With the level L as multiplier of the sum, a unit inside its bounds stands at L; at its upper bound L may lie above it,
    at its lower bound below.
    """

    primal: float
    """Largest violation of a bound, or of the mean limit."""
    dual: float
    """Largest multiplier of the wrong sign: a unit at its upper bound but above L, or at its lower bound but below."""
    complementarity: float
    """Largest distance from its bound of a unit whose multiplier is not zero, or that multiplier if smaller."""
    stationarity: float
    """Largest distance from L of a unit inside its bounds."""

    @property
    def worst(self) -> float:
        """Largest of the four."""
        return max(self.primal, self.dual, self.complementarity, self.stationarity)


def optimality(
    problem: AllocationProblem, answer: Allocation | ArrayLike, tolerance: float = 1e-9
) -> Optimality:
    """Residuals of `answer` to `problem`: an `Allocation`, or limits (n,); raises `AllocationError` for what is none.

    `tolerance`: distance from a bound, relative to the plan, within which a unit counts as being there.
    """
    limit: Any = getattr(answer, "limit", answer)
    level = getattr(answer, "level", math.nan)
    x, lower, upper = check_limits(problem, limit), problem.lower, problem.upper
    near = tolerance * problem.expected
    at_upper, at_lower = upper - x <= near, x - lower <= near
    free = ~at_upper & ~at_lower
    if free.any() and not math.isfinite(level):
        level = float(np.average(x[free], weights=problem.mass[free]))
    elif not math.isfinite(level):  # a unit whose bounds meet says nothing of the level
        below = x[at_upper & ~at_lower]
        level = float(below.max() if below.size else x[~at_upper].min(initial=x.max()))
    excess = x - level
    wrong = np.where(at_upper, excess, -excess)
    distance = np.where(at_upper, np.abs(upper - x), np.abs(x - lower))
    slack = np.where(free, 0.0, np.minimum(distance, np.abs(excess)))
    missed = abs(problem.mean(x) - problem.attainable)

    def largest(values: Floats) -> float:
        return float(values.max(initial=0.0))

    return Optimality(
        primal=max(missed, largest(lower - x), largest(x - upper)),
        dual=largest(wrong[at_upper ^ at_lower]),  # where both bounds meet, either sign is right
        complementarity=largest(slack),
        stationarity=largest(np.abs(excess[free])),
    )
