"""How the compiled functions of the MPC are declared: their arrays, the model that is handed to them, and their options.

Records of arrays come by reference (`alloc.old.records`), the model's functions by their address (`alloc.old.records`).
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from llvmlite import ir
from numba import float64, types, void
from numba.core import cgutils
from numba.extending import intrinsic

from alloc.old.compilation import FASTMATH, compiled
from alloc.old.records import stored_at

VECTOR, MATRIX = float64[::1], float64[:, ::1]
PREPARE = types.FunctionType(void(VECTOR, VECTOR))
"""What follows from a model's parameters alone: (parameters, constants)."""
SLOPE = types.FunctionType(void(VECTOR, VECTOR, VECTOR, VECTOR))
"""Model: (state, torque of each unit, constants, slope)."""
RATE = types.FunctionType(void(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR))
"""Model with derivatives: (state, torque, constants, slope, nonzeros of the Jacobian)."""
TANGENT = types.FunctionType(void(MATRIX, float64, MATRIX, MATRIX))
"""Sensitivities of a Runge-Kutta step, see `mpc.old.generated`."""


def sweep(signature: Any) -> Callable[[Any], Any]:
    """Decorator of a compiled function with one signature; Numba refuses what would allocate (`_nrt`)."""
    return partial(
        compiled,
        signature=signature,
        error_model="numpy",
        fastmath=FASTMATH,
        nogil=True,
        _nrt=False,
    )


def inlined(function: Any) -> Any:
    """Decorator of a part of a control period, which is inlined where it is called.

    A part that is called, and compiled when its caller is, would be one symbol with two versions: its own, and the copy that
    was optimised together with the caller. The version that runs, and so the rounding, would depend on whether this process
    compiled or loaded them.
    """
    return compiled(
        function, error_model="numpy", fastmath=FASTMATH, nogil=True, _nrt=False, forceinline=True
    )


prepare_at, slope_at, rate_at = stored_at(PREPARE), stored_at(SLOPE), stored_at(RATE)
tangent_at = stored_at(TANGENT)


@intrinsic(prefer_literal=True)
def on_stack(typingctx, size):
    """A vector of `size`, a constant, that lasts until the function returns."""
    if not isinstance(size, types.IntegerLiteral):
        return None

    def generate(context, builder, signature, args):
        kind = ir.ArrayType(ir.DoubleType(), size.literal_value)
        place = cgutils.alloca_once(builder, kind)
        array = context.make_array(VECTOR)(context, builder)
        context.populate_array(
            array,
            data=builder.bitcast(place, ir.DoubleType().as_pointer()),
            shape=[ir.Constant(ir.IntType(64), size.literal_value)],
            strides=[ir.Constant(ir.IntType(64), 8)],
            itemsize=ir.Constant(ir.IntType(64), 8),
            meminfo=None,
        )
        return array._getvalue()

    return VECTOR(size), generate
