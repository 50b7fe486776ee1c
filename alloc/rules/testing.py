"""Conformance kit: the laws that an allocation rule keeps, by its promise, over random problems.

    check_rule(my_rule)  # {law: worst amount}; raises `BrokenLaw` with the smallest counterexample that Hypothesis finds

Amounts are shares of the plan. Hypothesis is imported where it is used.
"""

import math
from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from alloc.errors import InputError
from alloc.rules.exact import exact_limits
from alloc.rules.problem import CASES, ROUNDING, AllocationProblem, optimality
from alloc.rules.reference import reference_rule
from alloc.rules.rule import PROMISES, Rule, rows_of

GRID = 2.0**-13
"""Coefficients are multiples of this, so that sums of them are exact."""
PLAN = 1400
"""The plan of random problems in such steps, 0.171: near that of 3.0 km/h/s."""


class BrokenLaw(AssertionError):
    """A rule breaks a law; the message has the law, the amount, and the counterexample."""


class Law(NamedTuple):
    """What rules keep: by how much one breaks it at a problem."""

    name: str
    meaning: str
    amount: Callable[[Rule, AllocationProblem], float]
    kind: str = "bounded"
    """Of problems: caps alone ("plain"), such that grow along the train ("growing"), all but rates ("bounded"), "rated"."""
    promises: tuple[str, ...] = PROMISES


def problems(kind: str = "bounded", largest: int = 8) -> Any:
    """Hypothesis strategy of problems of 1 to `largest` units: caps of any size, near the plan, tied, all on one side."""
    st = import_module("hypothesis.strategies")

    @st.composite
    def drawn(draw: Any) -> AllocationProblem:
        n = draw(st.integers(1, largest))

        def each(low: int, high: int) -> Any:
            steps = st.lists(st.integers(low, high), min_size=n, max_size=n)
            return np.array(draw(steps), dtype=float)

        span = [(0, 2 * PLAN), (PLAN - 200, PLAN + 200), (PLAN - 2, PLAN + 2), (0, PLAN), (PLAN, 2 * PLAN)]  # fmt: skip
        cap = GRID * each(*draw(st.sampled_from(span)))
        if kind in ("plain", "growing"):
            return AllocationProblem(np.sort(cap) if kind == "growing" else cap, GRID * PLAN)
        columns = {
            "mass": lambda: 10.0 ** (each(0, 3000) / 1000.0),
            "limit_max": lambda: np.where(each(0, 1) > 0, math.inf, GRID * each(0, 2 * PLAN)),
            "previous": lambda: GRID * each(0, 2 * PLAN),
            "delivered": lambda: GRID * each(0, 2 * PLAN),
        }
        given: dict[str, Any] = {key: make() for key, make in columns.items() if draw(st.booleans())}  # fmt: skip
        if kind == "rated":
            given["rate"] = GRID * draw(st.integers(0, PLAN))
        return AllocationProblem(cap, GRID * PLAN, **given)

    return drawn()


def _apart(problem: AllocationProblem, one: Any, other: Any) -> float:
    """Largest distance, where equal infinities are none."""
    with np.errstate(invalid="ignore"):
        far = np.where(np.equal(one, other), 0.0, np.abs(np.subtract(one, other)))
    return float(np.max(far, initial=0.0)) / problem.expected


def _answer(rule: Rule, problem: AllocationProblem) -> float:
    found = rule(problem)
    if np.shape(found.limit) != (problem.n,) or not np.all(found.limit >= 0.0) or found.failed:
        return math.inf
    short = max(problem.expected - found.effort(problem), 0.0)
    beyond = float(np.max(found.limit - problem.limit_max))
    return max(beyond, abs(found.unmet - short)) / problem.expected


def _case(rule: Rule, problem: AllocationProblem) -> float:
    return float(rule(problem).case != CASES[2 if problem.surplus > ROUNDING else 1])


def _repeatable(rule: Rule, problem: AllocationProblem) -> float:
    first = rule(problem).limit.copy()
    rule(problem.changed(cap=problem.cap[::-1] * 0.75, mass=problem.mass[::-1] * 2.0))
    return _apart(problem, first, rule(problem).limit)


def _rows(rule: Rule, problem: AllocationProblem) -> float:
    found, worst = rule(problem), 0.0
    for law in {rule.law, getattr(rule.law, "py_func", rule.law)}:
        units, run = rows_of(problem)
        law(units, run)
        same = CASES[run.case] == found.case
        worst = max(worst, _apart(problem, units.wanted, found.limit) if same else math.inf)
    return worst


def _scaled(rule: Rule, problem: AllocationProblem) -> float:
    double = {key: 2.0 * np.asarray(x) for key, x in problem.given.items() if key != "mass"}
    other = rule(problem.changed(**double, mass=1024.0 * problem.mass))
    return _apart(problem, 2.0 * rule(problem).limit, other.limit)


def _order(rule: Rule, problem: AllocationProblem) -> float:
    arrays = {key: np.asarray(x) for key, x in problem.given.items() if np.ndim(x)}
    turned = {key: np.roll(x[::-1], 1) for key, x in arrays.items()}
    other = rule(problem.changed(**turned)).limit
    return _apart(problem, np.roll(rule(problem).limit[::-1], 1), other)


def _effort(rule: Rule, problem: AllocationProblem) -> float:
    return abs(rule(problem).usable(problem) - problem.attainable) / problem.expected


def _reference(rule: Rule, problem: AllocationProblem) -> float:
    found = rule(problem)
    most = float(np.mean(reference_rule(list(problem.cap), problem.expected)))
    outside = max(problem.attainable - found.effort(problem), found.effort(problem) - most)
    return max(outside, float(np.max(found.limit - problem.cap)), 0.0) / problem.expected


def _optimal(rule: Rule, problem: AllocationProblem) -> float:
    found = rule(problem)
    apart = _apart(problem, found.limit, exact_limits(problem)[0])
    return max(apart, optimality(problem, found, 1e-6).worst / problem.expected)


LAWS = (
    Law("answer", "one limit per unit, none beyond its torque limit; what they lack; no failure", _answer),
    Law("case", "A where the caps do not allow more than the plan, else B", _case, "plain"),
    Law("repeatable", "one problem has one answer, whatever is asked between", _repeatable),
    Law("rows", "the law on rows, compiled and plain, answers as the rule does", _rows),
    Law("scale", "twice the coefficients, twice the limits; only ratios of masses count", _scaled),
    Law("order", "units in another order have their own limits", _order, "bounded", ("exact", "effort")),
    Law("effort", "up to their caps limits give the plan, or what bounds allow", _effort, "bounded", ("exact", "effort")),
    Law("reference", "within caps, no less than they allow, no more than the patent's rule", _reference, "growing",
        ("exact", "reference")),
    Law("optimal", "conditions of optimality, and the distance from the optimum", _optimal, "rated", ("exact",)),
)  # fmt: skip


def check_rule(
    rule: Rule | Callable[[AllocationProblem], Any], tolerance: float = 1e-6, examples: int = 100
) -> dict[str, float]:
    """Worst amount of every law that `rule` promises; raises `BrokenLaw` for one that it breaks by over `tolerance`.

    `rule`: a `Rule`, or an answer to a problem. `examples`: random problems per law. Raises `InputError` without Hypothesis.
    """
    try:
        hypothesis = import_module("hypothesis")
    except ImportError:
        raise InputError("check_rule needs hypothesis: pip install hypothesis") from None
    if not isinstance(rule, Rule):
        rule = Rule(getattr(rule, "__name__", "own rule"), "", answer=rule)
    settings = hypothesis.settings(
        max_examples=examples, database=None, derandomize=True, deadline=None, report_multiple_bugs=False,
        suppress_health_check=list(hypothesis.HealthCheck),
    )  # fmt: skip
    worst = {law.name: 0.0 for law in LAWS if rule.promise in law.promises}
    for law in LAWS:
        if law.name in worst:
            settings(hypothesis.given(problems(law.kind))(_search(rule, law, tolerance, worst)))()
    return worst


def _search(rule: Rule, law: Law, tolerance: float, worst: dict[str, float]) -> Callable[..., None]:
    def ask(problem: AllocationProblem) -> None:
        fault = ""
        try:
            amount = law.amount(rule, problem.changed())
        except Exception as error:
            amount, fault = math.inf, f", {type(error).__name__}: {error}"
        worst[law.name] = max(worst[law.name], amount)
        if not amount <= tolerance:
            raise BrokenLaw(
                f"{rule.name} breaks the law {law.name!r} ({law.meaning}) by {amount:.2g} of the plan{fault}; "
                f"counterexample: {problem!r}"
            )

    return ask
