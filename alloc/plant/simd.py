"""Eight axles at once: a compiled value that holds `WIDTH` numbers, and how it comes from arrays and goes to them.

The plant's laws are elementwise, so they take such a value as they take a float or a NumPy array. LLVM maps it to the
registers of the processor: one with AVX-512, two with AVX2, four with less. Arrays that are taken in blocks end on a whole
block. Compiled code only.
"""

import operator
from collections.abc import Callable
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

WIDTH = 8
"""Numbers in a `Vector`: a cache line of doubles."""


def padded(size: int) -> int:
    """The smallest number of whole blocks, at least one, that has room for `size` numbers; in numbers."""
    return max(1, -(-size // WIDTH)) * WIDTH


class Vector(types.Type):
    """Numba's type of `WIDTH` floats; a single float in its place counts for all."""

    def can_convert_from(self, typingctx: Any, other: types.Type) -> Conversion | None:
        """Numbers become vectors where they meet one."""
        return Conversion.safe if isinstance(other, (types.Float, types.Integer)) else None


class Mask(types.Type):
    """Numba's type of `WIDTH` truth values: what comparing vectors gives."""


VECTOR, MASK = Vector("vector"), Mask("mask")
_INDEX = ir.IntType(64)
_WORDS = ir.VectorType(_INDEX, WIDTH)
_FLOATS = ir.VectorType(ir.DoubleType(), WIDTH)


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, _FLOATS)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), WIDTH))


def constant(value: Any, number: float) -> ir.Constant:
    """`number` of the type of the operand `value`: as it is, or `WIDTH` times."""
    several = isinstance(value.type, ir.VectorType)
    return ir.Constant(value.type, [number] * WIDTH if several else number)


def _repeat(builder: Any, kind: ir.VectorType, value: Any) -> Any:
    """A vector of `value`, `WIDTH` times."""
    empty = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    picked = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, empty, picked)


@lower_cast(types.Float, Vector)
@lower_cast(types.Integer, Vector)
def _spread(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return _repeat(builder, _FLOATS, context.cast(builder, value, source, types.float64))


def elementwise(
    function: Any, emit: Callable[..., Any], operands: int, gives_mask: bool = False
) -> None:
    """Let compiled code call `function` with vectors, or with numbers as long as it is no operator of Python.

    `emit` makes its instructions of LLVM's builder and the operands, all vectors or all numbers. It is compiled where it is
    called; a function of Numba's own per type would take longer to compile than a law that calls it.
    """
    truth: Any = MASK if gives_mask else VECTOR

    class Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            if len(args) != operands or not all(isinstance(kind, _NUMBERS) for kind in args):
                return None
            if any(isinstance(kind, Vector) for kind in args):
                return signature(truth, *(VECTOR,) * operands)
            return signature(types.float64, *(types.float64,) * operands)

    infer_global(function, types.Function(Template))
    for kind in (VECTOR, types.float64) if isinstance(function, FunctionType) else (VECTOR,):
        lower_builtin(function, *(kind,) * operands)(
            lambda context, builder, sig, args: emit(builder, *args)
        )


_NUMBERS = (Vector, types.Float, types.Integer)


def of_llvm(name: str) -> Callable[..., Any]:
    """Emits one of LLVM's functions of one operand, such as ``sqrt``."""

    def emit(builder: Any, value: Any) -> Any:
        kind = "f64" if value.type == ir.DoubleType() else f"v{WIDTH}f64"
        signature_ = ir.FunctionType(value.type, [value.type])
        function = cgutils.get_or_insert_function(builder.module, signature_, f"llvm.{name}.{kind}")
        return builder.call(function, [value])

    return emit


def _compare(sign: str) -> Callable[..., Any]:
    return lambda builder, a, b: builder.fcmp_ordered(sign, a, b)


elementwise(operator.add, ir.IRBuilder.fadd, 2)
elementwise(operator.sub, ir.IRBuilder.fsub, 2)
elementwise(operator.mul, ir.IRBuilder.fmul, 2)
elementwise(operator.truediv, ir.IRBuilder.fdiv, 2)
elementwise(operator.neg, ir.IRBuilder.fneg, 1)
for _function, _sign in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
):  # fmt: skip
    elementwise(_function, _compare(_sign), 2, gives_mask=True)


def chosen(function: Any) -> None:
    """Let compiled code call `function` (condition, a, b) for `a` where the condition is true, else `b`."""

    class Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            condition, *values = args
            if isinstance(condition, Mask) or any(isinstance(kind, Vector) for kind in values):
                return signature(VECTOR, condition, VECTOR, VECTOR)
            return signature(types.float64, types.boolean, types.float64, types.float64)

    infer_global(function, types.Function(Template))
    for condition, kind in (
        (MASK, VECTOR), (types.boolean, VECTOR), (types.boolean, types.float64),
    ):  # fmt: skip
        lower_builtin(function, condition, kind, kind)(
            lambda context, builder, sig, args: builder.select(*args)
        )


def _intrinsic(function: Callable[..., Any]) -> Any:
    """Numba's decorator, for functions whose first argument callers do not give."""
    return intrinsic(function)


@_intrinsic
def spread(typingctx, number):
    """A number, `WIDTH` times."""
    return VECTOR(VECTOR), lambda context, builder, sig, args: args[0]


def _place(context: Any, builder: Any, kind: Any, array: Any, first: Any) -> Any:
    return builder.gep(context.make_array(kind)(context, builder, value=array).data, [first])


@_intrinsic
def is_nonzero(typingctx, values):
    """Whether any of the `WIDTH` numbers is not 0, or no number."""

    def generate(context, builder, sig, args):
        differs = builder.fcmp_unordered("!=", args[0], constant(args[0], 0.0))
        bits = builder.bitcast(differs, ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(VECTOR), generate


@_intrinsic
def load(typingctx, array, first):
    """`array` [first : first + WIDTH]."""

    def generate(context, builder, sig, args):
        place = _place(context, builder, sig.args[0], *args)
        return builder.load(builder.bitcast(place, _FLOATS.as_pointer()), align=8)

    return VECTOR(array, types.intp), generate


@_intrinsic
def store(typingctx, array, first, values):
    """`array` [first : first + WIDTH] = `values`."""

    def generate(context, builder, sig, args):
        place = _place(context, builder, sig.args[0], *args[:2])
        builder.store(args[2], builder.bitcast(place, _FLOATS.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, VECTOR), generate


def _pick(builder: Any, base: Any, index: Any) -> Any:
    """Numbers at `base` [`index`]; LLVM knows on which processors one instruction for it is worth while."""
    address = _repeat(builder, _WORDS, builder.ptrtoint(base, _INDEX))
    pointers = ir.VectorType(ir.DoubleType().as_pointer(), WIDTH)
    bytes_ = builder.shl(index, constant(index, 3))
    places = builder.inttoptr(builder.add(address, bytes_), pointers)
    masks = ir.VectorType(ir.IntType(1), WIDTH)
    kind = ir.FunctionType(_FLOATS, [pointers, ir.IntType(32), masks, _FLOATS])
    name = f"llvm.masked.gather.v{WIDTH}f64.v{WIDTH}p0"
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    empty = ir.Constant(_FLOATS, ir.Undefined)
    every = ir.Constant(masks, [1] * WIDTH)
    return builder.call(function, [places, ir.Constant(ir.IntType(32), 8), every, empty])


@_intrinsic
def gather(typingctx, array, index, first):
    """`array` [`index` [first : first + WIDTH]]."""

    def generate(context, builder, sig, args):
        base = context.make_array(sig.args[0])(context, builder, value=args[0]).data
        start = _place(context, builder, sig.args[1], *args[1:])
        return _pick(
            builder, base, builder.load(builder.bitcast(start, _WORDS.as_pointer()), align=8)
        )

    return VECTOR(array, index, types.intp), generate


@_intrinsic
def look_up(typingctx, table, x):
    """`table` at `x` >= 0, in units of its spacing, by linear interpolation."""

    def generate(context, builder, sig, args):
        base = context.make_array(sig.args[0])(context, builder, value=args[0]).data
        # what is no number must not become an index; the share below stays none
        nought = constant(args[1], 0.0)
        known = builder.fcmp_ordered(">=", args[1], nought)
        below = builder.fptosi(builder.select(known, args[1], nought), _WORDS)
        share = builder.fsub(args[1], builder.sitofp(below, _FLOATS))
        before = _pick(builder, base, below)
        after = _pick(builder, builder.gep(base, [ir.Constant(_INDEX, 1)]), below)
        return builder.fadd(before, builder.fmul(builder.fsub(after, before), share))

    return VECTOR(table, VECTOR), generate


@_intrinsic
def total(typingctx, values):
    """Sum of the `WIDTH` numbers, in pairs."""

    def generate(context, builder, sig, args):
        double = ir.DoubleType()
        kind = ir.FunctionType(double, [double, _FLOATS])
        function = cgutils.get_or_insert_function(
            builder.module, kind, f"llvm.vector.reduce.fadd.v{WIDTH}f64"
        )
        return builder.call(function, [ir.Constant(double, -0.0), args[0]], fastmath=("reassoc",))

    return types.float64(VECTOR), generate
