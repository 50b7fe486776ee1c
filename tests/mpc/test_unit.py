"""The unit's MPC: its belief is right, its search hears the curve, and what it commands is bounded."""

import signal
import threading
from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.controllers import CONTROLLERS
from alloc.run.simulation import COMMAND, PLAN, Simulation
from alloc.schema.errors import InputError
from mpc import problem
from mpc.plan import plan_torques
from mpc.problem import BELIEVED, plan_row
from mpc.unit import AXLES, MPC, mpc
from studies.files.scenario_files import load_scenario
from tests.cases import looped
from tests.wheel import SCALE, course, drive, rows

CONTROLLER = CONTROLLERS["mpc"]


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
    still = CONTROLLER.tuned(gain=1e-9)  # the target slip stays, so the curve is s^power about it
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
    axles.unit[2:5], axles.seen[5:] = -1, 0
    unit.torque_target, unit.motor_torque = 0.15 * SCALE, 0.1 * SCALE
    for k in range(50):
        run.time, run.reference_speed, axles.reading[:] = 0.01 * k, 0.01 * k, strange
        axles.seen[0] = not 20 <= k < 30
        axles.reading[:2] = strange if 20 <= k < 30 else 0.012 * k, 0.013 * k
        CONTROLLER.control(unit, axles, memory, run)
    m = memory.view(MPC.dtype)[0]
    assert m.slip[:2] == pytest.approx([0.002 * 48, 0.003 * 48], rel=0.1)
    assert m.noise < 0.01
    assert np.isnan(m.rim[2:]).sum() >= AXLES - 5


def test_a_unit_that_sees_no_axle_follows_its_target():
    unit, axles, run = rows()
    axles.seen[:], unit.torque_target = 0, 0.1 * SCALE
    CONTROLLER.control(unit, axles, CONTROLLER.rows(1)[0], run)
    assert unit.torque_command == 0.1 * SCALE


@looped(
    ("name", "rule"),
    [("wet-front", "greedy"), ("gradient-start", "qp"), ("noisy-sensors", "cooperative")],
)
def test_at_every_instant_of_a_run_casadi_and_its_twin_command_the_same(name, rule):
    """From the same readings and memory; in closed loop what rounding leaves grows by ten in a third of a second."""
    event = replace(load_scenario(name).event(0), duration=3.0)
    run, limited, worst = Simulation(event, rule, "mpc-casadi"), 0, 0.0
    for _ in range(run.ticks):
        run.run_to(PLAN)
        w = run.world
        units, memory = w.units.copy(), w.memory.copy()
        for j in range(units.size):
            axles = w.axles[units[j].first : units[j].last].copy()
            mpc(units[j], axles, memory[j], w.run[0])
        run.run_to(COMMAND)
        apart = np.abs(units.torque_command - w.units.torque_command)
        limited += int((units.torque_command < 0.99 * units.torque_target).sum())
        worst = max(worst, float((apart / np.maximum(units.torque_target, 1.0)).max()))
    assert limited > 50
    assert worst < 1e-8
    assert w.units.faults.sum() == 0


def test_casadi_solves_the_same_in_closed_loop():
    found = [drive(CONTROLLERS[one], lambda t: 0.08, 0.1, 4.0)[:3] for one in ("mpc", "mpc-casadi")]
    assert np.array(found[0]) == pytest.approx(np.array(found[1]), rel=1e-6, abs=1e-9)


@looped(
    "row", [name for name in BELIEVED.columns if name != "share"] + ["change_weight", "slip_weight"]
)
def test_a_number_that_is_none_makes_no_plan(row):
    """Neither CasADi nor its twin takes what it makes of it for a plan, and the torques stay."""
    m, b = MPC.rows(1)[0], BELIEVED.rows(1, target=3e3, upper=3e3)[0]
    values = b if row in BELIEVED.columns else m
    for number in (values[row], np.nan):
        values[row], m.torques[:] = number, 0.1
        plan = m.torques[:15].copy()
        numbers = np.array(b.tolist())
        solved = plan_row(numbers, plan, 0.01, float(m.change_weight), float(m.slip_weight))
        assert solved == plan_torques(m, b, 0.01) == np.isfinite(number)
        assert (plan == 0.1).all() == np.isnan(number)


def test_ctrl_c_ends_a_run_at_the_next_solve_and_an_error_names_the_controller(monkeypatch):
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    built = problem.build_solver(1, 15, "line", 0, "daqp")
    for error, match in ((KeyboardInterrupt, None), (InputError, "mpc-casadi.*no memory")):
        run = Simulation(load_scenario("wet-patch").event(0), "alone", "mpc-casadi")
        run.run_to(COMMAND)

        def solve(error=error, run=run):
            if run.world.run[0].time > 2.0:
                if error is InputError:
                    raise RuntimeError("no memory")
                signal.raise_signal(signal.SIGINT)

        monkeypatch.setattr(problem.keep_solver(15, threading.get_ident()), "solve", solve)
        with pytest.raises(error, match=match):
            run.run_to_end()
        assert 2.0 < run.world.run[0].time < 2.03
        monkeypatch.undo()
    assert built is problem.build_solver(1, 15, "line", 0, "daqp")
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler


def test_a_late_command_is_planned_for():
    def fluctuation(late, own):
        """Of the slip where commands come `late` periods after readings, of which the controller knows of `own`."""
        queue = [0.0] * (late - own)

        def control(unit, axles, memory, run):
            mpc(unit, axles, memory, run)
            queue.append(float(unit.torque_command))
            unit.torque_command = queue.pop(0)

        one = replace(CONTROLLER.tuned(late=own), control=control)
        slip, mu, *_ = drive(one, lambda t: 0.08, 0.15, 12.0)
        return slip[-500:].std(), mu[-500:].mean() / 0.08

    known, unknown = fluctuation(5, 5), fluctuation(5, 0)
    assert known[1] > 0.98
    assert known[0] < 0.5 * unknown[0]
    assert known[1] > unknown[1]


@looped("name", ("torque", "speed", "axle", "target"))
def test_readings_that_are_no_numbers_are_a_fault_and_leave_nothing_behind(name):
    memory, number = CONTROLLER.rows(1)[0], np.nan
    for k, (unit, axles, run) in enumerate(course(5, 400)):
        healthy = float(run.reference_speed), float(unit.motor_torque), float(unit.torque_target)
        if 100 <= k < 120:
            axles[0].reading = number if name == "axle" else axles[0].reading
            run.reference_speed = number if name == "speed" else healthy[0]
            unit.motor_torque = number if name == "torque" else healthy[1]
            unit.torque_target = number if name == "target" else healthy[2]
        CONTROLLER.control(unit, axles, memory, run)
        assert 0.0 <= unit.torque_command <= healthy[2]
        run.reference_speed, unit.motor_torque, unit.torque_target = healthy
    m = memory.view(MPC.dtype)[0]
    assert unit.faults == (0 if name == "axle" else 20)
    assert np.isfinite([m.noise, m.acceleration, m.sought, m.elasticity]).all()
    assert np.isfinite(m.coefficient).all()
    assert np.isfinite(m.torques).all()


def test_a_target_that_rises_on_a_dry_rail_is_followed_without_a_lag():
    """A torque behind its target would say that adhesion limits the unit, and no wheel would be believed to roll."""
    _, _, command, _ = drive(CONTROLLER, lambda t: 0.4, 0.08, seconds=1.4)
    target = np.minimum(1e-3 * np.arange(command.size), 0.15)
    assert command[20:] == pytest.approx(target[20:], rel=1e-3)


def test_without_a_plan_cut_and_ramp_commands():
    unit, axles, run = rows()
    memory, run.reference_speed, unit.torque_target = CONTROLLER.rows(1)[0], np.nan, 0.1 * SCALE
    other = CONTROLLERS["cut-and-ramp"]
    for k in range(300):
        unit.slipping, unit.coefficient_estimate = int(10 <= k < 13), 0.08
        if k == 0:
            twin, kept = unit.copy(), other.rows(1)[0]
        CONTROLLER.control(unit, axles, memory, run)
        own = unit.torque_command
        twin.slipping, twin.coefficient_estimate = unit.slipping, 0.08
        other.control(twin, axles, kept, run)
        assert own == twin.torque_command
        assert k != 30 or own < 0.09 * SCALE
    assert unit.faults == 300


def test_a_load_that_is_wrongly_known_does_not_move_the_slip():
    means = []
    for wrong in (0.9, 1.0, 1.1):

        def control(unit, axles, memory, run, wrong=wrong):
            load, unit.load = float(unit.load), wrong * unit.load
            mpc(unit, axles, memory, run)
            unit.load = load

        slip, mu, *_ = drive(replace(CONTROLLER, control=control), lambda t: 0.08, 0.1, 12.0)
        means.append((slip[-500:].mean(), mu[-500:].mean()))
    assert np.ptp(np.array(means), axis=0) / means[1] == pytest.approx(0.0, abs=0.02)


@looped("sign", (1.0, -1.0))
def test_braking_is_posed_as_pulling_mirrored(sign):
    unit, axles, run = rows(sign)
    memory, unit.air, unit.torque_target = CONTROLLER.rows(1)[0], 3e3, 0.15 * SCALE
    unit.drive_limit, unit.brake_limit = (np.array([0.1, 0.2]) * SCALE)[:: int(sign)]
    for k in range(50):
        unit.motor_torque, run.reference_speed = 0.08 * SCALE, sign * 0.01 * k
        axles.reading[0] = sign * (0.01 * k + 0.1)
        CONTROLLER.control(unit, axles, memory, run)
    b = memory.view(MPC.dtype)[0].problem.view(BELIEVED.dtype)[0]
    turning = unit.inertia / unit.radius**2 / unit.load
    assert b.upper == pytest.approx(0.1 * SCALE)
    assert b.slip == pytest.approx(0.1)
    assert b.acceleration == pytest.approx(1.0, rel=0.1)
    assert b.coefficient == pytest.approx(0.08 - turning + 3e3 / unit.load, rel=1e-3)
