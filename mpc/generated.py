"""From CasADi expressions to Numba functions: CasADi differentiates, Numba executes, no C compiler needed.

CasADi's own virtual machine takes several nanoseconds per operation and a call from Python near a microsecond; the
shooting sweep calls the model hundreds of times per control period. The expression's instructions are therefore written
out as Python source beside Numba's cache, once per model, and compiled there.
"""

import hashlib
from typing import Any

import casadi as cs

from mpc.code_cache import load_module

_OPERATIONS = {
    cs.OP_ADD: "{0} + {1}",
    cs.OP_SUB: "{0} - {1}",
    cs.OP_MUL: "{0} * {1}",
    cs.OP_DIV: "{0} / {1}",
    cs.OP_LT: "1.0 if {0} < {1} else 0.0",
    cs.OP_LE: "1.0 if {0} <= {1} else 0.0",
    cs.OP_EQ: "1.0 if {0} == {1} else 0.0",
    cs.OP_NE: "1.0 if {0} != {1} else 0.0",
    cs.OP_AND: "1.0 if {0} != 0.0 and {1} != 0.0 else 0.0",
    cs.OP_OR: "1.0 if {0} != 0.0 or {1} != 0.0 else 0.0",
    cs.OP_FMIN: "minimum({0}, {1})",
    cs.OP_FMAX: "maximum({0}, {1})",
    cs.OP_IF_ELSE_ZERO: "{1} if {0} != 0.0 else 0.0",
    cs.OP_ASSIGN: "{0}",
    cs.OP_NEG: "-{0}",
    cs.OP_SQ: "{0} * {0}",
    cs.OP_TWICE: "{0} + {0}",
    cs.OP_INV: "1.0 / {0}",
    cs.OP_NOT: "1.0 if {0} == 0.0 else 0.0",
    cs.OP_SIGN: "1.0 if {0} > 0.0 else (-1.0 if {0} < 0.0 else 0.0)",
    cs.OP_FABS: "absolute({0})",
    cs.OP_SQRT: "sqrt({0})",
    cs.OP_EXP: "exp({0})",
    cs.OP_ATAN: "atan({0})",
    cs.OP_SIN: "sine({0})",
}
_HEADER = '''"""Written by mpc; do not edit."""

import numpy as np
from numba import float64, types, void

from alloc.plant.operations import absolute, atan, exp, maximum, minimum, sine, sqrt
from mpc.arrays import VECTOR, on_stack, sweep
'''


class TranslationError(NotImplementedError):
    """An expression contains an operation without a translation; the message names it."""


def _body(function: cs.Function) -> str:
    """Every result has a name of its own: Numba cannot tell the type of one that is used again hundreds of times."""
    text, names = "", dict[int, str]()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        target, read = f"w{k}", [names.get(i, "") for i in inputs]
        if operation == cs.OP_CONST:
            value = repr(function.instruction_constant(k))
        elif operation == cs.OP_INPUT:
            value = f"{function.name_in(inputs[0])}[{inputs[1]}]"
        elif operation == cs.OP_OUTPUT:
            target, value = f"{function.name_out(outputs[0])}[{outputs[1]}]", read[0]
        elif operation in _OPERATIONS:
            value = _OPERATIONS[operation].format(*read)
        else:
            raise TranslationError(
                f"{function.name()}: CasADi operation {operation} has no translation"
            )
        text += f"    {target} = {value}\n"
        if operation != cs.OP_OUTPUT:
            names[outputs[0]] = target
    return text


def function_source(name: str, arguments: list[str], body: str) -> str:
    """Python source of a Numba function of float64 vectors; `body` is indented and ends its last line."""
    signature = ", ".join(["VECTOR"] * len(arguments))
    return f"\n\n@sweep(void({signature}))\ndef {name}({', '.join(arguments)}):\n{body}"


def source(functions: list[cs.Function]) -> str:
    """Python source of Numba functions with the names, inputs and outputs of the SX `functions`.

    Every input and output is a float64 vector of its nonzeros (columnwise); outputs are written in place, structural
    zeros are left out. Raises `TranslationError` for operations that the plant's equations do not use.
    """
    return "".join(
        function_source(function.name(), function.name_in() + function.name_out(), _body(function))
        for function in functions
    )


def compile_source(text: str) -> dict[str, Any]:
    """What the source `text` defines, by name; kept beside Numba's cache under a name that follows from it."""
    whole = _HEADER + text
    name = "readhesion_generated_" + hashlib.sha256(whole.encode()).hexdigest()[:16]
    return vars(load_module(name, whole))


def compile_functions(functions: list[cs.Function]) -> dict[str, Any]:
    """Numba functions of the SX `functions` by name, see `source`; compiled once per machine and expression."""
    return compile_source(source(functions))
