"""The MPC on the train: it readheres after a drop of the rail, keeps its bounds, and its failures are survived."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.metrics import evaluate
from alloc.onboard.host import HostedController, each_unit
from alloc.onboard.parameters import Onboard, ReferenceSpeed, Sensors
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.simulation import DriverCommand, Event, simulate
from mpc.hosted import MPC
from mpc.settings import MpcSettings
from mpc.unit import MpcController
from tests.mpc.drop import BACK, DROP, LOW, between, driven, drop_event, run_mpc


@pytest.fixture(scope="module")
def drop_run():
    return run_mpc(drop_event())


def test_a_drop_of_adhesion_is_readhered(drop_run):
    run, controllers = drop_run
    slip = run["slip_velocity"].values[:, driven(run)]
    peak_slip = run["peak_slip"].values[:, driven(run)]
    during = between(run, DROP, DROP + 0.5)
    assert slip[during].max() > peak_slip[during].max(), "the drop must make the wheels slip"
    # it swings about the best slip, which is near the peak's
    settled = between(run, DROP + 1.0, BACK)
    assert np.all(slip[settled] < 2.0 * peak_slip[settled])
    used = run["coefficient"].values[settled][:, driven(run)].mean()
    assert used > 0.95 * LOW
    assert run.attrs["controller_failures"] == 0
    for controller in controllers:
        assert controller.belief.peak.min() > 0.9 * LOW


def test_without_readhesion_control_the_same_drop_makes_the_wheels_run_away():
    run = simulate(drop_event(), "alone", "none")
    assert run["slip_velocity"].values[between(run, BACK - 0.1, BACK)].max() > 1.0


def test_it_keeps_more_effort_than_cut_and_ramp(drop_run):
    run, _ = drop_run
    classic = simulate(drop_event(), "alone", "cut-and-ramp")
    assert evaluate(run)["effort_ratio"] > evaluate(classic)["effort_ratio"]


def test_a_demand_far_beyond_the_rail_costs_no_adhesion():
    """A locomotive before 70 wagons, asked for five times what a narrow peak carries."""
    event = Event(
        "heavy start", build(find_set("heavy-70"), Rail(0.12, scatter=0.02)), DriverCommand((0.2,), (0.3 / 3.6,)),
        Onboard(reference=ReferenceSpeed(source="truth")), duration=12.0, initial_speed=10.0 / 3.6,
    )  # fmt: skip
    run = simulate(event, "alone", MPC)
    found = evaluate(run)
    assert found["effort_ratio"] < 0.25
    assert found["bound_use"] > 0.98
    assert found["slip_time"] < 1.0


def test_bounds_hold_all_the_way(drop_run):
    run, _ = drop_run
    command, target = run["torque_command"].values, run["torque_target"].values
    assert np.all(command >= 0.0)
    assert np.all(command <= target * (1 + 1e-12))
    assert np.any(command[target > 0.0] < 0.9 * target[target > 0.0])


def test_on_a_good_rail_it_gives_what_is_asked():
    event = drop_event(level=0.3, drop=1.0, duration=4.0)
    mpc, none = (
        evaluate(simulate(event, "alone", controller))["effort_ratio"]
        for controller in (MPC, "none")
    )
    assert mpc == pytest.approx(none, rel=1e-2)


def test_braking_is_readhered_too():
    run, _ = run_mpc(drop_event(command=-0.8, speed=25.0))
    slip = -run["slip_velocity"].values[:, driven(run)]
    settled = between(run, DROP + 0.8, BACK)
    assert slip[between(run, DROP, BACK)].max() > run["peak_slip"].values.min()
    assert np.all(slip[settled] < 2.0 * run["peak_slip"].values[settled][:, driven(run)])
    assert run["coefficient"].values[settled][:, driven(run)].mean() < -0.9 * LOW
    assert run.attrs["controller_failures"] == 0


@pytest.mark.parametrize(("noise", "least"), [(0.01, 0.9), (0.02, 0.8)])
def test_noise_of_the_sensors_does_not_talk_it_out_of_its_torque(noise, least):
    sensors = Sensors(speed_noise=noise, speed_quantum=0.5 * noise, seed=2)
    run, _ = run_mpc(drop_event(sensors=sensors))
    settled = between(run, DROP + 0.8, BACK)
    assert run["coefficient"].values[settled][:, driven(run)].mean() > least * LOW


def test_a_late_controller_leaves_the_run_to_cut_and_ramp():
    event = drop_event(duration=6.0)
    late, _ = run_mpc(event, MpcSettings(deadline=0.5e-3))
    classic = simulate(event, "alone", "cut-and-ramp")
    ticks = round(event.duration / event.onboard.period)
    assert late.attrs["controller_calls"] == 4 * ticks
    # without demand nothing is solved
    assert 0.9 * 4 * ticks < late.attrs["controller_failures"] < 4 * ticks
    assert "late" in late.attrs["messages"]
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(late[name], classic[name])


def test_failures_now_and_then_are_counted_and_survived(drop_run):
    class Faulty(MpcController):
        """Hears nothing for half a second after the drop."""

        def decide(self, sense):
            if DROP <= sense.time < DROP + 0.5:
                sense = sense._replace(omega=np.full_like(sense.omega, np.nan))
            return super().decide(sense)

    event = replace(drop_event(), name="faulty")
    run = simulate(event, "alone", HostedController("mpc", "fails at times", each_unit(Faulty)))
    assert run.attrs["controller_failures"] == 4 * 50
    settled = between(run, DROP + 1.2, BACK)
    slip = run["slip_velocity"].values[settled][:, driven(run)]
    assert np.all(slip < 2.0 * run["peak_slip"].values[settled][:, driven(run)])
    assert np.isfinite(run["speed"].values).all()


def test_runs_are_reproducible_to_the_bit(drop_run):
    again, _ = run_mpc(drop_event())
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(again[name], drop_run[0][name])
