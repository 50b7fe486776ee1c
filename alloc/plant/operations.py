"""Elementary operations that the plant's equations are written in.

Each one works on NumPy arrays and floats, on CasADi expressions, and inside Numba code on floats and on vectors of
`alloc.plant.simd`, so an equation is stated once for all of them. In Numba they are branch-free polynomials that agree with
the C library to a few units in the last place. That library has no vectors, and the wheels of Numba on PyPI come without
Intel's vector mathematics library.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.extending import overload

from alloc.compilation import INLINED, equation
from alloc.errors import PlantError
from alloc.plant import simd


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
        return simd.look_up(table, 1.0 + x)

    return look_up_all if isinstance(share, simd.Vector) else look_up
