"""One decision of the controller: what it answers, and that it answers whatever its solver does."""

from dataclasses import replace

import numpy as np
import pytest

from mpc.settings import MpcSettings, PeakBelief
from mpc.solver import NO_SOLUTION
from mpc.unit import MpcController

READINGS = ("speed", "torque", "target", "drive_limit", "omega")


def test_without_slip_it_follows_the_target(context, make_sense):
    controller = MpcController(context)
    torque = 0.0
    for _ in range(100):
        torque = controller.decide(make_sense(slip=0.004, torque=torque, target=200.0)).torque
    assert torque == pytest.approx(200.0, rel=1e-3)


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


@pytest.mark.parametrize(
    ("limit", "bound"), [({"target": 150.0}, 150.0), ({"drive_limit": 120.0}, 120.0)]
)
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


def test_no_demand_means_no_torque(context, make_sense):
    controller = MpcController(context)
    controller.decide(make_sense())
    decision = controller.decide(make_sense(target=0.0))
    assert decision.ok
    assert decision.torque == 0.0


@pytest.mark.parametrize("reading", READINGS)
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


def test_where_not_even_one_step_fits_the_answer_is_late(context, make_sense):
    for settings in (
        MpcSettings(step_time=2e-3, deadline=1.9e-3),
        MpcSettings(step_time=0.011, deadline=1.0),  # the control period counts too
    ):
        controller = MpcController(context, settings)
        decision = controller.decide(make_sense())
        assert not decision.ok
        assert decision.status == "late"
        assert decision.solve_time == settings.step_time
        assert controller.decide(make_sense(target=0.0)).ok, "nothing is solved"


@pytest.mark.parametrize(
    ("step_time", "deadline", "steps"), [(1e-3, 2e-3, 2), (1e-3, 2.9e-3, 2), (1e-4, 1.0, 7), (3e-3, 1.0, 3)]
)  # fmt: skip
def test_steps_are_bounded_by_simulated_time(context, make_sense, step_time, deadline, steps):
    settings = MpcSettings(iterations=7, tolerance=0.0, step_time=step_time, deadline=deadline)
    decision = MpcController(context, settings).decide(make_sense(slip=0.2, torque=600.0))
    assert decision.ok
    assert decision.solve_time == pytest.approx(steps * step_time, rel=1e-12)


def test_solver_failure_fails_and_does_not_stick(context, make_sense, monkeypatch):
    controller = MpcController(context)
    slipping = make_sense(slip=0.3, torque=600.0)
    assert controller.decide(make_sense()).ok
    with monkeypatch.context() as broken:
        broken.setattr(controller._solver, "_iterate", lambda *_: (1.0, 1.0, 1, NO_SOLUTION))
        decision = controller.decide(slipping)
    assert not decision.ok
    assert decision.status == "QP not solved"
    assert controller.decide(slipping).ok


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


def test_units_of_other_sizes_and_curves(make_context, make_sense):
    for axles, curve in ((1, "piecewise"), (4, "polach"), (4, "slip-ratio")):
        controller = MpcController(make_context(curve, axles=axles))
        for slip in (0.0, 0.1, 1.0):
            assert controller.decide(make_sense(slip=slip, axles=axles)).ok


def test_prediction_step_may_differ_from_the_control_period(context, make_sense):
    settings = replace(MpcSettings(), horizon=10, step=0.02)
    controller = MpcController(context, settings)
    for _ in range(60):
        decision = controller.decide(make_sense(slip=0.004, torque=200.0, target=200.0))
    assert decision.torque == pytest.approx(200.0, rel=1e-3)
