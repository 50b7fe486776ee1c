"""From CasADi expressions to Numba functions: CasADi differentiates, Numba executes, no C compiler needed.

In: a `UnitModel`. Out: compiled trajectory steps with sensitivities, of one car or assembled from several. Generated text
lies beside Numba's cache.
"""

import hashlib
import marshal
import sys
from collections.abc import Callable
from itertools import groupby
from types import ModuleType
from typing import Any, NamedTuple

import casadi as cs
import numpy as np

from alloc.old.onboard.host import UnitContext
from alloc.old.plant.model import Floats, Ints
from alloc.old.sources import cache_folder, keep, kept, write_whole
from mpc.old.condensing import Nonzeros
from mpc.old.model import UnitModel, Units, cars_of, folded, group_of, unit_model, unloading

_loaded: dict[str, ModuleType] = {}


def load_module(name: str, text: str) -> ModuleType:
    """Run Python source `text` as the module `name`, from a file so that Numba's cache knows it; once per process."""
    if name not in _loaded:
        path, content = cache_folder() / f"{name}.py", text.encode()
        if not path.exists() or path.read_bytes() != content:
            write_whole(path, lambda aside: aside.write_bytes(content))
        bytecode = f"{name}.{sys.implementation.cache_tag}"  # to compile a model takes 30 ms
        code = kept(bytecode)
        if code is None:
            code = marshal.dumps(compile(content, str(path), "exec"))
            keep(bytecode, code)
        module = ModuleType(name)
        module.__file__ = str(path)
        sys.modules[name] = module  # Numba looks it up by name when it loads from its cache
        exec(marshal.loads(code), vars(module))
        _loaded[name] = module
    return _loaded[name]


# CasADi's own virtual machine takes several nanoseconds per operation and a call from Python near a microsecond; the
# shooting sweep calls the model hundreds of times per control period. The expression's instructions are therefore
# written out as Python source beside Numba's cache, once per model, and compiled there.


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

from alloc.old.plant.operations import absolute, atan, exp, maximum, minimum, sine, sqrt
from mpc.old.arrays import VECTOR, on_stack, sweep
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


# Sensitivities of a Runge-Kutta step of a model, written out from where its Jacobian has nonzeros.
#
# Few of a model's numbers depend on each other. A loop over lists of its nonzeros takes most of its time to read the
# lists. Here every product stands in the source, and a block of sensitivities stays in registers through the four
# stages.


_BEGIN = """
from alloc.old.plant.operations import WIDTH, load, spread, store
from mpc.old.arrays import TANGENT


@sweep(TANGENT.signature)
def tangent(jacobians, step, sensitivity, torques):
    half, third, sixth = 0.5 * step, step / 3.0, step / 6.0
    for m in range(0, sensitivity.shape[1], WIDTH):
"""


def tangent_source(row: Ints, column: Ints, states: int, units: int) -> str:
    """Source of a function (jacobians, step, sensitivity, torques) of the kind `mpc.old.arrays.TANGENT`.

    `jacobians` (4, nonzeros) are those of the slopes by (state, torques) at the step's four evaluations, with nonzeros at
    `row`, `column`; where a place comes twice, values add up. `sensitivity` (states, width) is that of the state before
    the step, and of that after it in the end; `torques` (units, width) that of the torques.
    """
    terms: list[list[str]] = [[] for _ in range(states)]
    for number, (i, j) in enumerate(zip(row.tolist(), column.tolist(), strict=True)):
        terms[i].append(f"j[{number}] * {{x}}{j}" if j < states else f"j[{number}] * t{j - states}")
    lines = [f"t{k} = load(torques[{k}], m)" for k in range(units)]
    lines += [f"a{i} = load(sensitivity[{i}], m)" for i in range(states)]
    point = "a"
    for stage, (onward, following) in enumerate(
        (("half", "b"), ("half", "d"), ("step", "e"), ("", ""))
    ):
        lines.append(f"j = jacobians[{stage}]")
        share = "sixth" if stage in (0, 3) else "third"
        for i in range(states):
            rate = " + ".join(terms[i]).format(x=point) or "spread(0.0)"
            lines += [f"r = {rate}", f"c{i} = {'a' if stage == 0 else 'c'}{i} + {share} * r"]
            if following:
                lines.append(f"{following}{i} = a{i} + {onward} * r")
        point = following
    lines += [f"store(sensitivity[{i}], m, c{i})" for i in range(states)]
    return _BEGIN + "".join(f"        {line}\n" for line in lines)


def compile_tangent(row: Ints, column: Ints, states: int, units: int) -> Any:
    """The function of `tangent_source`, compiled once per machine and pattern."""
    return compile_source(tangent_source(row, column, states, units))["tangent"]


# A unit's model and its derivatives as Numba functions, with the places of their nonzeros.


class CompiledModel(NamedTuple):
    """Functions of the model as the sweeps of `mpc.old.condensing` call them; torques come last in a point."""

    prepare: Callable[..., Any]
    """(parameters, constants): what follows from the parameters alone, which the others take."""
    slope: Callable[..., Any]
    rate: Callable[..., Any]
    tangent: Callable[..., Any]
    nonzeros: Nonzeros
    constants: int
    """Number of the constants."""

    def prepared(self, parameters: Floats) -> Floats:
        """Constants of the functions for the model's `parameters`, (constants,)."""
        values = np.zeros(self.constants)
        self.prepare(parameters, values)
        return values


_compiled: dict[UnitModel, CompiledModel] = {}


def symbolic_functions(model: UnitModel) -> dict[str, cs.Function]:
    """The two functions as CasADi has them; what the Numba functions are translated from."""
    x, u, p, f = model.state, model.torque, model.parameters, model.rate
    point = cs.vertcat(x, u)
    names = ["state", "torque", "parameters"]

    def function(name: str, inputs: list[cs.SX], outputs: dict[str, cs.SX]) -> cs.Function:
        together = cs.cse(list(outputs.values()))
        return cs.Function(name, inputs, together, names, list(outputs))

    return {
        "slope": function("slope", [x, u, p], {"slopes": f}),
        "rate": function("rate", [x, u, p], {"slopes": f, "nonzeros": model.steps.jacobian(point)}),
    }


def compiled_model(model: UnitModel) -> CompiledModel:
    """Compile `model`, once per process; a cache keeps the result across processes."""
    if model not in _compiled:
        functions = symbolic_functions(model)
        row, column = functions["rate"].sparsity_out(1).get_triplet()
        whole = folded(functions)
        made = compile_functions(list(whole.values()))
        places = [np.array(values, dtype=np.int64) for values in (row, column)]
        tangent = compile_tangent(places[0], places[1], model.states, model.units)
        of_it = made["prepare"], made["slope"], made["rate"], tangent
        constants = whole["prepare"].numel_out(0)
        _compiled[model] = CompiledModel(*of_it, Nonzeros(*places), constants)
    return _compiled[model]


# The compiled model of several cars, assembled from that of a car.
#
# Cars on one rigid body are coupled by the speed alone: its rate is the sum of the contributions of each car's forces,
# and everything else belongs to one car. Compiling the expression of a whole train takes minutes, that of a car
# seconds. So the functions of a train are loops over its cars, written beside Numba's cache like those of the car.


class _Block(NamedTuple):
    """Consecutive cars that share one model."""

    cell: CompiledModel
    model: UnitModel
    cars: int
    axle: int
    """Number of its first axle."""
    unit: int
    constant: int
    """Place of its first constant."""
    nonzero: int
    """Place of its first nonzero of the Jacobian."""
    transfer: bool


_PREPARE = """
    p = on_stack({size})
    for c in range({cars}):
        a, j = {axle} + c * {n}, {unit} + c * {m}
        # the body's mass, and its weight on the gradient, count once
        p[{n}] = parameters[{axles}] if a == 0 else 0.0
        p[{n} + 1] = parameters[{axles} + 1]
        curve = {axles} + 2 + {constants} * {units}
        rest = {n} + 2 + {constants} * {m}
        for i in range({n}):
            p[i] = parameters[a + i]
            if {transfer}:
                p[rest + 6 + i] = parameters[curve + 6 + a + i]
        for i in range({m}):
            for k in range({constants}):
                p[{n} + 2 + k * {m} + i] = parameters[{axles} + 2 + k * {units} + j + i]
        for i in range(6):
            p[rest + i] = parameters[curve + i]
        k = {constant} + c * {constants_of_it}
        prepare_{b}(p, constants[k : k + {constants_of_it}])
"""
_GATHER = """
    x, u, f = on_stack({states}), on_stack({m}), on_stack({states})
    for c in range({cars}):
        a, j = {axle} + c * {n}, {unit} + c * {m}
        x[0] = state[0]
        for i in range({n}):
            x[1 + i] = state[1 + a + i]
        for i in range({m}):
            x[1 + {n} + i] = state[1 + {axles} + j + i]
            u[i] = torque[j + i]
        k = {constant} + c * {constants_of_it}
        own = constants[k : k + {constants_of_it}]
"""
_SCATTER = """
        slopes[0] += f[0]
        for i in range({n}):
            slopes[1 + a + i] = f[1 + i]
        for i in range({m}):
            slopes[1 + {axles} + j + i] = f[1 + {n} + i]
"""
_SLOPE = "        slope_{b}(x, u, own, f)" + _SCATTER
_RATE = (
    "        e = {nonzero} + c * {nonzeros}\n"
    "        rate_{b}(x, u, own, f, nonzeros[e : e + {nonzeros}])" + _SCATTER
)
_POINT = "state", "torque", "constants"
_FUNCTIONS = (
    ("prepare", ("parameters", "constants"), _PREPARE),
    ("slope", (*_POINT, "slopes"), _GATHER + _SLOPE),
    ("rate", (*_POINT, "slopes", "nonzeros"), _GATHER + _RATE),
)


def _blocks(group: tuple[UnitContext, ...]) -> list[_Block]:
    pairs = [(unit_model(car), bool(unloading(car).any())) for car in cars_of(group)]
    blocks: list[_Block] = []
    axle = unit = constant = nonzero = 0
    for _, alike in groupby(pairs, key=lambda pair: id(pair[0])):
        run = list(alike)
        (model, transfer), cars = run[0], len(run)
        cell = compiled_model(model)
        blocks.append(_Block(cell, model, cars, axle, unit, constant, nonzero, transfer))
        axle, unit = axle + cars * model.axles, unit + cars * model.units
        constant += cars * cell.constants
        nonzero += cars * cell.nonzeros.row.size
    return blocks


def _source(blocks: list[_Block], axles: int, units: int) -> str:
    text = ""
    for b, block in enumerate(blocks):
        names = ", ".join(f"{name} as {name}_{b}" for name, _, _ in _FUNCTIONS)
        text += f"from {block.cell.rate.__module__} import {names}\n"
    for name, arguments, template in _FUNCTIONS:
        body = "    slopes[0] = 0.0\n" if "slopes" in arguments else ""
        for b, block in enumerate(blocks):
            n, m = block.model.axles, block.model.units
            size = block.model.parameters.numel()
            body += template.format(
                b=b, n=n, m=m, size=size,
                states=block.model.states, cars=block.cars, axle=block.axle, unit=block.unit, axles=axles, units=units,
                constants=(size - n - 8 - n * block.transfer) // m, transfer=block.transfer,
                constant=block.constant, constants_of_it=block.cell.constants, nonzero=block.nonzero,
                nonzeros=block.cell.nonzeros.row.size,
            )  # fmt: skip
        text += function_source(name, [*arguments], body)
    return text


def _places(blocks: list[_Block], field: str, axles: int, units: int) -> Ints:
    """Rows or columns `field` of the cars' nonzeros as those of the whole; places may come twice, values add up."""
    found = []
    for block in blocks:
        n, m = block.model.axles, block.model.units
        local = getattr(block.cell.nonzeros, field)
        for c in range(block.cars):
            axle, unit = block.axle + c * n, block.unit + c * m
            torque = 1 + axles + unit + np.arange(m)
            whole = np.concatenate([[0], 1 + axle + np.arange(n), torque, units + torque])
            found.append(whole[local])
    return np.concatenate(found)


def compiled_group(units: Units) -> CompiledModel:
    """Compiled model of a unit or a group; that of one car is the expression's own, that of more is put together."""
    group = group_of(units)
    if len(cars_of(group)) == 1:
        return compiled_model(unit_model(units))
    blocks = _blocks(group)
    axles = sum(context.axles for context in group)
    made = compile_source(_source(blocks, axles, len(group)))
    places = [_places(blocks, field, axles, len(group)) for field in Nonzeros._fields]
    tangent = compile_tangent(places[0], places[1], axles + 1 + len(group), len(group))
    functions = made["prepare"], made["slope"], made["rate"], tangent
    constants = sum(block.cars * block.cell.constants for block in blocks)
    return CompiledModel(*functions, Nonzeros(*places), constants)
