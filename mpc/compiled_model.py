"""A unit's model and its derivatives as Numba functions, with the places of their nonzeros."""

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as cs
import numpy as np

from alloc.plant.structure import Floats
from mpc.folding import folded
from mpc.generated import compile_functions
from mpc.shooting import Nonzeros
from mpc.tangent import compile_tangent
from mpc.unit_model import UnitModel


class CompiledModel(NamedTuple):
    """Functions of the model as the sweeps of `mpc.shooting` call them; torques come last in a point."""

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
