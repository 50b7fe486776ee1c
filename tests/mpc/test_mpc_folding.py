"""What depends on a model's parameters alone is computed once, and nothing else changes."""

import casadi as cs
import numpy as np
import pytest

from mpc.belief import with_predicted_curve
from mpc.generated import symbolic_functions
from mpc.model import folded, unit_model, without_clamps

ENTRIES = cs.OP_INPUT, cs.OP_OUTPUT, cs.OP_CONST


@pytest.mark.parametrize("axles", [1, 3])
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
