"""The model of a unit and of a group is the plant; its compiled functions and derivatives are its expressions."""

from dataclasses import replace

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
from alloc.records import ByReference
from mpc.belief import with_predicted_curve
from mpc.condensing import needed_substeps, steepest, trajectory_cost
from mpc.generated import (
    TranslationError,
    compile_functions,
    compiled_group,
    compiled_model,
    source,
    symbolic_functions,
)
from mpc.model import (
    curve_place,
    folded,
    parameters,
    slip_matrix,
    stiffness_of,
    substeps,
    torque_per_coefficient,
    unit_model,
    without_clamps,
)
from mpc.period import RealTimeIteration, cost_of
from mpc.settings import MpcSettings
from mpc.solver import linearise_at
from tests.cases import looped
from tests.mpc.made_problems import cost_of_torques, model_at_guess, problem, small_cars, unit
from tests.mpc.peers import right_side, step_function
from tests.plant.numpy_plant import environment_at

PERIOD = 0.01


AXLES = 4


def _unit_plant(curve):
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
    plant = _unit_plant(curve)
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


@looped("slip", [(0.0,) * 4, (0.02, 0.05, 0.1, 0.3)])
@looped("curve", ["piecewise", "rational", "slip-ratio"])
@looped("step", [None, 1e-3])
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


@looped(("cars", "inverters"), [(2, "1C4M"), (1, "1C1M"), (2, "1C2M")])
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


@looped("group", GROUPS.values())
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


def _group_linearised(group, data, seed):
    solver = RealTimeIteration(group, SHORT, 0.05)
    solver.torques[:] = np.random.default_rng(seed).uniform(100.0, 800.0, solver.torques.size)
    return solver, model_at_guess(solver, data)


@looped("seed", range(3))
@looped("group", [small_cars(1), small_cars(2)])
def test_gradient_of_a_group_equals_finite_differences(group, seed):
    data = problem(group, seed)
    solver, quadratic = _group_linearised(group, data, seed)
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


STEP = 0.01


def _curve(rng):
    return RationalCurve(
        peak_slip=float(rng.uniform(0.02, 1.0)), steepness=float(rng.uniform(1.0, 60.0))
    )


def test_the_bound_of_the_slope_holds_and_is_close():
    rng = np.random.default_rng(5)
    for _ in range(200):
        curve, peak = _curve(rng), rng.uniform(0.01, 0.5)
        bound, exact = steepest(peak, curve.peak_slip, curve.steepness), curve.steepest_slope(peak)
        assert exact * (1.0 - 1e-9) <= bound <= 1.06 * exact


@looped("values", [{}, {"axles": 1}, {"axle_load": 200e3, "mass": 20e3}, {"torque_lag": 1e-3}])
def test_substeps_are_those_of_the_plant_on_the_believed_curve(make_context, values):
    context = with_predicted_curve(make_context(**values))
    stiffness, rng, found = stiffness_of(context, STEP), np.random.default_rng(6), set()
    assert stiffness.most == substeps(context, STEP)
    for _ in range(60):
        curve, peak = _curve(rng), rng.uniform(0.01, 0.5, context.axles)
        believed = parameters(context, peak)
        believed[curve_place(context)] = curve.peak_slip, curve.steepness
        # the plant's rail has a peak of 1
        scaled = replace(curve, peak_slip=curve.peak_slip / peak.max())
        plant = min(substeps(replace(context, curve=scaled), STEP), stiffness.most)
        needed = needed_substeps(stiffness, STEP, believed)
        assert plant <= needed <= min(np.ceil(1.06 * plant + 0.06), stiffness.most)
        found.add(needed)
    assert stiffness.most == max(found)
    assert len(found) > 1 or stiffness.rest * STEP / 2.0 > stiffness.most - 1


def test_what_is_no_number_gives_a_number_of_steps_and_other_curves_take_most(context):
    believed, other = with_predicted_curve(context), stiffness_of(context, STEP)
    place = curve_place(believed)
    for k in (0, place.start, place.stop - 1):
        for value in (np.nan, np.inf, 0.0):
            values = parameters(believed, 0.1)
            values[k] = value
            assert 1 <= needed_substeps(stiffness_of(believed, STEP), STEP, values) <= 6
    assert needed_substeps(other, STEP, parameters(context, 0.1)) == substeps(context, STEP)


def test_fewer_substeps_of_a_flatter_curve_predict_the_same(context, random_problem):
    context = with_predicted_curve(context)
    data = random_problem(context, 3)
    data.parameters[curve_place(context)] = 0.1, 2.5
    solver, slips = RealTimeIteration(context, MpcSettings()), []
    made = solver.period
    solver.restart(400.0)
    solver.take(data)
    assert made.now.substeps[0] < made.rules.stiffness.most
    for number in (made.now.substeps[0], 60):
        made.now.substeps[0] = number
        linearise_at(solver.torques, ByReference(made))
        slips.append(made.around.nodes @ made.terms.slip_matrix.T)
    assert np.abs(slips[0]).max() > 0.01
    np.testing.assert_allclose(slips[0], slips[1], atol=1e-3)


def test_a_group_needs_the_steps_of_its_stiffest_unit():
    group = [with_predicted_curve(one) for one in small_cars(2)]
    heavy = [replace(group[0], axle_load=3.0 * group[0].axle_load), *group[1:]]
    light, stiff = (stiffness_of(one, STEP) for one in (group, heavy))
    assert stiff.slope > 2.0 * light.slope


SIX_STEPS = MpcSettings(horizon=6)


def _unit_linearised(context, problem, seed):
    solver = RealTimeIteration(context, SIX_STEPS)
    solver.torques[:] = np.random.default_rng(seed).uniform(100.0, 900.0, SIX_STEPS.horizon)
    return solver, model_at_guess(solver, problem)


@looped("curve", ["piecewise", "rational", "slip-ratio"])
@looped("seed", range(4))
def test_gradient_equals_finite_differences_of_the_cost(make_context, random_problem, curve, seed):
    context = make_context(curve)
    problem = random_problem(context, seed)
    solver, quadratic = _unit_linearised(context, problem, seed)
    scale = solver.period.guess.scale

    def cost(scaled):
        return cost_of_torques(solver, problem, scaled * scale)

    expected = _central(cost, solver.torques / scale, 1e-5)
    assert np.abs(expected).max() > 0.1
    # central differences: 1e-5 squared, times the third derivatives that kinks leave undefined
    np.testing.assert_allclose(quadratic.gradient, expected, rtol=1e-5, atol=1e-6)


def test_cost_is_the_documented_sum(context):
    # nodes without slip: only tracking and rate are left
    terms = ByReference(cost_of(context, SIX_STEPS, 0.2))
    terms.slip_matrix[:] = 0.0
    axle, unit = terms.axle, terms.unit
    torques = np.array([100.0, 300.0])
    nodes = np.zeros((3, 6))
    scale, w = unit.scale[0], SIX_STEPS.weights
    unit.target[:], unit.before[:], unit.reference[:] = 400.0, 50.0, 150.0
    axle.slip_limit[:] = 1.0
    cost = trajectory_cost(nodes, torques, terms)
    expected = w.tracking * (300.0**2 + 100.0**2) + w.rate * (50.0**2 + 200.0**2)
    expected += 0.2 * (50.0**2 + 150.0**2)
    assert cost == pytest.approx(expected / scale**2, rel=1e-12)
    axle.slip_limit[0] = -0.1
    over = trajectory_cost(nodes, torques, terms)
    assert over - cost == pytest.approx(2 * w.slip / 4 * (0.1 / w.slip_scale) ** 2, rel=1e-12)


@looped("curve", ["piecewise", "rational", "slip-ratio"])
def test_numba_equals_casadi(make_context, random_problem, curve):
    context = make_context(curve)
    model = unit_model(context)
    compiled = compiled_model(model)
    for name, function in symbolic_functions(model).items():
        for seed in range(8):
            problem = random_problem(context, seed)
            inputs = [problem.state, np.array([500.0]), problem.parameters]
            expected = function.call(inputs)
            outputs = [np.full(function.nnz_out(k), np.nan) for k in range(function.n_out())]
            inputs[2] = compiled.prepared(problem.parameters)
            getattr(compiled, name)(*inputs, *outputs)
            for value, wanted in zip(outputs, expected, strict=True):
                values = np.array(wanted.nonzeros())
                scale = np.abs(values).max()
                np.testing.assert_allclose(value, values, rtol=1e-11, atol=1e-13 * scale)


def test_an_operation_without_translation_is_named():
    x = cs.SX.sym("x")
    function = cs.Function("unknown", [x], [cs.erf(x)], ["x"], ["y"])
    with pytest.raises(TranslationError, match="unknown"):
        source([function])


def test_translation_of_every_selection():
    x = cs.SX.sym("x", 2)
    a, b = x[0], x[1]
    outputs = cs.vertcat(
        cs.if_else(a < b, a, -b), cs.fmin(a, b), cs.fmax(a, b), cs.fabs(a), cs.sign(b),
        cs.if_else(cs.logic_and(a > 0, b > 0), 1, 2), cs.if_else(cs.logic_or(a > 0, b > 0), 1, 2),
        cs.if_else(cs.logic_not(a <= b), 3, 4), a**2, 2 * a, 1 / a, cs.exp(-a), cs.atan(b),
    )  # fmt: skip
    function = cs.Function("selections", [x], [outputs], ["x"], ["y"])
    compiled = compile_functions([function])["selections"]
    for point in ([1.0, 2.0], [2.0, 1.0], [-1.0, 0.5], [-0.5, -2.0]):
        y = np.empty(outputs.numel())
        compiled(np.array(point), y)
        np.testing.assert_allclose(y, np.asarray(function(point)).ravel(), rtol=1e-12)


ENTRIES = cs.OP_INPUT, cs.OP_OUTPUT, cs.OP_CONST


@looped("axles", [1, 3])
def test_no_operation_is_on_constants_alone(make_context, random_problem, axles):
    context = with_predicted_curve(make_context(axles=axles))
    symbolic = symbolic_functions(unit_model(context))
    made = folded(symbolic)
    rng = np.random.default_rng(2)
    for name, function in symbolic.items():
        whole, place = made[name], function.index_in("parameters")
        assert whole.name_in(place) == "constants"
        constant: dict[int, bool] = {}
        for k in range(whole.n_instructions()):
            operation = whole.instruction_id(k)
            read, written = whole.instruction_input(k), whole.instruction_output(k)
            if operation not in ENTRIES:
                constant[written[0]] = all(constant[i] for i in read)
                # CasADi writes 1 / x as its own operation, and stores no product with a number again
                assert not constant[written[0]] or all(i == read[0] for i in read)
                assert not (operation == cs.OP_DIV and constant[read[1]])
            elif operation != cs.OP_OUTPUT:
                constant[written[0]] = operation == cs.OP_CONST or read[0] == place
        data = random_problem(context, 3)
        inputs = [data.state, np.array([500.0]), data.parameters]
        inputs += [rng.standard_normal(data.state.size)] * (function.n_in() == 4)
        expected = function.call(inputs)
        inputs[place] = made["prepare"](data.parameters)
        for value, wanted in zip(whole.call(inputs), expected, strict=True):
            wanted = np.array(wanted.nonzeros())
            scale = np.abs(wanted).max()
            np.testing.assert_allclose(
                np.array(value.nonzeros()), wanted, rtol=1e-11, atol=1e-13 * scale
            )


def test_functions_share_constants_and_divisions_become_products():
    x, p = cs.SX.sym("x"), cs.SX.sym("p", 2)
    outputs = {"one": x / (p[0] + p[1]), "two": cs.sin(x) / (p[0] + p[1]) + p[1]}
    names = ["x", "parameters"]
    made = folded(
        {name: cs.Function(name, [x, p], [y], names, ["y"]) for name, y in outputs.items()}
    )
    np.testing.assert_allclose(np.asarray(made["prepare"]([1.0, 3.0])).ravel(), [0.25, 3.0])
    assert float(made["one"](2.0, [0.25, 3.0])) == 0.5
    assert float(made["two"](2.0, [0.25, 3.0])) == pytest.approx(0.25 * np.sin(2.0) + 3.0)


def test_only_clamps_that_do_nothing_are_left_out():
    x = cs.SX.sym("x", 2)
    far, near = (cs.fmin(cs.fmax(x[0], -most), most) for most in (1e9, 5.0))
    nothing = x[1] - cs.fmin(0.0, cs.fmax(0.0, x[0]))
    plain = without_clamps(cs.vertcat(far, nothing, near), 1e9)
    function = cs.Function("plain", [x], [plain])
    operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    assert sum(one in (cs.OP_FMIN, cs.OP_FMAX) for one in operations) == 2
    for point in ([3.0, 1.0], [7.0, 1.0], [-7.0, 2.0]):
        expected = [point[0], point[1], np.clip(point[0], -5.0, 5.0)]
        np.testing.assert_array_equal(np.asarray(function(point)).ravel(), expected)
