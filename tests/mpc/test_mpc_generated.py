"""The functions that Numba executes are the ones that CasADi differentiated."""

import casadi as cs
import numpy as np
import pytest

from mpc.generated import (
    TranslationError,
    compile_functions,
    compiled_model,
    source,
    symbolic_functions,
)
from mpc.model import unit_model


@pytest.mark.parametrize("curve", ["piecewise", "rational", "slip-ratio"])
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
