"""Motors that have failed: what is lost, who makes up for it, who leads, and what the unit itself commands."""

from itertools import product

import numpy as np
import pytest

from mpc.group import GroupController
from mpc.model import LostShare, leading, torque_per_coefficient


def _train_with_failures(make_context, seed):
    """What is lost, the units, the plan of each, which of them work (one at least does not), and who leads."""
    rng = np.random.default_rng(seed)
    units = [
        make_context(axle_load=load, mass=mass)
        for load, mass in zip(rng.uniform(60e3, 90e3, 5), rng.uniform(30e3, 60e3, 5), strict=True)
    ]
    works = rng.permutation(np.arange(5) < rng.integers(1, 5))
    plan = rng.uniform(0.05, 0.15) * np.array([torque_per_coefficient(unit) for unit in units])
    return LostShare(units), units, plan, works, int(works.argmax())


def _effort(units, torque):
    """Sum over units of mass times the coefficient at which they hold `torque`."""
    return sum(t / torque_per_coefficient(u) * u.mass for u, t in zip(units, torque, strict=True))


def test_alone_the_demand_with_what_is_lost_is_the_plan(make_context):
    for seed, rise in product(range(20), (0.3, 1.0)):
        lost, _, plan, works, leader = _train_with_failures(make_context, seed)
        demand = np.where(works, rise * plan, 0.0)
        found = lost.wanted(demand, works.tolist(), leader, plan[leader])
        np.testing.assert_array_equal(found[works], demand[works])
        np.testing.assert_allclose(found, rise * plan)
        mirrored = lost.wanted(-demand, works.tolist(), leader, plan[leader])
        np.testing.assert_array_equal(mirrored, -found)


def test_what_a_rule_has_laid_on_the_others_is_not_lost(make_context):
    for seed in range(20):
        lost, units, plan, works, leader = _train_with_failures(make_context, seed)
        left = []
        for more in (0.0, 0.02, 0.1, 50.0):
            demand = np.where(works, plan * (1.0 + more), 0.0)
            found = lost.wanted(demand, works.tolist(), leader, plan[leader])
            np.testing.assert_array_equal(found[works], demand[works])
            assert np.all((found >= 0.0) & (found <= np.maximum(plan, demand) * (1.0 + 1e-12))), (
                seed
            )
            whole = max(_effort(units, plan), _effort(units, demand))
            assert _effort(units, found) == pytest.approx(whole), seed
            left.append(found[~works].sum())
        assert left == sorted(left, reverse=True), seed
        assert left[-1] == 0.0, seed


def test_nothing_is_lost_where_air_brakes_give_it_or_nobody_can_make_up(make_context):
    units = [make_context(blended=True) for _ in range(3)]
    demand = np.array([0.0, 500.0, 500.0])
    lost = LostShare(units)
    works = [False, True, True]
    np.testing.assert_array_equal(lost.wanted(-demand, works, 1, 500.0), -demand)
    np.testing.assert_allclose(lost.wanted(demand, works, 1, 500.0), [500.0] * 3)
    np.testing.assert_array_equal(lost.wanted(demand, [False] * 3, 2, 500.0), [0.0] * 3)
    # what an order has said already is not lost once more
    np.testing.assert_array_equal(lost.wanted(demand, works, 1, 0.0), demand)


def test_the_foremost_unit_that_works_leads(make_sense):
    def sense(works):
        return make_sense(in_service=works)

    for works, leader in (
        ([1, 1, 1], 0),
        ([0, 1, 1], 1),
        ([0, 0, 1], 2),
        ([1, 0, 0], 0),
        ([0, 0, 0], 2),
    ):
        assert leading([sense(bool(one)) for one in works]) == leader


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_units_of_a_car_make_up_for_one_and_it_commands_nothing(make_context, make_sense, sign):
    # four small units of a car, the second of which has failed: three give what four were to give
    units = [make_context(axles=1, mass=14e3) for _ in range(4)]
    controller = GroupController(units)
    for k in range(60):
        senses = [
            make_sense(
                time=0.01 * k, axles=1, slip=0.005 * sign, torque=0.0 if j == 1 else sign * 400.0,
                target=sign * 300.0 if j != 1 else 0.0, in_service=j != 1, planned=300.0,
            )
            for j in range(4)
        ]  # fmt: skip
        answers = controller.decide(senses)
    torques = np.array([answer.torque for answer in answers])
    assert torques[1] == 0.0
    np.testing.assert_allclose(torques[[0, 2, 3]], sign * 400.0, rtol=0.01)
