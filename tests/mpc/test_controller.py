"""Decisions of the MPC of a unit and of a car: bounds, mirrors, failures, and motors that have failed."""

from itertools import product

import numpy as np
import pytest

from mpc.group import GroupController
from mpc.model import LostShare, leading, torque_per_coefficient
from mpc.settings import MpcSettings, PeakBelief
from mpc.unit import MpcController
from tests.cases import looped

READINGS = ("speed", "torque", "target", "drive_limit", "omega")


def test_with_slip_it_reduces_the_torque_and_the_more_the_lower_the_believed_peak(
    context, make_sense
):
    torques = []
    for initial in (0.12, 0.1, 0.08):
        # a belief that stays, for these readings go with one peak only
        settings = MpcSettings(
            belief=PeakBelief(initial=initial, floor=initial - 1e-12, ceiling=initial)
        )
        controller = MpcController(context, settings)
        for _ in range(5):
            decision = controller.decide(make_sense(slip=0.13, torque=600.0))
        assert decision.ok
        torques.append(decision.torque)
    assert 600.0 > torques[0] > torques[1] > torques[2]


@looped(("limit", "bound"), [({"target": 150.0}, 150.0), ({"drive_limit": 120.0}, 120.0)])
def test_target_and_motor_bound_the_torque(context, make_sense, limit, bound):
    controller = MpcController(context)
    for _ in range(50):
        torque = controller.decide(make_sense(slip=0.0, torque=bound, **limit)).torque
        assert 0.0 <= torque <= bound
    assert torque == pytest.approx(bound, rel=1e-3)


def test_believed_peak_and_headroom_bound_the_torque(context, make_sense):
    settings = MpcSettings(
        headroom=0.05, belief=PeakBelief(initial=0.03, floor=0.03 - 1e-12, ceiling=0.03)
    )
    controller = MpcController(context, settings)
    carried = 0.03 * 78e3 * 0.43 / 7.07 * (1 + 4 * 155.0 / (0.43**2 * 55e3))
    torque = 0.0
    for _ in range(50):
        torque = controller.decide(make_sense(slip=0.005, torque=0.0)).torque
    assert 0.8 * carried < torque <= 1.05 * carried * (1 + 1e-12)


def test_braking_mirrors_driving(context, make_sense):
    driving, braking = MpcController(context), MpcController(context)
    for k in range(40):
        sense = make_sense(slip=0.01 * k, torque=400.0)
        mirrored = sense._replace(
            speed=-sense.speed, omega=-sense.omega, torque=-sense.torque, target=-sense.target
        )
        assert braking.decide(mirrored).torque == -driving.decide(sense).torque


def test_braking_forwards_is_driving_with_the_opposite_slip(context, make_sense):
    # the piecewise curve does not know the speed
    driving, braking = MpcController(context), MpcController(context)
    for _ in range(20):
        torque = driving.decide(make_sense(slip=0.1, torque=500.0)).torque
        mirrored = make_sense(slip=-0.1, torque=-500.0, target=-900.0)
        assert braking.decide(mirrored).torque == pytest.approx(-torque, rel=1e-6)


@looped("reading", READINGS)
def test_reading_that_is_no_number_fails_and_is_forgotten(context, make_sense, reading):
    controller = MpcController(context)
    good = controller.decide(make_sense())
    bad = np.full(4, np.nan) if reading == "omega" else np.nan
    decision = controller.decide(make_sense()._replace(**{reading: bad}))
    assert not decision.ok
    assert decision.status == "reading not finite"
    after = controller.decide(make_sense())
    assert after.ok
    assert after.torque == pytest.approx(good.torque, rel=0.2)


@looped(
    ("step_time", "deadline", "steps"),
    [(1e-3, 2e-3, 2), (1e-3, 2.9e-3, 2), (1e-4, 1.0, 7), (3e-3, 1.0, 3)],
)
def test_steps_are_bounded_by_simulated_time(context, make_sense, step_time, deadline, steps):
    settings = MpcSettings(iterations=7, tolerance=0.0, step_time=step_time, deadline=deadline)
    decision = MpcController(context, settings).decide(make_sense(slip=0.2, torque=600.0))
    assert decision.ok
    assert decision.solve_time == pytest.approx(steps * step_time, rel=1e-12)


@pytest.mark.parametrize("error", [RuntimeError, TypeError, ValueError, ZeroDivisionError])
def test_a_fault_of_the_program_is_raised(context, make_sense, monkeypatch, error):
    def fails(*_):
        raise error("broken")

    controller = MpcController(context)
    monkeypatch.setattr(controller._solver, "_iterate", fails)
    with pytest.raises(error, match="broken"):
        controller.decide(make_sense(slip=0.3, torque=600.0))


def test_a_wrong_number_of_axles_is_a_fault_of_the_program(context, make_sense):
    with pytest.raises(ValueError, match="3 angular speeds for 4 axles"):
        MpcController(context).decide(make_sense(axles=3))


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


@looped("sign", [1.0, -1.0])
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
