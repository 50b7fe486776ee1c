"""A model's functions without the parts that depend on its parameters alone: those are computed once per control period.

Parameters are constant over a horizon, along which a model is evaluated hundreds of times. Expressions of parameters alone
become a vector of constants, which the function "prepare" fills. A division by one of them becomes a multiplication.
`casadi.extract_parametric` does the first, but leaves divisions, and CasADi turns a product with 1 / x back into a division
by x.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import casadi as cs

PARAMETERS, CONSTANTS = "parameters", "constants"
"""Names of the input that is folded away, and of the one in its place."""

Made = TypeVar("Made")


def _walk(
    function: cs.Function,
    entry: Callable[[int, int], Made],
    number: Callable[[float], Made],
    combined: Callable[..., Made],
) -> list[list[Made]]:
    """Values of the nonzeros of each output of `function`.

    `entry`: of a nonzero of an input; `number`: of a number; `combined`: of an operation and one or two values.
    """
    outputs: list[list[Made]] = [
        [number(0.0)] * function.nnz_out(k) for k in range(function.n_out())
    ]
    work: dict[int, Made] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        read, written = function.instruction_input(k), function.instruction_output(k)
        if operation == cs.OP_OUTPUT:
            outputs[written[0]][written[1]] = work[read[0]]
        elif operation == cs.OP_INPUT:
            work[written[0]] = entry(*read)
        elif operation == cs.OP_CONST:
            work[written[0]] = number(function.instruction_constant(k))
        else:
            work[written[0]] = combined(operation, *(work[i] for i in read))
    return outputs


def without_clamps(expression: cs.SX, unbounded: float) -> cs.SX:
    """The dense `expression` without clamps that do nothing: to the range from -x to x where x is `unbounded` or 0.

    No torque is as large, and a brake that is not there holds nothing. A derivative of a clamp costs four divisions.
    """

    def combined(operation: int, a: cs.SX, b: cs.SX | None = None) -> cs.SX:
        if b is None:
            return cs.SX.unary(operation, a)
        other = {cs.OP_FMIN: cs.OP_FMAX, cs.OP_FMAX: cs.OP_FMIN}.get(operation)
        for bound, value in ((a, b), (b, a)) if other is not None else ():
            if bound.is_constant() and abs(float(bound)) == unbounded:
                return value
            empty = bound.is_zero() and value.op() == other
            if empty and any(value.dep(k).is_zero() for k in range(2)):
                return bound
        return cs.SX.binary(operation, a, b)

    symbols = cs.symvar(expression)
    function = cs.Function("expression", [cs.vertcat(*symbols)], [expression])
    (made,) = _walk(function, lambda _, place: symbols[place], cs.SX, combined)
    return cs.vertcat(*made)


class _Value(NamedTuple):
    """A result on the way."""

    expression: cs.SX
    constant: bool
    """Whether it stays the same over the horizon."""
    key: tuple[object, ...] = ()
    """How a constant is computed."""


class _Folding:
    """The constants that are found in one function after the other."""

    def __init__(self, parameters: cs.SX) -> None:
        self.parameters = parameters
        self._found: dict[tuple[object, ...], tuple[cs.SX, cs.SX]] = {}
        """Symbol and expression of each constant."""

    def outputs(self, function: cs.Function, inputs: list[cs.SX]) -> list[cs.SX]:
        """Nonzeros of the outputs of `function` of the symbols `inputs`, by the constants."""
        folded = function.index_in(PARAMETERS)
        outputs = _walk(
            function,
            lambda one, k: _Value(inputs[one][k], one == folded, (PARAMETERS, k)),
            lambda number: _Value(cs.SX(number), True, (number,)),
            self._combined,
        )
        return [cs.vertcat(*map(self._symbol, values)) for values in outputs]

    def _combined(self, operation: int, a: _Value, b: _Value | None = None) -> _Value:
        """The value of an operation."""
        if b is None:
            expression = cs.SX.unary(operation, a.expression)
            return _Value(expression, a.constant, (operation, a.key))
        if a.constant and b.constant:
            expression = cs.SX.binary(operation, a.expression, b.expression)
            return _Value(expression, True, (operation, a.key, b.key))
        if operation == cs.OP_DIV and b.constant:
            operation, b = cs.OP_MUL, _Value(1.0 / b.expression, True, (cs.OP_INV, b.key))
        return _Value(cs.SX.binary(operation, self._symbol(a), self._symbol(b)), False)

    def _symbol(self, value: _Value) -> cs.SX:
        """The value, or the symbol that stands for it."""
        if not value.constant or value.expression.is_constant():
            return value.expression
        if value.key not in self._found:
            symbol = cs.SX.sym(f"{CONSTANTS}_{len(self._found)}")
            self._found[value.key] = symbol, value.expression
        return self._found[value.key][0]

    def constants(self) -> tuple[cs.SX, cs.SX]:
        """Symbols, and what they stand for."""
        symbols, expressions = zip(*self._found.values(), strict=True)
        return cs.vertcat(*symbols), cs.vertcat(*expressions)


def folded(functions: dict[str, cs.Function]) -> dict[str, cs.Function]:
    """The functions with an input "constants" in place of "parameters", and "prepare": (parameters) -> constants.

    Outputs are vectors of the nonzeros. All of `functions` share the constants.
    """
    inputs = {name: list(function.sx_in()) for name, function in functions.items()}
    first = next(iter(functions))
    folding = _Folding(inputs[first][functions[first].index_in(PARAMETERS)])
    made = {}
    for name, function in functions.items():
        inputs[name][function.index_in(PARAMETERS)] = folding.parameters
        made[name] = folding.outputs(function, inputs[name])
    symbols, expressions = folding.constants()
    result = {}
    for name, function in functions.items():
        place, names = function.index_in(PARAMETERS), function.name_in()
        inputs[name][place], names[place] = symbols, CONSTANTS
        outputs = cs.cse(made[name])
        result[name] = cs.Function(name, inputs[name], outputs, names, function.name_out())
    prepare = cs.Function(
        "prepare", [folding.parameters], [cs.cse(expressions)], [PARAMETERS], [CONSTANTS]
    )
    return {"prepare": prepare, **result}
