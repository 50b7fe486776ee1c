"""From CasADi expressions to Numba functions: CasADi differentiates, Numba executes, no C compiler needed.

CasADi's own virtual machine takes several nanoseconds per operation and a call from Python near a microsecond; the
shooting sweep calls the model hundreds of times per control period. The expression's instructions are therefore written
out as Python source beside Numba's cache, once per model, and compiled there.
"""

import hashlib
from types import ModuleType
from typing import Any

import casadi as cs

from mpc.code_cache import load_module

_BINARY = {
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
}
_UNARY = {
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
_HEADER = '''"""Written by mpc.generated; do not edit."""

from numba import float64, void

from alloc.compilation import FASTMATH
from alloc.plant.operations import absolute, atan, exp, maximum, minimum, sine, sqrt
from numba import njit

'''


class TranslationError(NotImplementedError):
    """An expression holds an operation that has no translation; the message names it."""


def _body(function: cs.Function) -> list[str]:
    lines = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        inputs, outputs = function.instruction_input(k), function.instruction_output(k)
        if operation == cs.OP_CONST:
            lines.append(f"w{outputs[0]} = {function.instruction_constant(k)!r}")
        elif operation == cs.OP_INPUT:
            lines.append(f"w{outputs[0]} = {function.name_in(inputs[0])}[{inputs[1]}]")
        elif operation == cs.OP_OUTPUT:
            lines.append(f"{function.name_out(outputs[0])}[{outputs[1]}] = w{inputs[0]}")
        elif operation in _BINARY:
            text = _BINARY[operation].format(f"w{inputs[0]}", f"w{inputs[1]}")
            lines.append(f"w{outputs[0]} = {text}")
        elif operation in _UNARY:
            lines.append(f"w{outputs[0]} = {_UNARY[operation].format(f'w{inputs[0]}')}")
        else:
            raise TranslationError(
                f"{function.name()}: CasADi operation {operation} has no translation"
            )
    return lines


def source(functions: list[cs.Function]) -> str:
    """Python source of Numba functions with the names, inputs and outputs of the SX `functions`.

    Every input and output is a float64 vector of its nonzeros (columnwise); outputs are written in place, structural
    zeros are left out. Raises `TranslationError` for operations that the plant's equations do not use.
    """
    text = _HEADER
    for function in functions:
        names = [function.name_in(i) for i in range(function.n_in())]
        names += [function.name_out(i) for i in range(function.n_out())]
        signature = ", ".join(["float64[::1]"] * len(names))
        text += (
            f'@njit(void({signature}), cache=True, error_model="numpy", fastmath=FASTMATH, nogil=True)\n'
            f"def {function.name()}({', '.join(names)}):\n"
        )
        text += "".join(f"    {line}\n" for line in _body(function)) + "\n\n"
    return text


def compile_source(text: str) -> ModuleType:
    """Module of the source `text`, kept beside Numba's cache under a name that follows from it."""
    name = "readhesion_generated_" + hashlib.sha256(text.encode()).hexdigest()[:16]
    return load_module(name, text)


def compile_functions(functions: list[cs.Function]) -> dict[str, Any]:
    """Numba functions of the SX `functions` by name, see `source`; compiled once per machine and expression."""
    module = compile_source(source(functions))
    return {function.name(): getattr(module, function.name()) for function in functions}
