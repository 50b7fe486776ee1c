"""Rules against their transcription in fractions, and what the patent promises of both readings of its rule."""

import math
import time
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from alloc.old.rules import AllocationProblem, find_rule
from alloc.old.rules.exact import box_limits, optimality
from alloc.old.rules.patent import description_level
from alloc.old.rules.rule import Units, units_of
from alloc.old.rules.testing import EXPECTED, problems
from tests.cases import looped
from tests.rules import references as reference
from tests.rules.references import exact_level, reference_limits

any_caps = problems(64, bounded=False).map(lambda problem: problem.cap)


growing = problems(64, bounded=False, growing=True).map(lambda problem: problem.cap)


READINGS = {"greedy": "description", "greedy-claim": "claim"}


def as_exactly(values):
    return [Fraction(float(v)) for v in values]


@looped("rule", READINGS)
@given(cap=any_caps)
@example(cap=np.array([EXPECTED]))
@example(cap=np.array([0.0, 2 * EXPECTED]))
def test_equals_the_transcription(rule, cap):
    limits, level, case = reference_limits(as_exactly(cap), Fraction(EXPECTED), READINGS[rule])
    answer = find_rule(rule)(AllocationProblem(cap, EXPECTED))
    assert answer.case == case
    assert answer.level == float(level)
    assert answer.limit.tolist() == [float(x) for x in limits]


def test_level_of_many_units_is_that_of_the_plain_scan_in_time_near_linear():
    def caps(n):
        yield np.linspace(0.14, 0.21, n)
        yield np.random.default_rng(n).uniform(0.1, 0.25, n)
        yield np.r_[np.full(n // 2, 0.1), np.linspace(EXPECTED, 0.35, n // 2)]
        yield np.r_[np.full(n // 2, 0.168), EXPECTED + np.geomspace(1e-6, 0.06, n // 2)]

    def least_time(cap):
        times = []
        for _ in range(30):
            started = time.thread_time_ns()
            description_level(cap, EXPECTED)
            times.append(time.thread_time_ns() - started)
        return min(times)

    for few, many in zip(caps(512), caps(4096), strict=True):
        front = int(np.argmax(few >= EXPECTED))
        enough = np.cumsum(EXPECTED - few[:front])[-1] * (1 - 1e-12) if front else 0.0
        sums = (
            (one, np.cumsum(np.minimum(few[front:], one) - EXPECTED)[-1]) for one in few[front:]
        )
        assert description_level(few, EXPECTED) == next(
            one for one, large in sums if large >= enough
        )
        # eight times the units: quadratic would be 64 times
        assert least_time(many) < 14 * least_time(few)


@given(cap=growing)
def test_claim_delivers_the_plan_where_caps_grow(cap):
    answer = find_rule("greedy-claim")(AllocationProblem(cap, EXPECTED))
    if answer.case == "B":
        assert answer.limit.sum() >= cap.size * EXPECTED


@given(cap=any_caps)
def test_level_is_never_below_the_exact_one(cap):
    problem = AllocationProblem(cap, EXPECTED)
    greedy, exact = find_rule("greedy")(problem), find_rule("exact")(problem)
    if greedy.case == "B":
        assert greedy.level >= exact.level - 1e-15


@given(cap=growing)
def test_gap_to_the_exact_level_is_less_than_a_step_of_the_caps(cap):
    level = exact_level(as_exactly(cap), Fraction(EXPECTED))
    assume(level is not None)
    answer = find_rule("greedy")(AllocationProblem(cap, EXPECTED))
    m = int(np.flatnonzero(cap == answer.level)[0])
    below = max(cap[m - 1], EXPECTED) if m > 0 else EXPECTED
    gap = Fraction(answer.level) - level
    assert gap <= Fraction(answer.level) - Fraction(float(below))
    if cap[0] < EXPECTED and cap[m] > EXPECTED:  # a deficit exists: then the gap is strictly below
        assert gap < Fraction(answer.level) - Fraction(float(below))


@given(cap=growing)
def test_claim_stops_no_earlier_than_the_description(cap):
    problem = AllocationProblem(cap, EXPECTED)
    assert find_rule("greedy-claim")(problem).level >= find_rule("greedy")(problem).level


def test_claim_can_fall_short_where_caps_do_not_grow():
    # The running sum covers the deficit 0.050 at unit 2 and 3 together, and stops at unit 3's low cap.
    cap = np.array([0.120, 0.215, 0.175, 0.240])
    problem = AllocationProblem(cap, 0.170)
    claim, description = find_rule("greedy-claim")(problem), find_rule("greedy")(problem)
    assert claim.case == description.case == "B"
    assert claim.level == 0.175
    assert claim.unmet == pytest.approx(0.170 - (0.120 + 3 * 0.175) / 4)
    assert description.unmet == 0.0


SHAPE = np.array([0.0, 0.010, 0.016, 0.021, 0.024, 0.027, 0.029, 0.031])


@looped("rule", ["greedy", "greedy-claim", "exact", "qp"])
def test_cases_meet_without_a_jump_in_the_limits(rule):
    # at mean cap = plan case A gives the caps; just beyond it case B must give nearly the same
    edge = 0.170 - SHAPE.mean()
    for step in (1e-6, 1e-8):
        low = find_rule(rule)(AllocationProblem(edge - step + SHAPE, 0.170))
        high = find_rule(rule)(AllocationProblem(edge + step + SHAPE, 0.170))
        assert (low.case, high.case) == ("A", "B")
        assert np.max(np.abs(high.limit - low.limit)) <= 16 * step + 1e-9


def test_inside_case_b_the_reference_jumps_and_the_exact_level_does_not():
    adhesion = np.linspace(0.150, 0.169, 4001)
    step = adhesion[1] - adhesion[0]
    levels = {
        rule: np.array(
            [find_rule(rule)(AllocationProblem(a + SHAPE, 0.170)).level for a in adhesion]
        )
        for rule in ("greedy", "exact")
    }
    # L moves at most as fast as all units' lost share falls on the single unit still free
    assert np.max(np.abs(np.diff(levels["exact"]))) <= SHAPE.size * step
    jumps = np.sort(np.diff(levels["greedy"]))[:4]
    # from unit to unit the level falls by the step between their caps: 2, 2, 3, 3 (x 0.001) at the rear of SHAPE
    assert np.all(jumps < -0.0015)


PLAN = Fraction(EXPECTED)


many = settings(max_examples=100)


def exactly(values):
    """Fractions of these numbers; inf stays itself."""
    return [Fraction(float(v)) if math.isfinite(v) else math.inf for v in values]


def as_fractions(problem):
    """What the transcriptions take: cap, mass, torque limit, previous, rate (None: any)."""
    rate = None if problem.rate is None else exactly(problem.rate)
    return (
        exactly(problem.cap), exactly(problem.weight), exactly(problem.torque_limit), exactly(problem.in_force), rate,
    )  # fmt: skip


def check(answer, problem, limits, surplus, atol=1e-12):
    """Limits, case and shortfall are the transcription's; which case it is does not matter where both meet."""
    np.testing.assert_allclose(answer.limit, [float(x) for x in limits], rtol=1e-11, atol=atol)
    mass = exactly(problem.weight)
    if abs(surplus) > 1e-11 * EXPECTED * float(sum(mass)):
        assert answer.case == ("B" if surplus > 0 else "A")
    short = PLAN - sum(m * x for m, x in zip(mass, limits, strict=True)) / sum(mass)
    assert answer.unmet == pytest.approx(max(float(short), 0.0), rel=1e-9, abs=2 * atol)


def accuracy(problem):
    """The exact level's sum holds to 1e-12 of the plan's; the lightest unit may have to bear that alone."""
    return 2e-12 * EXPECTED * problem.weight.sum() / problem.weight.min()


@many
@given(problem=problems())
def test_preset_is_its_transcription(problem):
    cap, mass, torque_limit, previous, rate = as_fractions(problem)
    limits = reference.preset_limits(mass, torque_limit, PLAN)
    limits = reference.inside(limits, *reference.bounds(None, torque_limit, previous, rate))
    surplus = reference.reach(cap, mass, torque_limit, PLAN)
    check(find_rule("preset")(problem), problem, limits, surplus)


@many
@given(problem=problems())
@example(
    AllocationProblem(
        [0.2, 0.2], EXPECTED, mass=[1.0, 1e3], previous=[0.2, 0.2], delivered=[0.1, 0.2]
    )
)
@example(
    AllocationProblem(
        [0.2, 0.2], EXPECTED, mass=[1.0, 1e3], previous=[0.2, 0.2], delivered=[0.2, 0.1]
    )
)
@example(AllocationProblem([0.2], EXPECTED, previous=[0.2], delivered=[0.2 - 0.039 * EXPECTED]))
@example(AllocationProblem([0.2], EXPECTED, previous=[0.2], delivered=[0.2 - 0.041 * EXPECTED]))
def test_sharing_is_its_transcription(problem):
    cap, mass, torque_limit, previous, rate = as_fractions(problem)
    delivered = problem.delivered
    if delivered is None:  # what the caps carry of the limits in force
        delivered = [min(p, c) for p, c in zip(problem.in_force, problem.cap, strict=True)]
    limits = reference.sharing_limits(mass, torque_limit, previous, exactly(delivered), PLAN)
    limits = reference.inside(limits, *reference.bounds(None, torque_limit, previous, rate))
    surplus = reference.reach(cap, mass, torque_limit, PLAN)
    check(find_rule("sharing")(problem), problem, limits, surplus)


def test_sharing_counts_a_negative_estimate_as_nothing():
    # by hand: unit 1 lacks 0.2 of its limit and falls by 0.15 of it; unit 2, twice as heavy, gets 0.15 of 0.2 / 2
    units = units_of(AllocationProblem([0.2, 0.2], 0.2, mass=[1.0, 2.0]))
    units = units._replace(delivered=np.array([-0.1, 0.2]), previous=np.array([0.2, 0.2]))
    limit = np.empty(2)
    find_rule("sharing").law(units, 0.2, limit)
    assert limit == pytest.approx([0.17, 0.215], rel=1e-14)


@looped("rule", ["exact", "oracle"])
@many
@given(problem=problems())
@example(
    AllocationProblem(
        [0.3] * 3, EXPECTED, mass=[1.0, 30.0, 900.0], previous=[0.3, 0.25, 0.05], rate=0.08
    )
)
@example(
    AllocationProblem(
        [0.3] * 3, EXPECTED, mass=[900.0, 30.0, 1.0], previous=[0.2, 0.01, 0.3], rate=0.02
    )
)
@example(
    AllocationProblem([0.3] * 2, EXPECTED, mass=[3.0, 1.0], previous=[0.3, 0.2], rate=[0.1, 0.02])
)
def test_exact_level_is_its_transcription(rule, problem):
    cap, mass, torque_limit, previous, rate = as_fractions(problem)
    if rule == "oracle" and problem.truth is not None:
        cap = exactly(problem.truth)
    lowest, highest = reference.bounds(cap, torque_limit, previous, rate)
    limits, level, _ = reference.level_within(lowest, highest, mass, PLAN)
    surplus = sum(m * (b - PLAN) for m, b in zip(mass, highest, strict=True))
    answer = find_rule(rule)(problem)
    atol = accuracy(problem)
    check(answer, problem, limits, surplus, atol)
    between = [a < level < b for a, b in zip(lowest, highest, strict=True)]
    if abs(surplus) > 1e-11 * EXPECTED * float(sum(mass)) and (surplus < 0 or any(between)):
        assert answer.level == pytest.approx(float(level), rel=1e-11, abs=atol)


@many
@given(
    units=st.lists(
        st.tuples(st.integers(0, 3000), st.integers(500, 1400), st.integers(0, 1000)),
        min_size=2,
        max_size=8,
    )
)
@example(units=[(1000, 1200, 500), (2000, 600, 1000), (0, 500, 200)])
@example(units=[(2500, 1100, 500), (3000, 600, 1000), (2000, 900, 900), (1000, 700, 0)])
def test_level_between_bounds_is_its_transcription(units):
    """Each unit in thousandths: the exponent of its mass, its lower bound and the room above that as shares of the plan."""
    exponent, low, room = np.array(units).T / 1000.0
    mass, lower, upper = 10.0**exponent, EXPECTED * low, EXPECTED * (low + room)
    limit = np.empty(mass.size)
    _, reached = box_limits(lower, upper, mass, EXPECTED, limit)
    limits, _, case = reference.level_within(*map(exactly, (lower, upper, mass)), PLAN)
    atol = 2e-12 * EXPECTED * mass.sum() / mass.min()
    np.testing.assert_allclose(limit, [float(x) for x in limits], rtol=1e-11, atol=atol)
    surplus = mass @ (upper - EXPECTED)
    assert reached == (case == "B") or abs(surplus) < 1e-11 * EXPECTED * mass.sum()


def test_level_where_even_the_lower_bounds_exceed_the_plan_is_the_least_of_them():
    limit = np.empty(3)
    lower, upper = np.array([0.25, 0.22, 0.30]), np.array([0.40, 0.41, 0.42])
    level, reached = box_limits(lower, upper, np.array([1.0, 2.0, 3.0]), 0.2, limit)
    assert (level, reached, limit.tolist()) == (0.22, True, lower.tolist())
    # and out of reach it is the highest upper bound
    level, reached = box_limits(lower, upper, np.array([1.0, 2.0, 3.0]), 0.5, limit)
    assert (level, reached, limit.tolist()) == (0.42, False, upper.tolist())


@looped(("rule", "reading"), [("greedy", "description"), ("greedy-claim", "claim")])
@many
@given(problem=problems())
def test_the_patents_rule_is_cut_to_torque_limits_and_rates_afterwards(rule, reading, problem):
    # it counts units, not masses, and knows neither torque limits nor rates: both are applied to its answer
    cap, _, torque_limit, previous, rate = as_fractions(problem)
    limits, level, case = reference_limits(cap, PLAN, reading)
    limits = [min(x, t) for x, t in zip(limits, torque_limit, strict=True)]
    limits = reference.inside(limits, *reference.bounds(cap, torque_limit, previous, rate))
    answer = find_rule(rule)(problem)
    surplus = sum(cap) - problem.n * PLAN
    check(answer, problem, limits, 1 if case == "B" else -1)
    assert answer.level == pytest.approx(float(level), rel=1e-12)
    assert (surplus > 0) == (case == "B")


@many
@given(problem=problems())
def test_alone_is_the_plan_within_torque_limits_and_rates(problem):
    cap, mass, torque_limit, previous, rate = as_fractions(problem)
    lowest, highest = reference.bounds(None, torque_limit, previous, rate)
    limits = reference.inside([PLAN] * problem.n, lowest, highest)
    surplus = reference.reach(cap, mass, torque_limit, PLAN)
    check(find_rule("alone")(problem), problem, limits, surplus)


@many
@given(problem=problems())
def test_effort_excess_and_use_are_weighted_with_mass(problem):
    cap, mass, *_ = as_fractions(problem)
    answer = find_rule("alone")(problem)
    limits, total = exactly(answer.limit), sum(mass)
    effort = sum(m * x for m, x in zip(mass, limits, strict=True)) / total
    usable = sum(m * min(x, c) for m, x, c in zip(mass, limits, cap, strict=True)) / total
    assert answer.effort(problem) == pytest.approx(float(effort), rel=1e-12)
    assert answer.usable(problem) == pytest.approx(float(usable), rel=1e-12)
    assert answer.excess(problem) == pytest.approx(max(float(effort - PLAN), 0.0), abs=1e-15)


@many
@given(problem=problems())
def test_bounds_of_the_problem_are_the_transcriptions(problem):
    cap, mass, torque_limit, previous, rate = as_fractions(problem)
    for found, known in ((problem.rate_box, None), (problem.box, cap)):
        for one, other in zip(
            found, reference.bounds(known, torque_limit, previous, rate), strict=True
        ):
            np.testing.assert_allclose(one, [float(x) for x in other], rtol=1e-15, atol=1e-16)
    lowest, highest = reference.bounds(cap, torque_limit, previous, rate)
    most, least = (
        sum(m * b for m, b in zip(mass, bound, strict=True)) / sum(mass)
        for bound in (highest, lowest)
    )
    assert problem.attainable == pytest.approx(
        float(min(max(PLAN, least), most)), rel=1e-12, abs=1e-300
    )


def test_fields_of_a_law_are_those_of_the_problem():
    problem = AllocationProblem(
        [0.1, 0.2], 0.15, mass=[3.0, 4.0], limit_max=[0.5, 0.6], previous=[0.11, 0.12], delivered=[0.07, 0.08],
        truth=[0.13, 0.14],
    )  # fmt: skip
    assert [np.asarray(field).tolist() for field in units_of(problem)] == [
        [0.1, 0.2], [3.0, 4.0], [0.5, 0.6], [0.11, 0.12], [0.07, 0.08], [0.13, 0.14], [np.inf] * 2,
        [0.1, 0.2], 0.15
    ]  # fmt: skip
    bare = AllocationProblem([0.1, 0.2], 0.15)
    assert [np.asarray(field).tolist() for field in units_of(bare)] == [
        [0.1, 0.2], [1.0, 1.0], [np.inf] * 2, [0.15] * 2, [0.1, 0.15], [0.1, 0.2], [np.inf] * 2,
        [0.1, 0.2], 0.15
    ]  # fmt: skip
    assert Units._fields == (
        "cap", "mass", "limit_max", "previous", "delivered", "truth", "upper_bound", "mark", "plan"
    )  # fmt: skip


def test_limits_before_bound_nothing_without_a_rate():
    problem = AllocationProblem([0.2, 0.3], 0.1, previous=[0.1, 0.25], limit_max=[0.15, 0.5])
    lower, upper = problem.rate_box
    assert (lower.tolist(), upper.tolist()) == ([0.0, 0.0], [0.15, 0.5])
    lower, upper = problem.box
    assert (lower.tolist(), upper.tolist()) == ([0.0, 0.0], [0.15, 0.3])


def test_a_unit_that_is_short_gets_nothing_of_what_lacks():
    # unit 1 delivers 0.1 of its 0.2: lowered by 0.15 of what it lacks; as much is unit 2's
    problem = AllocationProblem([0.3, 0.3], 0.2, previous=[0.2, 0.2], delivered=[0.1, 0.2])
    assert find_rule("sharing")(problem).limit == pytest.approx([0.185, 0.215], rel=1e-12)


@looped("rule", ["greedy", "greedy-claim", "exact"])
def test_more_than_the_plan_is_case_b_and_just_the_plan_is_not(rule):
    assert find_rule(rule)(AllocationProblem([0.3, 0.11], 0.2)).case == "B"
    assert find_rule(rule)(AllocationProblem([0.3, 0.1], 0.2)).case == "A"
    assert find_rule(rule)(AllocationProblem([0.3, 0.05], 0.2)).case == "A"


def test_the_level_without_reach_is_the_highest_cap():
    for rule in ("greedy", "exact"):
        assert find_rule(rule)(AllocationProblem([0.3, 0.05], 0.2)).level == pytest.approx(0.3)
    assert find_rule("exact")(AllocationProblem([0.3, 0.15], 0.2)).level == pytest.approx(0.25)


@looped("rule", ["alone", "preset", "sharing"])
def test_rules_that_know_no_caps_say_whether_these_allow_more_than_the_plan(rule):
    assert (
        find_rule(rule)(AllocationProblem([0.25, 0.25], 0.25)).case == "A"
    )  # a tie without rounding
    assert find_rule(rule)(AllocationProblem([0.25, 0.26], 0.25)).case == "B"
    assert find_rule(rule)(AllocationProblem([0.25, 0.26], 0.25, limit_max=[0.24, 1.0])).case == "A"
    heavy = AllocationProblem([0.25, 0.26], 0.25, mass=[9.0, 1.0], limit_max=[0.249, 1.0])
    assert find_rule(rule)(heavy).case == "B"  # 9 (-0.001) + 0.01 > 0


@looped("rule", ["exact", "qp"])
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
