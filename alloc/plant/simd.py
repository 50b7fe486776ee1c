"""Eight axles at once: a compiled value that holds `WIDTH` numbers, and how it comes from arrays and goes to them.

The plant's laws are elementwise, so they take such a value as they take a float or a NumPy array; LLVM makes of it what
the processor has: one register with AVX-512, two with AVX2, four with less. Arrays that are taken in blocks end on
a whole block. Compiled code only.
"""

import operator
from collections.abc import Callable
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
    """The least number of whole blocks, at least one, that holds `size` numbers; in numbers."""
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


def _constant(kind: ir.VectorType, value: int) -> ir.Constant:
    return ir.Constant(kind, [value] * WIDTH)


def _repeat(builder: Any, kind: ir.VectorType, value: Any) -> Any:
    """A vector of `value`, `WIDTH` times."""
    empty = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, empty, _constant(ir.VectorType(ir.IntType(32), WIDTH), 0))


@lower_cast(types.Float, Vector)
@lower_cast(types.Integer, Vector)
def _spread(context: Any, builder: Any, source: Any, target: Any, value: Any) -> Any:
    return _repeat(builder, _FLOATS, context.cast(builder, value, source, types.float64))


def _operator(function: Any, result: types.Type, operands: int, instruction: Any) -> None:
    """Teach Numba an operator of Python on vectors; `instruction` emits it."""

    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            some = len(args) == operands and any(isinstance(kind, Vector) for kind in args)
            return signature(result, *(VECTOR,) * operands) if some else None

    infer_global(function)(Template)
    lower_builtin(function, *(VECTOR,) * operands)(
        lambda context, builder, sig, args: instruction(builder, *args)
    )


def _compare(sign: str) -> Callable[..., Any]:
    return lambda builder, a, b: builder.fcmp_ordered(sign, a, b)


_operator(operator.add, VECTOR, 2, ir.IRBuilder.fadd)
_operator(operator.sub, VECTOR, 2, ir.IRBuilder.fsub)
_operator(operator.mul, VECTOR, 2, ir.IRBuilder.fmul)
_operator(operator.truediv, VECTOR, 2, ir.IRBuilder.fdiv)
_operator(operator.neg, VECTOR, 1, ir.IRBuilder.fneg)
for _function, _sign in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="),
):  # fmt: skip
    _operator(_function, MASK, 2, _compare(_sign))


def elementwise(emit: Callable[..., Any], *operands: types.Type) -> Any:
    """A compiled function of vectors; `emit` is called with LLVM's builder and the operands."""

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *args)

    kinds = operands or (VECTOR,)
    given = VECTOR(*kinds), generate
    if len(kinds) == 1:
        return intrinsic(lambda typingctx, a: given)
    if len(kinds) == 2:
        return intrinsic(lambda typingctx, a, b: given)
    return intrinsic(lambda typingctx, a, b, c: given)


def of_llvm(name: str) -> Any:
    """One of LLVM's functions of one vector, such as ``sqrt``."""

    def emit(builder: Any, value: Any) -> Any:
        kind = ir.FunctionType(_FLOATS, [_FLOATS])
        function = f"llvm.{name}.v{WIDTH}f64"
        return builder.call(cgutils.get_or_insert_function(builder.module, kind, function), [value])

    return elementwise(emit)


def _write_exponent(builder: Any, k: Any) -> Any:
    # 1.5 * 2**52 + k holds k in its last bits; a conversion to integers is no vector code before AVX-512
    shifted = builder.fadd(k, ir.Constant(_FLOATS, [6755399441055744.0] * WIDTH))
    biased = builder.add(builder.bitcast(shifted, _WORDS), _constant(_WORDS, 1023))
    return builder.bitcast(builder.shl(biased, _constant(_WORDS, 52)), _FLOATS)


fabs, sqrt, floor = of_llvm("fabs"), of_llvm("sqrt"), of_llvm("floor")
select = elementwise(
    lambda builder, condition, a, b: builder.select(condition, a, b), MASK, VECTOR, VECTOR
)
lesser = elementwise(
    lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b), VECTOR, VECTOR
)
greater = elementwise(
    lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b), VECTOR, VECTOR
)
power_of_two = elementwise(_write_exponent)
"""2**k for integer-valued k in [-1022, 1023], by writing the exponent's bits."""
spread = elementwise(lambda builder, value: value)
"""A number, `WIDTH` times."""


def _place(context: Any, builder: Any, kind: Any, array: Any, first: Any) -> Any:
    return builder.gep(context.make_array(kind)(context, builder, value=array).data, [first])


@intrinsic
def is_nonzero(typingctx, values):
    """Whether any of the `WIDTH` numbers is not 0, or no number."""

    def generate(context, builder, sig, args):
        differs = builder.fcmp_unordered("!=", args[0], ir.Constant(_FLOATS, [0.0] * WIDTH))
        bits = builder.bitcast(differs, ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(VECTOR), generate


@intrinsic
def load(typingctx, array, first):
    """`array` [first : first + WIDTH]."""

    def generate(context, builder, sig, args):
        place = _place(context, builder, sig.args[0], *args)
        return builder.load(builder.bitcast(place, _FLOATS.as_pointer()), align=8)

    return VECTOR(array, types.intp), generate


@intrinsic
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
    bytes_ = builder.shl(index, _constant(_WORDS, 3))
    places = builder.inttoptr(builder.add(address, bytes_), pointers)
    masks = ir.VectorType(ir.IntType(1), WIDTH)
    kind = ir.FunctionType(_FLOATS, [pointers, ir.IntType(32), masks, _FLOATS])
    name = f"llvm.masked.gather.v{WIDTH}f64.v{WIDTH}p0"
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    empty = ir.Constant(_FLOATS, ir.Undefined)
    return builder.call(
        function, [places, ir.Constant(ir.IntType(32), 8), _constant(masks, 1), empty]
    )


@intrinsic
def gather(typingctx, array, index, first):
    """`array` [`index` [first : first + WIDTH]]."""

    def generate(context, builder, sig, args):
        base = context.make_array(sig.args[0])(context, builder, value=args[0]).data
        start = _place(context, builder, sig.args[1], *args[1:])
        return _pick(
            builder, base, builder.load(builder.bitcast(start, _WORDS.as_pointer()), align=8)
        )

    return VECTOR(array, index, types.intp), generate


@intrinsic
def look_up(typingctx, table, x):
    """`table` at `x` >= 0, in units of its spacing, by linear interpolation."""

    def generate(context, builder, sig, args):
        base = context.make_array(sig.args[0])(context, builder, value=args[0]).data
        below = builder.fptosi(args[1], _WORDS)
        share = builder.fsub(args[1], builder.sitofp(below, _FLOATS))
        before = _pick(builder, base, below)
        after = _pick(builder, builder.gep(base, [ir.Constant(_INDEX, 1)]), below)
        return builder.fadd(before, builder.fmul(builder.fsub(after, before), share))

    return VECTOR(table, VECTOR), generate


@intrinsic
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
