"""Both readings of the patent's rule against their literal transcription, and what the patent promises of them."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given

from alloc.rules import AllocationProblem, find_rule
from alloc.rules.testing import EXPECTED, problems
from tests.rules.reference import exact_level, reference_limits

any_caps = problems(64, bounded=False).map(lambda problem: problem.cap)
growing = problems(64, bounded=False, growing=True).map(lambda problem: problem.cap)
READINGS = {"greedy": "description", "greedy-claim": "claim"}


def exactly(values):
    return [Fraction(float(v)) for v in values]


@pytest.mark.parametrize("rule", READINGS)
@given(cap=any_caps)
@example(cap=np.array([EXPECTED]))
@example(cap=np.array([0.0, 2 * EXPECTED]))
def test_equals_the_transcription(rule, cap):
    limits, level, case = reference_limits(exactly(cap), Fraction(EXPECTED), READINGS[rule])
    answer = find_rule(rule)(AllocationProblem(cap, EXPECTED))
    assert answer.case == case
    assert answer.level == float(level)
    assert answer.limit.tolist() == [float(x) for x in limits]


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
    level = exact_level(exactly(cap), Fraction(EXPECTED))
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


def test_figure_6a_level_is_the_cap_of_the_third_car():
    # By hand. Mean cap 0.17725 > 0.170: case B. Cars 1 and 2 are below the plan: deficit 0.020 + 0.005 = 0.025.
    # Candidate car 3: its cap bounds cars 3 to 8, surplus 6 x (0.176 - 0.170) = 0.036 >= 0.025. So the level is 0.176.
    cap = np.array([0.150, 0.165, 0.176, 0.180, 0.183, 0.186, 0.188, 0.190])
    answer = find_rule("greedy")(AllocationProblem(cap, 0.170))
    assert answer.case == "B"
    assert answer.level == cap[2]
    assert answer.limit.tolist() == [0.150, 0.165] + [0.176] * 6
    # Claim 1 adds car by car: 0.006, 0.016, 0.029 >= 0.025: it stops at car 5.
    assert find_rule("greedy-claim")(AllocationProblem(cap, 0.170)).level == cap[4]
    # Equal areas: 6 (L - 0.170) = 0.025.
    assert find_rule("exact")(AllocationProblem(cap, 0.170)).level == pytest.approx(
        0.170 + 0.025 / 6
    )


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


@pytest.mark.parametrize("rule", ["greedy", "greedy-claim", "exact", "qp"])
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
