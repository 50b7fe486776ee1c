"""The contract that all rules share, baselines, the prior art's and the project's own rule, and what is refused."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

from alloc.compilation import jit
from alloc.metrics import evaluate
from alloc.records import address_of
from alloc.rules import RULES, AllocationError, AllocationProblem, find_rule, qp
from alloc.rules.baselines import GAIN, TIMES
from alloc.rules.exact import cooperative_law
from alloc.rules.problem import CASE_A, CASE_B, CASES
from alloc.rules.rule import LAW, TRIGGERS, Caps, Trigger, Units, law_at, units_of
from alloc.rules.testing import EXPECTED, laws_of_rule, problems
from alloc.simulation import simulate
from studies.scenario import load as load_scenario
from tests.cases import looped
from tests.rules.references import redistributed

NAMES = [
    "alone",
    "plan-times",
    "uniform",
    "preset",
    "sharing",
    "erp",
    "greedy",
    "greedy-printed",
    "greedy-literal",
    "greedy-tuned",
    "greedy-claim",
    "exact",
    "qp",
    "qp-daqp",
    "qp-cvxpy",
    "qp-robust",
    "cooperative",
    "wear",
    "wear-qp",
    "wear-cvxpy",
    "preview",
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


def test_a_preview_asks_nobody_for_more_than_the_truth():
    """0.04 are missing at unit 2, and the two others have room for 0.02 each; unit 3 is at its cap's truth."""
    for truth, limit in (
        ([0.25, 0.13, 0.25], [0.19, 0.13, 0.19]),
        ([0.25, 0.13, 0.18], [0.20, 0.13, 0.18]),
        ([0.12, 0.13, 0.14], [0.12, 0.13, 0.14]),
    ):
        problem = AllocationProblem([0.15, 0.20, 0.21], 0.17, truth=truth)
        assert RULES["preview"](problem).limit == pytest.approx(limit, rel=1e-12)


def test_when_rules_are_asked_and_what_they_know():
    others = {
        "uniform": (Trigger.LIMITED, Caps.DELIVERED),
        "preset": (Trigger.TELEGRAM, Caps.FRONT),
        "sharing": (Trigger.STEPWISE, Caps.FRONT),
        "greedy-printed": (Trigger.SLIP, Caps.FRONT),
        "greedy-literal": (Trigger.SLIP, Caps.FRONT),
        "greedy-tuned": (Trigger.ANY_SLIP, Caps.DETECTED),
        "cooperative": (Trigger.LIMITED, Caps.DELIVERED),
        "preview": (Trigger.LIMITED, Caps.PREVIEW),
        "oracle": (Trigger.PERIOD, Caps.TRUE),
    } | dict.fromkeys(("wear", "wear-qp", "wear-cvxpy"), (Trigger.TELEGRAM, Caps.DELIVERED))
    for name in NAMES:
        usual = Trigger.LIMITED, Caps.FRONT
        assert (RULES[name].trigger, RULES[name].caps) == others.get(name, usual), name
    assert {name for name in NAMES if RULES[name].onboard} == {"greedy-printed", "greedy-tuned"}


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
    tuned = RULES["greedy-tuned"]
    assert all(f" {value:g} " in tuned.description for value in tuned.onboard.values())


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


def test_plan_times_asks_all_for_the_same_multiple_within_torque():
    answer = find_rule("plan-times")(AllocationProblem([0.1, 0.3], 0.17, limit_max=[np.inf, 0.2]))
    assert answer.limit == pytest.approx([TIMES * 0.17, 0.2])
    # it wins wherever effort counts without a bound, and that is not what the driver asked for
    event = load_scenario("wet-front").event()
    times, own = (
        evaluate(simulate(event, rule, "perturb-observe")) for rule in ("plan-times", "cooperative")
    )
    assert times["effort_ratio"] > own["effort_ratio"] + 0.01
    assert times["over_delivery"] > 0.01 > own["over_delivery"]


def test_uniform_asks_all_for_the_same_until_the_train_has_the_plan_or_no_more_can_be_had():
    adhesion, mass = np.array([0.12, 0.16, 0.20, 0.21]), np.array([1.0, 2.0, 2.0, 1.0])
    for most, reached in ((1.0, 0.17), (0.18, (0.12 + 2 * 0.16 + 3 * 0.18) / 6)):
        limit = np.full(4, 0.17)
        for _ in range(80):
            limit = find_rule("uniform")(
                AllocationProblem(
                    adhesion, 0.17, mass=mass, previous=limit, limit_max=np.full(4, most),
                    delivered=np.minimum(limit, adhesion),
                )
            ).limit  # fmt: skip
            assert np.ptp(limit) == 0.0
            assert 0.17 <= limit[0] <= most
        got = np.average(np.minimum(limit, adhesion), weights=mass)
        assert got == pytest.approx(reached, rel=2e-3)
    # what is delivered beyond the plan is taken back, down to the plan
    more = find_rule("uniform")(
        AllocationProblem(adhesion, 0.17, previous=np.full(4, 0.3), delivered=np.full(4, 0.3))
    )
    assert more.limit == pytest.approx(0.3 - GAIN * 0.13)


@given(problem=problems(24))
def test_erp_is_the_redistributed_pseudo_inverse_and_in_the_norm_of_exact_the_exact_level(problem):
    problem = problem.changed(rate=None)
    cap, mass, plan = problem.cap, problem.weight, problem.expected
    upper = np.minimum(cap, problem.torque_limit)
    found = find_rule("erp")(problem).limit
    least = redistributed(upper, mass, np.maximum(cap, 1e-9), plan * mass.sum())
    np.testing.assert_allclose(found, least, rtol=1e-9, atol=1e-9)
    judged = replace(find_rule("erp"), promise="exact")
    for law in laws_of_rule(judged):  # each but those that say that the exact level is the optimum
        if law.name in ("in the box", "attainable sum"):
            assert law.amount(judged, problem) < 1e-11
    if problem.within_reach:
        deviation = redistributed(upper - plan, mass, np.ones(problem.n), 0.0)
        np.testing.assert_allclose(plan + deviation, find_rule("exact")(problem).limit, rtol=1e-9)


@jit
def by_address(law, units, expected, limit_out):
    return law_at(law)(units, expected, limit_out)


@given(problem=problems(64, bounded=False))
def test_compiled_call_equals_the_python_call(problem):
    """As the loop of a run calls a law, by its address, so does Python."""
    lawful = [rule for rule in RULES.values() if rule.law is not None]
    assert len({rule.law for rule in lawful}) >= 11
    for rule in lawful:
        if rule.name == "cooperative":  # its law needs what a run remembers, see below
            continue
        limit, address = np.empty(problem.n), address_of(rule.law, LAW)
        *arrays, plan = units_of(problem)
        units = Units(*map(np.array, arrays), plan)  # the loop's may be written
        level, reached = by_address(address, units, problem.expected, limit)
        answer = rule(problem)
        assert limit.tolist() == answer.limit.tolist()
        assert CASES[CASE_B if reached else CASE_A] == answer.case
        np.testing.assert_equal(level, answer.level)


@looped(("name", "near"), [("greedi", "greedy"), ("exakt", "exact"), ("qp_cvxpy", "qp-cvxpy")])
def test_unknown_rule_is_refused_with_the_nearest_name(name, near):
    with pytest.raises(AllocationError, match=f"{name}.*did you mean '{near}'"):
        find_rule(name)


@pytest.mark.parametrize(
    ("rule", "module"), [("qp", "osqp"), ("qp-daqp", "daqp"), ("qp-cvxpy", "cvxpy")]
)
def test_missing_solver_is_named(rule, module, monkeypatch):
    qp.workspace.cache_clear()
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


GOOD = {"cap": [0.1, 0.2], "expected": 0.15}


@looped(
    ("changes", "message"),
    [
        ({"cap": [0.1, np.nan]}, r"cap\[1\] = nan"),
        ({"cap": [-0.1, 0.2]}, r"cap\[0\] = -0.1"),
        ({"cap": [0.1, np.inf]}, r"cap\[1\] = inf"),
        ({"cap": []}, r"cap has shape \(0,\)"),
        ({"cap": [[0.1, 0.2]]}, r"cap has shape \(1, 2\)"),
        ({"cap": "wet"}, r"cap = 'wet' must be an array of numbers"),
        ({"cap": 0.1}, r"cap has shape \(\)"),
        ({"expected": 0.0}, "expected = 0.0"),
        ({"expected": -0.1}, "expected = -0.1"),
        ({"expected": np.nan}, "expected = nan"),
        ({"expected": None}, "expected = None"),
        ({"expected": True}, "expected = True"),
        ({"expected": [0.1]}, r"expected = \[0.1\]"),
        ({"mass": [1.0, 0.0]}, r"mass\[1\] = 0.0 must be finite and greater than 0"),
        ({"mass": [1.0, -1.0]}, r"mass\[1\] = -1.0 must be finite and greater than 0"),
        ({"mass": [1.0]}, r"mass has shape \(1,\), must be \(2,\)"),
        ({"mass": [1.0, np.nan]}, r"mass\[1\] = nan"),
        ({"limit_max": [0.1, -1.0]}, r"limit_max\[1\] = -1.0 must be a number 0 or greater"),
        ({"limit_max": [0.1, np.nan]}, r"limit_max\[1\] = nan"),
        ({"previous": [0.1, np.inf]}, r"previous\[1\] = inf"),
        ({"rate": 0.1}, "give previous too"),
        ({"previous": [0.1, 0.1], "rate": -0.1}, r"rate\[0\] = -0.1"),
        ({"previous": [0.1, 0.1], "rate": [0.1, 0.1, 0.1]}, r"rate has shape \(3,\)"),
        ({"delivered": [np.nan, 0.1]}, r"delivered\[0\] = nan"),
        ({"truth": [0.1, -0.2]}, r"truth\[1\] = -0.2"),
        ({"deviation": [0.01, -0.01]}, r"deviation\[1\] = -0.01"),
        ({"deviation": [0.01, np.inf]}, r"deviation\[1\] = inf"),
        ({"deviation": 0.01}, r"deviation has shape \(\), must be \(2,\)"),
        ({"slip": "yes"}, "slip = 'yes' must be True or False"),
    ],
)
def test_is_refused_by_name_and_value(changes, message):
    with pytest.raises(AllocationError, match=message) as caught:
        AllocationProblem(**(GOOD | changes))
    assert isinstance(caught.value, ValueError)
    assert "\n" not in str(caught.value)


def test_infinite_torque_limits_and_rates_are_no_limits():
    AllocationProblem(**GOOD, limit_max=[np.inf, np.inf], previous=[0.1, 0.1], rate=np.inf)


def test_the_problem_keeps_its_own_copy():
    cap = np.array([0.1, 0.2])
    problem = AllocationProblem(cap, 0.15)
    cap[0] = 9.0
    assert problem.cap.tolist() == [0.1, 0.2]
    with pytest.raises(ValueError, match="read-only"):
        problem.cap[0] = 1.0


PLAN = 0.16


@given(problem=problems(24))
def test_its_law_gives_the_plan_at_least_and_within_reach_no_more_than_exact_needs(problem):
    problem = problem.changed(rate=None, previous=None)
    limit = np.empty(problem.n)
    units = units_of(problem)
    level, reached = cooperative_law(units, EXPECTED, limit)
    exact = find_rule("exact")(problem)
    np.testing.assert_equal(level, exact.level)
    assert reached == (exact.case == "B")
    most = np.minimum(max(EXPECTED, level) if reached else np.inf, units.limit_max)
    assert np.all(limit >= np.minimum(EXPECTED, units.limit_max))
    assert np.all(limit <= most + 1e-15)


def limits(cap, upper_bound, most=1.0, plan=PLAN, needed=None):
    """Limits and level of units of equal mass, limited at `cap` and open to `upper_bound`, that together need `needed`."""
    cap, upper_bound = np.asarray(cap, dtype=float), np.asarray(upper_bound, dtype=float)
    same = np.ones(cap.size)
    out = np.empty(cap.size)
    units = Units(cap, same, most * same, out, cap, cap, upper_bound, cap, plan)
    level, reached = cooperative_law(units, plan if needed is None else needed, out)
    return out, level, reached


def test_others_make_up_for_what_a_limited_unit_lacks():
    found, level, reached = limits([0.10, np.inf, np.inf, np.inf], [0.106, np.inf, np.inf, np.inf])
    assert reached
    assert level == pytest.approx(0.18)
    assert found == pytest.approx([PLAN, 0.18, 0.18, 0.18])


def test_no_limit_is_below_the_plan_or_above_what_motors_can():
    found, _, _ = limits([0.10, 0.12, 0.2], [0.106, 0.127, 0.212], most=0.15)
    assert found == pytest.approx([0.15, 0.15, 0.15])


def test_out_of_reach_each_unit_has_room_to_search_the_best_one_too():
    found, _, reached = limits([0.10, 0.15, 0.17], [0.106, 0.159, 0.1802])
    assert not reached
    assert found == pytest.approx([PLAN, PLAN, 0.1802])


def test_what_trailers_lack_is_asked_of_units_with_room_alone():
    """One that its rail limits below the plan keeps the plan: asked for more it would slip, and fill up with air."""
    rng = np.random.default_rng(5)
    for _ in range(200):
        needed = PLAN * rng.uniform(0.9, 1.2)
        cap = np.where(rng.random(8) < 0.4, PLAN * rng.uniform(0.3, 0.9, 8), np.inf)
        found, level, reached = limits(cap, 1.06 * cap, needed=needed)
        room = np.isinf(cap)
        assert reached == (room.any() or cap.mean() > needed)
        np.testing.assert_allclose(found[~room], PLAN)
        # what shoes give beyond their part, while cylinders empty, lowers no limit
        np.testing.assert_allclose(found[room], max(level, PLAN))
        if reached:
            assert np.where(room, level, cap).mean() == pytest.approx(needed)


@looped(("name", "gain"), [("wet-front", 0.03), ("long-train", 0.015)])
def test_where_there_is_headroom_a_searching_controller_gains_most_of_it(name, gain):
    event = load_scenario(name).event()
    alone, own = (
        evaluate(simulate(event, rule, "perturb-observe")) for rule in ("alone", "cooperative")
    )
    assert own["bound_use"] - alone["bound_use"] > gain
    assert own["bound_use"] > 0.99
    assert own["over_delivery"] < 0.005
