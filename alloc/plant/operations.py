"""Elementary operations that the plant's equations are written in.

Each one works on NumPy arrays and floats, on CasADi expressions, and inside Numba code, so an equation
is stated once for all three. In Numba they are branch-free polynomials that agree with the C library to
a few units in the last place: calls into the C library would keep LLVM from vectorising the loop over
scenarios, and the wheels of Numba on PyPI come without Intel's vector mathematics library.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from alloc.compilation import INLINED, equation
from alloc.errors import PlantError


def _casadi(*operands: Any) -> Any:
    """Return the casadi module if an operand is one of its expressions, else None (and do not import it)."""
    if any(type(operand).__module__.startswith("casadi") for operand in operands):
        import casadi

        return casadi
    return None


def where(condition: Any, if_true: Any, if_false: Any) -> Any:
    """Elementwise choice; both alternatives are evaluated."""
    casadi = _casadi(condition, if_true, if_false)
    if casadi:
        return casadi.if_else(condition, if_true, if_false)
    return np.where(condition, if_true, if_false)


def minimum(a: Any, b: Any) -> Any:
    """Elementwise minimum."""
    casadi = _casadi(a, b)
    return casadi.fmin(a, b) if casadi else np.minimum(a, b)


def maximum(a: Any, b: Any) -> Any:
    """Elementwise maximum."""
    casadi = _casadi(a, b)
    return casadi.fmax(a, b) if casadi else np.maximum(a, b)


def absolute(x: Any) -> Any:
    """Elementwise absolute value."""
    casadi = _casadi(x)
    return casadi.fabs(x) if casadi else np.abs(x)


def sqrt(x: Any) -> Any:
    """Elementwise square root."""
    casadi = _casadi(x)
    return casadi.sqrt(x) if casadi else np.sqrt(x)


def exp(x: Any) -> Any:
    """Elementwise exponential."""
    casadi = _casadi(x)
    return casadi.exp(x) if casadi else np.exp(x)


def atan(x: Any) -> Any:
    """Elementwise inverse tangent."""
    casadi = _casadi(x)
    return casadi.atan(x) if casadi else np.arctan(x)


def sine(x: Any) -> Any:
    """Elementwise sine."""
    casadi = _casadi(x)
    return casadi.sin(x) if casadi else np.sin(x)


def interpolate(table: Any, share: Any) -> Any:
    """Linear interpolation in `table` (n,), whose first entry is no value, at `share` 0 to 1 of its length; no CasADi."""
    if _casadi(share):
        raise PlantError(
            "a curve that is known by its values has no formula for the MPC to believe in; name another"
        )
    x = np.minimum(share * (len(table) - 2), len(table) - 2 - 1e-9)
    k = np.floor(x).astype(int)
    return table[k + 1] + (x - k) * (table[k + 2] - table[k + 1])


# --- Numba ---------------------------------------------------------------------------------------


@overload(where, jit_options=INLINED)
def _where(condition, if_true, if_false):
    def select(condition, if_true, if_false):
        return if_true if condition else if_false

    return select


@overload(minimum, jit_options=INLINED)
def _minimum(a, b):
    def smaller(a, b):
        return a if a < b else b

    return smaller


@overload(maximum, jit_options=INLINED)
def _maximum(a, b):
    def larger(a, b):
        return a if a > b else b

    return larger


@overload(absolute, jit_options=INLINED)
def _absolute(x):
    def magnitude(x):
        return math.fabs(x)

    return magnitude


@overload(sqrt, jit_options=INLINED)
def _sqrt(x):
    def root(x):
        return math.sqrt(x)

    return root


def _write_exponent(typing_context, k):

    def generate(context, builder, signature, arguments):
        integer = ir.IntType(64)
        biased = builder.add(builder.fptosi(arguments[0], integer), ir.Constant(integer, 1023))
        return builder.bitcast(builder.shl(biased, ir.Constant(integer, 52)), ir.DoubleType())

    return types.float64(types.float64), generate


_power_of_two: Any = intrinsic(_write_exponent)
"""2**k for an integer-valued float k in [-1022, 1023], by writing the exponent's bits."""

# exp(r) on |r| <= ln(2)/2: Taylor terms up to r**13/13!, remainder below 5e-18.
_EXP = tuple(1.0 / math.factorial(k) for k in range(14))
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # Cody and Waite
_LOG2_E = 1.4426950408889634


@equation
def _exp_polynomial(x):
    # Beyond these bounds the result is 0 or inf to double precision for the plant's purposes.
    # (Written so that a nan passes through.)
    bounded = -700.0 if x < -700.0 else x
    bounded = 700.0 if bounded > 700.0 else bounded
    k = np.floor(bounded * _LOG2_E + 0.5)
    r = (bounded - k * _LN2_HIGH) - k * _LN2_LOW
    p = _EXP[13]
    p = p * r + _EXP[12]
    p = p * r + _EXP[11]
    p = p * r + _EXP[10]
    p = p * r + _EXP[9]
    p = p * r + _EXP[8]
    p = p * r + _EXP[7]
    p = p * r + _EXP[6]
    p = p * r + _EXP[5]
    p = p * r + _EXP[4]
    p = p * r + _EXP[3]
    p = p * r + _EXP[2]
    p = p * r + 1.0
    p = p * r + 1.0
    return p * _power_of_two(k)


@overload(exp, jit_options=INLINED)
def _exp(x):
    def exponential(x):
        return _exp_polynomial(x + 0.0)

    return exponential


# atan on [0, tan(pi/8)] after two reductions; odd rational minimax of the Cephes library.
_ATAN_P = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
_ATAN_Q = (
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)
_TAN_3PI_8 = 2.41421356237309504880


@equation
def _atan_polynomial(x):
    a = math.fabs(x)
    large, middle = a > _TAN_3PI_8, a > 0.66
    # one division serves all three ranges: -1/a, (a - 1)/(a + 1), a
    numerator = -1.0 if large else (a - 1.0 if middle else a)
    denominator = a if large else (a + 1.0 if middle else 1.0)
    offset = 0.5 * math.pi if large else (0.25 * math.pi if middle else 0.0)
    t = numerator / denominator
    z = t * t
    p = (((_ATAN_P[0] * z + _ATAN_P[1]) * z + _ATAN_P[2]) * z + _ATAN_P[3]) * z + _ATAN_P[4]
    q = ((((z + _ATAN_Q[0]) * z + _ATAN_Q[1]) * z + _ATAN_Q[2]) * z + _ATAN_Q[3]) * z + _ATAN_Q[4]
    y = offset + (t + t * z * p / q)
    return y if x >= 0.0 else -y


@overload(atan, jit_options=INLINED)
def _atan(x):
    def inverse_tangent(x):
        return _atan_polynomial(x + 0.0)

    return inverse_tangent


_PI_HIGH, _PI_LOW = 3.14159265160560607910, 1.98418714791870343106e-09


@equation
def _sine_polynomial(x):
    k = np.floor(x * (1.0 / math.pi) + 0.5)
    r = (x - k * _PI_HIGH) - k * _PI_LOW
    z = r * r
    # Taylor terms up to r**21/21!: remainder below 2e-18 at |r| = pi/2
    p = 1.0 / 51090942171709440000.0
    p = p * z - 1.0 / 121645100408832000.0
    p = p * z + 1.0 / 355687428096000.0
    p = p * z - 1.0 / 1307674368000.0
    p = p * z + 1.0 / 6227020800.0
    p = p * z - 1.0 / 39916800.0
    p = p * z + 1.0 / 362880.0
    p = p * z - 1.0 / 5040.0
    p = p * z + 1.0 / 120.0
    p = p * z - 1.0 / 6.0
    p = r + r * z * p
    odd = k - 2.0 * np.floor(0.5 * k)
    return p * (1.0 - 2.0 * odd)


@overload(sine, jit_options=INLINED)
def _sine(x):
    def polynomial_sine(x):
        return _sine_polynomial(x + 0.0)

    return polynomial_sine


@overload(interpolate, jit_options=INLINED)
def _interpolate(table, share):
    def look_up(table, share):
        x = min(share * (table.size - 2), table.size - 2 - 1e-9)
        k = int(x)
        return table[k + 1] + (x - k) * (table[k + 2] - table[k + 1])

    return look_up
