"""The prediction model is the plant: with true parameters it predicts what the plant does."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.equipment import equipment
from alloc.onboard.host import unit_contexts
from alloc.onboard.parameters import Belief, Onboard
from alloc.plant import engine as compiled
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Car, Motors, TorqueLimit, Train
from mpc.model import parameters, slip_matrix, substeps, torque_per_coefficient, unit_model
from tests.benchmarks.unit_step import right_side, step_function
from tests.plant.numpy_plant import environment_at

PERIOD = 0.01
AXLES = 4


def _plant(curve):
    """One motor car alone, every axle on a rail of its own; the smallest train whose unit moves nothing else."""
    limit = TorqueLimit(5000.0, 1e9)
    car = Car(
        "car", 20.0, 40e3, 0.0, (2.0, 4.1, 15.9, 18.0), (0, 0, 1, 1), 0.43, (155.0,) * 4,
        (True,) * 4, Motors("1C4M", 7.07, limit, limit, 0.02),
    )  # fmt: skip
    rail = Rail(0.15, curve=curve, increments=(0.0, 0.01, 0.02, -0.03))
    return build(Train("car", (car,)), rail)


def _compare(curve, slip, step):
    """State after a control period by plant and by prediction, in the model's order."""
    plant = _plant(curve)
    onboard = Onboard(belief=Belief(curve=curve))
    context = unit_contexts(plant, equipment(plant, onboard), onboard, "mpc")[0]
    n = plant.layout
    state = plant.initial_state(12.0)
    state[n.omega] += np.array(slip) / 0.43
    state[n.torque] = 400.0
    peak = environment_at(plant, 0.0, state).peak
    pick = np.r_[n.speed, n.omega, n.torque]
    model = unit_model(context)
    step = PERIOD / substeps(context, PERIOD) if step is None else step
    predict = step_function(model, PERIOD, round(PERIOD / step))
    before = state[pick].copy()
    predicted = np.asarray(predict(before, 650.0, parameters(context, peak))).ravel()
    inputs = plant.zero_inputs()
    inputs.torque_command[:] = 650.0
    w = compiled.workspace(plant, step)
    compiled.advance(w, 0.0, step, round(PERIOD / step), state, inputs)
    return before, state[pick], predicted


@pytest.mark.parametrize("slip", [(0.0,) * 4, (0.02, 0.05, 0.1, 0.3)], ids=["rolling", "slipping"])
@pytest.mark.parametrize("curve", ["piecewise", "rational", "slip-ratio"])
@pytest.mark.parametrize("step", [None, 1e-3], ids=["substeps of the model", "1 ms"])
def test_prediction_equals_the_plant(make_context, curve, slip, step):
    before, plant, predicted = _compare(make_context(curve).curve, slip, step)
    assert np.abs(plant - before).max() > 1e-3
    np.testing.assert_allclose(predicted, plant, rtol=1e-11)


def test_substeps_of_the_model_are_accurate(make_context):
    # against 50 us; rim speeds to a fiftieth of the peak's slip velocity
    context = make_context()
    model = unit_model(context)
    x = np.array([10.0, *(np.array([10.0, 10.02, 10.06, 10.2]) / 0.43), 300.0])
    p = parameters(context, 0.12)
    coarse, fine = (
        np.asarray(step_function(model, PERIOD, k)(x, 600.0, p)).ravel()
        for k in (substeps(context, PERIOD), 200)
    )
    assert np.abs(slip_matrix(context) @ (coarse - fine)).max() < 1e-3
    assert abs(coarse[0] - fine[0]) < 1e-5


def test_units_that_differ_in_values_share_one_model(make_context):
    light, heavy = make_context(), make_context(axle_load=120e3, mass=80e3, inertia=100.0)
    assert unit_model(light) is unit_model(heavy)
    assert unit_model(light) is not unit_model(make_context(axles=2))
    assert unit_model(light) is not unit_model(make_context("slip-ratio"))


def test_torque_per_coefficient_keeps_the_slip_constant(make_context):
    # the plant's own right side: with this torque wheelsets and unit accelerate alike
    context = make_context()
    coefficient = 0.02  # on the straight part of the curve
    torque = coefficient * torque_per_coefficient(context)
    slip = coefficient / context.curve.micro_slope
    x = np.array([10.0, *[(10.0 + slip) / context.radius] * AXLES, torque])
    rate = right_side(unit_model(context))(x, torque, parameters(context, 0.2))
    assert np.abs(slip_matrix(context) @ np.asarray(rate).ravel()).max() < 1e-9
    wrong = right_side(unit_model(context))(
        x, torque, parameters(replace(context, inertia=200.0), 0.2)
    )
    assert np.abs(slip_matrix(context) @ np.asarray(wrong).ravel()).max() > 1e-3
