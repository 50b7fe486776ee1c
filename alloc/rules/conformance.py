"""Conformance kit: the laws that an allocation rule keeps, by its promise, over random problems.

    check_rule(my_rule)  # {law: worst amount}; raises `BrokenLaw` with a counterexample of few units

Amounts are shares of the plan.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from alloc.rules.exact import exact_limits
from alloc.rules.problem import CASES, ROUNDING, AllocationProblem, optimality
from alloc.rules.reference import reference_rule
from alloc.rules.rule import PROMISES, Rule, rows_of
from alloc.schema.errors import InputError, blamed_on


class Law(NamedTuple):
    """What parts of a kind keep: by how much one breaks it in each of some cases, and how much is `allowed`."""

    name: str
    meaning: str
    amount: Callable[[Any, Any], float]
    cases: Sequence[Any] = ()
    allowed: float = 0.0
    kind: str = "bounded"
    """Of the problems that a rule is asked, see `problems`; they are its cases."""
    promises: tuple[str, ...] = PROMISES
    """Of the rules that keep it."""


class Verdict(float):
    """By how much a law is missed at worst; `fault`: how it is broken in `case`, the first and smallest, or nothing."""

    law, allowed, fault = "", 0.0, ""
    case: Any = None

    def __str__(self) -> str:
        kept = "broken" if self.fault else "kept"
        return f"{kept:6} {self.law:14} by {float(self):.2g}, allowed {self.allowed:.2g}"


class BrokenLaw(AssertionError):
    """A part breaks laws: a line for each with its amount and counterexample, then a line for every law's verdict."""

    def __init__(self, verdicts: dict[str, Verdict]) -> None:
        self.verdicts, self.broken = verdicts, [one.fault for one in verdicts.values() if one.fault]
        super().__init__("\n".join([*self.broken, *map(str, verdicts.values())]))


def check(part: Any, name: str, laws: Sequence[Law], tolerance: float) -> dict[str, Verdict]:
    """Verdict on every law; raises `BrokenLaw` where one is broken by over `tolerance`, `InputError` at a misspelling."""
    verdicts = {}
    for law in laws:
        worst, fault, first, allowed = 0.0, "", None, max(tolerance, law.allowed)
        for case in law.cases:
            try:
                with blamed_on(name), np.errstate(invalid="ignore"):
                    amount, how = float(law.amount(part, case)), ""
            except InputError as error:
                if error.misspelt:
                    raise
                amount, how = math.inf, str(error)
            worst = max(worst, amount if amount == amount else math.inf)
            if not fault and not amount <= allowed:
                how = how or f"by {amount:.2g}; allowed {allowed:.2g}{_about(part, case, amount)}"
                fault = f"{name} breaks the law {law.name!r} ({law.meaning}) {how}; counterexample: {case!r}"
                first = case
        one = verdicts[law.name] = Verdict(worst)
        one.law, one.allowed, one.fault, one.case = law.name, allowed, fault, first
    if any(one.fault for one in verdicts.values()):
        raise BrokenLaw(verdicts)
    return verdicts


def _about(rule: Any, problem: Any, amount: float) -> str:
    """Of a rule that breaks a law by this amount: its status, its distance from the optimum, the cause if that is small."""
    if not isinstance(rule, Rule):
        return ""
    apart = _apart(problem, (answer := rule(problem)).limit, exact_limits(problem)[0])
    exact = f"; it lies {apart:.2g} of the plan from the exact level" * (rule.promise == "exact")
    cause = "; a solver's tolerance is the likely cause: tighten it, or allow more (--tolerance)"
    return f"; its status: {answer.status}{exact}{cause * (amount < 1e-2)}"


# Problems

GRID = 2.0**-13
"""Coefficients are multiples of this, so that sums of them are exact."""
PLAN = 1400
"""The plan of random problems in such steps, 0.171: near that of 3.0 km/h/s."""
SPANS = (0, 2 * PLAN), (PLAN - 200, PLAN + 200), (PLAN - 2, PLAN + 2), (0, PLAN), (PLAN, 2 * PLAN)
"""Of caps: any size, near the plan, nearly tied, all on one side."""
LARGEST = 8
"""Units of a problem, at most."""


def problems(kind: str, count: int) -> Iterator[AllocationProblem]:
    """Problems of 1 to `LARGEST` units, the small ones first.

    `kind`: with caps alone ("plain"), such that grow along the train ("growing"), all but rates ("bounded"), "rated". Near
    ties are not "bounded": `wear` jumps where units are out of reach by ever so little, since all are then to search.
    """
    draw = np.random.default_rng(count)
    for k in range(count):
        n = 1 + LARGEST * k // count

        def each(low: int, high: int, n: int = n) -> Any:
            return draw.integers(low, high, n, endpoint=True).astype(float)

        cap, plan = GRID * each(*SPANS[draw.integers(len(SPANS))]), GRID * PLAN
        if kind in ("plain", "growing"):
            yield AllocationProblem(np.sort(cap) if kind == "growing" else cap, plan)
            continue
        given: dict[str, Any] = {
            "mass": 10.0 ** (each(0, 3000) / 1000.0),
            "limit_max": np.where(each(0, 1) > 0, math.inf, GRID * each(0, 2 * PLAN)),
            "previous": GRID * each(0, 2 * PLAN),
            "delivered": GRID * each(0, 2 * PLAN),
        }
        chosen = {key: one for key, one in given.items() if draw.random() < 0.5}
        if kind == "rated":
            chosen["rate"] = GRID * int(draw.integers(PLAN))
        made = AllocationProblem(cap, plan, **chosen)
        if kind == "rated" or abs(made.surplus) > 1e-5:
            yield made


def _apart(problem: AllocationProblem, one: Any, other: Any) -> float:
    """Largest distance, where equal infinities are none."""
    with np.errstate(invalid="ignore"):
        far = np.where(np.equal(one, other), 0.0, np.abs(np.subtract(one, other)))
    return float(np.max(far, initial=0.0)) / problem.expected


def _answer(rule: Rule, problem: AllocationProblem) -> float:
    found = rule(problem)
    if found.failed:
        return math.inf
    short = max(problem.expected - found.effort(problem), 0.0)
    beyond = _apart(problem, found.limit, np.minimum(found.limit, problem.limit_max))
    return max(beyond, abs(found.unmet - short) / problem.expected)


def _case(rule: Rule, problem: AllocationProblem) -> float:
    units, run = rows_of(problem)
    rule.share(units, run)
    return float(run.case not in (0, 2 if problem.surplus > ROUNDING else 1))


def _repeatable(rule: Rule, problem: AllocationProblem) -> float:
    first = rule(problem).limit.copy()
    rule(problem.changed(cap=problem.cap[::-1] * 0.75, mass=problem.mass[::-1] * 2.0))
    return _apart(problem, first, rule(problem).limit)


def _rows(rule: Rule, problem: AllocationProblem) -> float:
    found, worst = rule(problem), 0.0
    for share in {rule.share, getattr(rule.share, "py_func", rule.share)}:
        units, run = rows_of(problem)
        share(units, run)
        same = run.case == 0 or CASES[run.case] == found.case
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
    # an answer is at its bounds as nearly as it is at the optimum
    return max(apart, optimality(problem, found, max(1e-6, 1.1 * apart)).worst / problem.expected)


AIMS = ("exact", "effort")
LAWS = (
    Law("optimal", "the distance from the exact level, and the conditions of optimality", _optimal, kind="rated",
        promises=("exact",)),
    Law("answer", "one limit per unit, none beyond its torque limit; what they lack; no failure", _answer),
    Law("case", "a case that it sets is A (1) where caps do not allow more than the plan, else B (2)", _case, kind="plain"),
    Law("repeatable", "one problem has one answer, whatever is asked between", _repeatable),
    Law("rows", "its sharing on rows, compiled and plain, answers as the rule does", _rows),
    Law("scale", "twice the coefficients, twice the limits; only ratios of masses count", _scaled),
    Law("order", "units in another order have their own limits", _order, promises=AIMS),
    Law("effort", "up to their caps limits give the plan, or what bounds allow", _effort, promises=AIMS),
    Law("reference", "within caps, no less than they allow, no more than the patent's rule", _reference,
        kind="growing", promises=("exact", "reference")),
)  # fmt: skip


def check_rule(
    rule: Rule | Callable[[AllocationProblem], Any], tolerance: float = 1e-6, examples: int = 100
) -> dict[str, Verdict]:
    """Worst amount of every law that `rule` promises; raises `BrokenLaw` where one is broken by over `tolerance`.

    `rule`: a `Rule`, or an answer to a problem. `examples`: random problems per law.
    """
    if not isinstance(rule, Rule):
        rule = Rule(getattr(rule, "__name__", "own rule"), "", answer=rule)
    kept = [one for one in LAWS if rule.promise in one.promises]
    laws = [one._replace(cases=list(problems(one.kind, examples))) for one in kept]
    return check(rule, rule.name, laws, tolerance)
