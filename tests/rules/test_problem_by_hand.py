"""Small problems worked out by hand: bounds of the problem, and a step of dynamic sharing."""

import numpy as np
import pytest

from alloc.rules import AllocationProblem, find_rule
from alloc.rules.exact import optimality


def test_limits_before_bound_nothing_without_a_rate():
    problem = AllocationProblem([0.2, 0.3], 0.1, previous=[0.1, 0.25], limit_max=[0.15, 0.5])
    lower, upper = problem.rate_box
    assert (lower.tolist(), upper.tolist()) == ([0.0, 0.0], [0.15, 0.5])
    lower, upper = problem.box
    assert (lower.tolist(), upper.tolist()) == ([0.0, 0.0], [0.15, 0.3])


def test_a_rate_bounds_the_change_but_adhesion_and_torque_prevail():
    problem = AllocationProblem(
        [0.2, 0.3, 0.05],
        0.1,
        previous=[0.1, 0.02, 0.2],
        limit_max=[0.12, 0.5, 0.5],
        rate=[0.03, 0.05, 0.1],
    )
    lower, upper = problem.rate_box
    np.testing.assert_allclose(lower, [0.07, 0.0, 0.1])
    np.testing.assert_allclose(upper, [0.12, 0.07, 0.3])
    lower, upper = problem.box
    np.testing.assert_allclose(lower, [0.07, 0.0, 0.05])
    np.testing.assert_allclose(upper, [0.12, 0.07, 0.05])


def test_a_unit_that_is_short_gets_nothing_of_what_lacks():
    # unit 1 delivers 0.1 of its 0.2: lowered by 0.15 of what it lacks; as much is unit 2's
    problem = AllocationProblem([0.3, 0.3], 0.2, previous=[0.2, 0.2], delivered=[0.1, 0.2])
    assert find_rule("sharing")(problem).limit == pytest.approx([0.185, 0.215], rel=1e-12)


@pytest.mark.parametrize("rule", ["greedy", "greedy-claim", "exact"])
def test_more_than_the_plan_is_case_b_and_just_the_plan_is_not(rule):
    assert find_rule(rule)(AllocationProblem([0.3, 0.11], 0.2)).case == "B"
    assert find_rule(rule)(AllocationProblem([0.3, 0.1], 0.2)).case == "A"
    assert find_rule(rule)(AllocationProblem([0.3, 0.05], 0.2)).case == "A"


def test_the_level_without_reach_is_the_highest_cap():
    for rule in ("greedy", "exact"):
        assert find_rule(rule)(AllocationProblem([0.3, 0.05], 0.2)).level == pytest.approx(0.3)
    assert find_rule("exact")(AllocationProblem([0.3, 0.15], 0.2)).level == pytest.approx(0.25)


@pytest.mark.parametrize("rule", ["alone", "preset", "sharing"])
def test_rules_that_know_no_caps_say_whether_these_allow_more_than_the_plan(rule):
    assert (
        find_rule(rule)(AllocationProblem([0.25, 0.25], 0.25)).case == "A"
    )  # a tie without rounding
    assert find_rule(rule)(AllocationProblem([0.25, 0.26], 0.25)).case == "B"
    assert find_rule(rule)(AllocationProblem([0.25, 0.26], 0.25, limit_max=[0.24, 1.0])).case == "A"
    heavy = AllocationProblem([0.25, 0.26], 0.25, mass=[9.0, 1.0], limit_max=[0.249, 1.0])
    assert find_rule(rule)(heavy).case == "B"  # 9 (-0.001) + 0.01 > 0


@pytest.mark.parametrize("rule", ["exact", "qp"])
def test_lower_bounds_that_just_give_the_plan_are_the_answer(rule):
    answer = find_rule(rule)(
        AllocationProblem([0.5, 0.5], 0.125, previous=[0.25, 0.25], rate=0.125)
    )
    assert answer.limit.tolist() == [0.125, 0.125]
    assert (answer.level, answer.case, answer.status) == (0.125, "B", "ok")


def test_what_stands_at_no_bound_has_no_multiplier_to_be_wrong():
    problem = AllocationProblem([0.5, 0.5], 0.2)
    found = optimality(problem, find_rule("exact")(problem))
    assert (found.complementarity, found.dual) == (0.0, 0.0)
