"""Time per call of every allocation rule, all in one run: `make bench`. Ratios are compared within the run only."""

import time
from itertools import cycle

import numpy as np
import pytest

from alloc.compilation import jit
from alloc.records import address_of
from alloc.rules import RULES, AllocationProblem, find_rule
from alloc.rules.exact import polish
from alloc.rules.rule import LAW, Units, law_at

EXPECTED = 0.17
CALLS = 200


def sequence(n):
    """Problems of a train whose adhesion wanders, as slip after slip would pose them."""
    generator = np.random.default_rng(11)
    shape = 0.0083 * np.log(np.arange(1, n + 1))
    shape -= shape.mean()
    return [
        AllocationProblem(
            EXPECTED * (1.0 + 0.1 * np.sin(0.1 * k)) + shape + 0.01 * generator.standard_normal(n),
            EXPECTED,
        )
        for k in range(CALLS)
    ]


@pytest.mark.parametrize("n", [8, 16, 64])
@pytest.mark.parametrize("rule", RULES)
def test_call(benchmark, rule, n):
    benchmark.group = f"one call, {n} units"
    problems, answer = sequence(n), find_rule(rule)
    for problem in problems:  # what a problem derives from itself is not the rule's time
        _ = problem.box, problem.attainable, problem.torque_limit, problem.in_force
        _ = problem.obtained, problem.available, problem.within_reach
    answer(problems[0])
    position = cycle(range(CALLS))

    def setup():
        return (problems[next(position)],), {}

    rounds = 50 if rule == "qp-cvxpy" else 500
    result = benchmark.pedantic(answer, setup=setup, rounds=rounds, warmup_rounds=20)
    assert result.status == "ok"
    if benchmark.stats is not None:
        times = np.array(benchmark.stats.stats.data)
        benchmark.extra_info["median_us"] = round(1e6 * float(np.median(times)), 2)
        benchmark.extra_info["p99_us"] = round(1e6 * float(np.quantile(times, 0.99)), 2)


@jit
def repeat(law, caps, expected, mass, limit_max, limit):
    """As the compiled simulation calls it: one rule over all rows of `caps`; the sum keeps the calls alive."""
    total = 0.0
    for k in range(caps.shape[0]):
        units = Units(caps[k], mass, limit_max, limit, limit, limit, limit_max, caps[k], expected)
        level, _ = law_at(law)(units, expected, limit)
        total += level
    return total


@pytest.mark.parametrize("n", [8, 16, 64])
@pytest.mark.parametrize("rule", ["greedy", "exact"])
def test_compiled(benchmark, rule, n):
    benchmark.group = f"{CALLS} calls inside compiled code, {n} units"
    caps = np.array([problem.cap for problem in sequence(n)])
    arguments = (
        address_of(RULES[rule].law, LAW),
        caps,
        EXPECTED,
        np.ones(n),
        np.full(n, np.inf),
        np.empty(n),
    )
    total = benchmark(repeat, *arguments)
    assert total > 0.0


@pytest.mark.parametrize("n", [8, 16, 64])
def test_certificate(benchmark, n):
    # what `qp` does after OSQP: the level of its active set, and the proof that this is the optimum
    benchmark.group = f"one call, {n} units"
    problem = sequence(n)[1]
    exact = find_rule("exact")(problem)
    arguments = (*problem.box, problem.weight, EXPECTED, exact.limit, exact.level - exact.limit)
    assert benchmark(polish, *arguments, np.empty(n))[2]


def best_of(call, rounds):
    """Shortest time of `call` [s]: what the machine's other work cannot make longer."""
    times = []
    for _ in range(rounds):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return min(times)


def test_exact_is_faster_than_the_solvers():
    # the margins measured are three and five times these (docs/limits.md); they guard the order of magnitude, within one run
    problems = sequence(16)
    took = {}
    for rule, rounds in (("exact", 20), ("qp", 20), ("qp-cvxpy", 2)):
        answer = find_rule(rule)
        answer(problems[0])
        few = problems[:20]
        took[rule] = best_of(lambda answer=answer, few=few: [answer(p) for p in few], rounds)
    assert took["exact"] < took["qp"] / 2
    assert took["exact"] < took["qp-cvxpy"] / 40
