"""Compiled functions and records that are handed to compiled code as numbers: their addresses.

So code that is compiled first can call what is made later, without knowing of which package it comes. Numba's own way to
hand over a function asks Python for its address at every call, which takes as long as a simulation over the MPC's horizon.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from alloc.by_reference import Record


def address_of(function: Any, kind: types.FunctionType) -> int:
    """Address of a compiled function, which must be kept while the address is in use."""
    made = function.get_compile_result(kind.signature)
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


def function_at(kind: types.FunctionType) -> Any:
    """Compiled function that takes an address (int64) and returns the function of `kind` stored there."""

    def at(typingctx, address):
        def generate(context, builder, signature, args):
            made = cgutils.create_struct_proxy(kind)(context, builder)
            pointer = builder.inttoptr(args[0], ir.IntType(8).as_pointer())
            made.c_addr = made.py_addr = ir.Constant(pointer.type, None)
            made.jit_addr = pointer
            return made._getvalue()

        return kind(types.int64), generate

    return intrinsic(at)


def record_at(kind: Record) -> Any:
    """Compiled function of an address (int64) that returns the record of `kind` there, see `alloc.by_reference`."""

    def at(typingctx, address):
        def generate(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_data_type(kind))

        return kind(types.int64), generate

    return intrinsic(at)
