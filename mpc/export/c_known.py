"""Functions that compiled code calls and that have no Python source to translate: what they are in C."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from alloc.plant import operations, simd
from mpc.arrays import prepare_at, rate_at, slope_at, tangent_at
from mpc.export.c_kinds import DOUBLE, INTEGER, TRUTH, Number

SQUARE, MODULO, WHOLE_MODULO, WHOLE_QUOTIENT = "square", "modulo", "whole_modulo", "whole_quotient"

OF_C: dict[Any, tuple[str, Number]] = {
    math.sqrt: ("sqrt", DOUBLE), np.sqrt: ("sqrt", DOUBLE), operations.sqrt: ("sqrt", DOUBLE),
    math.exp: ("exp", DOUBLE), np.exp: ("exp", DOUBLE), operations.exp: ("exp", DOUBLE),
    math.log: ("log", DOUBLE), np.log: ("log", DOUBLE),
    math.sin: ("sin", DOUBLE), np.sin: ("sin", DOUBLE), operations.sine: ("sin", DOUBLE),
    math.cos: ("cos", DOUBLE), np.cos: ("cos", DOUBLE),
    operations.atan: ("atan", DOUBLE), math.atan: ("atan", DOUBLE),
    abs: ("fabs", DOUBLE), np.abs: ("fabs", DOUBLE), operations.absolute: ("fabs", DOUBLE),
    np.ceil: ("ceil", DOUBLE), math.ceil: ("(int64_t)ceil", INTEGER),
    np.floor: ("floor", DOUBLE), operations.floor: ("floor", DOUBLE),
    math.isnan: ("isnan", TRUTH), np.isnan: ("isnan", TRUTH),
    math.isfinite: ("isfinite", TRUTH), np.isfinite: ("isfinite", TRUTH),
}  # fmt: skip
"""Functions of one number, by the Python function that the source calls: the one of `math.h`, and the kind of its result."""

FOLDED: dict[Any, Callable[[str, str], str]] = {
    # Python's: the first stands where neither is less, and where the second is no number
    min: lambda a, b: f"lesser({a}, {b})",
    max: lambda a, b: f"greater({a}, {b})",
    operations.minimum: lambda a, b: f"minimum({a}, {b})",
    operations.maximum: lambda a, b: f"maximum({a}, {b})",
}
"""Functions of several numbers, two by two."""

AS_THEY_ARE = (prepare_at, slope_at, rate_at, tangent_at)
"""What makes a function of an address; here the address is the function."""

LOAD, STORE, SPREAD, TOTAL = simd.load, simd.store, simd.spread, simd.total
WHERE = operations.where
CASTS: dict[Any, Number] = {int: INTEGER, float: DOUBLE, bool: TRUTH}

HELPERS = {
    "lesser": "double lesser(double a, double b)\n{\n  return b < a ? b : a;\n}",
    "greater": "double greater(double a, double b)\n{\n  return b > a ? b : a;\n}",
    "minimum": "double minimum(double a, double b)\n{\n  return a < b ? a : b;\n}",
    "maximum": "double maximum(double a, double b)\n{\n  return a > b ? a : b;\n}",
    "lesser_whole": "int64_t lesser_whole(int64_t a, int64_t b)\n{\n  return b < a ? b : a;\n}",
    "greater_whole": "int64_t greater_whole(int64_t a, int64_t b)\n{\n  return b > a ? b : a;\n}",
    SQUARE: "double square(double x)\n{\n  return x * x;\n}",
    MODULO: (
        "double modulo(double a, double b)\n{\n  const double rest = fmod(a, b);\n"
        "  return rest != 0.0 && (rest < 0.0) != (b < 0.0) ? rest + b : rest;\n}"
    ),
    WHOLE_MODULO: (
        "int64_t whole_modulo(int64_t a, int64_t b)\n{\n  const int64_t rest = a % b;\n"
        "  return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;\n}"
    ),
    WHOLE_QUOTIENT: (
        "int64_t whole_quotient(int64_t a, int64_t b)\n{\n"
        "  return a / b - (a % b != 0 && (a < 0) != (b < 0));\n}"
    ),
    "total": (
        "double total(const double *x)\n{\n"
        "  return ((x[0] + x[4]) + (x[2] + x[6])) + ((x[1] + x[5]) + (x[3] + x[7]));\n}"
    ),
}  # fmt: skip
"""C functions that are written where they are used; as Python's, where C has others."""
