"""Elementary operations in which laws are stated; these are NumPy's, `alloc.backends` has the others."""

from numpy import abs as absolute
from numpy import arctan as atan
from numpy import copysign, exp, floor, maximum, minimum, sqrt, where
from numpy import sin as sine

__all__ = [
    "absolute", "atan", "copysign", "exp", "floor", "maximum", "minimum", "sine", "sqrt", "where",
]  # fmt: skip
