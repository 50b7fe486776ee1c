"""Creep stiffness of the contact of wheel and rail from wheel load and radius.

Polach's law describes the contact by one number, G pi a b C11 / (4 Q), with the half axes a along and b across the rail.
Here a b is that of a cylinder on a rail head of constant width, as in Open Rails (`Axle.cs`, `PolachCalculator`). It grows
as sqrt(Q R), so stiffness falls as Q^-1/2. Between bodies that are curved both ways (Hertz) a b grows as Q^2/3, and
stiffness would fall as Q^-1/3. But the contact width of worn profiles does not grow in that way with the load.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

SHEAR_MODULUS = 8.4e10
"""Of steel [Pa], as in Polach's and Open Rails' sets."""

YOUNGS_MODULUS = 2.07e11
"""Of steel [Pa]."""

HALF_WIDTH = 6e-3
"""Half of the contact's width across the rail [m]: Open Rails' constant."""

CYLINDER = 1.52
"""Half length of a cylinder's contact over sqrt(load x radius / (length x modulus)): Hertz, Poisson's ratio 0.3."""

REFERENCE_LOAD, REFERENCE_RADIUS = 1e5, 0.5
"""Wheel load [N] and wheel radius [m] of the contact that a curve describes where no axle is named."""

HALF_AXES_RATIO = 1.137
"""a / b of the reference contact, by the same cylinder."""

RATIOS = (0.1, 2.0)
"""Ratios of the half axes for which `longitudinal_coefficient` is a fit of Kalker's table, to 9 % at its ends."""


def longitudinal_coefficient(half_axes_ratio: float) -> float:
    """Kalker's C11 over a / b: Open Rails' quadratic fit of his table."""
    return 0.32955 * half_axes_ratio**2 + 0.48538 * half_axes_ratio + 3.4992


def creep_stiffness(half_axes_ratio: float = HALF_AXES_RATIO) -> float:
    """G pi a b C11 / (4 Q) of the reference contact; 121 with the default ratio."""
    length = CYLINDER * math.sqrt(
        REFERENCE_LOAD * REFERENCE_RADIUS / (2.0 * HALF_WIDTH * YOUNGS_MODULUS)
    )
    area = math.pi * length * HALF_WIDTH
    return SHEAR_MODULUS * area * longitudinal_coefficient(half_axes_ratio) / (4.0 * REFERENCE_LOAD)


def relative_stiffness(load: ArrayLike, radius: ArrayLike) -> NDArray[np.float64]:
    """Creep stiffness under a wheel load `load` [N] of wheels of `radius` [m], over that of the reference contact."""
    load, radius = np.asarray(load, dtype=float), np.asarray(radius, dtype=float)
    return np.sqrt(REFERENCE_LOAD / load * (radius / REFERENCE_RADIUS))
