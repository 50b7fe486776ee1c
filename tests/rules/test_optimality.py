"""Optimality: every solver satisfies its conditions, residuals by hand, and solvers that certify their answer."""

import math
import os
import signal
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import qpsolvers
import quadprog
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from alloc.rules import AllocationError, AllocationProblem, find_rule, optimality, qp, robust_rule
from alloc.rules.exact import certified, exact_in_box, fitted_level, polish
from alloc.rules.problem import CASE_B, allocation
from alloc.rules.qp import QP_ROBUST, chance_constrained
from alloc.rules.testing import EXPECTED, problems
from tests.cases import looped
from tests.rules.references import PLAN, random_problem


@looped("solver", qpsolvers.available_solvers)
def test_every_installed_solver_gives_the_exact_limits(solver):
    generator = np.random.default_rng(3)
    # a first-order method (scs) and a simplex-like one (highs) reach what their own tolerances allow
    accuracy = {"scs": 1e-5, "highs": 1e-6}.get(solver, 1e-7)
    options = {
        "scs": {"eps_abs": 1e-9, "eps_rel": 1e-9},
        "osqp": {"eps_abs": 1e-10, "eps_rel": 1e-10, "raise_error": True},
    }
    for n in (1, 3, 8, 16):
        cap = EXPECTED * generator.uniform(0.6, 1.6, n)
        mass = generator.uniform(0.5, 1.5, n)
        problem = AllocationProblem(cap, EXPECTED, mass=mass)
        quadratic = sparse.diags(mass).tocsc()
        total = np.array([mass.sum() * problem.attainable / EXPECTED])
        dense = solver in ("quadprog", "daqp")
        x = qpsolvers.solve_qp(
            quadratic.toarray() if dense else quadratic, -mass,
            A=mass[None, :] if dense else sparse.csc_matrix(mass[None, :]), b=total,
            lb=np.zeros(n), ub=cap / EXPECTED, solver=solver, **options.get(solver, {}),
        )  # fmt: skip
        exact = find_rule("exact")(problem)
        assert x is not None
        np.testing.assert_allclose(EXPECTED * x, exact.limit, atol=accuracy)


@given(problem=problems(64, bounded=False))
def test_gap_of_the_reference_is_its_excess_and_nothing_else(problem):
    answer = find_rule("greedy")(problem)
    check = optimality(problem, answer)
    # the only condition that it misses is the sum, by what it delivers beyond the plan
    assert check.primal == pytest.approx(
        answer.excess(problem) if answer.case == "B" else 0.0, abs=1e-15
    )
    assert check.stationarity <= 1e-15
    assert check.complementarity <= 1e-15
    assert check.dual <= 1e-15
    if check.primal > 1e-12:
        assert check.gap > 0.0


@given(problem=problems(24))
def test_checker_finds_a_limit_moved_from_the_optimum(problem):
    limit = np.empty(problem.n)
    level, case = exact_in_box(problem, limit)
    moved = limit.copy()
    moved[0] += 1e-3
    check = optimality(problem, allocation(problem, moved, level, case, 0.0))
    share = problem.weight[0] / problem.weight.sum()
    assert check.worst >= 0.99e-3 * share
    assert check.gap == pytest.approx(1e-3 * np.sqrt(share), rel=1e-6)


# Unit 1 lacks 2 x 0.05, which units 2 and 3 make up by 0.05 each: the optimum is 0.15, 0.25, 0.25 and the level 0.25.
PROBLEM = AllocationProblem([0.15, 0.30, 0.40], 0.2, mass=[2.0, 1.0, 1.0])


def checked(limit, level, problem=PROBLEM, **options):
    """primal, dual, complementarity, stationarity, gap and level of these limits."""
    answer = allocation(problem, np.array(limit), level, CASE_B, 0.0)
    found = optimality(problem, answer, **options)
    return (
        found.primal, found.dual, found.complementarity, found.stationarity, found.gap, found.level,
    )  # fmt: skip


@looped(("limit", "level", "expected"), [
        ([0.15, 0.25, 0.25], 0.25, (0, 0, 0, 0, 0, 0.25)),
        # inside their bounds at 0.04 below and 0.02 above the level: 0.02 / 4 are missed
        ([0.15, 0.21, 0.27], 0.25, (0.005, 0, 0, 0.04, math.sqrt((0.04**2 + 0.02**2) / 4), 0.25)),
        # without a level the mean of units 2 and 3 stands for it
        ([0.15, 0.22, 0.28], math.nan, (0, 0, 0, 0.03, math.sqrt(2 * 0.03**2 / 4), 0.25)),
        # unit 1 beyond its cap by 0.01, of twice the mass
        ([0.16, 0.24, 0.24], 0.24, (0.01, 0, 0.01, 0, math.sqrt((2 * 0.01**2 + 2 * 0.01**2) / 4), 0.24)),
        # at its upper bound although above the level
        ([0.15, 0.30, 0.20], 0.20, (0, 0.10, 0, 0, math.sqrt(2 * 0.05**2 / 4), 0.20)),
        # unit 3 at its lower bound although below the level; unit 1 holds 2 x 0.10 less
        ([0.05, 0.30, 0.00], 0.30, (0.1, 0.30, 0, 0.25, math.sqrt((2 * 0.1**2 + 0.05**2 + 0.25**2) / 4), 0.30)),
    ])  # fmt: skip
def test_residuals_are_those_by_hand(limit, level, expected):
    assert checked(limit, level) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_a_limit_below_its_lower_bound_by_hand():
    # bounds 0.10 to 0.15, 0.20 to 0.30, 0.20 to 0.30; unit 3 is 0.02 below its own, and 0.09 below the level
    held = PROBLEM.changed(previous=[0.15, 0.25, 0.25], rate=0.05)
    expected = (0.02, 0.09, 0.02, 0, math.sqrt((0.02**2 + 0.07**2) / 4), 0.27)
    assert checked([0.15, 0.27, 0.18], 0.27, held) == pytest.approx(expected, rel=1e-9, abs=1e-15)


def test_where_both_bounds_meet_a_multiplier_has_either_sign():
    fixed = AllocationProblem([0.3], 0.2, previous=[0.15], rate=0.0)
    for level in (0.10, 0.25):
        assert checked([0.15], level, fixed)[:5] == (0.0, 0.0, 0.0, 0.0, 0.0)


def test_near_a_bound_counts_as_at_it_by_the_tolerance():
    # 1e-4 below the cap, with a multiplier of 0.05: it stands at its bound if 1e-4 is near
    limit = [0.15, 0.2499, 0.2501]
    bounded = AllocationProblem([0.15, 0.25, 0.40], 0.2, mass=[2.0, 1.0, 1.0])
    far = checked(limit, 0.30, bounded, tolerance=1e-4)
    near = checked(limit, 0.30, bounded, tolerance=1e-3)
    assert far[2:4] == pytest.approx((0.0, 0.0501), rel=1e-9)
    assert near[2:4] == pytest.approx((1e-4, 0.0499), rel=1e-9)


def test_the_level_that_fits_best():
    # the free units' mean by mass; else the highest that stands at its cap; else the lowest
    free = AllocationProblem([0.3, 0.3, 0.1], 0.2, mass=[3.0, 1.0, 1.0])
    assert fitted_level(np.array([0.2, 0.24, 0.1]), free) == pytest.approx(0.21, rel=1e-12)
    assert fitted_level(np.array([0.3, 0.0, 0.1]), free) == 0.3
    held = free.changed(previous=[0.25, 0.28, 0.09], rate=[0.03, 0.02, 0.005])
    assert fitted_level(np.array([0.22, 0.26, 0.085]), held) == pytest.approx(0.085)


def test_what_is_near_a_bound_does_not_tell_the_level():
    # 2e-4 is near, by 1e-3 of the plan: so the second unit stands at its cap, and 1e-3 below it is free
    problem = AllocationProblem([0.3, 0.1], 0.2)
    for low, level in ((0.0999, 0.25), (0.099, 0.1745)):
        assert fitted_level(np.array([0.25, low]), problem, 1e-3) == pytest.approx(level)


def test_worst_is_the_largest_residual():
    answer = allocation(PROBLEM, np.array([0.15, 0.30, 0.20]), 0.20, CASE_B, 0.0)
    assert optimality(PROBLEM, answer).worst == pytest.approx(0.10)


FULL = bool(os.environ.get("READHESION_FULL"))


COUNTS = {
    "qp": (2000, 100_000), "qp-daqp": (2000, 100_000), "qp-robust": (1000, 100_000), "qp-cvxpy": (100, 1000),
}  # fmt: skip


"""Rule -> problems by default, and with READHESION_FULL=1."""


EXACT = find_rule("exact")


@looped("rule", COUNTS)
def test_ok_is_the_optimum_and_the_rest_is_few_and_said(rule):
    count, others = COUNTS[rule][FULL], []
    for k in range(count):
        problem = random_problem(k)
        answer = find_rule(rule)(problem)
        exact = EXACT(chance_constrained(problem) if rule == "qp-robust" else problem)
        assert np.all(np.abs(answer.limit - exact.limit) <= 1e-9 * np.maximum(PLAN, exact.limit)), k
        assert answer.case == exact.case
        if answer.status != "ok":
            others.append(answer.status)
            assert answer.status.startswith(f"{rule} failed (")
            assert answer.status.endswith("exact level used")
    assert len(others) <= 1e-2 * count


def test_an_independent_solver_agrees():
    compared = 0
    for k in range(300):
        problem = random_problem(k)
        lower, upper = (bound / PLAN for bound in problem.box)
        if not problem.within_reach or problem.attainable > PLAN or np.any(lower == upper):
            continue  # quadprog asks for bounds that leave a choice
        root = np.sqrt(problem.weight / problem.weight.mean())
        capped = np.isfinite(upper)
        sides = np.vstack([root, np.diag(1.0 / root), -np.diag(1.0 / root)[capped]])
        bounds = np.concatenate([[root @ root], lower, -upper[capped]])
        found = quadprog.solve_qp(np.eye(problem.n), root, sides.T, bounds, 1)[0] / root
        np.testing.assert_allclose(
            find_rule("qp")(problem).limit / PLAN, found, rtol=0.0, atol=1e-9
        )
        compared += 1
    assert compared > 50


def test_a_solver_stopped_early_is_never_ok_and_wrong(monkeypatch):
    for name in ("eps_abs", "eps_rel"):
        monkeypatch.setitem(qp.SETTINGS, name, 0.1)
    qp.workspace.cache_clear()
    statuses = []
    for k in range(400):
        problem = random_problem(k)
        answer = find_rule("qp")(problem)
        np.testing.assert_allclose(answer.limit, EXACT(problem).limit, rtol=0.0, atol=1e-9 * PLAN)
        statuses.append(answer.status)
    qp.workspace.cache_clear()
    # the certificate refuses what it must, and not everything
    assert 10 < statuses.count("qp failed (not optimal): exact level used") < 200


def certificate(problem, limit, level):
    return certified(*problem.box, problem.weight, problem.expected, limit, level)


def with_a_choice(count):
    """Problems whose bounds leave a choice, with a unit inside them: by its level every limit is known."""
    for k in range(count):
        problem = random_problem(k)
        limit, level = EXACT(problem).limit, EXACT(problem).level
        lower, upper = problem.box
        if (
            problem.within_reach
            and problem.attainable == PLAN
            and np.any((lower < level) & (level < upper))
        ):
            yield problem, limit.copy(), level


def test_certificate_holds_at_the_optimum_and_nowhere_else():
    tried = 0
    for problem, limit, level in with_a_choice(300):
        assert certificate(problem, limit, level)
        lower, upper = problem.box
        free = np.flatnonzero((lower < level - 1e-8) & (level + 1e-8 < upper))
        for moved in (level - 1e-9 * PLAN, level + 1e-9 * PLAN):
            # all conditions but the sum hold
            assert not certificate(problem, np.clip(moved, lower, upper), moved)
            for j in free[:3]:
                one = limit.copy()
                one[j] = moved
                assert not certificate(problem, one, level)
        outside = limit.copy()
        outside[0] = np.nextafter(upper[0], np.inf)
        assert not certificate(problem, outside, level)
        tried += free.size > 0
    assert tried > 50


def test_a_light_unit_is_certified_though_the_sum_hardly_counts_it():
    # by hand: the heavy unit stands at its cap, the light one (1e-6 of it) carries 1e6 times what that lacks
    problem = AllocationProblem([0.17 - 5e-8, 0.30], 0.17, mass=[1e6, 1.0])
    answer = find_rule("qp")(problem)
    assert answer.status == "ok"
    assert answer.limit[1] == pytest.approx(0.22, rel=1e-9)
    wrong = np.array([0.17 - 5e-8, 0.22001])
    assert abs(np.average(wrong, weights=problem.weight) - 0.17) < 1e-10
    assert not certificate(problem, wrong, 0.22001)


def test_a_wrong_active_set_is_refused():
    refused = 0
    for problem, limit, level in with_a_choice(200):
        excess, out = level - limit, np.empty(problem.n)
        lower, upper = problem.box
        arguments = (lower, upper, problem.weight, PLAN)
        assert polish(*arguments, limit, excess, out)[2]
        capped = np.flatnonzero((upper < level - 1e-6) & (lower < upper))
        if capped.size:
            excess[capped[0]] = 0.0  # taken for a unit inside its bounds
            guess = limit.copy()
            guess[capped[0]] = 0.5 * (lower + upper)[capped[0]]
            accepted = polish(*arguments, guess, excess, out)[2]
            assert not accepted or np.allclose(out, limit, rtol=1e-9)
            refused += not accepted
    assert refused > 20


def test_an_interrupt_during_a_solve_reaches_python(monkeypatch):
    problem = AllocationProblem([0.1, 0.2, 0.3], 0.17)
    find_rule("qp")(problem)
    work = qp.workspace(qp.OsqpProblem, 3)
    info = SimpleNamespace(status_val=work.interrupted, status="interrupted", rho_updates=0)
    solver = Mock(info=info, solution=SimpleNamespace(x=np.zeros(3), y=np.zeros(4)))
    monkeypatch.setattr(work, "solver", solver)
    heard = []
    before = signal.signal(signal.SIGINT, lambda *_: heard.append(True))
    try:
        assert find_rule("qp")(problem).status == "qp failed (interrupted): exact level used"
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard
    monkeypatch.undo()
    assert find_rule("qp")(problem).status == "ok"


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


@looped("probability", [0.6, 0.9, 0.99])
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


@looped("probability", [0.0, 0.49, 1.0, 1.2, np.nan, None, "sure", True])
def test_impossible_probabilities_are_refused(probability):
    problem = AllocationProblem(CAP, EXPECTED, deviation=DEVIATION)
    for ask in (robust_rule, lambda p: chance_constrained(problem, p)):
        with pytest.raises(AllocationError, match=r"probability = .* must be a number with 0.5"):
            ask(probability)


def test_rule_of_another_probability_keeps_its_name():
    assert robust_rule(0.95).name == QP_ROBUST.name == "qp-robust"
    assert robust_rule(0.95).answer.keywords == {"probability": 0.95}
    assert "0.95" in robust_rule(0.95).description
