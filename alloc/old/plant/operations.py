"""Elementary operations that the plant's laws are written in, for numbers, arrays, symbols and vectors of eight.

In: floats, NumPy arrays, CasADi symbols, or compiled vectors (`WIDTH` numbers at once). Out: the same kind. A law that uses
these operations alone runs on all of them.
"""

import math
import operator
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typeconv import Conversion
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, lower_cast, models, overload, register_model

from alloc.old.compilation import INLINED, equation
from alloc.old.errors import PlantError
from alloc.old.plant import operations as simd

# Eight axles at once: a compiled value that holds `WIDTH` numbers, and how it comes from arrays and goes to them.
#
# The plant's laws are elementwise, so they take such a value as they take a float or a NumPy array. LLVM maps it to the
# registers of the processor: one with AVX-512, two with AVX2, four with less. Arrays that are taken in blocks end on a
# whole block. Compiled code only.


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
def looked_up(typingctx, table, x):
    """As `look_up`."""

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


# Elementary operations that the plant's equations are written in.
#
# Each one works on NumPy arrays and floats, on CasADi expressions, and inside Numba code on floats and on vectors of
# `alloc.old.plant.operations`, so an equation is stated once for all of them. In Numba they are branch-free polynomials that
# agree with the C library to a few units in the last place. That library has no vectors, and the wheels of Numba on
# PyPI come without Intel's vector mathematics library.


def _casadi(*operands: Any) -> Any:
    """Return the casadi module if an operand is one of its expressions, else None (and do not import it)."""
    if any(type(operand).__module__.startswith("casadi") for operand in operands):
        import casadi

        return casadi
    return None


def _operation(plain: Callable[..., Any], symbolic: str) -> Any:
    """An elementwise operation: `plain` for NumPy, `symbolic` for CasADi; what is compiled is registered apart."""

    def operation(*operands: Any) -> Any:
        casadi = _casadi(*operands)
        return getattr(casadi, symbolic)(*operands) if casadi else plain(*operands)

    return operation


def _emitted(plain: Callable[..., Any], symbolic: str, operands: int, emit: Any) -> Any:
    """An operation of which LLVM knows the instructions, see `simd.elementwise`."""
    operation = _operation(plain, symbolic)
    simd.elementwise(operation, emit, operands)
    return operation


def _lesser(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


def _greater(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", a, b), a, b)


where = _operation(np.where, "if_else")
"""`a` where `condition` is true, else `b`; both are evaluated."""
simd.chosen(where)
minimum = _emitted(np.minimum, "fmin", 2, _lesser)
maximum = _emitted(np.maximum, "fmax", 2, _greater)
absolute = _emitted(np.abs, "fabs", 1, simd.of_llvm("fabs"))
sqrt = _emitted(np.sqrt, "sqrt", 1, simd.of_llvm("sqrt"))
floor = _emitted(np.floor, "floor", 1, simd.of_llvm("floor"))


def _write_exponent(builder: Any, k: Any) -> Any:
    word: ir.Type = ir.IntType(64)
    if isinstance(k.type, ir.VectorType):
        word = ir.VectorType(word, simd.WIDTH)
    # 1.5 * 2**52 + k holds k in its last bits; a conversion to integers is no vector code before AVX-512
    bits = builder.bitcast(builder.fadd(k, simd.constant(k, 6755399441055744.0)), word)
    biased = builder.add(bits, simd.constant(bits, 1023))
    return builder.bitcast(builder.shl(biased, simd.constant(bits, 52)), k.type)


_power_of_two = _emitted(np.exp2, "exp2", 1, _write_exponent)
"""2**k for integer-valued k in [-1022, 1023], by writing the exponent's bits."""


def _polynomial(*coefficients: float) -> Any:
    """Horner's scheme with these coefficients, that of the highest power first."""

    def emit(builder: Any, x: Any) -> Any:
        value = simd.constant(x, coefficients[0])
        for coefficient in coefficients[1:]:
            value = builder.fadd(builder.fmul(value, x), simd.constant(x, coefficient))
        return value

    return _emitted(lambda x: np.polyval(coefficients, x), "", 1, emit)


def _written(plain: Callable[..., Any], symbolic: str, body: Callable[..., Any]) -> Any:
    """An operation of which `body` is compiled in its place."""
    operation = _operation(plain, symbolic)
    overload(operation, jit_options=INLINED, strict=False)(lambda x: body)
    return operation


# exp(r) on |r| <= ln(2)/2: Taylor terms up to r**13/13!, remainder below 5e-18.
_EXP = _polynomial(*(1.0 / math.factorial(k) for k in range(13, -1, -1)))
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # Cody and Waite
_LOG2_E = 1.4426950408889634


@equation
def _exp_polynomial(x):
    # Beyond these bounds the result is 0 or inf to double precision for the plant's purposes.
    # (In this order a nan passes through.)
    bounded = minimum(700.0, maximum(-700.0, x))
    k = floor(bounded * _LOG2_E + 0.5)
    r = (bounded - k * _LN2_HIGH) - k * _LN2_LOW
    return _EXP(r) * _power_of_two(k)


def _exp_of_vector(x):
    # most axles do not slip, and then the tails of their curves ask for exp(0)
    return _exp_polynomial(x) if simd.is_nonzero(x) else simd.spread(1.0)


exp = _operation(np.exp, "exp")


@overload(exp, jit_options=INLINED)
def _exp(x):
    return _exp_of_vector if isinstance(x, simd.Vector) else lambda x: _exp_polynomial(x + 0.0)


# (atan(t) / t - 1) / t**2 over t**2 on |t| <= tan(pi/8): met at Chebyshev's nodes, times t**2 within 7e-18 between. A ratio
# of polynomials of the same cost would need one more division.
_ATAN = _polynomial(
    -0.01917688711906226, 0.03923165829558719, -0.0508544973794026, 0.0585814891280221,
    -0.06664511447381948, 0.07692183190826087, -0.09090904578123903, 0.11111111015256361,
    -0.14285714284666542, 0.1999999999999552, -0.3333333333333333,
)  # fmt: skip
_TAN_PI_8, _TAN_3PI_8 = 0.41421356237309504880, 2.41421356237309504880


def _atan_polynomial(x):
    a = absolute(x)
    large, middle = a > _TAN_3PI_8, a > _TAN_PI_8
    # one division serves all three ranges: -1/a, (a - 1)/(a + 1), a
    numerator = where(large, -1.0, where(middle, a - 1.0, a))
    denominator = where(large, a, where(middle, a + 1.0, 1.0))
    offset = where(large, 0.5 * math.pi, where(middle, 0.25 * math.pi, 0.0 * a))
    t = numerator / denominator
    z = t * t
    y = offset + (t + t * z * _ATAN(z))
    return where(x >= 0.0, y, -y)


# Taylor terms from r**3/3! up to r**21/21!, over r**3: remainder below 2e-18 at |r| = pi/2
_SINE = _polynomial(*((-1.0) ** k / math.factorial(2 * k + 1) for k in range(10, 0, -1)))
_PI_HIGH, _PI_LOW = 3.14159265160560607910, 1.98418714791870343106e-09


def _sine_polynomial(x):
    k = floor(x * (1.0 / math.pi) + 0.5)
    r = (x - k * _PI_HIGH) - k * _PI_LOW
    z = r * r
    odd = k - 2.0 * floor(0.5 * k)
    return (r + r * z * _SINE(z)) * (1.0 - 2.0 * odd)


atan = _written(np.arctan, "atan", _atan_polynomial)
sine = _written(np.sin, "sin", _sine_polynomial)


def look_up(table: Any, x: Any) -> Any:
    """`table` (points,) at `x` >= 0 in units of its spacing, before the last point, by linear interpolation; no CasADi.

    Where `x` is no number, nor is the result.
    """
    k = np.where(x >= 0.0, x, 0.0).astype(int)
    return table[k] + (table[k + 1] - table[k]) * (x - k)


@overload(look_up, jit_options=INLINED)
def _look_up(table, x):
    def of_number(table, x):
        k = int(x if x >= 0.0 else 0.0)
        return table[k] + (table[k + 1] - table[k]) * (x - k)

    def of_vector(table, x):
        return simd.looked_up(table, x)

    return of_vector if isinstance(x, simd.Vector) else of_number


def interpolate(table: Any, share: Any) -> Any:
    """Linear interpolation in `table` (n,), whose first entry is no value, at `share` 0 to 1 of its length; no CasADi."""
    if _casadi(share):
        raise PlantError(
            "a curve that is known by its values has no formula for the MPC to believe in; name another"
        )
    x = np.minimum(share * (len(table) - 2), len(table) - 2 - 1e-9)
    k = np.floor(x).astype(int)
    return table[k + 1] + (x - k) * (table[k + 2] - table[k + 1])


@overload(interpolate, jit_options=INLINED)
def _interpolate(table, share):
    def look_up(table, share):
        x = min(share * (table.size - 2), table.size - 2 - 1e-9)
        k = int(x)
        return table[k + 1] + (x - k) * (table[k + 2] - table[k + 1])

    def look_up_all(table, share):
        x = minimum(share * (table.size - 2), table.size - 2 - 1e-9)
        return simd.looked_up(table, 1.0 + x)

    return look_up_all if isinstance(share, simd.Vector) else look_up
