"""A rule's problem and its answer: caps along the train, the plan, other bounds; the limits and what they deliver.

In: `AllocationProblem` (coefficients, (n,)), validated with errors that name field and value. Out: `Allocation`.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.old.compilation import jit
from alloc.old.display import displayed
from alloc.old.errors import AllocationError

# Whether the plan is within reach of what bounds the units.


ROUNDING = 1e-12
"""Relative slack of comparisons between sums, so that a tie in exact arithmetic is one in floating point."""


@jit
def bounds_allow_plan(cap, expected, mass, limit_max):
    """Whether caps and torque limits allow more than the plan, weighted with mass."""
    balance = 0.0
    for j in range(cap.size):
        balance += mass[j] * (min(cap[j], limit_max[j]) - expected)
    return balance > 0.0


@jit
def within_reach(cap, expected):
    """Step S207: whether the mean cap (7) exceeds the plan, which is case B."""
    total = 0.0
    for j in range(cap.size):
        total += cap[j]
    return total > cap.size * expected * (1.0 + ROUNDING)


@jit
def sums_at_bounds(lower, upper, mass, expected):
    """Sums of m (upper - expected), m (lower - expected) and m."""
    most, least, total = 0.0, 0.0, 0.0
    for j in range(upper.size):
        most += mass[j] * (upper[j] - expected)
        least += mass[j] * (lower[j] - expected)
        total += mass[j]
    return most, least, total


@jit
def highest_cap(cap):
    """The level of case A, where every unit works at its cap."""
    highest = cap[0]
    for j in range(1, cap.size):
        highest = max(highest, cap[j])
    return highest


@jit
def lowest(values):
    """The smallest of an array's values."""
    smallest = values[0]
    for j in range(1, values.size):
        smallest = min(smallest, values[j])
    return smallest


Floats = NDArray[np.float64]

_ADVICE = {
    "cap": "check the estimate of the foremost unit and the increments added to it",
    "mass": "every unit moves some mass; leave mass out for equal ones",
    "limit_max": "give the torque limit as a coefficient, inf for none",
    "previous": "give the limits in force, or leave previous out",
    "rate": "give the largest change of a limit per call as a coefficient, or leave rate out",
    "delivered": "give the magnitude of the coefficient that each unit delivers now",
    "truth": "give the available coefficients, inf where one is not told, or leave truth out",
    "deviation": "give the standard deviation of each cap about the truth, or leave deviation out",
    "mark": "give the coefficient that each unit has shown to carry, or leave mark out",
    "upper_bound": "give the coefficient up to which each unit may search, or leave upper_bound out",
}


MOST_EXPECTED = 10.0
"""A greater coefficient is a percentage or a force by mistake."""

_GIVEN = tuple(name for name in _ADVICE if name not in ("cap", "rate"))
"""Arrays that may be left out."""


@displayed
@dataclass(frozen=True, eq=False)
class AllocationProblem:
    """Caps, plan and further bounds of n traction units, unit 1 foremost in the running direction.

    Every array is copied to a read-only float array of shape (n,); coefficients are dimensionless and
    count positive in the direction of the demand. Raises `AllocationError` naming the field at fault.
    Source: JP5484215, equations (5) to (11).
    """

    cap: ArrayLike
    """Upper bound of the tangential force coefficient of each unit, equation (5); >= 0."""
    expected: float
    """Coefficient that the planned acceleration needs of every unit, the patent's Mu_z; > 0."""
    mass: ArrayLike | None = None
    """Mass on the axles of each unit, any unit of mass, > 0. None: equal."""
    slip: bool = True
    """False: no slip, or none for a set time; then every limit is the plan."""
    limit_max: ArrayLike | None = None
    """Torque limit of each unit expressed as a coefficient, >= 0, inf for none."""
    previous: ArrayLike | None = None
    """Limits in force. None: the plan."""
    rate: ArrayLike | None = None
    """Largest change of a limit against `previous` per call; a number or one per unit."""
    delivered: ArrayLike | None = None
    """Coefficient that each unit delivers now under its own readhesion control; read by `sharing`. None: what the caps
    carry."""
    truth: ArrayLike | None = None
    """Coefficients truly available, inf where one is not told; read by `oracle` and `preview`. None: the caps are true."""
    deviation: ArrayLike | None = None
    """Standard deviation of each cap about the truth, >= 0; read by `qp-robust` alone. None: the caps are certain."""
    mark: ArrayLike | None = None
    """Coefficient that each unit has shown to carry at its best; read by `wear` and its forms. None: the caps."""
    upper_bound: ArrayLike | None = None
    """What `wear` and its forms ask, beside the plan, of each unit at its cap or where the plan is out of reach; inf for its
    cap. None: the caps."""
    plan: float | None = None
    """Coefficient that the driver asks of every unit, > 0, where `expected` makes up for trailers too; read by `wear` and
    its forms. None: `expected`."""
    n: int = field(init=False)
    """Number of units."""

    def __post_init__(self) -> None:
        cap = _coefficients("cap", self.cap, None)
        put = object.__setattr__
        put(self, "n", cap.size)
        put(self, "cap", cap)
        given = ("expected",) if self.plan is None else ("expected", "plan")
        AllocationError.check("allocation", self, positive=given)
        put(self, "expected", float(self.expected))
        if self.expected > MOST_EXPECTED:
            raise AllocationError(
                f"expected = {self.expected!r} must be a coefficient, such as 0.17 for 17 %"
            )
        if not isinstance(self.slip, bool | np.bool_):
            raise AllocationError(f"slip = {self.slip!r} must be True or False")
        for name in _GIVEN:
            given = getattr(self, name)
            if given is not None:
                put(self, name, _coefficients(name, given, cap.size))
        if self.rate is not None:
            if self.previous is None:
                raise AllocationError(
                    f"rate = {self.rate!r} bounds the change against `previous`: give previous too"
                )
            rate = np.full(cap.size, self.rate) if np.ndim(self.rate) == 0 else self.rate
            put(self, "rate", _coefficients("rate", rate, cap.size))

    def _given(self, name: str, otherwise: Floats) -> Floats:
        """Field `name`, which construction made an array, or what holds where none was given."""
        values = getattr(self, name)
        return _frozen(otherwise) if values is None else values

    @cached_property
    def weight(self) -> Floats:
        """Mass of each unit, ones where none was given, (n,)."""
        return self._given("mass", np.ones(self.n))

    @cached_property
    def box(self) -> tuple[Floats, Floats]:
        """Lower and upper bound of every limit, two (n,), from cap, torque limit and rate; lower <= upper.

        Where adhesion or torque fell faster than the rate allows to follow, adhesion and torque have priority. Without slip
        nothing is bounded.
        """
        if not self.slip:
            return np.zeros(self.n), np.full(self.n, np.inf)
        lower, upper = self.rate_box
        upper = np.minimum(upper, self.cap)
        return np.minimum(lower, upper), upper

    @cached_property
    def torque_limit(self) -> Floats:
        """`limit_max`, infinite where none was given, (n,)."""
        return self._given("limit_max", np.full(self.n, np.inf))

    @cached_property
    def rate_box(self) -> tuple[Floats, Floats]:
        """As `box`, without the caps: the bounds of a unit without information on adhesion."""
        lower, upper = np.zeros(self.n), self.torque_limit
        if self.previous is not None and self.rate is not None:
            previous, rate = np.asarray(self.previous), np.asarray(self.rate)
            upper = np.minimum(upper, previous + rate)
            lower = np.minimum(np.maximum(previous - rate, 0.0), upper)
        return lower, upper

    @cached_property
    def in_force(self) -> Floats:
        """`previous`, the plan where none was given, (n,)."""
        return self._given("previous", np.full(self.n, self.expected))

    @cached_property
    def obtained(self) -> Floats:
        """`delivered`; where none was given, the part of the limits in force that the caps carry, (n,)."""
        return self._given("delivered", np.minimum(self.in_force, self.cap))

    @cached_property
    def available(self) -> Floats:
        """`truth`, the caps where none was given, (n,)."""
        return self._given("truth", np.asarray(self.cap))

    @cached_property
    def peak(self) -> Floats:
        """`mark`, the caps where none was given, (n,)."""
        return self._given("mark", np.asarray(self.cap))

    @cached_property
    def searching(self) -> Floats:
        """`upper_bound`, infinite where none was given, (n,)."""
        return self._given("upper_bound", np.full(self.n, np.inf))

    @cached_property
    def own_plan(self) -> float:
        """`plan`, `expected` where none was given."""
        return self.expected if self.plan is None else float(self.plan)

    @cached_property
    def within_reach(self) -> bool:
        """Whether the box allows more than the plan: case B."""
        if not self.slip:
            return True
        most = float(np.dot(self.weight, self.box[1] - self.expected))
        return most > ROUNDING * self.expected * float(self.weight.sum())

    def changed(self, **values: Any) -> "AllocationProblem":
        """A copy with other values of these fields."""
        return replace(self, **values)

    @cached_property
    def attainable(self) -> float:
        """The mean coefficient that the box allows, weighted with mass, nearest to the plan."""
        if not self.slip:
            return self.expected
        lower, upper = self.box
        most, least = (float(np.average(bound, weights=self.weight)) for bound in (upper, lower))
        return min(max(self.expected, least), most)


def import_solver(module: str, rule: str) -> Any:
    """The solver's module; raises `AllocationError` naming the rule where it is not installed."""
    try:
        return import_module(module)
    except ImportError as error:
        raise AllocationError(
            f"rule {rule!r} needs {module!r}, which cannot be imported ({error}): install it with "
            f"`pip install {module}`, or choose another rule"
        ) from None


def _frozen(array: Floats) -> Floats:
    """`array`, made read-only: like those given, so that compiled rules need one version only."""
    array.flags.writeable = False
    return array


def _coefficients(name: str, values: ArrayLike, n: int | None) -> Floats:
    """A read-only copy of `values`, (n,); raises `AllocationError` where it is none."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise AllocationError(f"{name} = {values!r} must be an array of numbers") from None
    if n is None and (array.ndim != 1 or array.size == 0):
        raise AllocationError(
            f"{name} has shape {array.shape}, must be (n,) with n >= 1: one coefficient per traction unit"
        )
    if n is not None and array.shape != (n,):
        raise AllocationError(f"{name} has shape {array.shape}, must be ({n},) as cap has")
    may_be_infinite = name in ("limit_max", "rate", "upper_bound", "truth")
    largest = np.inf if may_be_infinite else np.finfo(float).max
    wrong = ~((array >= 0.0) & (array <= largest)) | ((name == "mass") & (array == 0.0))
    if wrong.any():
        j = int(np.argmax(wrong))
        kind = "a number" if may_be_infinite else "finite and"
        bound = "greater than 0" if name == "mass" else "0 or greater"
        raise AllocationError(f"{name}[{j}] = {array[j]} must be {kind} {bound}: {_ADVICE[name]}")
    return _frozen(array)


CASE_NONE, CASE_A, CASE_B = 0, 1, 2
CASES = ("none", "A", "B")
"""Name of each case by its number: no slip; the plan out of reach; within reach."""


@displayed
@dataclass(frozen=True, eq=False)
class Allocation:
    """Limits of the tangential force coefficients, one per unit, and how the rule determined them.

    Raises `AllocationError` for a case that is none.
    """

    limit: Floats
    """Limit of each unit, (n,), read-only."""
    level: float
    """Coefficient at which the units with adhesion to spare are held; nan where the rule has none."""
    case: str
    """"none": no slip. "A": the bounds do not allow the plan. "B": they do."""
    unmet: float
    """Mean shortfall of the limits against the plan, weighted with mass, as a coefficient; >= 0."""
    status: str = "ok"
    """"ok", which a rule with a solver states only for a certified optimum, or what happened instead."""
    solve_time: float = 0.0
    """Wall time that the rule took [s]."""

    def __post_init__(self) -> None:
        AllocationError.check_choice("allocation", "case", self.case, CASES)

    def effort(self, problem: AllocationProblem) -> float:
        """Mean limit weighted with mass: what the train would deliver if every unit reached its limit."""
        return float(np.average(self.limit, weights=problem.weight))

    def excess(self, problem: AllocationProblem) -> float:
        """Mean limit beyond the plan, weighted with mass; >= 0."""
        return max(self.effort(problem) - problem.expected, 0.0)

    def usable(self, problem: AllocationProblem) -> float:
        """Mean of min(limit, cap) weighted with mass: what would be delivered if the caps were true."""
        return float(np.average(np.minimum(self.limit, problem.cap), weights=problem.weight))


def fault_of(answer: Any, problem: AllocationProblem) -> str:
    """What is wrong with a rule's answer to `problem`, and what to do; empty where it can be carried out."""
    if not isinstance(answer, Allocation):
        return f"returns {answer!r:.80}; return allocation(problem, limit, level, case, solve_time)"
    limit = answer.limit
    if np.shape(limit) != (problem.n,) or not np.all(np.isfinite(limit)):
        return f"sets limits {limit} for {problem.n} units; set one finite limit each"
    if np.min(limit) < 0.0:
        return f"sets limits {limit}; none may be negative: they are magnitudes"
    if answer.case not in CASES[1:] and problem.slip:
        return f"answers case {answer.case!r}; use {' or '.join(CASES[1:])}"
    if not isinstance(answer.status, str) or not answer.status:
        return f"has status {answer.status!r:.80}; use 'ok', or say what happened"
    if not 0.0 <= answer.solve_time < math.inf:
        return f"has solve_time {answer.solve_time}; give seconds"
    return ""


def allocation(
    problem: AllocationProblem,
    limit: Floats,
    level: float,
    case: int,
    solve_time: float,
    status: str = "ok",
) -> Allocation:
    """The answer with `limit` to `problem`; shortfalls within rounding count as none.

    `case`: place in `CASES`. Raises `AllocationError` where there is not one limit per unit.
    """
    if limit.shape != (problem.n,):
        raise AllocationError(f"limit has shape {limit.shape}, must be ({problem.n},) as cap has")
    shortfall = problem.expected - float(np.dot(problem.weight, limit) / problem.weight.sum())
    unmet = shortfall if shortfall > ROUNDING * problem.expected else 0.0
    limit.flags.writeable = False
    return Allocation(limit, float(level), CASES[case], unmet, status, solve_time)
