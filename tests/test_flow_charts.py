"""JP5484215, Figs. 7 to 9, transcribed: the rules on any caps, the leader in a run; what the steps lead to."""

from fractions import Fraction

import numpy as np
import pytest

from alloc.rules import RULES, AllocationProblem
from alloc.run.simulation import simulate
from studies.files.scenario_files import load_scenario

READINGS = {"greedy": "description", "greedy-claim": "claim"}
GROWTH = np.array([0.0, 0.010, 0.016, 0.021, 0.024, 0.027, 0.029, 0.031])
CASES = "none", "A", "B"


def flow_chart(cap, planned, rule):
    """Limits, level and case from caps."""
    n, claim = len(cap), READINGS[rule] == "claim"
    if sum(cap) / n <= planned:  # S206, S207: (7)
        return list(cap), max(cap), "A"  # S208
    expected = next(j for j in range(n) if cap[j] >= planned)
    small = sum(planned - one for one in cap[:expected])  # S209: (8)
    for j in range(expected, n):  # S210: (9), S211
        added = cap[expected : j + 1] if claim else [min(one, cap[j]) for one in cap[expected:]]
        if sum(one - planned for one in added) >= small:
            break
    return [min(one, cap[j]) for one in cap], cap[j], "B"  # S212 to S214: (10), (11)


@pytest.mark.parametrize("rule", READINGS)
def test_rules_answer_by_the_charts_and_motors_cut_their_answer(rule):
    rng = np.random.default_rng(5)
    for _ in range(300):
        n, planned = rng.integers(1, 12), Fraction(int(rng.integers(2, 12)), 16)
        cap = [Fraction(int(one), 16) for one in rng.integers(0, 14, n)]
        limits, level, case = flow_chart(cap, planned, rule)
        most, mass = rng.uniform(0.0, 1.0, n), rng.uniform(0.1, 10.0, n)  # which counts for nothing
        problem = AllocationProblem([float(x) for x in cap], float(planned), mass, limit_max=most)
        found = RULES[rule](problem)
        assert (found.level, found.case) == (float(level), case)
        assert list(found.limit) == list(np.minimum([float(x) for x in limits], most))


@pytest.mark.parametrize("rule", READINGS)
def test_the_leader_goes_through_the_charts_at_its_slips_and_lifts_limits_a_set_time_later(rule):
    start = load_scenario("wet-start")
    rail = start.rail.model_dump() | {"patches": [{"factor": 1.5, "begin_s": 3.0}]}
    command = [{"time_s": t, "acceleration_kmhs": a} for t, a in ((0.0, 3.0), (2.5, 2.9))]
    keys = {"duration_s": 7.0, "rail": rail, "onboard": {"hold_time_s": 2.0}}
    belief = RULES[rule].with_belief("front detected")
    run = simulate(start.changed(command=command, **keys).event(), belief, "cut-and-ramp")
    driven, along = run["axle_unit"].values, 0.0166 * np.log(np.arange(1, 33)) - 0.0132  # (15)
    increment = np.array([along[driven == j].mean() for j in range(4)])
    slips, detected, cases = run["slipping"].values[:, 0], -np.inf, []
    for k, (time, planned) in enumerate(zip(run["time"].values, run["plan"].values, strict=True)):
        if slips[k] > slips[k - 1]:  # S203
            estimate = run["coefficient_estimate"].values[k, 0]
            detected, cap = time, estimate + increment - increment[0]  # S204, S205: (5)
        wanted, level, case = [np.inf] * 4, np.nan, "none"  # S216
        if time - detected < 2.0 + 1e-6:
            wanted, level, case = flow_chart(list(cap), planned, rule)
        found = *run["wanted"].values[k], run["level"].values[k]
        assert found == pytest.approx((*wanted, level), rel=1e-12, nan_ok=True)
        cases.append(case)
    assert [CASES[one] for one in run["case"].values] == cases
    assert (cases[0], "B" in cases, cases[-1]) == ("none", True, "none")


def test_the_level_exceeds_the_exact_one_by_less_than_a_step_of_caps_that_grow():
    names, before = ("greedy", "greedy-claim", "exact"), "A"
    for cap in np.linspace(0.140, 0.169, 200)[:, None] + GROWTH:
        found, claim, exact = (RULES[name](AllocationProblem(cap, 0.170)) for name in names)
        if found.case == "B":
            step = cap - np.maximum(np.r_[0.0, cap[:-1]], 0.170)
            assert 0.0 <= found.level - exact.level < step[cap == found.level][0]
            assert found.unmet == claim.unmet == 0.0
        if found.case != before:  # where the cases meet limits do not jump
            assert found.limit == pytest.approx(cap, abs=2e-3)
        before = found.case
