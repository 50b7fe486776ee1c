"""The model of a group is the plant with one body, and its compiled form is its expression."""

import casadi as cs
import numpy as np
import pytest

from alloc.onboard.equipment import equipment
from alloc.onboard.host import unit_contexts
from alloc.onboard.parameters import Belief, Onboard
from alloc.plant import engine as compiled
from alloc.plant.adhesion import RationalCurve
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Car, Motors, TorqueLimit, Train
from mpc.generated import compiled_group, symbolic_functions
from mpc.model import parameters, substeps, unit_model
from mpc.period import RealTimeIteration
from mpc.settings import MpcSettings
from tests.benchmarks.unit_step import step_function
from tests.mpc.groups import problem, small_cars, unit
from tests.mpc.parts import cost_of_torques, model_at_guess
from tests.plant.numpy_plant import environment_at

PERIOD = 0.01
SHORT = MpcSettings(horizon=5)


def _plant(cars, inverters):
    limit = TorqueLimit(5000.0, 1e9)
    one = [
        Car(
            f"car {c}", 20.0, 36e3 + 4e3 * c, 0.0, (2.0, 4.1, 15.9, 18.0), (0, 0, 1, 1), 0.43,
            (155.0,) * 4, (True,) * 4, Motors(inverters, 7.07, limit, limit, 0.02),
        )
        for c in range(cars)
    ]  # fmt: skip
    increments = tuple(np.linspace(-0.03, 0.03, 4 * cars))
    return build(Train("cars", tuple(one), load_transfer=True), Rail(0.15, increments=increments))


@pytest.mark.parametrize(("cars", "inverters"), [(2, "1C4M"), (1, "1C1M"), (2, "1C2M")])
def test_prediction_equals_the_plant_with_load_transfer(cars, inverters):
    plant = _plant(cars, inverters)
    onboard = Onboard(belief=Belief())
    group = unit_contexts(plant, equipment(plant, onboard), onboard, "mpc")
    assert sorted({context.car for context in group}) == list(range(cars))
    n, rng = plant.layout, np.random.default_rng(2)
    state = plant.initial_state(12.0)
    state[n.omega] += rng.uniform(0.0, 0.2, n.axles) / 0.43
    state[n.torque] = rng.uniform(200.0, 600.0, n.units)
    command = rng.uniform(300.0, 700.0, n.units)
    peak = environment_at(plant, 0.0, state).peak
    pick = np.r_[n.speed, n.omega, n.torque]
    count = substeps(group, PERIOD)
    predict = step_function(unit_model(group), PERIOD, count)
    before = state[pick].copy()
    predicted = np.asarray(predict(before, command, parameters(group, peak))).ravel()
    # the factors of load transfer are the last of the parameters
    factors = np.concatenate([np.ones(n.axles + 8 + 6 * len(group)), np.zeros(n.axles)])
    constant = predict(before, command, parameters(group, peak) * factors)
    inputs = plant.zero_inputs()
    inputs.torque_command[:] = command
    w = compiled.workspace(plant, PERIOD / count)
    compiled.advance(w, 0.0, PERIOD / count, count, state, inputs)
    np.testing.assert_allclose(predicted, state[pick], rtol=1e-11)
    assert np.abs(np.asarray(constant).ravel() - predicted).max() > 1e-3, (
        "load transfer must matter here"
    )


def _dense(function, places, shape):
    whole = np.zeros(shape)
    np.add.at(whole, places, function)
    return whole


GROUPS = {
    "alike": small_cars(2),
    "unlike": [*small_cars(2), unit(4, 2, 2, (0.1, -0.1))],  # ends with a car of another shape
    "rational": small_cars(2, RationalCurve(0.08, 2.5)),
}


@pytest.mark.parametrize("group", GROUPS.values(), ids=GROUPS)
def test_assembled_functions_equal_the_whole_expression(group):
    model, made = unit_model(group), compiled_group(group)
    symbolic = symbolic_functions(model)
    width, states = model.states + model.units, model.states
    for seed in range(4):
        data = problem(group, seed)
        inputs = [data.state, np.asarray(data.target), data.parameters]
        slopes, again = np.full(states, np.nan), np.full(states, np.nan)
        jacobian = np.full(made.nonzeros.row.size, np.nan)
        point = (*inputs[:2], made.prepared(data.parameters))
        made.slope(*point, slopes)
        made.rate(*point, again, jacobian)
        f, j = symbolic["rate"].call(inputs)
        np.testing.assert_allclose(slopes, again, rtol=1e-14)
        np.testing.assert_allclose(slopes, np.asarray(f).ravel(), rtol=1e-10, atol=1e-9)
        wanted = np.asarray(cs.DM(j))
        found = _dense(jacobian, (made.nonzeros.row, made.nonzeros.column), (states, width))
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12 * np.abs(wanted).max())


def _central(function, x, width):
    columns = []
    for k in range(x.size):
        ahead, behind = x.copy(), x.copy()
        ahead[k] += width
        behind[k] -= width
        columns.append((function(ahead) - function(behind)) / (2.0 * width))
    return np.stack(columns, axis=-1)


def _linearised(group, data, seed):
    solver = RealTimeIteration(group, SHORT, 0.05)
    solver.torques[:] = np.random.default_rng(seed).uniform(100.0, 800.0, solver.torques.size)
    return solver, model_at_guess(solver, data)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("group", [small_cars(1), small_cars(2)], ids=["car", "train"])
def test_gradient_equals_finite_differences_of_the_cost(group, seed):
    data = problem(group, seed)
    solver, quadratic = _linearised(group, data, seed)
    scale = solver.period.guess.scale

    def cost(scaled):
        return cost_of_torques(solver, data, scaled * scale)

    expected = _central(cost, solver.torques / scale, 1e-5)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(quadratic.gradient, expected, rtol=1e-4, atol=1e-5)


def test_a_group_of_one_is_the_unit(context, random_problem):
    # through the expression with load transfer, whose factors are next to nothing
    alone = RealTimeIteration(context, MpcSettings())
    factors = (1e-12, 0.0, 0.0, -1e-12)
    group = [type(context)(**{**vars(context), "unloading": factors})]
    grouped = RealTimeIteration(group, MpcSettings(), 1e-12)
    for seed in range(6):
        data = random_problem(context, seed)
        longer = data._replace(parameters=np.concatenate([data.parameters, factors]))
        alone.restart(data.before)
        grouped.restart(data.before)
        for _ in range(3):
            one, same = alone.solve(data), grouped.solve(longer)
            assert same.cost == pytest.approx(one.cost, rel=1e-8)
            np.testing.assert_allclose(same.torques, one.torques, atol=1e-4)
