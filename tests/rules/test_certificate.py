"""Solvers that certify: "ok" is the optimum to 1e-9 of the plan, also where masses are a million apart."""

import os
import signal
from types import SimpleNamespace

import numpy as np
import pytest
import quadprog

from alloc.rules import AllocationProblem, find_rule, qp
from alloc.rules.exact import certified, polish
from alloc.rules.qp import chance_constrained
from tests.rules.random_problems import PLAN, random_problem

FULL = bool(os.environ.get("READHESION_FULL"))
COUNTS = {"qp": (2000, 100_000), "qp-robust": (1000, 100_000), "qp-cvxpy": (100, 1000)}
"""Rule -> problems by default, and with READHESION_FULL=1."""
EXACT = find_rule("exact")


@pytest.mark.parametrize("rule", COUNTS)
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
    work = qp.workspace(3)
    info = SimpleNamespace(status_val=work.interrupted, status="interrupted", rho_updates=0)
    result = SimpleNamespace(info=info, x=np.zeros(3), y=np.zeros(4))
    monkeypatch.setattr(work.solver, "solve", lambda raise_error: result)
    heard = []
    before = signal.signal(signal.SIGINT, lambda *_: heard.append(True))
    try:
        assert find_rule("qp")(problem).status == "qp failed (interrupted): exact level used"
    finally:
        signal.signal(signal.SIGINT, before)
    assert heard
    monkeypatch.undo()
    assert find_rule("qp")(problem).status == "ok"
