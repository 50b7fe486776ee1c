"""Conformance kit: what an allocation rule must keep, by its promise, over random problems.

    check_rule(my_rule)  # {requirement: worst amount}; raises `BrokenLaw` with a counterexample of few units
    check_rule("greedy")

Amounts are shares of the plan.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from alloc.rules.exact import exact_limits
from alloc.rules.problem import CASES, ROUNDING, AllocationProblem, optimality
from alloc.rules.reference import reference_rule
from alloc.rules.rule import PROMISES, RULES, Rule, rows_of_problem
from alloc.schema.errors import InputError, blamed_on
from alloc.schema.registry import find_part

Amount = Callable[[Any, Any], float]


class Requirement(NamedTuple):
    """What parts of a kind keep: by how much a part breaks it in each of its cases, and how much is `allowed`."""

    name: str
    meaning: str
    amount: Amount
    cases: Sequence[Any] = ()
    allowed: float = 0.0
    kind: str = "bounded"
    """Of the problems that a rule is asked, see `problems`; they are its cases."""
    promises: tuple[str, ...] = PROMISES
    """Of the rules that keep it."""


def require(
    requirements: list[Requirement], name: str, meaning: str, **fields: Any
) -> Callable[[Amount], Amount]:
    """Decorator that adds a requirement to those of a kind of parts, by its function `amount(part, case)`."""

    def add(amount: Amount) -> Amount:
        requirements.append(Requirement(name, meaning, amount, **fields))
        return amount

    return add


class Verdict(float):
    """By how much a requirement is missed at worst; `fault`: how it is broken in `case`, the first and smallest."""

    requirement, allowed, fault = "", 0.0, ""
    case: Any = None

    def __str__(self) -> str:
        verdict = "broken" if self.fault else "kept"
        return f"{verdict:6} {self.requirement:14} by {float(self):.2g}, allowed {self.allowed:.2g}"


class BrokenLaw(AssertionError):
    """A part breaks requirements: a line for each with its amount and counterexample, then a line for every verdict."""

    def __init__(self, verdicts: dict[str, Verdict]) -> None:
        faults = [verdict.fault for verdict in verdicts.values() if verdict.fault]
        self.verdicts, self.broken = verdicts, faults
        super().__init__("\n".join([*faults, *map(str, verdicts.values())]))


def check_requirements(
    part: Any, name: str, requirements: Sequence[Requirement], tolerance: float
) -> dict[str, Verdict]:
    """Verdict on every requirement; raises `BrokenLaw` where one is broken by over `tolerance`, `InputError` if misspelt."""
    verdicts = {}
    for requirement in requirements:
        worst, fault, first, allowed = 0.0, "", None, max(tolerance, requirement.allowed)
        for case in requirement.cases:
            try:
                with blamed_on(name), np.errstate(invalid="ignore"):
                    amount, how = float(requirement.amount(part, case)), ""
            except InputError as error:
                if error.misspelt:
                    raise
                amount, how = math.inf, str(error)
            worst = max(worst, amount if amount == amount else math.inf)
            if not fault and not amount <= allowed:
                if not how:  # an answer, and no error
                    remark = describe_answer(part, case, amount)
                    how = f"by {amount:.2g}; allowed {allowed:.2g}{remark}"
                law = f"the law {requirement.name!r} ({requirement.meaning})"
                fault = f"{name} breaks {law} {how}; counterexample: {case!r}"
                first = case
        verdicts[requirement.name] = verdict = Verdict(worst)
        verdict.requirement, verdict.allowed = requirement.name, allowed
        verdict.fault, verdict.case = fault, first
    if any(verdict.fault for verdict in verdicts.values()):
        raise BrokenLaw(verdicts)
    return verdicts


def describe_answer(rule: Any, problem: Any, amount: float) -> str:
    """Of a rule that breaks a requirement by `amount`: its status, distance from the optimum, the cause if that is small."""
    if not isinstance(rule, Rule):
        return ""
    answer = rule(problem)
    distance = largest_distance(problem, answer.limit, exact_limits(problem)[0])
    text = f"; its status: {answer.status}"
    if rule.promise == "exact":
        text += f"; it lies {distance:.2g} of the plan from the exact level"
    if amount < 1e-2:
        text += (
            "; a solver's tolerance is the likely cause: tighten it, or allow more (--tolerance)"
        )
    return text


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

        def steps(low: int, high: int, n: int = n) -> Any:
            return draw.integers(low, high, n, endpoint=True).astype(float)

        cap, plan = GRID * steps(*SPANS[draw.integers(len(SPANS))]), GRID * PLAN
        if kind in ("plain", "growing"):
            yield AllocationProblem(np.sort(cap) if kind == "growing" else cap, plan)
            continue
        fields: dict[str, Any] = {
            "mass": 10.0 ** (steps(0, 3000) / 1000.0),
            "limit_max": np.where(steps(0, 1) > 0, math.inf, GRID * steps(0, 2 * PLAN)),
            "previous": GRID * steps(0, 2 * PLAN),
            "delivered": GRID * steps(0, 2 * PLAN),
        }
        chosen = {key: array for key, array in fields.items() if draw.random() < 0.5}
        if kind == "rated":
            chosen["rate"] = GRID * int(draw.integers(PLAN))
        problem = AllocationProblem(cap, plan, **chosen)
        if kind == "rated" or abs(problem.surplus) > 1e-5:
            yield problem


def largest_distance(problem: AllocationProblem, limit: Any, reference: Any) -> float:
    """Between limits, over the plan; equal infinities are at no distance."""
    with np.errstate(invalid="ignore"):
        distance = np.abs(np.subtract(limit, reference))
    far = np.where(np.equal(limit, reference), 0.0, distance)
    return float(np.max(far, initial=0.0)) / problem.expected


RULE_REQUIREMENTS: list[Requirement] = []
of_rules = partial(require, RULE_REQUIREMENTS)
AIMS = ("exact", "effort")


@of_rules(
    "optimal",
    "the distance from the exact level, and the conditions of optimality",
    kind="rated",
    promises=("exact",),
)
def _optimum_error(rule: Rule, problem: AllocationProblem) -> float:
    answer = rule(problem)
    distance = largest_distance(problem, answer.limit, exact_limits(problem)[0])
    # an answer is at its bounds as nearly as it is at the optimum
    residuals = optimality(problem, answer, max(1e-6, 1.1 * distance))
    return max(distance, residuals.worst / problem.expected)


@of_rules("answer", "one limit per unit, none beyond its torque limit; what they lack; no failure")
def _answer_error(rule: Rule, problem: AllocationProblem) -> float:
    answer = rule(problem)
    if answer.failed:
        return math.inf
    short = max(problem.expected - answer.effort(problem), 0.0)
    within = np.minimum(answer.limit, problem.limit_max)
    beyond = largest_distance(problem, answer.limit, within)
    return max(beyond, abs(answer.unmet - short) / problem.expected)


@of_rules(
    "case",
    "a case that it sets is A (1) where caps do not allow more than the plan, else B (2)",
    kind="plain",
)
def _case_error(rule: Rule, problem: AllocationProblem) -> float:
    units, run = rows_of_problem(problem)
    rule.share(units, run)
    return float(run.case not in (0, 2 if problem.surplus > ROUNDING else 1))


@of_rules("repeatable", "one problem has one answer, whatever is asked between")
def _repetition_error(rule: Rule, problem: AllocationProblem) -> float:
    first = rule(problem).limit.copy()
    rule(problem.changed(cap=problem.cap[::-1] * 0.75, mass=problem.mass[::-1] * 2.0))
    return largest_distance(problem, first, rule(problem).limit)


@of_rules("rows", "its sharing on rows, compiled and plain, answers as the rule does")
def _row_error(rule: Rule, problem: AllocationProblem) -> float:
    answer, worst = rule(problem), 0.0
    for share in {rule.share, getattr(rule.share, "py_func", rule.share)}:
        units, run = rows_of_problem(problem)
        share(units, run)
        if run.case != 0 and CASES[run.case] != answer.case:
            return math.inf
        worst = max(worst, largest_distance(problem, units.wanted, answer.limit))
    return worst


@of_rules("scale", "twice the coefficients, twice the limits; only ratios of masses count")
def _scale_error(rule: Rule, problem: AllocationProblem) -> float:
    double = {key: 2.0 * np.asarray(x) for key, x in problem.fields.items() if key != "mass"}
    scaled = rule(problem.changed(**double, mass=1024.0 * problem.mass)).limit
    return largest_distance(problem, 2.0 * rule(problem).limit, scaled)


@of_rules("order", "units in another order have their own limits", promises=AIMS)
def _order_error(rule: Rule, problem: AllocationProblem) -> float:
    arrays = {key: np.asarray(x) for key, x in problem.fields.items() if np.ndim(x)}
    turned = {key: np.roll(x[::-1], 1) for key, x in arrays.items()}
    limit = rule(problem.changed(**turned)).limit
    return largest_distance(problem, np.roll(rule(problem).limit[::-1], 1), limit)


@of_rules("effort", "up to their caps limits give the plan, or what bounds allow", promises=AIMS)
def _effort_error(rule: Rule, problem: AllocationProblem) -> float:
    return abs(rule(problem).usable(problem) - problem.attainable) / problem.expected


@of_rules(
    "reference",
    "within caps, no less than they allow, no more than the patent's rule",
    kind="growing",
    promises=("exact", "reference"),
)
def _reference_error(rule: Rule, problem: AllocationProblem) -> float:
    answer = rule(problem)
    most = float(np.mean(reference_rule(list(problem.cap), problem.expected)))
    effort, beyond = answer.effort(problem), float(np.max(answer.limit - problem.cap))
    return max(problem.attainable - effort, effort - most, beyond, 0.0) / problem.expected


def check_rule(
    rule: str | Rule | Callable[[AllocationProblem], Any],
    tolerance: float = 1e-6,
    examples: int = 100,
) -> dict[str, Verdict]:
    """Worst amount of every requirement that `rule` promises; raises `BrokenLaw` where one is broken by over `tolerance`.

    `rule`: a `Rule`, its name, or an answer to a problem. `examples`: random problems per requirement.
    """
    part = find_part(RULES, rule, callable(rule))
    if not isinstance(part, Rule):
        part = Rule(getattr(part, "__name__", "own rule"), "", answer=part)
    requirements = [
        requirement._replace(cases=list(problems(requirement.kind, examples)))
        for requirement in RULE_REQUIREMENTS
        if part.promise in requirement.promises
    ]
    return check_requirements(part, part.name, requirements, tolerance)
