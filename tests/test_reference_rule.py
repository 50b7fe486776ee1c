"""The reference rule of JP5484215 at the door: by hand, in fractions, and the optimising rules on the same caps."""

from fractions import Fraction

import numpy as np
import pytest

from alloc.rules import RULES, AllocationProblem, Rule, optimality, reference_rule

FIG_6A = [0.150, 0.165, 0.176, 0.180, 0.183, 0.186, 0.188, 0.190]
FIG_6B = [0.130, 0.145, 0.156, 0.160, 0.163, 0.166, 0.168, 0.170]
PLAN = 0.170


def drawn(count=150):
    """Caps around the plan in eighths, ties among them, and the plan."""
    rng = np.random.default_rng(11)
    for _ in range(count):
        n, plan = rng.integers(1, 9), Fraction(int(rng.integers(2, 12)), 8)
        yield [Fraction(int(k), 8) for k in rng.integers(0, 14, n)], plan


def fifths(count=60):
    """Caps in fifths, which no binary number holds exactly, growing along the train."""
    rng = np.random.default_rng(12)
    for _ in range(count):
        yield (
            sorted(Fraction(int(k), 5) for k in rng.integers(0, 9, rng.integers(1, 9))),
            Fraction(4, 5),
        )


def exact_in_fractions(caps, plan):
    """par. 0050: L with sum min(cap, L) = n plan, by trying how many units are at their caps; all are, out of reach."""
    ordered, n = sorted(caps), len(caps)
    for at_cap in range(n):
        level = (n * plan - sum(ordered[:at_cap])) / (n - at_cap)
        if level <= ordered[at_cap]:
            return [min(cap, level) for cap in caps]
    return list(caps)


def ask(name, caps, plan):
    return RULES[name](AllocationProblem([float(cap) for cap in caps], float(plan)))


@pytest.mark.parametrize("reading", ["description", "claim"])
def test_fig_6a_by_hand(reading):
    """Cars 1 and 2 lack 0.020 + 0.005; 6 x 0.006 of car 3 is enough; claim 1 adds 0.006 + 0.010 + 0.013 up to car 5."""
    level = {"description": 0.176, "claim": 0.183}[reading]
    by_hand = [0.150, 0.165, *(min(cap, level) for cap in FIG_6A[2:])]
    assert reference_rule(FIG_6A, PLAN, reading) == by_hand
    found = ask({"description": "greedy", "claim": "greedy-claim"}[reading], FIG_6A, PLAN)
    assert list(found.limit) == by_hand
    assert (found.case, found.level, found.unmet) == ("B", level, 0.0)


def test_fig_6b_by_hand():
    """The mean cap is 0.1573: case A, every unit at its cap, and the plan is not met."""
    assert reference_rule(FIG_6B, PLAN) == FIG_6B
    for name in ("greedy", "greedy-claim", "exact", "qp"):
        found = ask(name, FIG_6B, PLAN)
        assert list(found.limit) == FIG_6B
        assert found.case == "A"
        assert found.unmet == pytest.approx(PLAN - np.mean(FIG_6B))


def test_without_slip_every_unit_keeps_the_plan():
    assert reference_rule(FIG_6A, PLAN, slip=False) == [PLAN] * 8


@pytest.mark.parametrize(
    ("name", "reading"), [("greedy", "description"), ("greedy-claim", "claim")]
)
def test_greedy_is_the_reference_compiled(name, reading):
    for caps, plan in [*drawn(), *fifths()]:
        by_steps = reference_rule(caps, plan, reading)
        assert all(isinstance(limit, Fraction) for limit in by_steps)
        assert list(ask(name, caps, plan).limit) == [float(limit) for limit in by_steps]


@pytest.mark.parametrize("name", ["exact", "qp", "qp-cvxpy", "qp-robust", "oracle"])
def test_optimising_rules_are_the_level_in_fractions(name):
    for caps, plan in [*drawn(40), *fifths(20)]:
        found = ask(name, caps, plan)
        assert not found.failed
        assert found.limit == pytest.approx([float(x) for x in exact_in_fractions(caps, plan)], abs=1e-7)  # fmt: skip


def test_the_description_delivers_the_plan_and_no_less_than_the_exact_level():
    for caps, plan in drawn():
        limits, exact = reference_rule(caps, plan), exact_in_fractions(caps, plan)
        assert all(low <= high <= cap for low, high, cap in zip(exact, limits, caps, strict=True))
        assert sum(limits) >= min(sum(caps), len(caps) * plan)


def test_the_claim_stops_no_earlier_but_may_fall_short_where_caps_do_not_grow():
    short = 0
    for caps, plan in drawn():
        claim = reference_rule(caps, plan, "claim")
        short += sum(claim) < min(sum(caps), len(caps) * plan)
        grown = sorted(caps)
        assert max(reference_rule(grown, plan, "claim")) >= max(reference_rule(grown, plan))
    assert short > 0


@pytest.mark.parametrize("name", ["exact", "qp", "qp-cvxpy"])
def test_conditions_of_karush_kuhn_and_tucker(name):
    rng = np.random.default_rng(3)
    for n in (1, 3, 8, 16):
        problem = AllocationProblem(
            PLAN + rng.normal(0.01, 0.02, n), PLAN, rng.uniform(0.5, 2.0, n)
        )
        assert optimality(problem, RULES[name](problem), 1e-7).worst < 1e-8


def test_the_conditions_notice_what_is_no_optimum():
    problem = AllocationProblem(FIG_6A, PLAN)
    assert optimality(problem, RULES["greedy"](problem)).primal > 1e-4  # more than the plan
    assert optimality(problem, RULES["wear"](problem)).stationarity > 1e-3  # no one level


def test_your_solver_here():
    """Five lines: an answer that returns limits, a rule of it, and its distance from the exact level."""

    def answer(problem):
        scale = problem.expected * problem.n / problem.cap.sum()
        return problem.cap * min(scale, 1.0)

    problem = AllocationProblem(FIG_6A, PLAN)
    gap = np.abs(
        Rule("proportional", "", answer=answer)(problem).limit - RULES["exact"](problem).limit
    )
    assert gap.max() == pytest.approx(0.00806, abs=1e-5)
