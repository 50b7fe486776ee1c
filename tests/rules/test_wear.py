"""Least wear: three forms with one answer, the conditions of its optimum, and what a run's memory makes of reports."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import LinearConstraint, minimize

from alloc.metrics import evaluate
from alloc.rules import RULES, AllocationProblem, find_rule
from alloc.rules.rule import Units
from alloc.rules.testing import EXPECTED, problems
from alloc.rules.wear import in_shares, wear_law
from alloc.simulation import simulate
from studies import broad
from studies.scenario import load as load_scenario
from tests.cases import looped

FORMS = ("wear", "wear-qp", "wear-cvxpy")
AGREE = 1e-9
"""Largest difference between the forms, relative to the plan."""


def marked(problem, shares):
    """`problem` with marks: its caps times `shares`, at least a hundredth of the plan."""
    mark = np.maximum(np.asarray(problem.cap) * np.resize(shares, problem.n), 0.01 * EXPECTED)
    return problem.changed(mark=mark)


SHARES = st.lists(st.floats(0.5, 2.0), min_size=1, max_size=8)


@given(problem=problems(16), shares=SHARES)
def test_three_forms_give_one_answer(problem, shares):
    problem = marked(problem, shares)
    one, qp, cvxpy = (find_rule(name)(problem) for name in FORMS)
    for other in (qp, cvxpy):
        np.testing.assert_allclose(other.limit, one.limit, rtol=0.0, atol=AGREE * EXPECTED)
        assert (other.case, other.status) == (one.case, "ok")


@given(problem=problems(24), shares=SHARES)
def test_units_at_no_bound_work_at_one_share_of_their_marks(problem, shares):
    problem = marked(problem, shares)
    answer = find_rule("wear")(problem)
    lower, upper = problem.box
    assert answer.effort(problem) == pytest.approx(problem.attainable, rel=1e-9, abs=1e-12)
    share = answer.limit / problem.peak
    near = 1e-9 * EXPECTED
    at_upper, at_lower = upper - answer.limit <= near, answer.limit - lower <= near
    free = share[~at_upper & ~at_lower]
    if free.size:
        level = free.mean()
        np.testing.assert_allclose(free, level, rtol=1e-9)
        # who is at a bound would go further that way
        assert np.all(share[at_upper & ~at_lower] <= level * (1.0 + 1e-9))
        assert np.all(share[at_lower & ~at_upper] >= level * (1.0 - 1e-9))


def test_no_split_of_the_effort_costs_less():
    generator = np.random.default_rng(6)
    for _ in range(20):
        n = int(generator.integers(2, 9))
        mark, mass = EXPECTED * generator.uniform(0.6, 1.6, n), generator.uniform(0.5, 2.0, n)
        cap = np.minimum(mark, EXPECTED * generator.uniform(0.9, 1.5, n))
        problem = AllocationProblem(cap, EXPECTED, mass=mass, mark=mark)
        answer = find_rule("wear")(problem)
        if answer.case == "A":
            assert answer.limit == pytest.approx(cap)
            continue
        found = minimize(
            lambda x, mass=mass, mark=mark: 1e3 * (mass * x**2 / mark).sum(), cap * 0.5,
            jac=lambda x, mass=mass, mark=mark: 2e3 * mass * x / mark, bounds=[(0.0, one) for one in cap],
            constraints=LinearConstraint(mass, EXPECTED * mass.sum(), EXPECTED * mass.sum()), method="SLSQP",
            options={"ftol": 1e-13, "maxiter": 500},
        )  # fmt: skip
        assert answer.limit == pytest.approx(found.x, abs=1e-5)


def test_it_is_the_split_of_least_dissipation_where_units_share_a_curve():
    """Whatever the curve: power x s(x / p), with the slip s of a share of the peak, convex."""
    mark = EXPECTED * np.array([0.8, 1.1, 1.4])
    limit = find_rule("wear")(AllocationProblem(mark, EXPECTED, mark=mark)).limit
    for slip in (lambda u: 1.0 - np.sqrt(1.0 - u), lambda u: u / (1.2 - u), lambda u: u**5):
        power = [(x * slip(x / mark)).sum() for x in (limit, *_others(limit, mark))]
        assert power[0] < min(power[1:])


def _others(limit, mark):
    """Splits of the same sum nearby, below the marks."""
    for j, k in ((0, 1), (1, 2), (2, 0)):
        for move in (1e-3, -1e-3):
            other = limit.copy()
            other[j] += move
            other[k] -= move
            assert np.all(other < mark)
            yield other


def law(cap, mark, upper_bound, most=1.0, plan=0.16):
    """Limits of units of equal mass, and whether 0.16 is within reach."""
    cap, mark, upper_bound = (np.asarray(one, dtype=float) for one in (cap, mark, upper_bound))
    same, out = np.ones(cap.size), np.empty(cap.size)
    units = Units(cap, same, most * same, out, cap, cap, upper_bound, mark, plan)
    return out, wear_law(units, 0.16, out)[1]


def test_out_of_reach_every_unit_is_asked_for_what_it_may_search_up_to():
    found, reached = law([0.10, 0.15], [0.11, 0.15], [0.13, 0.195], most=0.18)
    assert not reached
    assert found.tolist() == [0.16, 0.18]  # the plan at least, and no more than the motors give
    problem = AllocationProblem([0.10, 0.15], 0.16, mark=[0.11, 0.15], upper_bound=[0.13, np.inf])
    for name in FORMS:
        answer = find_rule(name)(problem)
        assert (answer.case, answer.limit.tolist()) == ("A", [0.16, 0.15])


def test_what_trailers_lack_is_asked_of_no_unit_that_does_what_it_can():
    """In stops the train needs 0.16 of units whose own plan is 0.12: air would fill what a limited one is asked for."""
    mark, upper_bound = [0.09, 0.10, 0.25], [0.1, 0.13, 0.3]
    for cap, within in (([0.08, 0.10, 0.25], False), ([0.08, 0.10, 0.40], True)):
        found, reached = law(cap, mark, upper_bound, plan=0.12)
        assert reached == within
        assert found[:2].tolist() == [0.12, 0.13]
        if within:
            assert found[2] == pytest.approx(3 * 0.16 - cap[0] - cap[1])
        problem = AllocationProblem(cap, 0.16, mark=mark, upper_bound=upper_bound, plan=0.12)
        for name in FORMS:
            np.testing.assert_allclose(find_rule(name)(problem).limit, found, atol=AGREE)


def test_a_unit_at_its_limit_is_asked_for_no_more_and_the_others_share_the_rest():
    found, reached = law([0.10, np.inf, np.inf], [0.20, 0.20, 0.24], [np.inf] * 3)
    assert reached
    assert found == pytest.approx([0.10, 0.38 * 0.20 / 0.44, 0.38 * 0.24 / 0.44])


def test_a_unit_at_its_cap_is_left_to_its_own_search_in_all_forms():
    """Another that the rail limits, the first, would do more than its share: it is relieved."""
    problem = AllocationProblem(
        [0.10, 0.15, 0.40], 0.16, mark=[0.10, 0.24, 0.40], upper_bound=[0.13, 0.24, 0.40]
    )
    for name in FORMS:
        answer = find_rule(name)(problem)
        assert answer.case == "B"
        assert answer.limit == pytest.approx([0.066, 0.24, 0.264])


def test_the_program_in_shares_leaves_nothing_out():
    problem = AllocationProblem(
        [0.2, 0.3], 0.15, mass=[2.0, 1.0], limit_max=[0.4, np.inf], previous=[0.1, 0.2], rate=[0.05, 0.1],
        mark=[0.2, 0.1],
    )  # fmt: skip
    shares, mark = in_shares(problem)
    assert mark.tolist() == [0.2, 0.1]
    assert shares.weight == pytest.approx([0.4, 0.1])
    assert shares.expected == pytest.approx(0.15 * 3.0 / 0.5)
    for own, other in zip(shares.box, problem.box, strict=True):
        assert own * mark == pytest.approx(other)


@looped(["controller", "most"], [("perturb-observe", 0.75), ("pi-creep", 1.0 + 1e-9)])
def test_where_others_can_make_up_the_same_effort_costs_no_more(controller, most):
    """Cars loaded unevenly: some units are limited, and all of them together reach the plan."""
    event = load_scenario("uneven-load").event()
    wear, own = (evaluate(simulate(event, rule, controller)) for rule in ("wear", "cooperative"))
    assert wear["bound_use"] > own["bound_use"] - 0.001
    assert wear["excess_damage"] < most * own["excess_damage"]
    assert wear["over_delivery"] < 0.005


def test_where_the_rail_comes_back_no_unit_stays_at_what_it_found_before():
    """Starts on rail that falls and recovers, with noise and slow motors, on which `wear` had lost 4 to 14 points."""
    for k in (34, 38, 46):
        event = broad.event(3300, k).event(k)
        wear, alone = (
            evaluate(simulate(event, rule, "perturb-observe"))["bound_use"]
            for rule in ("wear", "alone")
        )
        assert wear > alone - 0.003, k


def test_forms_of_a_run_differ_by_rounding_alone():
    event = load_scenario("wet-front").event()
    one, other = (simulate(event, name, "perturb-observe") for name in ("wear", "wear-qp"))
    assert other.attrs["rule_failures"] == 0
    np.testing.assert_allclose(other["limit"], one["limit"], atol=1e-6)


def test_it_belongs_to_the_rules_that_are_asked_with_every_telegram():
    assert all(RULES[name].trigger.name == "TELEGRAM" for name in FORMS)
