"""The conformance kit that ships: every registered rule keeps the laws that it promises, and faulty ones break them."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.compilation import jit
from alloc.rules import RULES, Allocation, Rule
from alloc.rules.patent import greedy_law
from alloc.rules.prior_art import sharing_law
from alloc.rules.problem import allocation
from alloc.rules.testing import KNOWN, RULE_LAWS, BrokenLaw, check_rule, laws_of_rule, verdict
from tests.cases import looped

ROUNDING = 1e-11


"""Largest amount of the project's own rules, as a share of the plan; the kit allows others a hundred times as much."""


PROMISED = {
    "exact": {"exact", "qp", "qp-daqp", "qp-cvxpy", "qp-robust", "cooperative", "oracle"},
    "reference": {"greedy", "greedy-printed", "greedy-literal", "greedy-tuned"},
    "heuristic": {
        "alone",
        "preset",
        "sharing",
        "erp",
        "greedy-claim",
        "wear",
        "wear-qp",
        "wear-cvxpy",
        "preview",
    },
    "baseline": {"plan-times", "uniform"},
}


@looped("rule", RULES.values())
def test_every_rule_keeps_what_it_promises(rule):
    assert rule.name in PROMISED[rule.promise]
    found = check_rule(rule, examples=100)
    assert not [one for one in found if one.worst > ROUNDING]


@looped("name", KNOWN)
def test_known_answers_are_those_of_the_projects_rules(name):
    problem, exact, greedy = KNOWN[name]
    for rule, limits in (("exact", exact), ("greedy", greedy)):
        if limits is not None:
            answer = RULES[rule](problem)
            assert answer.limit == pytest.approx(limits, rel=1e-12, abs=1e-15)
            assert not answer.limit.flags.writeable


def exact(problem, change=lambda limit, problem: limit, **others):
    """The exact answer with other limits."""
    found = RULES["exact"](problem)
    limit = change(np.array(found.limit), problem)
    unmet = (
        max(problem.expected - replace(found, limit=limit).effort(problem), 0.0)
        if limit.size == problem.n
        else 0.0
    )
    return replace(found, **({"limit": limit, "unmet": unmet} | others))


def case_c(problem):
    return Allocation(np.zeros(problem.n), 0.0, "C", problem.expected)


def changes_caps(problem):
    answer = exact(problem)
    problem.cap.flags.writeable = True
    problem.cap[:] *= 0.5
    return answer


def changes_box(problem):
    problem.box[1][:] *= 0.5
    return RULES["exact"](problem.changed())


def remembers(problem, kept=[]):  # noqa: B006
    kept.append(problem.n)
    return exact(problem, lambda limit, problem: limit * (1.0 if len(kept) % 5 else 0.9))


def by_order(problem):
    """The exact sum, but what lacks falls on the rear units first."""
    lower, upper = problem.box
    limit = np.clip(np.full(problem.n, problem.expected), lower, upper)
    for j in reversed(range(problem.n)):
        rest = problem.weight @ (problem.attainable - limit) / problem.weight[j]
        limit[j] = np.clip(limit[j] + rest, lower[j], upper[j])
    return allocation(problem, limit, np.nan, 1 + problem.within_reach, 0.0)


def with_weights(problem):
    return RULES["exact"](problem.changed(mass=1.0 + problem.weight))


@jit
def overwrites(units, expected, limit_out):
    """Sharing, but the limits in force are lost before they are read: in a run they lie in the same array."""
    for j in range(limit_out.size):
        limit_out[j] = expected
    return sharing_law(units, expected, limit_out)


FAULTS = {
    "the plan times 1.3": (RULES["plan-times"], "heuristic", "from rest", "cap=["),
    "uniform": (RULES["uniform"], "heuristic", "from rest", "cap=["),
    "case C": (case_c, "heuristic", "answer", "case = 'C'"),
    "wrong length": (lambda p: exact(p, lambda x, _: x[:-1]), "heuristic", "answer", "one finite limit each"),
    "negative": (lambda p: exact(p, lambda x, _: x - 1.0), "heuristic", "answer", "none may be negative"),
    "no answer": (lambda p: None, "heuristic", "answer", "returns None"),
    "raises": (lambda p: 1 // 0, "heuristic", "answer", "by zero in line"),
    "shortfall untold": (lambda p: exact(p, unmet=0.0), "heuristic", "answer", "cap=[0.0]"),
    "changes its caps": (changes_caps, "heuristic", "inputs untouched", "changes cap"),
    "changes the box": (changes_box, "heuristic", "inputs untouched", "changes box"),
    "remembers": (remembers, "heuristic", "repeatable", ""),
    "absolute masses": (with_weights, "heuristic", "scale of masses", "mass="),
    "motors ignored": (lambda p: RULES["exact"](p.changed(limit_max=None)), "heuristic", "torque and rate", "limit_max"),
    "never case A": (lambda p: exact(p, case="B"), "heuristic", "case", "cap=[0.0]"),
    "by order": (by_order, "exact", "order of units", "cap=["),
    "greedy": (RULES["greedy"], "exact", "optimal", "cap="),
    "another law": (replace(RULES["exact"], law=greedy_law), "heuristic", "compiled law", "cap="),
    "overwrites": (replace(RULES["sharing"], law=overwrites), "heuristic", "compiled law", "previous="),
    "a lower sum": (lambda p: exact(p, lambda x, _: x * (1 - 1e-6)), "reference", "reference", "cap="),
    "gives up": (lambda p: exact(p, status="gave up"), "exact", "status", "gave up"),
    "claim": (RULES["greedy-claim"], "reference", "reference", "cap="),
}  # fmt: skip


"""Fault -> rule, promise, a law that it breaks, words of the message."""


@looped("fault", FAULTS)
def test_a_faulty_rule_is_told_the_law_the_worst_value_and_a_small_counterexample(fault):
    answer, promise, name, words = FAULTS[fault]
    rule = answer if isinstance(answer, Rule) else Rule("mine", "", answer)
    rule = rule.promising(promise)
    law = next(law for law in laws_of_rule(rule) if law.name == name)
    with pytest.raises(
        BrokenLaw, match=rf"breaks the law {name!r} .* worst .*; counterexample: Alloc"
    ) as caught:
        verdict(law, rule, 100).check("mine")
    assert words in str(caught.value)


def test_every_law_is_broken_by_one_of_the_faults():
    told = {name for _, _, name, _ in FAULTS.values()}
    told |= {
        "without slip",
        "threads",
    }  # a `Rule` answers the first itself; for the second see below
    told |= {
        "known answers",
        "known answers, bounded",
        "in the box",
        "attainable sum",
        "case of the box",
    }
    assert {law.name for law in RULE_LAWS} == told
