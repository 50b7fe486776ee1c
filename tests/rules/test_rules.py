"""The contract that all rules share, the prior art's rules, and what happens without a solver."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from alloc.rules import RULES, AllocationError, AllocationProblem, find_rule, qp
from alloc.rules.dispatch import COMPILED, allocate_compiled, compiled_index
from alloc.rules.problem import CASES
from alloc.rules.rule import TRIGGERS, Caps, Trigger, units_of
from alloc.rules.testing import EXPECTED, problems

NAMES = [
    "alone",
    "preset",
    "sharing",
    "greedy",
    "greedy-literal",
    "greedy-tuned",
    "greedy-claim",
    "exact",
    "qp",
    "qp-cvxpy",
    "qp-robust",
    "cooperative",
    "oracle",
]


def test_names_are_the_contract():
    assert list(RULES) == NAMES
    for name, rule in RULES.items():
        assert rule.name == name
        assert rule.description


def test_oracle_is_the_exact_level_on_the_truth():
    cap, truth = np.array([0.15, 0.20, 0.21]), np.array([0.16, 0.13, 0.25])
    oracle = find_rule("oracle")(AllocationProblem(cap, 0.17, truth=truth))
    assert oracle.limit == pytest.approx(find_rule("exact")(AllocationProblem(truth, 0.17)).limit)
    assert RULES["oracle"].needs_truth
    assert not any(RULES[name].needs_truth for name in NAMES if name != "oracle")


def test_when_rules_are_asked_and_what_they_know():
    others = {
        "preset": (Trigger.TELEGRAM, Caps.FRONT),
        "sharing": (Trigger.STEPWISE, Caps.FRONT),
        "greedy-literal": (Trigger.SLIP, Caps.FRONT),
        "greedy-tuned": (Trigger.ANY_SLIP, Caps.DETECTED),
        "cooperative": (Trigger.LIMITED, Caps.DELIVERED),
        "oracle": (Trigger.PERIOD, Caps.TRUE),
    }
    for name in NAMES:
        usual = Trigger.LIMITED, Caps.FRONT
        assert (RULES[name].trigger, RULES[name].caps) == others.get(name, usual), name
    assert {name for name in NAMES if RULES[name].onboard} == {"greedy-tuned"}


def test_triggers_and_caps_that_do_not_go_together_are_refused():
    for one in Caps:
        for trigger in Trigger:
            if trigger in TRIGGERS[one]:
                assert replace(RULES["exact"], trigger=trigger, caps=one).caps is one
                continue
            with pytest.raises(AllocationError, match=f"'exact'.*{trigger.name}.*{one.name}"):
                replace(RULES["exact"], trigger=trigger, caps=one)
    for name, wrong in (
        ("trigger", "slip"),
        ("trigger", 3),
        ("caps", Trigger.SLIP),
        ("caps", None),
    ):
        with pytest.raises(AllocationError, match=f"'exact': {name} = .* must be one of"):
            replace(RULES["exact"], **{name: wrong})


def test_what_a_rule_brings_along_stands_in_its_description():
    for rule in RULES.values():
        for value in rule.onboard.values():
            assert f" {value:g} " in rule.description


def test_alone_keeps_the_plan():
    answer = find_rule("alone")(AllocationProblem([0.10, 0.30], 0.17, limit_max=[np.inf, 0.16]))
    assert answer.limit.tolist() == [0.17, 0.16]


@given(problem=problems(24))
def test_preset_pattern_delivers_the_plan_where_torque_allows(problem):
    answer = find_rule("preset")(problem.changed(limit_max=None, previous=None, rate=None))
    assert answer.effort(problem) == pytest.approx(EXPECTED, rel=1e-12)
    assert np.all(np.diff(answer.limit) >= 0.0)


def test_dynamic_sharing_settles_at_the_plan_step_by_step():
    # the prior art's weakness: each step hands on a part, so torque wanders until it settles
    adhesion = np.array([0.12, 0.16, 0.20, 0.21])
    limit, efforts = np.full(4, 0.17), []
    for _ in range(40):
        delivered = np.minimum(limit, adhesion)
        answer = find_rule("sharing")(
            AllocationProblem(adhesion, 0.17, previous=limit, delivered=delivered)
        )
        limit = answer.limit
        efforts.append(np.minimum(limit, adhesion).mean())
    assert efforts[0] < 0.999 * 0.17
    assert efforts[-1] == pytest.approx(0.17, rel=0.01)
    assert next(k for k, effort in enumerate(efforts) if effort > 0.99 * 0.17) >= 2


@given(problem=problems(64, bounded=False))
def test_compiled_call_equals_the_python_call(problem):
    for index, rule in enumerate(COMPILED):
        assert compiled_index(rule) == index
        if rule.caps is Caps.DELIVERED:  # its law needs what a run remembers, see test_cooperative
            continue
        limit = np.empty(problem.n)
        level, case = allocate_compiled(index, units_of(problem), problem.expected, limit)
        answer = find_rule(rule.name)(problem)
        assert limit.tolist() == answer.limit.tolist()
        assert CASES[case] == answer.case
        np.testing.assert_equal(level, answer.level)


def test_a_rule_that_compiled_code_does_not_know_keeps_the_plan_within_torque():
    problem = AllocationProblem([0.3, 0.3], EXPECTED, limit_max=[0.5 * EXPECTED, np.inf])
    limit = np.empty(2)
    level, case = allocate_compiled(-1, units_of(problem), EXPECTED, limit)
    assert (limit.tolist(), CASES[case]) == ([0.5 * EXPECTED, EXPECTED], "none")
    assert np.isnan(level)


def test_every_rule_with_a_law_is_known_to_compiled_code():
    for rule in RULES.values():
        known = compiled_index(rule)
        assert known == -1 if rule.law is None else COMPILED[known].law is rule.law
        assert rule.law is None or known >= 0
    assert compiled_index(find_rule("qp")) == -1


@pytest.mark.parametrize(
    ("name", "near"), [("greedi", "greedy"), ("exakt", "exact"), ("qp_cvxpy", "qp-cvxpy")]
)
def test_unknown_rule_is_refused_with_the_nearest_name(name, near):
    with pytest.raises(AllocationError, match=f"{name}.*did you mean '{near}'"):
        find_rule(name)


@pytest.mark.parametrize(("rule", "module"), [("qp", "osqp"), ("qp-cvxpy", "cvxpy")])
def test_missing_solver_is_named(rule, module, monkeypatch):
    qp.workspace.cache_clear()
    qp.formulation.cache_clear()
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(
        AllocationError, match=f"rule '{rule}' needs '{module}'.*pip install {module}"
    ):
        find_rule(rule)(AllocationProblem([0.1, 0.2], 0.15))


def test_failing_solver_gives_the_exact_level_and_says_so(monkeypatch):
    problem = AllocationProblem(np.linspace(0.12, 0.22, 11), 0.17, mass=np.linspace(1.0, 2.0, 11))
    qp.workspace.cache_clear()
    monkeypatch.setitem(qp.SETTINGS, "max_iter", 1)
    answer = find_rule("qp")(problem)
    qp.workspace.cache_clear()
    assert answer.status.startswith("qp failed (")
    assert answer.status.endswith("exact level used")
    exact = find_rule("exact")(problem)
    assert answer.limit.tolist() == exact.limit.tolist()
    assert answer.level == exact.level


def test_workspace_is_set_up_once_per_size():
    qp.workspace.cache_clear()
    rule = find_rule("qp")
    generator = np.random.default_rng(5)
    for _ in range(20):
        rule(AllocationProblem(EXPECTED * generator.uniform(0.5, 1.5, 8), EXPECTED))
        rule(AllocationProblem(EXPECTED * generator.uniform(0.5, 1.5, 3), EXPECTED))
    assert qp.workspace.cache_info().misses == 2


def test_change_of_masses_reaches_the_workspace():
    cap = [0.12, 0.30, 0.30]
    for mass in ([2.0, 1.0, 1.0], [1.0, 1.0, 4.0], None, [2.0, 1.0, 1.0]):
        problem = AllocationProblem(cap, 0.17, mass=mass)
        assert find_rule("qp")(problem).limit == pytest.approx(
            find_rule("exact")(problem).limit, abs=1e-9
        )
