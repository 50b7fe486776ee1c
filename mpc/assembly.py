"""The compiled model of several cars, assembled from that of a car.

Cars on one rigid body are coupled by the speed alone: its rate is the sum of the contributions of each car's forces, and
everything else belongs to one car. Compiling the expression of a whole train takes minutes, that of a car seconds. So the
functions of a train are loops over its cars, written beside Numba's cache like those of the car.
"""

from itertools import groupby
from typing import NamedTuple

import numpy as np

from alloc.onboard.host import UnitContext
from alloc.plant.structure import Ints
from mpc.compiled_model import CompiledModel, compiled_model
from mpc.generated import compile_source, function_source
from mpc.shooting import Nonzeros
from mpc.tangent import compile_tangent
from mpc.unit_model import UnitModel, Units, cars_of, group_of, unit_model, unloading


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
