"""`qp-robust`: each cap holds with the probability that was asked for, and no more is given away than that."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from alloc.rules import AllocationError, AllocationProblem, find_rule, optimality, robust_rule
from alloc.rules.qp import PROBABILITY, QP_ROBUST, chance_constrained
from alloc.rules.testing import EXPECTED, problems

CAP = np.array([0.150, 0.160, 0.172, 0.176])
DEVIATION = np.array([0.000, 0.004, 0.008, 0.012])


@settings(max_examples=40)
@given(problem=problems(12))
def test_without_deviation_it_is_the_plain_program(problem):
    plain = find_rule("qp")(problem)
    for deviation in (None, np.zeros(problem.n)):
        answer = find_rule("qp-robust")(problem.changed(deviation=deviation))
        assert answer.limit.tolist() == plain.limit.tolist()
        assert (answer.case, answer.status) == (plain.case, "ok")


@settings(max_examples=60)
@given(
    problem=problems(12),
    spread=st.floats(0.0, 0.1),
    probability=st.floats(0.5, 0.999),
)
def test_optimality_conditions_of_the_shifted_problem(problem, spread, probability):
    uncertain = problem.changed(deviation=spread * np.linspace(0.0, 1.0, problem.n))
    answer = robust_rule(probability)(uncertain)
    assert answer.status == "ok"
    check = optimality(chance_constrained(uncertain, probability), answer)
    assert check.worst <= 1e-12
    assert check.gap <= 1e-12


@pytest.mark.parametrize("probability", [0.6, 0.9, 0.99])
def test_stated_probability_is_met_in_monte_carlo(probability):
    draws = 40_000
    # case A: every unit stands at its bound, so the probability is met exactly and not exceeded
    problem = AllocationProblem(CAP, 0.25, deviation=DEVIATION)
    limit = robust_rule(probability)(problem).limit
    truth = CAP + DEVIATION * np.random.default_rng(5).standard_normal((draws, CAP.size))
    holds = (limit <= truth + 1e-9).mean(axis=0)
    error = np.sqrt(probability * (1.0 - probability) / draws)
    assert holds[0] == 1.0  # certain
    assert np.all(np.abs(holds[1:] - probability) < 4.0 * error)


def test_where_the_plan_is_within_reach_caps_hold_more_often():
    problem = AllocationProblem(CAP + 0.02, 0.16, deviation=DEVIATION)
    answer = find_rule("qp-robust")(problem)
    assert answer.case == "B"
    assert np.all(answer.limit <= CAP + 0.02 - norm.ppf(PROBABILITY) * DEVIATION + 1e-9)
    assert answer.effort(problem) == pytest.approx(0.16)


@settings(max_examples=30)
@given(
    problem=problems(10, bounded=False),
    pair=st.tuples(st.floats(0.5, 0.999), st.floats(0.5, 0.999)),
)
def test_more_certainty_never_gives_more_effort(problem, pair):
    low, high = sorted(pair)
    uncertain = problem.changed(deviation=np.full(problem.n, 0.01))
    daring, careful = robust_rule(low)(uncertain), robust_rule(high)(uncertain)
    assert careful.effort(problem) <= daring.effort(problem) + 1e-9
    assert careful.unmet >= daring.unmet - 1e-9
    caps = [np.asarray(chance_constrained(uncertain, p).cap) for p in (low, high)]
    assert np.all(caps[1] <= caps[0])


def test_cost_of_certainty_by_hand():
    # one unit, case A: cap 0.15 less 1.2816 x 0.01
    answer = find_rule("qp-robust")(AllocationProblem([0.15], 0.2, deviation=[0.01]))
    assert answer.limit[0] == pytest.approx(0.15 - 1.2815515655 * 0.01, abs=1e-9)


def test_a_cap_below_nothing_is_none():
    answer = find_rule("qp-robust")(AllocationProblem([0.01, 0.2], 0.15, deviation=[0.05, 0.0]))
    assert answer.limit == pytest.approx([0.0, 0.2], abs=1e-9)
    assert answer.status == "ok"


def test_other_rules_leave_the_deviation_alone():
    certain = AllocationProblem(CAP, 0.165)
    uncertain = certain.changed(deviation=DEVIATION)
    for name in ("alone", "greedy", "exact", "qp"):
        limits = [find_rule(name)(problem).limit for problem in (certain, uncertain)]
        np.testing.assert_allclose(*limits, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("probability", [0.0, 0.49, 1.0, 1.2, np.nan, None, "sure", True])
def test_impossible_probabilities_are_refused(probability):
    problem = AllocationProblem(CAP, EXPECTED, deviation=DEVIATION)
    for ask in (robust_rule, lambda p: chance_constrained(problem, p)):
        with pytest.raises(AllocationError, match=r"probability = .* must be a number with 0.5"):
            ask(probability)


def test_rule_of_another_probability_keeps_its_name():
    assert robust_rule(0.95).name == QP_ROBUST.name == "qp-robust"
    assert robust_rule(0.95).answer.keywords == {"probability": 0.95}
    assert "0.95" in robust_rule(0.95).description
