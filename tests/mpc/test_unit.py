"""The unit's MPC: its problem is solved, its belief is right, and what it commands is bounded."""

import daqp
import numpy as np
import pytest

from alloc.onboard.controllers import CONTROLLERS
from mpc.unit import AXLES, MPC, STEPS, plan
from tests.cases import looped
from tests.wheel import SCALE, drive, rows

CONTROLLER = CONTROLLERS["mpc"]


def problems(count, seed):
    """Random problems as `plan` takes them, without the torques that it begins with; the slip limit acts in most."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        n = int(rng.integers(1, STEPS + 1))
        free = np.cumsum(rng.normal(0.0, 1.0, n)) + rng.uniform(-5.0, 5.0)
        gain = rng.uniform(0.1, 3.0) * rng.uniform(0.4, 1.0) ** np.arange(n)
        before, upper = rng.uniform(0.0, 3.0, 2)
        target, weights = upper * rng.choice([1.0, 1.5]), tuple(rng.choice([0.0, 0.3, 2.0], 2))
        yield free, gain, rng.uniform(0.0, 5.0), before, target, upper, weights


def solved(free, gain, limit, before, target, upper, weights):
    torques = np.full(free.size, min(before, upper))
    assert plan(free, gain, limit, torques, before, target, upper, weights)
    return torques


def matrices(free, gain):
    """Slip over torques, and changes of torque over torques."""
    n = free.size
    return sum(gain[k] * np.eye(n, k=-k) for k in range(n)), np.eye(n) - np.eye(n, k=-1)


def test_the_plan_satisfies_the_optimality_conditions():
    for one in problems(200, 1):
        (free, gain, limit, before, target, upper, weights), u = one, solved(*one)
        slip, change = matrices(free, gain)
        over, changes = np.maximum(free + slip @ u - limit, 0.0), change @ u
        changes[0] -= before
        slope = u - target + weights[0] * change.T @ changes + weights[1] * slip.T @ over
        assert ((u >= 0.0) & (u <= upper)).all()
        assert (slope[u < upper] > -1e-5).all()
        assert (slope[u > 0.0] < 1e-5).all()


def test_the_plan_is_that_of_an_independent_solver():
    active = 0
    for one in problems(200, 2):
        (free, gain, limit, before, target, upper, weights), u = one, solved(*one)
        (slip, change), n = matrices(free, gain), free.size
        hessian = np.diag(np.repeat([1.0, weights[1] + 1e-9], n))
        hessian[:n, :n] += weights[0] * change.T @ change
        slope = np.concatenate([-target - weights[0] * before * change[0], np.zeros(n)])
        above = np.concatenate([np.full(n, upper), np.full(n, 1e9), limit - free])
        below = np.concatenate([np.zeros(2 * n), np.full(n, -1e9)])
        x, _, flag, _ = daqp.solve(hessian, slope, np.hstack([slip, -np.eye(n)]), above, below)
        assert flag == 1
        assert u == pytest.approx(x[:n], abs=1e-4)
        active += bool((free + slip @ u > limit).any()) and weights[1] > 0.0
    assert active > 60


def test_where_nothing_slips_the_torque_settles_at_the_target_and_is_never_beyond_its_limit():
    unit, axles, run = rows()
    memory = CONTROLLER.rows(1)[0]
    unit.torque_target = 0.15 * SCALE
    for limit in (0.2, 0.05, 0.15):
        unit.drive_limit = limit * SCALE
        for _ in range(30):
            CONTROLLER.control(unit, axles, memory, run)
            assert unit.torque_command <= min(limit, 0.15) * SCALE
            unit.motor_torque = unit.torque_command
        assert unit.torque_command == pytest.approx(min(limit, 0.15) * SCALE, rel=1e-3)


@looped("power", (0.2, 0.5))
def test_the_search_hears_the_elasticity_of_a_curve(power):
    still = CONTROLLER.tuned(gain=1e-9)  # the slip sought stays, so the curve is s^power about it
    *_, memory = drive(still, lambda t: 0.08, 0.08, power=power)
    assert memory.view(MPC.dtype)[0].elasticity == pytest.approx(power, abs=0.05)


def test_the_belief_is_the_balance_of_the_wheelset():
    slip, mu, _, memory = drive(CONTROLLER.tuned(swing=1e-6, loud=0.0), lambda t: 0.08, 0.3)
    m = memory.view(MPC.dtype)[0]
    assert m.coefficient[0] == pytest.approx(mu[-20:].mean(), rel=0.01)
    assert m.slip[0] == pytest.approx(slip[-20:].mean(), rel=0.02)


def test_the_noise_of_the_sensors_is_measured():
    memory = drive(CONTROLLER, lambda t: 0.4, 0.08, noise=0.02)[-1]
    assert memory.view(MPC.dtype)[0].noise == pytest.approx(0.02, rel=0.2)


@looped("strange", (-5.0, 9.0))
def test_axles_that_are_not_driven_or_not_seen_say_nothing(strange):
    (unit, axles, run), memory = rows(axles=AXLES), CONTROLLER.rows(1)[0]
    axles.unit[2:5], axles.sensed[5:], axles.lost[0], axles.back[0] = -1, 0, 0.2, 0.3
    unit.torque_target, unit.motor_torque = 0.15 * SCALE, 0.1 * SCALE
    for k in range(50):
        run.time, run.reference_speed, axles.reading[:] = 0.01 * k, 0.01 * k, strange
        axles.reading[:2] = strange if 20 <= k < 30 else 0.012 * k, 0.013 * k
        CONTROLLER.control(unit, axles, memory, run)
    m = memory.view(MPC.dtype)[0]
    assert m.slip[:2] == pytest.approx([0.002 * 48, 0.003 * 48], rel=0.1)
    assert m.noise < 0.01
    assert np.isnan(m.rim[2:]).sum() >= AXLES - 5


def test_a_unit_that_sees_no_axle_follows_its_target():
    unit, axles, run = rows()
    axles.sensed[:], unit.torque_target = 0, 0.1 * SCALE
    CONTROLLER.control(unit, axles, CONTROLLER.rows(1)[0], run)
    assert unit.torque_command == 0.1 * SCALE
