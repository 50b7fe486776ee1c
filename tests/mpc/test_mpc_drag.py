"""Drag is what rail forces do not explain of the acceleration: a gradient, found from speeds and torque alone."""

import numpy as np
import pytest

from alloc.plant.laws import GRAVITY
from mpc.belief import UnitBelief
from mpc.settings import MpcSettings
from mpc.unit import MpcController

PERIOD, SLIP = 0.01, 0.02


def _climb(unit, context, grade, seconds, start=8.0):
    """Drive the unit up a gradient at constant slip with a constant force; returns the last speed [m/s]."""
    coefficient, wheels = 0.1, context.axles
    force = coefficient * context.axle_load * wheels
    acceleration = force / context.mass - GRAVITY * grade
    turning = context.inertia * acceleration / context.radius
    torque = coefficient * context.axle_load * context.radius + turning
    for k in range(round(seconds / PERIOD)):
        speed = start + acceleration * k * PERIOD
        omega = np.full(wheels, (speed + SLIP) / context.radius)
        unit.update(speed, omega, torque / context.gear_ratio)
    return speed


@pytest.mark.parametrize("grade", [-0.02, 0.0, 0.03])
def test_a_gradient_is_found(context, grade):
    unit = UnitBelief(context, MpcSettings())
    _climb(unit, context, grade, 5.0)
    assert unit.grade == pytest.approx(grade, abs=2e-4)


def test_it_is_found_within_its_time_and_a_new_start_of_the_observers_is_no_jump(context):
    unit = UnitBelief(context, MpcSettings())
    speed = _climb(unit, context, 0.03, 0.5)
    found = unit.grade
    assert 0.5 * 0.03 < found < 0.8 * 0.03
    unit.forget_forces()
    _climb(unit, context, 0.03, PERIOD, start=speed + 1.0)
    assert unit.grade == found
    _climb(unit, context, 0.03, 5.0, start=speed + 1.0)
    assert unit.grade == pytest.approx(0.03, abs=2e-4)


def test_the_prediction_has_it(context, make_sense):
    controller = MpcController(context)
    for k in range(50):
        assert controller.decide(make_sense(speed=10.0 + 0.001 * k, torque=500.0)).ok
    assert controller.belief.grade > 0.01
    assert controller._unit.solver.now.parameters[context.axles] == controller.belief.grade
